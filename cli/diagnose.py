"""``sysid diagnose``: localise model errors, select missing effects, validate the new model."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.errors import UsageError
from sysid.workspace.logs import as_fitted, judged_on
from sysid.workspace.store import AUGMENTED, StoredModel, Workspace

from . import fit_options, reading, render, targets
from .diagnose_files import keep_models, write_results
from .diagnose_report import show
from .field_options import with_options
from .mission_options import Driven, DriveOptions
from .options import command, group, option
from .read_as import decided

if TYPE_CHECKING:
    from sysid.data.finding import Finding
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.diagnosis.diagnosis import Diagnosis
    from sysid.structures.model import Model


@command
def diagnose(
    logs: list[Path] = reading.LOGS,
    model: str | None = reading.model(
        "Model to diagnose as it is [a baseline, which has absorbed nothing yet]."
    ),
    validation: list[Path] | None = fit_options.validation(
        "Validation log; repeatable [the logs are split]."
    ),
    bench: Path | None = option(
        "FILE",
        "Written by `sysid bench power -o FILE`: effects of battery and bridge are sought "
        "near its values.",
        advanced=True,
    ),
    drive: Driven = group(DriveOptions),
    output: Path | None = targets.target("DIR", "Output folder [WORKSPACE/diagnosis]."),
    steps: "Preparation" = group(reading.Preparing),
    read: "ReadOptions" = group(reading.Reading),
    workspace: Path = reading.WORKSPACE,
    full: bool = reading.FULL,
    json: bool = reading.JSON,
) -> None:
    """Find what a model lacks on a log, and validate it.

    Both models are kept in the workspace. diagnosis.json, a page (index.html) and schedules of the
    next experiments (next_*.csv) are written to a folder.
    """
    place = Workspace(workspace)
    folder = _folder(output or place.diagnosis_dir, logs, validation or [])
    if drive.package is not None and model is not None:
        raise UsageError("--model and --plant both give the model to diagnose; give one of them")
    given = place.load(model) if model is not None else None
    read, steps = as_fitted(given, read, steps)
    data = _estimation_data(logs, read, steps, place, given, drive)
    data, holdout, holdout_findings = _with_holdout(data, validation or [], steps)
    files = [str(p.resolve()) for p in logs]
    origin = {"files": files, "read": data.read.to_json(), "prepare": steps.to_json()}
    judged = judged_on(holdout or (), validation or ())
    result = _run(data, holdout, drive, (*data.findings, *holdout_findings), bench)
    before, after = keep_models(place, result, given, origin, judged)
    offsets = result.before.operating_point.decision
    read_as = decided((*data.records, *(holdout or ())), offsets)
    document, page = write_results(folder, result, before, after, read_as)
    if after != before:
        place.remember(AUGMENTED, after)
    if json:
        render.document(document)
    else:
        show(result, before, after, folder, read_as)
        if full:
            render.page(page)


@dataclass(frozen=True, eq=False)
class _EstimationData:
    """The logs as read, and the model to diagnose on them.

    Attributes:
        records: one or several a log.
        model: the model to diagnose, a stored one's or the plant's; None for the baseline.
        against: the workspace's best model of these channels, which the result is compared with.
    """

    records: "list[Record]"
    findings: "tuple[Finding, ...]"
    read: "ReadOptions"
    model: "Model | None"
    against: StoredModel | None


def _estimation_data(
    logs: list[Path],
    read: "ReadOptions",
    steps: "Preparation",
    place: Workspace,
    given: StoredModel | None,
    drive: Driven,
) -> _EstimationData:
    """The logs, read such that the model to diagnose can run on them.

    Where outputs follow each other's commands the inputs are taken in the outputs' order.
    """
    from sysid.data.checks.robot_checks import exchanged_inputs, wrong_wires

    if read.resample == "auto":  # an empty reading is one of the things to be found: a dropout
        read = replace(read, resample="hold")
    records, findings = _records(logs, read, steps)
    given_model = given.model if given else drive.package.model() if drive.package else None
    slow = read.held == "auto" and any(f.code == "held-telemetry" for f in findings)
    if slow and not (given_model and given_model.fits_clock(records[0])):
        # no model at the sensor's rate: repeats are masked, and commands keep their instants
        read = replace(read, held="keep")
        records, findings = _records(logs, read, steps)
    wired = wrong_wires(records)
    if wired and given_model is None and (inputs := exchanged_inputs(records)):
        read = replace(read, inputs=inputs)
        records, findings = _records(logs, read, steps)
    if wired:  # the sides and signs of a path are those of the wheels
        records = [replace(r, pose=None) for r in records]
    best = place.best_for(records[0]) if given_model is None else None
    return _EstimationData(records, (*findings, *wired), read, given_model, best)


def _with_holdout(
    data: _EstimationData, validation: list[Path], steps: "Preparation"
) -> "tuple[_EstimationData, list[Record] | None, tuple[Finding, ...]]":
    """The data and the records of the validation logs, at one sample time."""
    from sysid.data.same_kind import with_validation

    if not validation:
        return data, None, ()
    holdout, findings = _records(validation, data.read, steps)
    records, judged, resampled = with_validation(data.records, holdout)
    return replace(data, records=list(records)), list(judged), (*findings, *resampled)


def _folder(folder: Path, logs: list[Path], val: list[Path]) -> Path:
    """Where the results go, refused early where that cannot be."""
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; name a folder with -o")
    for log in (*logs, *val):
        ours = log.name in ("diagnosis.json", "index.html", "page.json") or log.match("next_*.csv")
        if ours and folder.is_dir() and log.exists() and log.resolve().parent == folder.resolve():
            raise UsageError(f"-o {folder} could overwrite the log {log}; name another folder")
    return folder


def _records(
    logs: list[Path], read: "ReadOptions", steps: "Preparation"
) -> "tuple[list[Record], tuple[Finding, ...]]":
    """The records of logs, and what there is to say about the reading."""
    from sysid.data.inspection import require_usable
    from sysid.data.preparation import read_prepared

    records, findings = read_prepared(logs, read, steps)
    require_usable(records)
    return list(records), findings


def _run(
    data: _EstimationData,
    holdout: "list[Record] | None",
    drive: Driven,
    read_as: "tuple[Finding, ...]",
    bench: Path | None,
) -> "Diagnosis":
    """The diagnosis, with what there is to say about the reading of its logs."""
    from sysid.data.finding import notes, warned
    from sysid.diagnosis.against import compared
    from sysid.diagnosis.diagnose import diagnose
    from sysid.effects.catalogue import chain_effects
    from sysid.effects.measured import measured_keys, read_measured

    measured = None if bench is None else read_measured(bench)
    render.cautions(drive.package.notes if drive.package else ())
    for record in (*data.records, *(holdout or ())):
        if data.model is not None:
            data.model.check(record)
    with render.stages("Diagnosing") as shown:
        result = diagnose(
            data.records,
            holdout,
            model=data.model,
            mission=drive.mission,
            geometry=drive.geometry,
            measured=measured,
            progress=shown,
        )
    if data.against is not None:
        beside = compared(data.against.id, data.against.model, result.traces)
        result = replace(result, against=beside)
    said = (*warned(read_as), *result.warnings)
    read = tuple(map(with_options, notes(read_as)))
    if measured:
        keys = [key for key in measured_keys(chain_effects()) if key in measured]
        read = (*read, f"Searched near the values of {bench}: {', '.join(keys) or 'nothing'}.")
    shapes = tuple(replace(s, sentence=with_options(s.sentence)) for s in result.shapes)
    told = replace(result, story=with_options(result.story), shapes=shapes)
    return replace(told, reading=read, warnings=tuple(map(with_options, said)))
