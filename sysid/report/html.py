"""The page of a diagnosis: one self-contained HTML file."""

import re
from typing import Any

import numpy as np

from sysid.diagnosis.diagnosis import Diagnosis
from sysid.diagnosis.several.results import sentences, table_of_logs
from sysid.report import diagnosis_panels as panels
from sysid.report import diagnosis_picture as picture
from sysid.report import diagnosis_words as words
from sysid.report import style
from sysid.report.svg_panels import svg

_TEMPLATE = "diagnosis.html.j2"


def diagnosis_page(diagnosis: Diagnosis, before: str, after: str) -> str:
    """The page as text.

    Args:
        diagnosis: the diagnosis, its experiments with the names of their files.
        before, after: ids of the models in the workspace.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    place = Environment(
        loader=PackageLoader("sysid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    place.filters |= {"number": _number, "percent": words.percent, "fit": style.percent}
    text = place.get_template(_TEMPLATE).render(
        diagnosis=diagnosis,
        words=words,
        svg=svg,
        headline=words.headline(diagnosis),
        channels=words.channel_lines(diagnosis),
        moved=words.moved(diagnosis),
        regions=words.leading_regions(diagnosis, 10),
        logs=_logs(diagnosis),
        log_table=table_of_logs(diagnosis.several) if diagnosis.several.logs else (),
        log_sentences=sentences(diagnosis.several),
        before=before,
        after=after,
        picture=_pictures(diagnosis),
        experiments=_experiments(diagnosis),
        path_rows=words.path_table(diagnosis.path),
        detectable=words.detectable(diagnosis),
        equations=diagnosis.after.equations(),
    )
    return re.sub(r"(?<=\d) %(?!\w)", "\N{NO-BREAK SPACE}%", text)


def _pictures(diagnosis: Diagnosis) -> dict[str, Any]:
    """The panels by place; those whose data are missing are left out."""
    shown = words.leading_regions(diagnosis, 10)
    outputs = [t.record.outputs for t in words.held_out(diagnosis)[:1]]
    channels = [_channel(diagnosis, k) for k in range(len(outputs[0]))] if outputs else []
    return {
        "channels": channels,
        "profiled": any(c["profiles"] for c in channels),
        "regions": panels.regions(shown) if shown else (),
        "candidates": panels.candidates(diagnosis) if diagnosis.candidates else (),
        "gap": panels.gap(words.channel_lines(diagnosis)) if diagnosis.grown else (),
        "isolability": panels.isolability(diagnosis.isolability) if diagnosis.isolability else (),
        "shapes": [p for s in (*diagnosis.shapes, *diagnosis.curves) for p in panels.shape(s)],
        "paths": [p for path in words.path_lines(diagnosis.path) for p in panels.path(*path)],
    }


def _channel(diagnosis: Diagnosis, i: int) -> dict[str, Any]:
    """The panels of one output; a short log has no profiles."""
    channel = words.held_out(diagnosis)[0].record.outputs[i]
    known = diagnosis.gap.channels.get(channel.name)  # a gap of the path knows no wheel speeds
    facts = channel.unit, known.noise_floor if known is not None else 0.0
    changed = diagnosis.grown
    return {
        "name": channel.name,
        "worst": panels.worst(picture.worst_windows(diagnosis, i), changed=changed),
        "profiles": panels.profiles(picture.profiles(diagnosis, i), *facts, changed=changed),
        "regimes": panels.regimes(picture.regime_lines(diagnosis, i), *facts, changed=changed),
    }


def _experiments(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    return [{"it": e, "picture": panels.schedule(e)} for e in diagnosis.next_experiments]


def _logs(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """(role, names) of the records."""
    roles = dict.fromkeys(t.role for t in diagnosis.traces)
    names = {r: [t.record.name for t in diagnosis.traces if t.role == r] for r in roles}
    return [(role, ", ".join(dict.fromkeys(each))) for role, each in names.items()]


def _number(value: Any, digits: int = 4) -> str:
    """A number with so many significant digits; a dash where there is none; words as they are."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "–"
    return f"{value:.{digits}g}".replace("-", "−") if isinstance(value, int | float) else str(value)
