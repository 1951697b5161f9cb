"""Gains from the plant alone: rules for a lag with dead time, and for the edge of stability.

Sources: Ziegler and Nichols, Trans. ASME 64 (1942); Cohen and Coon, Trans. ASME 75 (1953);
Rivera, Morari and Skogestad, Ind. Eng. Chem. Process Des. Dev. 25 (1986) for λ; Skogestad,
J. Process Control 13 (2003) for SIMC. The thesis (§4.6.1) names the first two.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from sysid.robot.mission.control.linear import PIDTerms
from sysid.robot.mission.tuning.axes import Axis, AxisAnswer


@dataclass(frozen=True)
class LagModel:
    """A lag with dead time, K e^{−θs}/(τs + 1), behind an integrator for the yaw.

    Attributes:
        gain: K [m/s or rad/s per full drive].
        lag: τ [s].
        dead_time: θ [s], half a control period included: the command is held over one.
    """

    gain: float
    lag: float
    dead_time: float


def lag_model(answer: AxisAnswer, period: float) -> LagModel:
    """The lag with dead time that fits an answer to a step best in the sense of least squares.

    Args:
        period: of control [s].
    """
    from scipy.optimize import minimize_scalar

    t = np.arange(len(answer.step)) * answer.dt
    share = answer.step / answer.gain

    def lag_of(dead: float) -> tuple[float, float]:
        """The best lag at a dead time, and the squared error."""
        after = np.maximum(t - dead, 0.0)
        area = float(np.sum(1.0 - share[t >= dead]) * answer.dt)  # ∫(1 − s) = τ from there on

        def error(lag: float) -> float:
            return float(np.sum((share + np.expm1(-after / lag)) ** 2))

        high = max(4.0 * abs(area), 4.0 * answer.dt)
        minimum = minimize_scalar(error, bounds=(1e-3 * answer.dt, high), method="bounded")
        return float(minimum.x), float(minimum.fun)

    first = t[np.flatnonzero(np.abs(share) > 0.5)[0]]  # the dead time ends before the middle
    dead = minimize_scalar(
        lambda d: lag_of(d)[1], bounds=(0.0, max(first, answer.dt)), method="bounded"
    ).x
    lag, _ = lag_of(float(dead))
    return LagModel(answer.gain, lag, float(dead) + 0.5 * period)


def _parallel(kp: float, ti: float = math.inf, td: float = 0.0) -> PIDTerms:
    """kp (e + ∫e dt/ti + td de/dt) (thesis 4.32)."""
    return PIDTerms(kp, kp / ti, kp * td)


def _ziegler_nichols(m: LagModel) -> dict[str, PIDTerms]:
    a, theta = m.gain * m.dead_time / m.lag, m.dead_time
    return {
        "p": _parallel(1 / a),
        "pi": _parallel(0.9 / a, theta / 0.3),
        "pid": _parallel(1.2 / a, 2 * theta, 0.5 * theta),
    }


def _cohen_coon(m: LagModel) -> dict[str, PIDTerms]:
    r, theta = m.dead_time / m.lag, m.dead_time
    a = m.gain * r
    return {
        "p": _parallel((1 + r / 3) / a),
        "pi": _parallel((0.9 + r / 12) / a, theta * (30 + 3 * r) / (9 + 20 * r)),
        "pid": _parallel(
            (4 / 3 + r / 4) / a, theta * (32 + 6 * r) / (13 + 8 * r), theta * 4 / (11 + 2 * r)
        ),
    }


def _lambda(m: LagModel) -> dict[str, PIDTerms]:
    """IMC with λ = τ: the closed loop is as quick as the plant, without overshoot."""
    return {"pi": _parallel(m.lag / (m.gain * (m.lag + m.dead_time)), m.lag)}


def _simc(m: LagModel) -> dict[str, PIDTerms]:
    """τ_c = θ, which Skogestad recommends."""
    closed = 2 * m.dead_time
    return {"pi": _parallel(m.lag / (m.gain * closed), min(m.lag, 4 * closed))}


_OF_A_LAG: Mapping[str, Callable[[LagModel], dict[str, PIDTerms]]] = {
    "ziegler-nichols": _ziegler_nichols,
    "cohen-coon": _cohen_coon,
    "lambda": _lambda,
    "simc": _simc,
}


def _integrating(m: LagModel) -> dict[str, dict[str, PIDTerms]]:
    """Rules for K e^{−θs}/(s(τs + 1)); a lag counts as dead time where no derivative meets it.

    Ziegler and Nichols look at the slope K and the apparent dead time L; Cohen and Coon have no
    rule for an integrator: theirs tends to 1/(KL) with the lag growing.
    """
    apparent = m.dead_time + m.lag
    slope = m.gain * apparent
    return {
        "ziegler-nichols": {
            "p": _parallel(1 / slope),
            "pi": _parallel(0.9 / slope, apparent / 0.3),
            "pid": _parallel(1.2 / slope, 2 * apparent, 0.5 * apparent),
        },
        "lambda": {"p": _parallel(1 / (m.gain * (3 * m.lag + apparent)))},
        "simc": {
            "p": _parallel(1 / (2 * slope)),
            "pd": _parallel(1 / (m.gain * 2 * m.dead_time), td=m.lag),
            "pi": _parallel(1 / (2 * slope), 8 * apparent),
        },
    }


def from_lag(axis: Axis, model: LagModel) -> dict[str, dict[str, PIDTerms]]:
    """Gains by rule and kind of controller.

    Args:
        axis: of the yaw it is the integral that is controlled.
    """
    if axis is Axis.YAW:
        return _integrating(model)
    return {name: rule(model) for name, rule in _OF_A_LAG.items()}


def from_edge(ultimate_gain: float, ultimate_period: float) -> dict[str, PIDTerms]:
    """Ziegler and Nichols' gains from a proportional loop on the edge of stability.

    Args:
        ultimate_gain: K_u.
        ultimate_period: of its oscillation [s].
    """
    ku, tu = ultimate_gain, ultimate_period
    return {
        "p": _parallel(0.5 * ku),
        "pi": _parallel(0.45 * ku, tu / 1.2),
        "pid": _parallel(0.6 * ku, tu / 2, tu / 8),
    }
