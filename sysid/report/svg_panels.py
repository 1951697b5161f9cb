"""A panel as an ``<svg>`` of a page: real text, colours of the page's style sheet, some ms each.

matplotlib draws the files; a page that every fit writes cannot wait for it (30 ms a panel after
500 ms of import), and its colours could not follow a dark page
([0038](../../docs/decisions/0038-pages-without-scripts.md)).
"""

import html
import math
from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.report.movement import drawn
from sysid.report.panels import Curve, Panel, thinned
from sysid.report.style import printable

WIDTH, HEIGHT = 360.0, 216.0
LEFT, RIGHT, TOP, BOTTOM = 52.0, 10.0, 34.0, 34.0
ROW = 15.0
"""Height of a named row; twice that where the name is long and stands above."""

LONG_NAME = 0.45 * WIDTH
"""Room of a name at the side [px]."""

TICKS = 5
MARGIN = 0.06
"""Room above and below the curves, as a share of their range."""

MARK = 24.0
"""Room of the mark that enlarges a panel [px]."""

LETTER = 6.9
"""Width of a letter of 11 px [px]: that of short names, which must have room beside each other."""

MEAN = 6.3
"""Mean width of a letter of 11 px in longer words [px]."""

LEGEND = 14.0
"""Height of a row of names below a panel, where they have no room beside the axis' name [px]."""


class _Axis:
    """From values to pixels along one side."""

    def __init__(self, values: Array, ends: tuple[float, float], log: bool, margin: float) -> None:
        known = values[np.isfinite(values)]
        if log:
            known = known[known > 0.0]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        self.log = log and low > 0.0
        low, high = (math.log10(low), math.log10(high)) if self.log else (low, high)
        if high - low <= 1e-4 * max(abs(low), abs(high), 1e-300):
            flat = 0.02 * abs(low) or 1.0
            low, high = low - flat, high + flat
        room = margin * (high - low)
        self.low, self.high, self.ends = low - room, high + room, ends

    def __call__(self, values: Array) -> Array:
        v = np.asarray(values, dtype=np.float64)
        with np.errstate(all="ignore"):
            v = np.log10(v) if self.log else v
            share = (v - self.low) / (self.high - self.low)
        a, b = self.ends
        return np.asarray(a + (b - a) * np.clip(share, -9.0, 9.0))

    def ticks(self) -> list[float]:
        """Round values inside the range."""
        if self.log:
            decades = range(math.floor(self.low), math.ceil(self.high) + 1)
            steps = (1.0, 2.0, 5.0) if self.high - self.low < 1.6 else (1.0,)
            every = [s * 10.0**d for d in decades for s in steps]
            return [v for v in every if self.low <= math.log10(v) <= self.high]
        step = _round_step((self.high - self.low) / TICKS)
        first = math.ceil(self.low / step - 1e-9)
        return [step * k for k in range(first, math.floor(self.high / step + 1e-9) + 1)]


def _round_step(wanted: float) -> float:
    size = 10.0 ** math.floor(math.log10(wanted))
    return next(size * m for m in (1.0, 2.0, 2.5, 5.0, 10.0) if size * m >= wanted * 0.999)


def svg(panel: Panel) -> str:
    """The panel as an element that scales with its place."""
    height = _height(panel)
    left = LEFT
    if panel.names:
        left = 8.0 if _above(panel) else LETTER * max(map(len, panel.names)) + 10.0
    across, down = _axes(panel, left, height)
    curves = [_curve(c, across, down, bool(panel.names)) for c in panel.curves]
    if panel.circle:
        x, y = across(np.array([0.0, 1.0])), down(np.array([0.0]))
        at = f'cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="{x[1] - x[0]:.1f}"'
        curves.append(f'<circle class="rule" {at}/>')
    moving = drawn(panel.movers, across, down, [f"c{_series(m.colour)}" for m in panel.movers])
    box = f"{left:.1f} {TOP:g} {WIDTH - RIGHT - left:.1f} {height - TOP - BOTTOM:g}"
    x0, y0, wide, tall = box.split()
    inside = f'<svg x="{x0}" y="{y0}" width="{wide}" height="{tall}" viewBox="{box}">'
    parts = [_frame(panel, across, down, left, height), inside, *curves, moving, "</svg>"]
    label = html.escape(printable(f"{panel.title}: {panel.y} over {panel.x}"))
    names, height = _names(panel, left, height)
    return (
        f'<svg class="panel" viewBox="0 0 {WIDTH:g} {height:g}" role="img" aria-label="{label}">'
        f"{''.join(parts)}{names}</svg>"
    )


def _above(panel: Panel) -> bool:
    """Whether names of rows stand above their marks, because the side has no room."""
    return LETTER * max(map(len, panel.names)) + 10.0 > LONG_NAME


def _height(panel: Panel) -> float:
    """Room for every named row, and for a plane's own proportions."""
    if panel.names:
        return max(HEIGHT, TOP + BOTTOM + ROW * (1 + _above(panel)) * len(panel.names))
    if not panel.equal or panel.circle:
        return HEIGHT
    wide, tall = (
        float(np.ptp(np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(1)])))
        for values in ([c.x for c in panel.curves], [c.y for c in panel.curves])
    )
    wanted = TOP + BOTTOM + (WIDTH - LEFT - RIGHT) * tall / max(wide, 1e-9)
    return min(max(HEIGHT, wanted), WIDTH)


def _axes(panel: Panel, left: float, height: float) -> tuple[_Axis, _Axis]:
    lying = bool(panel.names)
    ends = (left, WIDTH - RIGHT), (height - BOTTOM, TOP)
    x = np.concatenate([c.x for c in panel.curves] or [np.zeros(1)])
    y = [c.y for c in panel.curves]
    y += [np.array(panel.rules)] if panel.rules else []
    y += [np.zeros(1) for c in panel.curves if c.kind == "stems" and lying]
    shown = np.concatenate([np.asarray(v)[np.isfinite(v)] for v in y] or [np.zeros(1)])
    bands = [e for c in panel.curves for e in (c.low, c.high) if e is not None]
    if bands and len(shown):  # a band may reach far: it widens the panel by half of it at most
        reach = np.concatenate([np.asarray(e)[np.isfinite(e)] for e in bands])
        room = float(np.ptp(shown)) or abs(float(shown[0])) or 1.0
        low, high = float(shown.min()) - 0.5 * room, float(shown.max()) + 0.5 * room
        shown = np.concatenate([shown, np.clip(reach, low, high)])
    if panel.log_y:
        shown = shown[shown > 0.0]
    if panel.limits is not None:
        shown = np.array(panel.limits)
    margin = 0.0 if panel.limits is not None else MARGIN
    if lying:
        middle = 0.72 if _above(panel) else 0.5  # of a row, where its marks are
        places = np.array([len(panel.names) - middle, -middle])
        rows = _Axis(places, (TOP, height - BOTTOM), False, 0.0)
        return _Axis(shown, ends[0], False, margin), rows
    dots = any(c.kind in ("dots", "marks") for c in panel.curves)
    across = _Axis(x, ends[0], panel.log_x, 0.03 if dots else 0.0)
    down = _Axis(shown, ends[1], panel.log_y, margin)
    if panel.equal or panel.circle:
        _make_equal(across, down, panel.circle)
    return across, down


def _make_equal(across: _Axis, down: _Axis, circle: bool) -> None:
    """One scale for both axes; the whole unit circle inside."""
    if circle:
        across.low, across.high = min(across.low, -1.05), max(across.high, 1.05)
        down.low, down.high = min(down.low, -1.05), max(down.high, 1.05)
    wide, tall = (abs(a.ends[1] - a.ends[0]) for a in (across, down))
    scale = max((across.high - across.low) / wide, (down.high - down.low) / tall)
    for axis, pixels in ((across, wide), (down, tall)):
        middle = 0.5 * (axis.low + axis.high)
        axis.low, axis.high = middle - 0.5 * scale * pixels, middle + 0.5 * scale * pixels


def _frame(panel: Panel, across: _Axis, down: _Axis, left: float, height: float) -> str:
    bottom, right = height - BOTTOM, WIDTH - RIGHT
    parts = []
    for v in across.ticks():
        x = float(across(np.array([v]))[0])
        parts.append(f'<path class="grid" d="M{x:.1f} {TOP:g}V{bottom:g}"/>')
        parts.append(_text(x, bottom + 13.0, f"{_short(v)}", "middle", "tick"))
    if panel.names:
        above = _above(panel)
        row = (bottom - TOP) / len(panel.names)
        for k, name in enumerate(panel.names):
            y = TOP + row * (k + 0.5)
            if above:
                words = _cut(name, (right - left) * LETTER / MEAN)
                parts.append(_text(left + 3.0, y - 0.5 * row + 11.0, words, "start", "tick row"))
            else:
                parts.append(_text(left - 5.0, y + 4.0, name, "end", "tick"))
    else:
        for v in down.ticks():
            y = float(down(np.array([v]))[0])
            parts.append(f'<path class="grid" d="M{left:g} {y:.1f}H{right:g}"/>')
            parts.append(_text(left - 5.0, y + 4.0, _short(v), "end", "tick"))
    for level in panel.rules:
        if panel.names:
            x = float(across(np.array([level]))[0])
            parts.append(f'<path class="rule" d="M{x:.1f} {TOP:g}V{bottom:g}"/>')
        else:
            y = float(down(np.array([level]))[0])
            parts.append(f'<path class="rule" d="M{left:g} {y:.1f}H{right:g}"/>')
    parts.append(f'<path class="axis" d="M{left:g} {TOP:g}V{bottom:g}H{right:g}"/>')
    below = panel.y if panel.names and not panel.x else panel.x
    parts.append(_text(right, height - 6.0, _cut(below, right), "end", "tick"))
    return "".join(parts)


def _names(panel: Panel, left: float, height: float) -> tuple[str, float]:
    """The title; the curves' names in their colours, and the height with them: on the line of the
    axis' name, below the panel where they have no room there.
    """
    parts = [_text(2.0, 12.0, _cut(panel.title, WIDTH - MARK), "start", "title")]
    named = {c.label: c for c in reversed(panel.curves) if c.label and c.kind != "words"}
    named = named if len(named) > 1 else {}
    right = WIDTH - RIGHT
    below = sum(LETTER * len(label) + 12.0 for label in named) > right - left
    x = 2.0 if below else right
    height += LEGEND * below
    for label, c in reversed(named.items()) if below else named.items():
        kind, wide = f"name c{_series(c.colour)}", LETTER * len(label)
        if below and x > 2.0 and x + wide > right:
            x, height = 2.0, height + LEGEND
        at = height - 4.0 if below else TOP - 7.0
        parts.append(_text(x, at, _cut(label, right), "start" if below else "end", kind))
        x += (wide + 12.0) * (1 if below else -1)
    if not panel.names:
        room = (right if below else x) - left
        parts.append(_text(left, TOP - 7.0, _cut(panel.y, room), "start", "tick"))
    return "".join(parts), height


def _cut(words: str, room: float) -> str:
    """Words as far as they have room [px]; the label of the panel has them whole."""
    most = max(int(room / LETTER), 1)
    return words if len(words) <= most else f"{words[: most - 1]}…"


def _text(x: float, y: float, words: str, anchor: str, kind: str) -> str:
    shown = html.escape(printable(words))
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" class="{kind}">{shown}</text>'


def _series(colour: int) -> str:
    return "m" if colour < 0 else str(colour % 6)


def _curve(c: Curve, across: _Axis, down: _Axis, lying: bool) -> str:
    kind = f"c{_series(c.colour)}"
    if lying:
        x, y = across(c.y), down(c.x)
        low, high = (None if e is None else across(e) for e in (c.low, c.high))
    else:
        x, y = across(c.x), down(c.y)
        low, high = (None if e is None else down(e) for e in (c.low, c.high))
    if c.kind == "words":
        each = zip(x, y, strict=True)
        return "".join(_text(a + 5.0, b - 3.0, c.label, "start", "tick") for a, b in each)
    if c.kind in ("dots", "marks"):
        return _points(c.kind, kind, x, y, low, high, lying)
    if c.kind == "stems" and lying:
        zero = float(across(np.zeros(1))[0])
        d = "".join(f"M{zero:.1f} {b:.1f}H{a:.1f}" for a, b in zip(x, y, strict=True))
        return f'<path class="line bar {kind}" d="{d}"/>'
    if c.kind == "stems":
        zero = float(down(np.zeros(1))[0])
        d = "".join(f"M{a:.1f} {zero:.1f}V{b:.1f}" for a, b in zip(x, y, strict=True))
        return f'<path class="line {kind}" d="{d}"/>'
    if c.kind == "area":
        return f'<path class="band {kind}" d="{_line([*zip(x, y, strict=True)])}Z"/>'
    band = ""
    if low is not None and high is not None:
        known = np.isfinite(low) & np.isfinite(high) & np.isfinite(x)
        if known.sum() > 1:
            ring = [*zip(x[known], high[known], strict=True)]
            ring += [*zip(x[known][::-1], low[known][::-1], strict=True)]
            band = f'<path class="band {kind}" d="{_line(ring)}Z"/>'
    shown_x, shown_y = thinned(c)
    x, y = across(shown_x), down(shown_y)
    if c.kind == "steps":
        x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
    return f'{band}<path class="line {kind}" d="{_line([*zip(x, y, strict=True)])}"/>'


def _line(points: Sequence[tuple[float, float]]) -> str:
    """A path through points; those that are not finite break it."""
    parts, pen = [], "M"
    for x, y in points:
        if math.isfinite(x) and math.isfinite(y):
            parts.append(f"{pen}{x:.1f} {min(max(y, -999.0), 9999.0):.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(parts)


def _points(
    mark: str,
    kind: str,
    x: Array,
    y: Array,
    low: Array | None,
    high: Array | None,
    lying: bool,
) -> str:
    parts = []
    for k, (a, b) in enumerate(zip(x, y, strict=True)):
        if not (math.isfinite(a) and math.isfinite(b)):
            continue
        if low is not None and high is not None and math.isfinite(low[k] + high[k]):
            way = (
                f"M{low[k]:.1f} {b:.1f}H{high[k]:.1f}"
                if lying
                else (f"M{a:.1f} {low[k]:.1f}V{high[k]:.1f}")
            )
            parts.append(f'<path class="line {kind}" d="{way}"/>')
        if mark == "marks":
            cross = f"M{a - 3:.1f} {b - 3:.1f}l6 6m0 -6l-6 6"
            parts.append(f'<path class="line {kind}" d="{cross}"/>')
        else:
            parts.append(f'<circle class="dot {kind}" cx="{a:.1f}" cy="{b:.1f}" r="2.2"/>')
    return "".join(parts)


def _short(value: float) -> str:
    text = f"{value:.4g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
    return text.replace("-", "−")
