"""The page of a diagnosis: one self-contained HTML file."""

import re
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.diagnosis import Diagnosis, Experiment
from sysid.diagnosis.several.results import sentences, table_of_logs
from sysid.diagnosis.shapes.grading import FoundShape
from sysid.report import diagnosis_bars, diagnosis_drawing, diagnosis_picture, style
from sysid.report import diagnosis_words as words
from sysid.report.isolability_drawing import draw_isolability
from sysid.report.plots import inline_svg, share_letters
from sysid.report.shape_drawing import draw_curve

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
        look=style,
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
    text = re.sub(r"(?<=\d) %(?!\w)", "\N{NO-BREAK SPACE}%", text)
    return share_letters(text)


def _pictures(diagnosis: Diagnosis) -> dict[str, Any]:
    """Every picture by name; those whose data are missing are left out."""
    shown = words.leading_regions(diagnosis, 10)
    drawn: dict[str, Any] = {
        "channels": [],
        "regions": "",
        "candidates": "",
        "gap": "",
        "isolability": "",
    }
    if shown:
        drawn["regions"] = inline_svg(
            "regions", "Shares of the excess error by regime", diagnosis_drawing.draw_regions, shown
        )
    lines = words.channel_lines(diagnosis)
    if diagnosis.grown:
        drawn["gap"] = inline_svg(
            "gap",
            "Errors before and after by output, with the noise floor",
            diagnosis_bars.draw_gap,
            lines,
        )
    if diagnosis.candidates:
        tied = tuple(i for e in diagnosis.effects for i in e.indistinguishable)
        facts = (diagnosis.candidates, tuple(e.id for e in diagnosis.effects), tied)
        drawn["candidates"] = inline_svg(
            "candidates", "Candidates by score", diagnosis_bars.draw_candidates, *facts
        )
    if diagnosis.isolability is not None:
        drawn["isolability"] = inline_svg(
            "isolability",
            "Angles between the signatures of effects",
            draw_isolability,
            diagnosis.isolability,
        )
    found = enumerate((*diagnosis.shapes, *diagnosis.curves))
    drawn["shapes"] = [(s, _shape(k, s)) for k, s in found]
    drawn["paths"] = [_path(k, *entry) for k, entry in enumerate(words.path_lines(diagnosis.path))]
    if words.held_out(diagnosis):
        outputs = words.held_out(diagnosis)[0].record.outputs
        drawn["channels"] = [_channel(diagnosis, k) for k in range(len(outputs))]
    return drawn


def _channel(diagnosis: Diagnosis, i: int) -> dict[str, Any]:
    """The pictures of one output."""
    record = words.held_out(diagnosis)[0].record
    channel = record.outputs[i]
    known = diagnosis.gap.channels.get(channel.name)  # a gap of the path knows no wheel speeds
    floor = known.noise_floor if known is not None else 0.0
    windows = diagnosis_picture.worst_windows(diagnosis, i)
    profiles = diagnosis_picture.profiles(diagnosis, i)
    regimes = diagnosis_picture.regime_lines(diagnosis, i)
    unit, changed, draw = channel.unit, diagnosis.grown, diagnosis_drawing
    return {
        "name": channel.name,
        "worst": inline_svg(
            f"worst{i}",
            f"{channel.name} where the original model is worst",
            draw.draw_worst,
            windows,
            changed=changed,
        ),
        "profiles": inline_svg(  # a short log has none
            f"profiles{i}",
            f"Residuals of {channel.name} against the regime variables",
            draw.draw_profiles,
            profiles,
            unit,
            floor,
            changed=changed,
        )
        if profiles
        else "",
        "regimes": inline_svg(
            f"regimes{i}",
            f"Errors of {channel.name} by regime before and after",
            draw.draw_regimes,
            regimes,
            unit,
            floor,
            changed=changed,
        ),
    }


def _shape(k: int, shape: FoundShape) -> str:
    """The curve of a shape; empty where its sentence says all."""
    if shape.curve is None:
        return ""
    return inline_svg(f"shape{k}", f"{shape.id} of {shape.output}", draw_curve, shape.curve)


def _path(k: int, record: str, lines: tuple[tuple[str, Array], ...]) -> dict[str, Any]:
    """The picture of one replayed path."""
    picture = inline_svg(
        f"path{k}",
        f"Paths of {record}: measured, and by both models under its commands",
        diagnosis_drawing.draw_path,
        lines,
    )
    return {"record": record, "picture": picture}


def _experiments(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    return [
        {"it": e, "picture": _schedule(k, e) if len(e.schedule) > 1 else ""}
        for k, e in enumerate(diagnosis.next_experiments)
    ]


def _schedule(k: int, e: Experiment) -> str:
    """The picture of one experiment's commands."""
    rows = np.array(e.schedule, dtype=np.float64)
    return inline_svg(
        f"next{k}",
        f"Schedule of the experiment for {', '.join(e.effects)}",
        diagnosis_drawing.draw_schedule,
        e.columns,
        rows,
    )


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
