"""The page of a diagnosis: one HTML file that needs nothing beside it."""

import gc
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import Array
from sysid.discrepancy.diagnosis import Diagnosis, Experiment
from sysid.discrepancy.several.words import sentences, table_of_logs
from sysid.report import diagnosis_bars, diagnosis_drawing, diagnosis_picture, style
from sysid.report import diagnosis_words as words
from sysid.report.layout import NARROW, NARROWEST_WIDE, WIDE, Layout
from sysid.report.plots import inline_svg, share_letters

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEMPLATE = "diagnosis.html.j2"


def diagnosis_page(found: Diagnosis, before: str, after: str) -> str:
    """The page as text.

    Args:
        found: the diagnosis, its experiments with the names of their files.
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
    with _uncollected():
        pictures, experiments = _pictures(found), _experiments(found)
    text = place.get_template(_TEMPLATE).render(
        found=found,
        words=words,
        look=style,
        narrowest_wide=NARROWEST_WIDE,
        headline=words.headline(found),
        channels=words.channel_lines(found),
        moved=words.moved(found),
        regions=words.leading_regions(found, 10),
        logs=_logs(found),
        log_table=table_of_logs(found.several) if found.several.logs else (),
        log_sentences=sentences(found.several),
        before=before,
        after=after,
        picture=pictures,
        experiments=experiments,
        path_rows=words.path_table(found.path),
        detectable=words.detectable(found),
        equations=_equations(found),
    )
    text = re.sub(r"(?<=\d) %(?!\w)", "\N{NO-BREAK SPACE}%", text)
    return share_letters(text)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Without collecting garbage: all that is drawn is in use until it is done, and to look through
    it again and again takes an eighth of the time.
    """
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _pictures(found: Diagnosis) -> dict[str, Any]:
    """Every picture by name; those whose data are missing are left out."""
    shown = words.leading_regions(found, 10)
    drawn: dict[str, Any] = {"channels": [], "regions": "", "candidates": "", "gap": ""}
    if shown:
        drawn["regions"] = _picture(
            "regions",
            lambda layout: diagnosis_drawing.regions_size(shown, layout),
            lambda figure, layout: diagnosis_drawing.draw_regions(figure, shown, layout),
            "Shares of the excess error by regime",
        )
    lines = words.channel_lines(found)
    if found.grown:
        drawn["gap"] = _picture(
            "gap",
            lambda layout: diagnosis_bars.gap_size(lines, layout),
            lambda figure, layout: diagnosis_bars.draw_gap(figure, lines, layout),
            "Errors before and after by output, with the noise floor",
        )
    if found.candidates:
        accepted = tuple(e.id for e in found.effects)
        tied = tuple(i for e in found.effects for i in e.indistinguishable)
        facts = (found.candidates, accepted, tied)
        drawn["candidates"] = _picture(
            "candidates",
            lambda layout: diagnosis_bars.candidates_size(*facts, layout),
            lambda figure, layout: diagnosis_bars.draw_candidates(figure, *facts, layout),
            "Candidates by score",
        )
    drawn["paths"] = [_path(k, *entry) for k, entry in enumerate(words.path_lines(found.path))]
    if words.held_out(found):
        outputs = words.held_out(found)[0].record.outputs
        drawn["channels"] = [_channel(found, k) for k in range(len(outputs))]
    return drawn


def _picture(
    name: str,
    size: Callable[[Layout], tuple[float, float]],
    draw: Callable[["Figure", Layout], None],
    label: str,
) -> str:
    """A picture in both layouts, of which the page's style shows the one that can be read."""
    wide = inline_svg(name, size(WIDE), lambda figure: draw(figure, WIDE), label)
    narrow = inline_svg(f"{name}-narrow", size(NARROW), lambda figure: draw(figure, NARROW), label)
    return f'<div class="wide">{wide}</div>\n<div class="narrow">{narrow}</div>'


def _channel(found: Diagnosis, i: int) -> dict[str, str]:
    """The pictures of one output."""
    record = words.held_out(found)[0].record
    channel = record.outputs[i]
    known = found.gap.channels.get(channel.name)  # a gap of the path knows no wheel speeds
    floor = known.noise_floor if known is not None else 0.0
    windows = diagnosis_picture.worst_windows(found, i)
    profiles = diagnosis_picture.profiles(found, i)
    regimes = diagnosis_picture.regime_lines(found, i)
    unit, changed = channel.unit, found.grown
    draw = diagnosis_drawing
    return {
        "name": channel.name,
        "worst": _picture(
            f"worst{i}",
            lambda layout: draw.worst_size(windows, changed=changed, layout=layout),
            lambda figure, layout: draw.draw_worst(figure, windows, changed=changed, layout=layout),
            f"{channel.name} where the model before is worst",
        ),
        "profiles": _picture(  # a short log has none
            f"profiles{i}",
            lambda layout: draw.profiles_size(profiles, changed=changed, layout=layout),
            lambda figure, layout: draw.draw_profiles(
                figure, profiles, unit, floor, changed=changed, layout=layout
            ),
            f"Residuals of {channel.name} against the regime variables",
        )
        if profiles
        else "",
        "regimes": _picture(
            f"regimes{i}",
            lambda layout: draw.regimes_size(regimes, changed=changed, layout=layout),
            lambda figure, layout: draw.draw_regimes(
                figure, regimes, unit, floor, changed=changed, layout=layout
            ),
            f"Errors of {channel.name} by regime before and after",
        ),
    }


def _path(k: int, record: str, lines: tuple[tuple[str, Array], ...]) -> dict[str, str]:
    """The picture of one replayed path."""
    picture = _picture(
        f"path{k}",
        lambda layout: diagnosis_drawing.path_size(lines, layout),
        lambda figure, layout: diagnosis_drawing.draw_path(figure, lines, layout),
        f"Paths of {record}: measured, and by both models under its commands",
    )
    return {"record": record, "picture": picture}


def _experiments(found: Diagnosis) -> list[dict[str, Any]]:
    return [
        {"it": e, "picture": _schedule(k, e) if len(e.rows) > 1 else ""}
        for k, e in enumerate(found.next_experiments)
    ]


def _schedule(k: int, e: Experiment) -> str:
    """The picture of one experiment's commands."""
    rows = np.array(e.rows, dtype=np.float64)
    return _picture(
        f"next{k}",
        lambda layout: diagnosis_drawing.schedule_size(e.columns, layout),
        lambda figure, layout: diagnosis_drawing.draw_schedule(figure, e.columns, rows, layout),
        f"Schedule of the experiment for {', '.join(e.effects)}",
    )


def _logs(found: Diagnosis) -> list[tuple[str, str]]:
    """(role, names) of the records."""
    roles = dict.fromkeys(t.role for t in found.traces)
    return [(r, ", ".join(dict.fromkeys(_names(found, r)))) for r in roles]


def _names(found: Diagnosis, role: str) -> Iterable[str]:
    return (t.record.name for t in found.traces if t.role == role)


def _equations(found: Diagnosis) -> tuple[str, ...]:
    return found.after.equations()


def _number(value: Any, digits: int = 4) -> str:
    """A number with so many significant digits; a dash where there is none; words as they are."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "–"
    return f"{value:.{digits}g}".replace("-", "−") if isinstance(value, int | float) else str(value)
