"""Test whether an input is a controller's instant answer to an output.

A controller computes, with constants of each experiment,

    u(t) = a y(t) + b Σ_{k≤t} y(k) + d y(t−1) + c t + e,

and with the references in the log also what is proportional to r(t) and to its sum.

In open loop, with a delay of at least one sample, y(t) knows nothing of what is new in u(t): the
law can leave no less of the input than a prediction of u(t) from the past of u and y leaves. Where
it leaves far less, y(t) decides u(t). Without an integral part (b = 0) the same is left by a plant
that passes its input on within the sample, y(t) = (u(t) − d y(t−1))/a: such a law says no more than
that it holds. One with an integral part would be that of a plant without static gain.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.impulse import least_squares
from sysid.data.record import Array, Record

EXACT = 0.01
"""Share of the input's variance that a law may leave."""

DECIDED = 0.25
"""Share of what the past leaves open of the input that the law may leave."""

NEEDED = 4.0
"""A term of the law counts where without it so many times as much is left."""

PAST = 4
"""Samples of the past."""

OPEN = 0.05
"""Share of the input's variance that its past must leave open for a law without an integral part:
a smooth input follows from its past, and so from an output that it moves."""

ROUNDED = 4.0
"""Variances of rounding (a twelfth of the squared last digit) that what is left may have."""

LAWS = (("y", "sum"), ("y", "before", "sum"), ("y",), ("y", "before"))
"""Terms of the laws, in the order in which they are tried: PI, PID, P, PD."""


@dataclass(frozen=True)
class ControlLaw:
    """u = gain·(y + Σ y dt / integral_time + …) + …, gain in the units of the record.

    Attributes:
        gain: what one unit of the output changes in the input for good.
        integral_time: [s]; infinite without an integral part.
        explained: share of the input's variance, 0 … 1.
        computed: whether the output at this instant decides the input but for the rounding of both,
            as what a computer has computed from the column does, and no sensor.
    """

    gain: float
    integral_time: float
    explained: float
    computed: bool

    @property
    def integrates(self) -> bool:
        """Whether it has an integral part, so that no plant looks like it."""
        return bool(np.isfinite(self.integral_time))


def control_law(records: Sequence[Record], i: int, j: int) -> ControlLaw | None:
    """The law by which input j follows output i; None where it follows none."""
    y, total, past, line, u = [], [], [], [], []
    mean = float(np.mean(np.concatenate([r.y[:, i] for r in records])))
    usable = [r for r in records if len(r) > 10 * PAST and np.ptp(r.u[:, j]) > 0.0]
    same = len({r.reference_names for r in usable}) == 1
    for k, r in enumerate(usable):
        own = np.zeros((len(r), 2 * len(usable)))
        own[:, 2 * k], own[:, 2 * k + 1] = 1.0, np.linspace(-1.0, 1.0, len(r))
        wished = r.references if r.references is not None and same else np.zeros((len(r), 0))
        wished = wished - wished.mean(axis=0)
        own = np.hstack([own, wished, np.cumsum(wished, axis=0)])
        of_y, of_u = r.y[:, i] - mean, r.u[:, j]
        lagged = [x[PAST - q : len(x) - q] for q in range(1, PAST + 1) for x in (of_y, of_u)]
        y.append(of_y[PAST:])
        total.append(np.cumsum(of_y)[PAST:])
        past.append(np.column_stack([*lagged, wished[PAST:], wished[PAST - 1 : -1]]))
        line.append(own[PAST:])
        u.append(of_u[PAST:])
    if not usable:
        return None
    lines, target, before = np.concatenate(line), np.concatenate(u), np.concatenate(past)
    terms = {"y": np.concatenate(y), "before": before[:, 0], "sum": np.concatenate(total)}
    spread = float(np.sum((target - target.mean()) ** 2))
    unknown = _left(np.column_stack([before, np.ones(len(target))]), target)
    for law in LAWS:
        if "sum" not in law and unknown < OPEN * spread:
            return None
        columns = [terms[name] for name in law]
        theta, rest = least_squares(np.column_stack([*columns, lines]), target)
        left = float(rest @ rest)
        if left > EXACT * spread or left > DECIDED * unknown:
            continue
        without = [
            _left(np.column_stack([*(c for c in columns if c is not x), lines]), target)
            for x in columns
        ]
        if min(*without, unknown) < NEEDED * max(left, 1e-12 * spread):
            continue
        gain = float(theta[: 1 + ("before" in law)].sum())
        rate = float(theta[len(law) - 1]) / records[0].dt if "sum" in law else 0.0
        if gain * rate < 0.0:  # an integral part pushes the way of the proportional one
            continue
        time = gain / rate if rate else np.inf
        step = _last_digit(target) + abs(gain) * _last_digit(terms["y"] + mean)
        rounding = ROUNDED * step**2 / 12.0 * len(target)
        fine = rounding < EXACT * spread  # else two levels would count as rounded, too
        computed = law == ("y",) and fine and left <= max(rounding, 1e-12 * spread)
        return ControlLaw(gain, time, 1.0 - left / spread, computed)
    return None


def _left(X: Array, target: Array) -> float:
    """Squared errors of a regression."""
    return float(np.sum(least_squares(X, target)[1] ** 2))


def _last_digit(x: Array) -> float:
    """The decimal that a column is written to; 0 beyond nine of them."""
    for decimals in range(10):
        if np.max(np.abs(np.round(x, decimals) - x)) < 1e-12 * np.max(np.abs(x)):
            return float(10.0**-decimals)
    return 0.0
