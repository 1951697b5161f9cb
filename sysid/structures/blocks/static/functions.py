"""Static nonlinearities of one channel: chains of stages, and how they are written.

Stages are joined by commas, the first one first: ``abs,polynomial:3``. The kinds of stages are in
``static_kinds``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.errors import UsageError
from sysid.outside_text import whole
from sysid.structures.blocks.static.kinds import KINDS, Stage

MAX_SIZE = 40
"""Largest number of points or highest degree: more than any log of a machine supports."""

CLOSEST = 0.02
"""Least distance of neighbouring points, as a share of their range: two in one place are a jump."""

EXAMPLES = "dead-zone, piecewise:8 or abs,polynomial:3"


@dataclass(frozen=True)
class Static:
    """A chain of stages; its parameters p are those of the stages, one after the other."""

    stages: tuple[Stage, ...] = ()

    @property
    def text(self) -> str:
        """The static as users type it."""
        return ",".join(s.text for s in self.stages) or "identity"

    @property
    def is_identity(self) -> bool:
        return not self.stages

    @property
    def has_gain(self) -> bool:
        """Whether a factor of the signal could be moved into its parameters."""
        return any(KINDS[s.kind].has_gain for s in self.stages)

    @property
    def has_offset(self) -> bool:
        """Whether its parameters can add any constant to its value."""
        return bool(self.stages) and KINDS[self.stages[-1].kind].has_offset

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(n for s in self.stages for n in s.names)

    @property
    def n(self) -> int:
        return len(self.names)

    def slices(self) -> tuple[slice, ...]:
        """Where each stage's parameters stand."""
        edges = np.cumsum([0, *(len(s.names) for s in self.stages)]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(edges))

    def value(self, x: Any, p: Any, xp: Any = np) -> Any:
        """f(x), over any array namespace."""
        for stage, part in zip(self.stages, self.slices(), strict=True):
            x = stage.value(x, p[part], xp)
        return x

    def evaluated(self, x: Array, p: Array) -> tuple[Array, Array, Array]:
        """(f(x), ∂f/∂x, ∂f/∂p (n, …)) by the chain rule."""
        slope = np.ones_like(x)
        partials: list[Array] = []
        for stage, part in zip(self.stages, self.slices(), strict=True):
            x, inner, slopes = stage.evaluated(x, p[part])
            partials = [*(d * inner for d in partials), slopes]
            slope = slope * inner
        return x, slope, np.concatenate(partials) if partials else np.zeros((0, *x.shape))

    def admissible_each(self, p: Array) -> NDArray[np.bool_]:
        """Whether limits and points stand in increasing order, points not all but together.

        For every row of p (K, n), (K,).
        """
        admissible = np.ones(len(p), dtype=bool)
        for stage, part in zip(self.stages, self.slices(), strict=True):
            rising = p[:, part][:, : KINDS[stage.kind].ordered(stage.size)]
            if rising.shape[1] < 2:
                continue
            share = CLOSEST if stage.size > 2 else 0.0
            least = np.maximum(share * (rising[:, -1:] - rising[:, :1]), 0.0)
            admissible &= ~np.any(np.diff(rising, axis=1) <= least, axis=1)
        return admissible

    def to_json(self) -> dict[str, Any]:
        """{text, knots}: what ``from_json`` needs."""
        return {"text": self.text, "knots": [list(s.knots) for s in self.stages]}

    @staticmethod
    def from_json(raw: Mapping[str, Any]) -> "Static":
        plain = parse_static(str(raw["text"]))
        knots = [tuple(float(t) for t in row) for row in raw["knots"]]
        return Static(tuple(replace(s, knots=k) for s, k in zip(plain.stages, knots, strict=True)))


def parse_static(text: str) -> Static:
    """Read ``dead-zone``, ``piecewise:8`` or ``abs,polynomial:3``."""
    stages: list[Stage] = []
    for item in text.replace(" ", "").lower().split(","):
        kind, colon, number = item.partition(":")
        if kind not in KINDS:
            raise UsageError(
                f"`structure_options`: there is no static {item!r}; the kinds are "
                f"{', '.join(KINDS)}, joined by commas, e.g. {EXAMPLES}"
            )
        least = KINDS[kind].smallest
        size = whole(number) or 0
        if least and not least <= size <= MAX_SIZE:
            raise UsageError(
                f"`structure_options`: {item!r} needs a size from {least} to {MAX_SIZE}, "
                f"e.g. {kind}:{max(least, 5)}"
            )
        if colon and not least:
            raise UsageError(
                f"`structure_options`: {kind} has no size; write {kind} instead of {item!r}"
            )
        if kind == "identity":
            continue
        stage = Stage(kind, size if least else 0)
        if set(stage.names) & {n for s in stages for n in s.names}:
            raise UsageError(
                f"`structure_options`: {text!r} has two stages with the same parameters"
            )
        stages.append(stage)
    return Static(tuple(stages))


IDENTITY = Static()
