"""What moves over a plane of a page: drawn by the style sheet, without a script.

A row of radio buttons is the time (arrow keys go along it), a checkbox plays from there. Whoever
has asked the system for less motion has the row only; print has neither.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array

FRAMES = 60
"""Places of a way between which a page moves straight on."""

INSTANTS = 21
"""Times that can be chosen."""

LONGEST = 20.0
"""A longer drive is played so fast that it takes so long [s]."""


@dataclass(frozen=True, eq=False)
class Mover:
    """An outline that moves.

    Attributes:
        t: evenly spaced times [s], (n,).
        x, y: its place [m], (n,).
        heading: counter-clockwise from the x axis, without jumps [rad], (n,).
        outline: its corners around (0, 0), the heading 0 along x [m], (m, 2).
        colour: index into the series; -1 for what stands in the way.
    """

    t: Array
    x: Array
    y: Array
    heading: Array
    outline: Array
    colour: int = 0

    def at(self, k: int) -> Array:
        """Its outline at the k-th time [m], (m, 2)."""
        c, s = np.cos(self.heading[k]), np.sin(self.heading[k])
        return np.asarray(self.outline @ np.array([[c, s], [-s, c]]) + [self.x[k], self.y[k]])


def mover(t: Array, x: Array, y: Array, heading: Array, outline: Array, colour: int = 0) -> Mover:
    """A mover over as many places as a page shows."""
    times = np.linspace(t[0], t[-1], FRAMES + 1)
    x, y, heading = (np.interp(times, t, v) for v in (x, y, heading))
    return Mover(times, x, y, heading, outline, colour)


def instants(movers: Sequence[Mover]) -> list[str]:
    """The times that can be chosen, in words."""
    first = movers[0].t
    return [f"{v:.1f} s" for v in np.linspace(first[0], first[-1], INSTANTS)]


Scale = Callable[[Array], Array]


def drawn(movers: Sequence[Mover], across: Scale, down: Scale, kinds: Sequence[str]) -> str:
    """The outlines as paths of an SVG, and the rules that move them.

    Args:
        across, down: from metres to pixels, alike but for the direction.
        kinds: class of each colour.
    """
    if not movers:
        return ""
    first = movers[0].t
    seconds = min(float(first[-1] - first[0]), LONGEST)
    rules, paths = [], []
    for k, (m, kind) in enumerate(zip(movers, kinds, strict=True)):
        zero = np.zeros(1)
        corners = zip(across(m.outline[:, 0]) - across(zero), down(m.outline[:, 1]) - down(zero),
                      strict=True)  # fmt: skip
        ring = "L".join(f"{a:.2f} {b:.2f}" for a, b in corners)
        paths.append(f'<path class="mover m{k} {kind}" d="M{ring}Z"/>')
        places = [
            f"translate({a:.1f}px,{b:.1f}px) rotate({-np.degrees(h):.0f}deg)"
            for a, b, h in zip(across(m.x), down(m.y), m.heading, strict=True)
        ]
        frames = "".join(f"{100.0 * i / (len(places) - 1):.2f}%{{transform:{p}}}"
                         for i, p in enumerate(places))  # fmt: skip
        rules.append(f"@keyframes m{k}{{{frames}}}.m{k}{{transform:{places[0]}}}")
        chosen = np.linspace(0, len(places) - 1, INSTANTS).round().astype(int)
        rules += [f"{_at(i)} .m{k}{{transform:{places[at]}}}" for i, at in enumerate(chosen)]
        play = f"animation:m{k} {seconds:.2f}s linear var(--from,0s) forwards"
        rules.append(f"@media (prefers-reduced-motion: no-preference)"
                     f"{{figure:has(.play:checked) .m{k}{{{play}}}}}")  # fmt: skip
    starts = (f"{_at(i)}{{--from:-{seconds * i / (INSTANTS - 1):.2f}s}}" for i in range(INSTANTS))
    return f"<style>{''.join(rules)}{''.join(starts)}</style>{''.join(paths)}"


def _at(i: int) -> str:
    return f'figure:has(.at[value="{i}"]:checked)'
