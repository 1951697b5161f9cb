"""Test whether an input is a controller's instant answer to an output.

A proportional-integral controller computes, with constants of each experiment,

    u(t) = a y(t) + b Σ_{k≤t} y(k) + c t + d,

and with the references in the log also what is proportional to r(t) and to its sum.

In open loop, with a delay of at least one sample, y(t) knows nothing of what is new in u(t): the
law can leave no less of the input than a prediction of u(t) from the past of u and y leaves. Where
it leaves far less, y(t) decides u(t). A gain alone (b = 0) is not judged: an input that is passed
on within the sample looks the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.impulse import least_squares
from sysid.data.record import Record

EXACT = 0.01
"""Share of the input's variance that a law may leave."""

DECIDED = 0.25
"""Share of what the past leaves open of the input that the law may leave."""

NEEDED = 4.0
"""A term of the law counts where without it so many times as much is left."""

PAST = 4
"""Samples of the past."""


@dataclass(frozen=True)
class ControlLaw:
    """u = gain·(y + Σ y dt / integral_time) + …, gain in the units of the record.

    Attributes:
        gain: what one unit of the output changes in the input at once.
        integral_time: [s].
        explained: share of the input's variance, 0 … 1.
    """

    gain: float
    integral_time: float
    explained: float


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
    lines, target = np.concatenate(line), np.concatenate(u)
    terms = {"y": np.concatenate(y), "sum": np.concatenate(total)}
    theta, rest = least_squares(np.column_stack([*terms.values(), lines]), target)
    left = float(rest @ rest)
    spread = float(np.sum((target - target.mean()) ** 2))
    columns = np.column_stack([np.concatenate(past), np.ones(len(target))])
    others = [*(np.column_stack([x, lines]) for x in terms.values()), columns]
    without = [float(np.sum(least_squares(X, target)[1] ** 2)) for X in others]
    needed = NEEDED * max(left, 1e-12 * spread)
    if left > EXACT * spread or left > DECIDED * without[-1] or min(without) < needed:
        return None
    gain, rate = float(theta[0]), float(theta[1]) / records[0].dt
    if gain * rate <= 0.0:  # an integral part pushes the way of the proportional one
        return None
    return ControlLaw(gain, gain / rate, 1.0 - left / spread)
