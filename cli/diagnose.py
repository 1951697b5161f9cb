"""``sysid diagnose``: where model and log disagree, what is missing, and the proof once added."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sysid.errors import DataError, ModelError, UsageError
from sysid.workspace.logs import as_fitted, judged_on
from sysid.workspace.store import StoredModel, Workspace

from . import packages, reading, render, targets
from .diagnose_files import keep_models, write_results
from .diagnose_report import show

if TYPE_CHECKING:
    from sysid.data.finding import Finding
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.discrepancy.diagnosis import Diagnosis
    from sysid.plant.package import Package
    from sysid.vehicle.kinematics import Geometry

_JUDGING = "Judging"
_MISSION = "On a log with a pose"


@reading.composed(steps=reading.preparation, read=reading.read_options)
def diagnose(
    logs: reading.Logs,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="ID",
            help="Model to doubt [the workspace's best for these channels, else the plainest].",
        ),
    ] = None,
    val: Annotated[
        list[Path] | None,
        typer.Option(
            "--val",
            metavar="LOG",
            rich_help_panel=_JUDGING,
            help="Log to prove it on; the logs are split unless given. Again for more.",
        ),
    ] = None,
    mission: Annotated[
        Path | None,
        typer.Option(
            "--mission",
            metavar="M.yaml",
            rich_help_panel=_MISSION,
            help="Mission that the log was driven on; also names effects of the vehicle.",
        ),
    ] = None,
    plant: Annotated[
        Path | None,
        typer.Option(
            "--plant",
            metavar="PATH",
            rich_help_panel=_MISSION,
            help="Plant package the mission was planned with: the model to doubt.",
        ),
    ] = None,
    geometry: Annotated[
        str | None,
        typer.Option(
            "--geometry",
            metavar="r=M,B=M",
            rich_help_panel=_MISSION,
            help="Wheel or sprocket radius and distance of the tracks or wheels in metres, "
            "r=0.30,B=1.08 [the mission's, else the bundled robot's; estimated where the pose "
            "contradicts that].",
        ),
    ] = None,
    accept_changes: packages.AcceptChanges = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="DIR", help="Where to write [WORKSPACE/diagnosis]."),
    ] = None,
    *,
    steps: "Preparation",
    read: "ReadOptions",
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
    json: reading.Json = False,
) -> None:
    """Find where a model and a log disagree, name the missing effect, add it, prove the gap shrank.

    Both models stay in the workspace; diagnosis.json, a page (index.html) and schedules of the
    experiments that would tell more (next_*.csv) are written to a folder.
    """
    from sysid.data.finding import notes, warned

    place = Workspace(workspace)
    if output is not None:
        targets.check(output, "-o")
    folder = _folder(output or place.diagnosis_dir, logs, val or [])
    _mission_files(mission, plant)
    if plant is not None and model is not None:
        raise UsageError("--model and --plant both name the model to doubt; give one of them")
    lengths = _lengths(geometry, mission)
    given = place.load(model) if model is not None else None
    read, steps = as_fitted(given, read, steps)
    if read.resample == "auto":  # an empty reading is one of the things to be found: a dropout
        read = replace(read, resample="hold")
    package = packages.read(plant, accept_changes) if plant is not None else None
    estimation, said = _records(logs, read, steps)
    base = given or (place.best_for(estimation[0]) if plant is None else None)
    doubted = base.model if base else package.model() if package else None
    slow = read.held == "auto" and any(f.code == "held-telemetry" for f in said)
    if slow and not (doubted and doubted.fits_clock(estimation[0])):
        # no model at the sensor's rate: repeats are masked, and commands keep their instants
        read = replace(read, held="keep")
        estimation, said = _records(logs, read, steps)
    held, more = _records(val, read, steps) if val else (None, [])
    _apart(estimation, held)
    found = _run(estimation, held, base, (mission, lengths), package)
    read_as = (*said, *more)
    found = replace(found, reading=notes(read_as), warnings=(*warned(read_as), *found.warnings))
    origin = {"files": [str(p.resolve()) for p in logs], "read": read.to_json()}
    before, after = keep_models(
        place,
        found,
        base,
        origin | {"prepare": steps.to_json()},
        judged_on(held or (), val or ()),
    )
    document = write_results(folder, found, before, after)
    if json:
        render.document(document)
        return
    show(found, before, after, folder, val or ())


def _folder(folder: Path, logs: list[Path], val: list[Path]) -> Path:
    """Where the results go, refused early where that cannot be."""
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; name a folder with -o")
    for log in (*logs, *val):
        ours = log.name in ("diagnosis.json", "index.html") or log.match("next_*.csv")
        if ours and folder.is_dir() and log.exists() and log.resolve().parent == folder.resolve():
            raise UsageError(f"-o {folder} could overwrite the log {log}; name another folder")
    return folder


def _mission_files(mission: Path | None, plant: Path | None) -> None:
    if plant is not None and mission is None:
        raise UsageError("--plant is of use only with --mission; name the mission of the log")
    for path, option in ((mission, "--mission"), (plant, "--plant")):
        if path is not None and not path.exists():
            raise UsageError(f"there is no {path}; check the path after {option}")


def _lengths(text: str | None, mission: Path | None) -> "Geometry | None":
    """The vehicle's lengths as ``--geometry`` gives them."""
    from sysid.vehicle.kinematics import Geometry

    if text is None:
        return None
    found: dict[str, float] = {}
    for part in text.split(","):
        name, sign, value = (p.strip() for p in part.partition("="))
        key = {"r": "r", "b": "B"}.get(name.lower(), "")
        try:
            number = float(value)
        except ValueError:
            key = ""
        if not (key and sign) or key in found:
            raise UsageError(
                f"--geometry cannot read {part.strip()!r}; write both lengths once, in metres, "
                "such as r=0.30,B=1.08"
            )
        found[key] = number
    if len(found) < 2:
        raise UsageError(
            f"--geometry gives no {'B' if 'r' in found else 'r'}; write both lengths in metres, "
            "such as r=0.30,B=1.08"
        )
    try:
        lengths = Geometry(found["r"], found["B"])
    except ModelError as error:
        raise UsageError(f"--geometry: {error}") from None
    if mission is not None:
        from sysid.mission.spec import load_mission

        theirs = load_mission(mission).vehicle.given_geometry
        if theirs is not None and theirs != lengths:
            raise UsageError(
                f"{mission} gives r = {theirs.r:g} m and B = {theirs.B:g} m, --geometry something "
                "else; leave --geometry away or mend the mission"
            )
    return lengths


def _records(
    logs: list[Path], read: "ReadOptions", steps: "Preparation"
) -> "tuple[list[Record], tuple[Finding, ...]]":
    """The records of logs, and what there is to say about the reading."""
    from sysid.data.checks.quality import require_usable
    from sysid.data.preparation import read_prepared

    records, findings = read_prepared(logs, read, steps)
    require_usable(records)
    return list(records), findings


def _apart(estimation: "list[Record]", held: "list[Record] | None") -> None:
    """Refuse held-out logs that prove nothing or belong to something else."""
    first = estimation[0]
    for r in held or []:
        if (r.input_names, r.output_names) != (first.input_names, first.output_names):
            raise DataError(
                f"{r.name} has {', '.join(r.input_names)} -> {', '.join(r.output_names)} but "
                f"{first.name} has {', '.join(first.input_names)} -> "
                f"{', '.join(first.output_names)}; choose the columns with --input and --output"
            )
        if any(r.sha256 == e.sha256 for e in estimation):
            raise UsageError(
                f"{r.name} is both a log and a --val log and would prove nothing; leave --val "
                "away and the log is split"
            )


def _run(
    estimation: "list[Record]",
    held: "list[Record] | None",
    base: StoredModel | None,
    driven: "tuple[Path | None, Geometry | None]",
    package: "Package | None",
) -> "Diagnosis":
    from sysid.discrepancy.diagnose import diagnose

    doubted = base.model if base else None
    if package is not None:
        doubted = package.model()
        for note in package.notes:
            render.warn(f"! {note}")
    for record in (*estimation, *(held or ())):
        if doubted is not None:
            doubted.check(record)
    mission, lengths = driven
    with render.stages("Diagnosing") as progress:
        return diagnose(
            estimation, held, model=doubted, mission=mission, geometry=lengths, progress=progress
        )
