"""``sysid diagnose``: where model and log disagree, what is missing, and the proof once added."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sysid.errors import UsageError
from sysid.workspace.logs import as_fitted, judged_on
from sysid.workspace.store import StoredModel, Workspace

from . import fit_options, reading, render, targets
from .diagnose_files import keep_models, write_results
from .diagnose_report import show
from .field_options import with_options
from .mission_options import Driven, driven

if TYPE_CHECKING:
    from sysid.data.finding import Finding
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.diagnosis.diagnosis import Diagnosis
    from sysid.structures.model import Model


@reading.composed(drive=driven, steps=reading.preparation, read=reading.read_options)
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
    validation: Annotated[
        list[Path] | None,
        fit_options.judging_option(
            "--val", "LOG", "Log to prove it on; the logs are split unless given. Again for more."
        ),
    ] = None,
    bench: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What `sysid bench power -o FILE` measured: effects of battery and bridge are "
            "looked for near it.",
        ),
    ] = None,
    *,
    drive: Driven,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="DIR", help="Where to write [WORKSPACE/diagnosis]."),
    ] = None,
    steps: "Preparation",
    read: "ReadOptions",
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
    json: reading.Json = False,
) -> None:
    """Find where a model and a log disagree, name the missing effect, add it, prove the gap shrank.

    Both models stay in the workspace; diagnosis.json, a page (index.html) and schedules of the
    experiments that would tell more (next_*.csv) are written to a folder.
    """
    place = Workspace(workspace)
    if output is not None:
        targets.check(output, "-o")
    folder = _folder(output or place.diagnosis_dir, logs, validation or [])
    if drive.package is not None and model is not None:
        raise UsageError("--model and --plant both name the model to doubt; give one of them")
    given = place.load(model) if model is not None else None
    read, steps = as_fitted(given, read, steps)
    data = _estimation_data(logs, read, steps, place, given, drive)
    held, held_as = _records(validation, data.read, steps) if validation else (None, ())
    files = [str(p.resolve()) for p in logs]
    origin = {"files": files, "read": data.read.to_json(), "prepare": steps.to_json()}
    judged = judged_on(held or (), validation or ())
    found = _run(data, held, drive, (*data.findings, *held_as), bench)
    before, after = keep_models(place, found, data.base, origin, judged)
    document = write_results(folder, found, before, after)
    render.document(document) if json else show(found, before, after, folder, validation or ())


@dataclass(frozen=True, eq=False)
class _EstimationData:
    """The logs as read, and the model that is doubted on them.

    Attributes:
        records: one or several a log.
        findings: what there is to say about the reading.
        read: how they were read.
        base: the stored model that is doubted, if any.
        doubted: the model, the base's or the plant's; None for the plainest.
    """

    records: "list[Record]"
    findings: "tuple[Finding, ...]"
    read: "ReadOptions"
    base: StoredModel | None
    doubted: "Model | None"


def _estimation_data(
    logs: list[Path],
    read: "ReadOptions",
    steps: "Preparation",
    place: Workspace,
    given: StoredModel | None,
    drive: Driven,
) -> _EstimationData:
    """The logs, read such that the model to doubt can run on them."""
    if read.resample == "auto":  # an empty reading is one of the things to be found: a dropout
        read = replace(read, resample="hold")
    records, findings = _records(logs, read, steps)
    base = given or (place.best_for(records[0]) if drive.package is None else None)
    doubted = base.model if base else drive.package.model() if drive.package else None
    slow = read.held == "auto" and any(f.code == "held-telemetry" for f in findings)
    if slow and not (doubted and doubted.fits_clock(records[0])):
        # no model at the sensor's rate: repeats are masked, and commands keep their instants
        read = replace(read, held="keep")
        records, findings = _records(logs, read, steps)
    return _EstimationData(records, findings, read, base, doubted)


def _folder(folder: Path, logs: list[Path], val: list[Path]) -> Path:
    """Where the results go, refused early where that cannot be."""
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; name a folder with -o")
    for log in (*logs, *val):
        ours = log.name in ("diagnosis.json", "index.html") or log.match("next_*.csv")
        if ours and folder.is_dir() and log.exists() and log.resolve().parent == folder.resolve():
            raise UsageError(f"-o {folder} could overwrite the log {log}; name another folder")
    return folder


def _records(
    logs: list[Path], read: "ReadOptions", steps: "Preparation"
) -> "tuple[list[Record], tuple[Finding, ...]]":
    """The records of logs, and what there is to say about the reading."""
    from sysid.data.checks.quality import require_usable
    from sysid.data.preparation import read_prepared

    records, findings = read_prepared(logs, read, steps)
    require_usable(records)
    return list(records), findings


def _run(
    data: _EstimationData,
    held: "list[Record] | None",
    drive: Driven,
    read_as: "tuple[Finding, ...]",
    bench: Path | None,
) -> "Diagnosis":
    """The diagnosis, with what there is to say about the reading of its logs.

    Args:
        data: what effects are searched on.
        held: what judges.
        drive: the mission and the vehicle.
        read_as: what there is to say about the reading.
        bench: what a bench measured.
    """
    from sysid.data.finding import notes, warned
    from sysid.diagnosis.diagnose import diagnose
    from sysid.effects.catalogue import chain_effects
    from sysid.effects.measured import measured_keys, read_measured

    measured = None if bench is None else read_measured(bench)
    for note in drive.package.notes if drive.package else ():
        render.warn(f"! {note}")
    for record in (*data.records, *(held or ())):
        if data.doubted is not None:
            data.doubted.check(record)
    with render.stages("Diagnosing") as shown:
        found = diagnose(
            data.records,
            held,
            model=data.doubted,
            mission=drive.mission,
            geometry=drive.geometry,
            measured=measured,
            progress=shown,
        )
    said = (*warned(read_as), *found.warnings)
    read = tuple(map(with_options, notes(read_as)))
    if measured:
        keys = [key for key in measured_keys(chain_effects()) if key in measured]
        read = (*read, f"Looked for near what {bench} measured: {', '.join(keys) or 'nothing'}.")
    return replace(found, reading=read, warnings=tuple(map(with_options, said)))
