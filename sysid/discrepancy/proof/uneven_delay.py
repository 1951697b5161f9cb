"""Commands that act unevenly late: jitter of a line or a board, which no model can foretell.

A model knows one delay. Where the delay of each change of the command is drawn anew, the errors
behind a change are the slope of its response, by as much as this one was early or late.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sysid.data.record import Array
from sysid.discrepancy.base_model import Base
from sysid.discrepancy.search.named_sets import Node
from sysid.effects.catalogue import DELAY

SHIFT = 0.5
"""By which the delay is moved for its slope [samples]."""

MOVES = 0.05
"""Change of the drive that shows an instant, of full drive."""

HOLDS = 1e-3
"""Change of the drive below which it holds."""

FEWEST = 15
"""Changes that a spread is told from: it is then known to a fifth."""

SHORTEST, LONGEST = 3, 12
"""Samples behind a change that tell when it acted; the next one must leave as many."""

MOST = 0.5
"""Share of the errors behind changes that uneven delays must explain: else it is something else."""

FORETOLD = 0.3
"""Share of the delays that command and change may foretell: else they are no jitter but an effect
that depends on them."""

SURE = 3.0
"""Mean square of the delays in units of their squared standard errors, beyond noise alone."""


MEDIAN = 0.455
"""Median of a squared standard normal number."""

REACH = 2.0
"""Spreads by which a delay is early or late: one in twenty is by more."""

Rows = tuple[Array, ...]
"""A number a sample, (N, ny) a record."""


@dataclass(frozen=True)
class UnevenDelay:
    """Delays of one output that differ from change to change.

    Attributes:
        output: name.
        spread: standard deviation of the delays [s].
        changes: of the command, from which it is read.
        share: of the error beyond the noise behind these changes that it explains.
    """

    output: str
    spread: float
    changes: int
    share: float

    @property
    def sentence(self) -> str:
        """What it is, and how large."""
        return (
            f"Commands act unevenly late: from change to change the delay of {self.output} varies "
            f"by {self.spread:.2g} s (standard deviation of {self.changes}), which is "
            f"{100.0 * self.share:.0f} % of its errors there. Such jitter of a line or a board no "
            "model foretells: stamp commands with the time at which they act."
        )


def uneven_delays(base: Base, node: Node, floor: Array) -> tuple[UnevenDelay, ...]:
    """Outputs whose errors behind changes of the command are delays that differ.

    δ_k = Σ e s/Σ s² over the samples behind change k, s = ∂y/∂θ.

    Args:
        base: the search.
        node: the model whose errors are asked.
        floor: noise of each output, (ny,).
    """
    search, names = base.search, base.parts.estimation[0].output_names
    model, data = search.model, search.data
    later = node.q.copy()
    for i in range(model.tracks):
        at = model.place.get((DELAY.id, DELAY.parameters[0].name, i))
        if at is None:
            return ()
        later[at] += SHIFT * model.dt
    now, then = model.run(np.array([node.q, later]), data)
    slopes = (then - now) / (SHIFT * model.dt)
    errors = np.where(data.weight > 0.0, data.y - now, np.nan)
    starts = np.cumsum([0, *data.lengths])
    found = []
    for i, name in enumerate(names):
        seen = [
            _behind(data.drive[a:b, i], errors[a:b, i], slopes[a:b, i])
            for a, b in pairwise(starts.tolist())
        ]
        rows = np.concatenate(seen)
        told = _spread(rows, float(floor[i]))
        if told is not None:
            found.append(UnevenDelay(name, told[0], len(rows), told[1]))
    return tuple(found)


def rows_apart(base: Base, late: Sequence[UnevenDelay], floor: Array) -> tuple[Rows, Rows]:
    """Which samples of both parts such delays do not spoil: 1, else 0, (N, ny) a record.

    Within ``REACH`` spreads to either side the model's reading moves by less than the noise.
    """
    search = base.search
    found = []
    for data in (search.data, search.held_data):
        runs = data.split(search.model.run(base.node.q, data)[0])
        rows = [np.ones(run.shape) for run in runs]
        for u in late:
            i = base.parts.estimation[0].output_names.index(u.output)
            reach = int(np.ceil(REACH * u.spread / search.model.dt))
            for run, kept in zip(runs, rows, strict=True):
                near = np.pad(run[:, i], reach, mode="edge")
                around = np.lib.stride_tricks.sliding_window_view(near, 2 * reach + 1)
                kept[:, i] = np.ptp(around, axis=1) < floor[i]
        found.append(tuple(rows))
    return found[0], found[1]


def _behind(drive: Array, errors: Array, slopes: Array) -> Array:
    """Of each change: Σ e s, Σ s², Σ e², samples, drive before and after, (changes, 6)."""
    steps = np.abs(np.diff(drive))
    changes = 1 + np.flatnonzero(steps > HOLDS)  # a command that always moves shows no instant
    ends = np.minimum(np.append(changes[1:], len(drive)), changes + LONGEST)
    found = []
    for a, b in zip(changes, ends, strict=True):
        if steps[a - 1] <= MOVES:
            continue
        e, s = errors[a:b], slopes[a:b]
        good = np.isfinite(e)
        if b - a < SHORTEST or good.sum() < SHORTEST or not np.any(s[good]):
            continue
        e, s = e[good], s[good]
        found.append([e @ s, s @ s, e @ e, len(e), drive[a - 1], drive[a]])
    return np.array(found).reshape(-1, 6)


def _spread(rows: Array, floor: float) -> tuple[float, float] | None:
    """Standard deviation of the delays and the share of the errors they are; None for none."""
    if len(rows) < FEWEST:
        return None
    both, power, errors, samples, before, after = rows.T
    delays = both / power
    about = float(np.sum(both) / np.sum(power))
    apart = (delays - about) ** 2 * power
    if float(np.median(apart)) < SURE * floor**2 * MEDIAN or np.mean(apart) < SURE * floor**2:
        return None
    left = float(np.sum(errors - samples * floor**2))
    share = float(np.sum(apart - floor**2)) / left if left > 0.0 else 0.0
    step = after - before
    sizes = (np.ones(len(step)), step, after)
    known = np.column_stack([*sizes, *(f(x) for x in sizes[1:] for f in (np.abs, np.sign))])
    root = np.sqrt(power)[:, None]
    fitted = known @ np.linalg.lstsq(known * root, delays * root[:, 0], rcond=None)[0]
    rest = float(np.sum((delays - fitted) ** 2 * power)) / (len(step) - known.shape[1])
    foretold = 1.0 - rest / (float(np.sum(apart)) / (len(step) - 1))
    if share < MOST or foretold > FORETOLD:
        return None
    spread = np.sqrt(max(float(np.sum(apart - floor**2)) / float(np.sum(power)), 0.0))
    return float(spread), min(share, 1.0)
