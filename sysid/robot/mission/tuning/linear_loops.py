"""Controllers of P, PI, PD or PID along their axes: gains by the rules, and margins."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.control.linear import P, PIDTerms
from sysid.robot.mission.settings import TunedSettings
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tuning.axes import Axis, AxisAnswer, answer
from sysid.robot.mission.tuning.gain_space import gain_of
from sysid.robot.mission.tuning.rules import from_edge, from_lag, lag_model

_POINTS = 8000
"""Frequencies of a loop: a crossing is found within 0.3 % of its frequency, then interpolated."""

_SLOWEST = 1e-5
"""The lowest frequency, of that of the plant's answer: an integral a thousand times slower than the
plant is seen to be one."""


_NOTHING = 1e-9
"""A loop this small counts as 0: no gain that a person sets makes it 1."""


@dataclass(frozen=True)
class Margins:
    """How far a loop is from the edge of stability.

    Attributes:
        gain: factor by which the loop's gain may grow; infinite where the phase never crosses.
        phase_deg: phase that may be lost at the crossover [°]; infinite where the gain is below 1.
        delay_s: dead time that may be added [s].
        crossover: frequency where the loop's gain is 1 [rad/s]; 0 where it never is.
        peak: largest sensitivity |1/(1 + L)|: below 2 is robust, above 4 is fragile.
    """

    gain: float
    phase_deg: float
    delay_s: float
    crossover: float
    peak: float
    stable: bool


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """The plant of one axis as its controller meets it, once a period.

    G(z) = Σ g_k z^{−k} of the answer's differences, times T/2·(z + 1)/(z − 1) for the yaw, whose
    rate is integrated by the trapezoidal rule. The measurement of an instant and the command it
    leads to share the instant, as in the simulated loop.

    Attributes:
        omega: frequencies up to Nyquist's, (N,) [rad/s].
        plant: G(e^{jωT}), (N,).
        period: T [s].
        integrates: whether the plant does, as the yaw.
    """

    omega: Array
    plant: NDArray[np.complex128]
    period: float
    integrates: bool

    @classmethod
    def of(cls, answer: AxisAnswer, period: float) -> "SampledLoop":
        """The loop around an answer, sampled with the control period; from slow to Nyquist's."""
        sampled = answer.sampled(period)
        differences = np.diff(sampled.step, prepend=0.0)
        slowest = _SLOWEST / (len(differences) * period)
        omega = np.geomspace(slowest, math.pi / period, _POINTS)
        z = np.exp(1j * omega * period)
        plant = np.polynomial.polynomial.polyval(1 / z, differences.astype(np.complex128))
        if answer.axis is Axis.YAW:
            plant = plant * 0.5 * period * (z + 1) / (z - 1)
        return cls(omega, plant, period, answer.axis is Axis.YAW)

    def controller(self, gains: PIDTerms) -> NDArray[np.complex128]:
        """C = kp + ki T z/(z − 1) + kd F (z − 1)/(T z), as the loop's laws sum and difference.

        F = a z/(z − 1 + a) with a = T/(T_f + T) is the derivative's filter, 1 without one.
        """
        z, T = np.exp(1j * self.omega * self.period), self.period
        share = T / (gains.filter_time + T)
        filtered = share * z / (z - 1 + share)
        response: NDArray[np.complex128] = (
            gains.kp + gains.ki * T * z / (z - 1) + gains.kd * filtered * (z - 1) / (T * z)
        )
        return response

    def edge(self) -> tuple[float, float] | None:
        """Gain and period [s] of a proportional loop on the edge of stability; None: no edge."""
        gain, at = _gain_margin(self.omega, self.plant)
        return (gain, 2 * math.pi / at) if math.isfinite(gain) else None

    def margins(self, gains: PIDTerms) -> Margins:
        loop = self.plant * self.controller(gains)
        gain, _ = _gain_margin(self.omega, loop)
        phase, crossover = _phase_margin(self.omega, loop)
        delay = math.radians(phase) / crossover if crossover > 0 else math.inf
        peak = float(np.max(1 / np.abs(1 + loop)))
        integrators = self.integrates + (gains.ki != 0)
        stable = _encircles_not(loop, integrators)
        return Margins(gain, phase, delay, crossover, peak, stable)


def _crossings(omega: Array, value: Array) -> Array:
    """Frequencies where a value changes its sign, by linear interpolation in log ω."""
    at = np.flatnonzero(np.sign(value[1:]) != np.sign(value[:-1]))
    share = value[at] / (value[at] - value[at + 1])
    x = np.log(omega)
    frequencies: Array = np.exp(x[at] + share * (x[at + 1] - x[at]))
    return frequencies


def _gain_margin(omega: Array, loop: NDArray[np.complex128]) -> tuple[float, float]:
    """The smallest factor above 0 that brings the loop to −1, and at which frequency."""
    at = _crossings(omega, loop.imag)
    real = np.interp(at, omega, loop.real)
    at, real = at[real < -_NOTHING], real[real < -_NOTHING]
    if loop[-1].real < -_NOTHING:  # Nyquist's frequency: the loop is real there
        at, real = np.append(at, omega[-1]), np.append(real, loop[-1].real)
    if not len(at):
        return math.inf, math.nan
    k = int(np.argmin(real))
    return float(-1 / real[k]), float(at[k])


def _phase_margin(omega: Array, loop: NDArray[np.complex128]) -> tuple[float, float]:
    """The smallest phase above −180° where the gain is 1 [°], and at which frequency."""
    at = _crossings(omega, np.abs(loop) - 1.0)
    if not len(at):
        return math.inf, 0.0
    phase = np.degrees(np.interp(at, omega, np.unwrap(np.angle(loop)))) + 180.0
    k = int(np.argmin(np.abs(phase)))
    return float((phase[k] + 180.0) % 360.0 - 180.0), float(at[k])


def _encircles_not(loop: NDArray[np.complex128], integrators: int) -> bool:
    """Nyquist's test for a loop whose only poles on the unit circle are its integrators.

    From low frequencies, where n integrators hold 1 + L at −90°·n, up to Nyquist's, where it is
    real, a stable loop turns by +90°·n and ends on the positive side.
    """
    turned = np.unwrap(np.angle(1 + loop))
    return bool(abs(turned[-1] - turned[0] - 0.5 * np.pi * integrators) < 0.25 * np.pi)


_FLAT = {
    Axis.SPEED: {"kp": "kp_speed", "ki": "ki_speed", "kd": "kd_speed"},
    Axis.YAW: {"kp": "kp_yaw", "ki": "ki_yaw", "kd": "kd_yaw"},
}
"""How a controller of both axes at once names the gains of each."""

_PARTS = {
    frozenset({"kp"}): "p",
    frozenset({"kp", "ki"}): "pi",
    frozenset({"kp", "kd"}): "pd",
    frozenset({"kp", "ki", "kd"}): "pid",
}
"""The kind that gains make."""


class RuleGains(NamedTuple):
    """What a rule proposes.

    Attributes:
        axes: for which it has gains; the others keep the mission's.
    """

    name: str
    axes: tuple[str, ...]
    gains: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class LinearLoops:
    """The loops of both axes around the estimated plant, as far as they are linear."""

    mission: Mission
    robot: SteppablePlant

    @cached_property
    def keys(self) -> Mapping[Axis, Mapping[str, str]]:
        """Names of kp, ki and kd of each axis whose law is of such gains alone."""
        control, by_axis = self.mission.control, {}
        if not isinstance(control, TunedSettings):
            return {}
        for axis in Axis:
            law = getattr(control, axis.value, None)
            if isinstance(law, P):
                by_axis[axis] = {n: f"{axis.value}.{n}" for n in law.gains}
            elif law is None:
                keys = {n: key for n, key in _FLAT[axis].items() if key in control.gains}
                if frozenset(keys) in _PARTS:
                    by_axis[axis] = keys
        return by_axis

    @cached_property
    def _answers(self) -> Mapping[Axis, SampledLoop]:
        geometry, period = self.mission.vehicle.geometry, self.mission.control.period
        return {a: SampledLoop.of(answer(self.robot, geometry, a), period) for a in self.keys}

    def margins(self, gains: Mapping[str, float]) -> dict[str, Margins]:
        """Margins of each axis whose law is linear; of the others there are none."""
        margins = {}
        for axis, names in self.keys.items():
            law = getattr(self.mission.control, axis.value, None)
            terms: dict[str, Any] = {n: gains[key] for n, key in names.items()}
            terms["filter_time"] = float(getattr(law, "filter_time", 0.0))
            margins[axis.value] = self._answers[axis].margins(PIDTerms(**terms))
        return margins

    def stable(self, gains: Mapping[str, float]) -> bool:
        """Whether no linear loop is unstable; such a one swings between limits of the command."""
        return all(m.stable for m in self.margins(gains).values())

    def rules(self) -> tuple[RuleGains, ...]:
        """The gains that rules read off the plant, where they know the kind of a law."""
        period, geometry = self.mission.control.period, self.mission.vehicle.geometry
        by_rule: dict[str, dict[str, float]] = {}
        axes: dict[str, list[str]] = {}
        for axis, names in self.keys.items():
            kind = _PARTS[frozenset(names)]
            lag = lag_model(answer(self.robot, geometry, axis), period)
            sets = dict(from_lag(axis, lag))
            edge = self._answers[axis].edge()
            if edge is not None:
                sets["ziegler-nichols-edge"] = from_edge(*edge)
            for rule, kinds in sets.items():
                if kind in kinds:
                    axis_gains = {key: getattr(kinds[kind], n) for n, key in names.items()}
                    by_rule.setdefault(rule, {}).update(axis_gains)
                    axes.setdefault(rule, []).append(axis.value)
        control = self.mission.control
        whole = control.gains if isinstance(control, TunedSettings) else {}
        return tuple(
            RuleGains(
                rule, tuple(axes[rule]), {n: axis_gains.get(n, gain_of(control, n)) for n in whole}
            )
            for rule, axis_gains in by_rule.items()
        )
