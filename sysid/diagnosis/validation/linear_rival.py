"""The linear rival of a nonlinear effect: a linear model of higher order than the base.

A spring, an elastic part or creep adds a pole and a zero. A base without them leaves errors of
which some nonlinear law always takes a part. What a linear model of higher order from the track's
own command, y = B(q)/F(q) u, explains of what is left is said beside the answer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.selection import Selection
from sysid.errors import SysidError
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.pem import fit
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.structures.linear.families import OE

MORE = (1, 2)
"""Orders above the base's that are tried: each part that stores energy or flow adds one."""

ROUGH = FitOptions(focus=Focus.SIMULATION, stable=True, max_evaluations=20, tolerance=1e-4)
"""Where linear motion is the answer a search ends at once; where it is not, its last digits do not
matter."""


@dataclass(frozen=True, eq=False)
class LinearRival:
    """Linear models of a higher order, one an output.

    Attributes:
        orders: of each output; the base's where no higher one can be fitted, (ny,).
        rmse: held-out RMSE of each output, infinite where none can be fitted, (ny,).
    """

    orders: tuple[int, ...]
    rmse: Array

    def better(self, selection: Selection) -> NDArray[np.bool_]:
        """Outputs that it explains better than the augmented model, (ny,)."""
        after = np.sqrt(selection.final.errors.mean_squares()[1])
        return np.asarray(self.rmse < RULE.held_out * after)

    def words(self, selection: Selection, floor: Array, names: Sequence[str]) -> str:
        """What linear motion explains of the errors that are left; empty where that is nothing."""
        after, better = selection.final.errors.mean_squares()[1], self.better(selection)
        above, rest = after - floor**2, np.maximum(self.rmse**2 - floor**2, 0.0)
        shares = [
            f"{100.0 * (1.0 - rest[i] / above[i]):.0f} % of the error of {name} (order {order})"
            for i, (name, order) in enumerate(zip(names, self.orders, strict=True))
            if better[i] and above[i] > 0.0
        ]
        if not shares:
            return ""
        return (
            f"A linear model of higher order explains {', '.join(shares)} above the noise: the "
            "model lacks a state, such as a spring, an elastic part or a store of energy"
        )


def linear_rival(base: Base) -> LinearRival:
    """The best linear model of a higher order for each output, fitted on the estimation part."""
    ny = base.parts.holdout[0].ny
    rivals = [_best(base, i) for i in range(ny)]
    return LinearRival(tuple(n for n, _ in rivals), np.array([rmse for _, rmse in rivals]))


def _best(base: Base, i: int) -> tuple[int, float]:
    """(order, held-out RMSE) of one output."""
    parts, order_of_base = base.parts, base.search.model.order
    weights, counts = parts.weights
    if parts.holdout is parts.estimation:
        holdout = _columns(
            parts.estimation, i, [a + b for a, b in zip(*parts.weights, strict=True)]
        )
        fitted = list(hold_out(holdout).train)  # the same blocks as those of the base
    else:
        fitted = _columns(parts.estimation, i, weights)
        holdout = _columns(parts.holdout, i, counts)
    delay, later = base.search.delay, base.search.later
    nk = [[delay + d for d in later]] if later else delay
    best, facts = (order_of_base, np.inf), LogFacts(tuple(fitted))
    detrend = "none" if fitted[0].is_robot_log else "auto"
    for order in (order_of_base + more for more in MORE):
        structure = OE.from_orders({"nb": order, "nf": order, "nk": nk}, fitted[0].nu, 1)
        try:
            model = fit(structure, facts, ROUGH, detrend=detrend)
            runs = [outputs(model, r, None, Start.ESTIMATED) for r in holdout]
        except SysidError:
            continue
        each = zip(holdout, runs, counts, strict=True)
        errors = np.concatenate([(r.y - run)[w[:, i] > 0.0] for r, run, w in each])
        rmse = float(np.sqrt(np.mean(errors**2)))
        if RULE.tie * rmse < best[1]:
            best = (order, rmse)
    return best


def _columns(records: Sequence[Record], i: int, weights: Sequence[Array]) -> list[Record]:
    """One output with its own command, or with all of them; lost measurements bridged by lines."""
    columns = []
    for r, w in zip(records, weights, strict=True):
        at = np.arange(len(r))
        there = w[:, i] > 0.0
        y = np.interp(at, at[there], r.y[there, i])[:, None]
        own = [i] if r.nu == r.ny else list(range(r.nu))
        inputs = tuple(r.inputs[k] for k in own)
        plain = Record(r.u[:, own], y, r.dt, inputs, (r.outputs[i],), t0=r.t0, name=r.name)
        columns.append(plain)
    return columns
