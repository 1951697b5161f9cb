"""The page of a diagnosis: one HTML file that needs nothing beside it."""

import gc
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.diagnosis import Diagnosis, Experiment
from sysid.diagnosis.several.words import sentences, table_of_logs
from sysid.report import diagnosis_bars, diagnosis_drawing, diagnosis_picture, style
from sysid.report import diagnosis_words as words
from sysid.report.layout import NARROW, NARROWEST_WIDE, WIDE, Layout
from sysid.report.plots import inline_svg, share_letters
from sysid.second_process import SecondProcess

_TEMPLATE = "diagnosis.html.j2"


def drawing_tools() -> None:
    """Import what pictures are drawn with."""
    import matplotlib.backends.backend_agg
    import matplotlib.backends.backend_svg
    import matplotlib.figure  # noqa: F401


def diagnosis_page(
    found: Diagnosis, before: str, after: str, second: SecondProcess | None = None
) -> str:
    """The page as text.

    Args:
        found: the diagnosis, its experiments with the names of their files.
        before, after: ids of the models in the workspace.
        second: draws half of the pictures.
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
    gallery = _Gallery()
    pictures, experiments = _pictures(gallery, found), _experiments(gallery, found)
    with _uncollected():
        gallery.draw(second or SecondProcess(drawing_tools))
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


class _Size(Protocol):
    """Width and height of a picture in a layout [in]."""

    def __call__(self, *, layout: Layout) -> tuple[float, float]: ...


class _Draw(Protocol):
    """Draws a picture on a figure."""

    def __call__(self, figure: Any, *, layout: Layout) -> None: ...


@dataclass(eq=False)
class _Picture:
    """A picture in both layouts, of which the page's style shows the one that can be read.

    Attributes:
        name, label: as ``inline_svg`` has them.
        size, draw: can be sent to another process.
        wide, narrow: as text, once the gallery is drawn.
    """

    name: str
    size: _Size
    draw: _Draw
    label: str
    wide: str = ""
    narrow: str = ""

    def __html__(self) -> str:
        return f'<div class="wide">{self.wide}</div>\n<div class="narrow">{self.narrow}</div>'


def _svg(name: str, size: _Size, draw: _Draw, label: str, layout: Layout) -> str:
    return inline_svg(name, size(layout=layout), partial(draw, layout=layout), label)


@dataclass(frozen=True, eq=False)
class _Gallery:
    """The pictures of a page."""

    pictures: list[_Picture] = field(default_factory=list)

    def add(self, name: str, size: _Size, draw: _Draw, label: str) -> _Picture:
        """One more picture."""
        self.pictures.append(_Picture(name, size, draw, label))
        return self.pictures[-1]

    def draw(self, second: SecondProcess) -> None:
        """Draw all: the narrow ones in the second process, if it was started."""
        drawn = [
            second.call(partial(_svg, f"{p.name}-narrow", p.size, p.draw, p.label, NARROW))
            for p in self.pictures
        ]
        for p in self.pictures:
            p.wide = _svg(p.name, p.size, p.draw, p.label, WIDE)
        for p, narrow in zip(self.pictures, drawn, strict=True):
            p.narrow = narrow()


def _pictures(gallery: _Gallery, found: Diagnosis) -> dict[str, Any]:
    """Every picture by name; those whose data are missing are left out."""
    shown = words.leading_regions(found, 10)
    drawn: dict[str, Any] = {"channels": [], "regions": "", "candidates": "", "gap": ""}
    if shown:
        drawn["regions"] = gallery.add(
            "regions",
            partial(diagnosis_drawing.regions_size, shown),
            partial(diagnosis_drawing.draw_regions, regions=shown),
            "Shares of the excess error by regime",
        )
    lines = words.channel_lines(found)
    if found.grown:
        drawn["gap"] = gallery.add(
            "gap",
            partial(diagnosis_bars.gap_size, lines),
            partial(diagnosis_bars.draw_gap, lines=lines),
            "Errors before and after by output, with the noise floor",
        )
    if found.candidates:
        facts: dict[str, Any] = {
            "candidates": found.candidates,
            "accepted": tuple(e.id for e in found.effects),
            "tied": tuple(i for e in found.effects for i in e.indistinguishable),
        }
        drawn["candidates"] = gallery.add(
            "candidates",
            partial(diagnosis_bars.candidates_size, **facts),
            partial(diagnosis_bars.draw_candidates, **facts),
            "Candidates by score",
        )
    drawn["paths"] = [
        _path(gallery, k, *entry) for k, entry in enumerate(words.path_lines(found.path))
    ]
    if words.held_out(found):
        outputs = words.held_out(found)[0].record.outputs
        drawn["channels"] = [_channel(gallery, found, k) for k in range(len(outputs))]
    return drawn


def _channel(gallery: _Gallery, found: Diagnosis, i: int) -> dict[str, Any]:
    """The pictures of one output."""
    record = words.held_out(found)[0].record
    channel = record.outputs[i]
    known = found.gap.channels.get(channel.name)  # a gap of the path knows no wheel speeds
    floor = known.noise_floor if known is not None else 0.0
    windows = diagnosis_picture.worst_windows(found, i)
    profiles = diagnosis_picture.profiles(found, i)
    regimes = diagnosis_picture.regime_lines(found, i)
    unit, changed, draw = channel.unit, found.grown, diagnosis_drawing
    return {
        "name": channel.name,
        "worst": gallery.add(
            f"worst{i}",
            partial(draw.worst_size, windows, changed=changed),
            partial(draw.draw_worst, windows=windows, changed=changed),
            f"{channel.name} where the original model is worst",
        ),
        "profiles": gallery.add(  # a short log has none
            f"profiles{i}",
            partial(draw.profiles_size, profiles, changed=changed),
            partial(draw.draw_profiles, profiles=profiles, unit=unit, floor=floor, changed=changed),
            f"Residuals of {channel.name} against the regime variables",
        )
        if profiles
        else "",
        "regimes": gallery.add(
            f"regimes{i}",
            partial(draw.regimes_size, regimes, changed=changed),
            partial(draw.draw_regimes, lines=regimes, unit=unit, floor=floor, changed=changed),
            f"Errors of {channel.name} by regime before and after",
        ),
    }


def _path(
    gallery: _Gallery, k: int, record: str, lines: tuple[tuple[str, Array], ...]
) -> dict[str, Any]:
    """The picture of one replayed path."""
    picture = gallery.add(
        f"path{k}",
        partial(diagnosis_drawing.path_size, lines),
        partial(diagnosis_drawing.draw_path, paths=lines),
        f"Paths of {record}: measured, and by both models under its commands",
    )
    return {"record": record, "picture": picture}


def _experiments(gallery: _Gallery, found: Diagnosis) -> list[dict[str, Any]]:
    return [
        {"it": e, "picture": _schedule(gallery, k, e) if len(e.rows) > 1 else ""}
        for k, e in enumerate(found.next_experiments)
    ]


def _schedule(gallery: _Gallery, k: int, e: Experiment) -> _Picture:
    """The picture of one experiment's commands."""
    rows = np.array(e.rows, dtype=np.float64)
    return gallery.add(
        f"next{k}",
        partial(diagnosis_drawing.schedule_size, e.columns),
        partial(diagnosis_drawing.draw_schedule, columns=e.columns, rows=rows),
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
