"""Test whether an output integrates its inputs, as a stroke or a heading does.

Over a block from t₁ to t₂, where ū and ȳ are the means in it and ū₋ is that of the block before,
and with blocks at an end stop left out,

    y(t₂) − y(t₁) = bᵀ ū + b₋ᵀ ū₋ + rᵀ s̄ + r₋ᵀ s̄₋ − ȳ / τ + c,    s = sign u,

where r is what dry friction takes of an input of both signs: in a loop it would look like a pull of
the level.
Unused columns that act on the output, such as the weather, stand beside u: their level hides the
pull of its own. An output integrates where its inputs explain its changes and its level does not
pull it back: 1/τ is not above zero beyond chance, and τ is longer than what the log can show.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.checks.direction import acting_columns
from sysid.data.finding import Finding
from sysid.data.impulse import least_squares, lengths
from sysid.data.record import Array, Record, block_means

BLOCKS = 400
"""Blocks of all records together."""

DRIVEN = 0.3
"""Share of the changes that the inputs explain at least."""

PULLED = -3.0
"""Value of Student's t from which down the level pulls the output back."""

FOREVER = 0.3
"""A time constant longer than this share of the records is an integrator's; of what its unit says
is a position, any that the records do not show."""

GROUPS = 20
"""Stretches of a log whose errors are taken as independent of each other."""

FOLLOWS = 0.5
"""An output of which the inputs of the same time explain more than this share follows them."""

END = 0.01
"""Share of its range within which an output is at an end."""

POSITIONS = ("rad", "m")
"""Units of positions; what is written in degrees, turns, counts or millimetres is read in these."""

MIN_SAMPLES = 200

SPEEDS = ("rad/s", "m/s")
"""Units of speeds: a body without drag is a first-order model with a pole near one, no position."""


@dataclass(frozen=True)
class Integral:
    """An output whose speed follows an input.

    Attributes:
        output, input: of these the input of largest effect.
        stopped: share of rows at an end of the range while that input pushes on, 0 … 1.
    """

    output: str
    input: str
    stopped: float


def integrals(records: Sequence[Record]) -> tuple[Integral, ...]:
    """The outputs that integrate, speeds apart; none of a robot's, whose structures know it."""
    first = records[0]
    if first.is_robot_log or not first.nu:
        return ()
    seen = [_integral(records, j) for j, c in enumerate(first.outputs) if c.unit not in SPEEDS]
    return tuple(s for s in seen if s is not None)


def _integral(records: Sequence[Record], j: int) -> Integral | None:
    every = max(1, sum(map(len, records)) // BLOCKS)
    y = np.concatenate([r.y[:, j] for r in records])
    low, width = float(y.min()), float(np.ptp(y))
    u = np.concatenate([r.u for r in records])
    means, both = u.mean(axis=0), (u.min(axis=0) < 0.0) & (u.max(axis=0) > 0.0)
    nu = records[0].nu
    acting = acting_columns(records, j, every)
    rows, changes, ends = [], [], []
    for r in records:
        n = (len(r) - 1) // every
        if n < 4:
            continue
        of_u = block_means(r.u[: n * every] - means, every)
        of_way = block_means(np.sign(r.u[: n * every]) * both, every)
        level = block_means(r.y[: n * every], every)[:, j]
        step = np.diff(r.y[: n * every + 1 : every, j])
        columns = np.empty((len(r), 0)) if r.unused is None else r.unused[:, acting]
        of_c = block_means(columns[: n * every], every)
        ways = (of_way[1:], of_way[:-1], of_c[1:])
        rows.append(np.column_stack([of_u[1:], of_u[:-1], *ways, level[1:], np.ones(n - 1)]))
        changes.append(step[1:])
        side = (level[1:] - low) / max(width, 1e-300)
        ends.append((side >= 1.0 - END).astype(float) - (side <= END))
    if not rows or width == 0.0:
        return None
    every_X, every_d, end = map(np.concatenate, (rows, changes, ends))
    X, d = every_X[end == 0.0], every_d[end == 0.0]
    if len(d) < 40:
        return None
    theta, rest = least_squares(X, d)
    left, without = float(rest @ rest), _left(X[:, 4 * nu :], d)
    now = np.column_stack([X[:, : 2 * nu], X[:, -1:]])
    follows = 1.0 - _left(now, X[:, -2]) / float(np.sum((X[:, -2] - X[:, -2].mean()) ** 2))
    pull = float(theta[-2])
    if without - left < DRIVEN * without or left <= 0.0 or follows > FOLLOWS:
        return None
    length = sum(len(r) for r in records) / every
    known = records[0].outputs[j].unit in POSITIONS
    if pull < PULLED * _pull_error(X, rest) or (-pull * FOREVER * length > 1.0 and not known):
        return None
    total = theta[:nu] + theta[nu : 2 * nu]
    i = int(np.argmax(np.abs(total * X[:, :nu].std(axis=0))))
    free = every_X @ theta  # the changes of an output that nothing stops
    pushed = free * end > 0.5 * float(np.std(free))
    stopped = pushed & (every_d * end < 0.5 * np.abs(free))
    return Integral(records[0].output_names[j], records[0].input_names[i], float(np.mean(stopped)))


def _pull_error(X: Array, rest: Array) -> float:
    """Standard error of the pull, also where the errors of neighbouring blocks are alike.

    What dry friction takes from an axis is alike as long as it stands. With s_k the sum of xᵢ eᵢ
    over the k-th of ``GROUPS`` stretches: (XᵀX)⁻¹ Σ s_k s_kᵀ (XᵀX)⁻¹ (Liang & Zeger 1986).
    """
    size = lengths(X)
    unit = X / size
    ends = np.linspace(0, len(X), GROUPS + 1).astype(int)[:-1]
    sums = np.add.reduceat(unit * rest[:, None], ends, axis=0)
    pulls = sums @ np.linalg.pinv(unit.T @ unit)[-2] / size[-2]
    return float(np.sqrt(GROUPS / (GROUPS - 1) * (pulls @ pulls)))


def counts_that_integrate(
    findings: Sequence[Finding], records: Sequence[Record]
) -> tuple[Finding, ...]:
    """The findings without those of running counts that are none: ticks of one sample each.

    A count that its input does not move on, but to a level, is a speed; of a robot's and of what is
    too short to say, the finding stays.
    """
    said = [f for f in findings if f.code == "running-count"]
    unclear = records[0].is_robot_log or not records[0].nu or sum(map(len, records)) < MIN_SAMPLES
    if not said or unclear:
        return tuple(findings)
    moving = {s.output for s in integrals(records)}
    return tuple(f for f in findings if f not in said or f.channel in moving)


def _left(X: Array, y: Array) -> float:
    return float(np.sum(least_squares(X, y)[1] ** 2))


def integrates(records: Sequence[Record]) -> bool:
    """Whether the output of a log of one input and one output integrates."""
    return records[0].nu == records[0].ny == 1 and bool(integrals(records))


def is_position(records: Sequence[Record], output: int) -> bool:
    """Whether an output is a position: by its unit, or where that is unknown by its measurements.

    Args:
        records: a motor an output, each with the input of its own number.
    """
    channel = records[0].outputs[output]
    if channel.unit:
        return channel.unit in POSITIONS
    motors = [
        r.select(r.input_names[output : output + 1], r.output_names[output : output + 1])
        for r in records
    ]
    return integrates(motors)
