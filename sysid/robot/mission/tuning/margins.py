"""Margins of the sampled linear loop of one axis."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.robot.mission.tuning.axes import Axis, AxisAnswer
from sysid.robot.mission.tuning.rules import Gains

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
        stable: whether the closed loop is.
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

    def controller(self, gains: Gains) -> NDArray[np.complex128]:
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

    def margins(self, gains: Gains) -> Margins:
        """The margins with a controller."""
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
