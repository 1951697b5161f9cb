"""Results of ``sysid diagnose``: two models, a document, a page and schedules."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.data import documents
from sysid.workspace.store import StoredModel, Workspace

if TYPE_CHECKING:
    from sysid.diagnosis.diagnosis import Diagnosis, Experiment
    from sysid.report.page import Page
    from sysid.structures.model import Model


def keep_models(
    place: Workspace,
    result: "Diagnosis",
    base: StoredModel | None,
    origin: Mapping[str, Any],
    judged: Mapping[str, Any] | None = None,
) -> tuple[str, str]:
    """Keep the original and the augmented model; return their ids.

    Args:
        base: the stored model that was diagnosed, whose id is then that of the original model.
        origin: how the data were read, so that they can be read again.
        judged: the logs that judged, as ``judged_on`` of a report holds them.
    """
    if base is not None and (result.before is base.model or _same(result.before, base.model)):
        before = base.id
    else:
        before = _keep(place, result.before, result, origin, judged)
    same = result.after is result.before or _same(result.after, result.before)
    return before, before if same else _keep(place, result.after, result, origin, judged)


def write_results(
    folder: Path, result: "Diagnosis", before: str, after: str, read_as: list[dict[str, str]]
) -> "tuple[dict[str, Any], Page]":
    """Write schedules, page and document; return document and page.

    Args:
        before, after: ids of the models in the workspace.
        read_as: what was decided when the logs were read.
    """
    from sysid.data.files import write_atomic
    from sysid.report.diagnosis_page import diagnosis_page

    result = replace(result, next_experiments=_named(result.next_experiments))
    document: dict[str, Any] = documents.plain(result.to_json(before, after))
    document["read_as"] = read_as
    files = {e.file: schedule_text(e) for e in result.next_experiments if e.file}
    page = diagnosis_page(result, before, after)
    files |= {"index.html": page.html(), "page.json": documents.text(page)}
    files["diagnosis.json"] = documents.text(document)
    for name, content in files.items():
        write_atomic(folder / name, content)
    return document, page


def schedule_text(experiment: "Experiment") -> str:
    """A schedule as CSV: ``t`` [s] and one command a track, one row at each change."""
    rows = [",".join(f"{v:.9g}" for v in row) for row in experiment.schedule]
    return "\n".join([",".join(experiment.columns), *rows]) + "\n"


def _named(experiments: "tuple[Experiment, ...]") -> "tuple[Experiment, ...]":
    """Every schedule with a file name of its own, ``next_*.csv``."""
    taken: set[str] = set()
    named = []
    for k, e in enumerate(experiments, start=1):
        name = Path(e.file).name if e.schedule else ""
        if e.schedule and (not name or name in taken):
            name = f"next_{k}_{e.effects[0]}.csv" if e.effects else f"next_{k}.csv"
        taken.add(name)
        named.append(replace(e, file=name))
    return tuple(named)


def _keep(
    place: Workspace,
    model: "Model",
    result: "Diagnosis",
    origin: Mapping[str, Any],
    judged: Mapping[str, Any] | None,
) -> str:
    report = _report(model, result) | {"judged_on": judged}
    options = {"made_by": "diagnose", **origin, **model.provenance.options}
    model = replace(model, provenance=replace(model.provenance, options=options))
    return place.save(model, report).id


def _report(model: "Model", result: "Diagnosis") -> dict[str, Any]:
    """The figures that a fit would report, so that the model is listed and compared like one."""

    from sysid.estimation.assessment.findings import DataFigures
    from sysid.report.diagnosis_words import free_run_figures

    def figures(role: str) -> dict[str, Any] | None:
        traces = [t for t in result.traces if t.role == role]
        if not traces:
            return None
        free = free_run_figures(traces, after=model is not result.before)
        return DataFigures(free, replace(free, horizon=1)).to_json()

    return {
        "estimation": figures("estimation") or figures("held-out"),
        "validation": figures("held-out"),
        "residuals": result.tests.as_dict() if model is result.after and result.tests else None,
        "criteria": dict(model.criteria),
        "seconds": result.seconds,
        "warnings": list(model.warnings),
    }


def _same(a: "Model", b: "Model") -> bool:
    return bool(documents.plain(a.to_json()) == documents.plain(b.to_json()))
