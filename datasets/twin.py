"""The truth twin of the Devastator: continuous-time physics behind the bundled logs.

It imports nothing from the workbench that is tested on its logs. Two geared DC motors on H-bridges
(thesis 2.53-2.61) turn two tracks; the body's mass and yaw inertia couple them; each track has
Stribeck friction that really sticks. With the sprocket speeds w = (w_l, w_r) [rad/s]:

    M dw/dt = G V - D w - C(|w|) sign(w)
    V = g Vs clip(PWM / 20000, -s, s)                       G = n Kc / R
    M = [[J + a + b, a - b], [a - b, J + a + b]]            D = n^2 (Kc Kem / R + f)
    J = n^2 Jtot,  a = m r^2 / 4,  b = Jz r^2 / B^2
    C(w) = (n C0 + Cr) (1 + (k - 1) / (1 + (w / ws)^2))

A track at rest stays at rest while the torque on it, inertial reaction of the other track included,
is at most the breakaway torque k (n C0 + Cr). The pose follows from the tracks without slip:
v = r (w_l + w_r) / 2 and dpsi/dt = r (w_r - w_l) / B (thesis 2.13).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

PWM_FULL = 20000.0
"""Pulse width of full drive [µs]."""

SAMPLE_TIME = 0.1
"""Time between two readings of the encoders, and between two commands [s]."""

State = tuple[float, float, float, float, float]
"""(w_l, w_r [rad/s], x, y [m], psi [rad, counter-clockwise])."""

AT_REST: State = (0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Twin:
    """Everything that makes one robot differ from another; SI units, pairs are (left, right).

    Motor-side constants are those the thesis prints (§5.2); an effect is another value here.
    """

    supply: float = 7.5
    """Vs: voltage at the H-bridges [V]."""
    duty_limit: float = 0.95
    """s: duty cycle beyond which the bridge gives no more."""
    voltage_gain: tuple[float, float] = (0.92, 1.08)
    """g: share of the nominal voltage that reaches each motor."""
    resistance: float = 3.1
    """R: armature [Ω]; the inductance is neglected, as in the thesis."""
    back_emf: float = 0.0023
    """Kem: motor side [V/(rad/s)]."""
    torque_constant: float = 8.6626e-4
    """Kc: motor side [Nm/A]."""
    motor_viscous: float = 1.0651e-7
    """f: motor side [Nm/(rad/s)]."""
    motor_coulomb: float = 2.9658e-5
    """C0: motor side [Nm]."""
    motor_inertia: float = 1e-7
    """Jtot: motor side [kg m²]."""
    gear: float = 120.0
    """n: turns of the motor for one of the sprocket."""
    track_load: tuple[float, float] = (0.020, 0.020)
    """Cr: sliding resistance of each track at its sprocket [Nm]."""
    breakaway_ratio: float = 1.5
    """k: torque that starts a track over the torque that keeps it sliding."""
    stribeck_speed: float = 1.0
    """ws: sprocket speed at which half of the extra torque is gone [rad/s]."""
    mass: float = 1.5
    """m: body [kg]."""
    yaw_inertia: float = 0.0652
    """Jz: body about the vertical [kg m²]."""
    sprocket_radius: float = 0.0215
    """r [m]."""
    track_distance: float = 0.186
    """B: between the track centres [m]."""

    @cached_property
    def torque_per_volt(self) -> float:
        """G: stall torque at the sprocket per volt at the motor [Nm/V]."""
        return self.gear * self.torque_constant / self.resistance

    @cached_property
    def damping(self) -> float:
        """D: back-EMF and viscous friction at the sprocket [Nm/(rad/s)]."""
        electric = self.torque_constant * self.back_emf / self.resistance
        return self.gear**2 * (electric + self.motor_viscous)

    @cached_property
    def inertia(self) -> tuple[float, float]:
        """Diagonal and off-diagonal entry of M [kg m²]."""
        forward = self.mass * self.sprocket_radius**2 / 4.0
        turning = self.yaw_inertia * (self.sprocket_radius / self.track_distance) ** 2
        return self.gear**2 * self.motor_inertia + forward + turning, forward - turning

    @cached_property
    def sliding(self) -> tuple[float, float]:
        """Friction torque of each track far above the Stribeck speed [Nm]."""
        left, right = self.track_load
        return self.gear * self.motor_coulomb + left, self.gear * self.motor_coulomb + right

    def drive_torque(self, pwm: float, track: int) -> float:
        """Stall torque at the sprocket of ``track`` (0 left, 1 right) under ``pwm`` [Nm]."""
        duty = min(max(pwm / PWM_FULL, -self.duty_limit), self.duty_limit)
        return self.torque_per_volt * self.voltage_gain[track] * self.supply * duty

    def friction(self, speed: float, track: int) -> float:
        """Size of the friction torque at a sprocket speed [Nm]."""
        ratio = speed / self.stribeck_speed
        return self.sliding[track] * (1.0 + (self.breakaway_ratio - 1.0) / (1.0 + ratio * ratio))


DEVASTATOR = Twin()
"""The robot of the bundled logs."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What happened, before any sensor: arrays with time along axis 0."""

    t: NDArray[np.float64]
    """Sample instants [s], shape (N,)."""
    pwm: NDArray[np.float64]
    """Command applied from each instant to the next [µs], shape (N, 2)."""
    omega: NDArray[np.float64]
    """Sprocket speeds at each instant [rad/s], shape (N, 2)."""
    pose: NDArray[np.float64]
    """x, y [m] and psi [rad] at each instant, shape (N, 3)."""


def simulate_truth(
    pwm: ArrayLike,
    twin: Twin = DEVASTATOR,
    start: State = AT_REST,
    sample_time: float = SAMPLE_TIME,
    steps: int = 50,
) -> Truth:
    """The noise-free answer of ``twin`` to a schedule of commands.

    Row k of the answer is read at k·``sample_time``, just before command k is applied and then
    held: speeds of row k + 1 answer command k, so a discrete-time model has the delay nk = 1.

    Args:
        pwm: commands (left, right) [µs], shape (N, 2).
        twin: the robot.
        start: its state at the first sample.
        sample_time: time between the samples [s].
        steps: integration steps in a sample.
    """
    commands = np.asarray(pwm, dtype=np.float64)
    rows = []
    state = start
    for left, right in commands.tolist():
        rows.append(state)
        state = advance(state, (left, right), sample_time, twin, steps)
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    t = sample_time * np.arange(len(table), dtype=np.float64)
    return Truth(t=t, pwm=commands, omega=table[:, :2], pose=table[:, 2:])


def advance(
    state: State,
    pwm: Sequence[float],
    duration: float = SAMPLE_TIME,
    twin: Twin = DEVASTATOR,
    steps: int = 50,
) -> State:
    """The state after holding the command ``pwm`` (left, right) [µs] for ``duration`` [s].

    Classical Runge-Kutta 4 in ``steps`` equal steps; a step in which a sliding track would reverse
    is cut where it stops, so that friction stops a track and never drives it.
    """
    torque = (twin.drive_torque(pwm[0], 0), twin.drive_torque(pwm[1], 1))
    step = duration / steps
    for _ in range(steps):
        state = _one_step(state, torque, step, twin)
    return state


Pair = tuple[float, float]


def _one_step(state: State, torque: Pair, step: float, twin: Twin) -> State:
    left, right, x, y, psi = state
    remaining = step
    while remaining > 0.0:
        before = (left, right)
        senses = _senses(before, torque, twin)
        left, right = _runge_kutta(before, torque, senses, remaining, twin)
        stop_left = _stop_share(before[0], left, senses[0])
        stop_right = _stop_share(before[1], right, senses[1])
        share = min(stop_left, stop_right)
        taken = remaining * share
        if share < 1.0:
            left, right = _runge_kutta(before, torque, senses, taken, twin)
        if stop_left == share < 1.0 or left * senses[0] < 0.0:
            left = 0.0
        if stop_right == share < 1.0 or right * senses[1] < 0.0:
            right = 0.0
        travel_left = 0.5 * taken * twin.sprocket_radius * (before[0] + left)
        travel_right = 0.5 * taken * twin.sprocket_radius * (before[1] + right)
        turn = (travel_right - travel_left) / twin.track_distance
        along = 0.5 * (travel_left + travel_right)
        x += along * math.cos(psi + 0.5 * turn)
        y += along * math.sin(psi + 0.5 * turn)
        psi += turn
        remaining -= taken
    return left, right, x, y, psi


def _stop_share(before: float, after: float, sense: float) -> float:
    """Share of a step after which a sliding track stops; 1 when it does not stop in the step."""
    return before / (before - after) if before * sense > 0.0 > after * sense else 1.0


def _senses(speed: Pair, torque: Pair, twin: Twin) -> Pair:
    """Which way each track slides: +1, -1, or 0 while friction holds it.

    A track at rest gives way when the torque on it, with the other track accelerating as it does
    while this one stands, exceeds the breakaway torque.
    """
    senses = [_sign(speed[0]), _sign(speed[1])]
    limit = (twin.friction(0.0, 0), twin.friction(0.0, 1))
    if senses == [0.0, 0.0]:
        senses = [_sign(torque[i]) if abs(torque[i]) > limit[i] else 0.0 for i in (0, 1)]
    for i in (0, 1):
        if senses[i] == 0.0:
            other = 1 - i
            locked = (0.0, senses[1]) if i == 0 else (senses[0], 0.0)
            push = torque[i] - twin.inertia[1] * _acceleration(speed, torque, locked, twin)[other]
            if abs(push) > limit[i]:
                senses[i] = _sign(push)
    return senses[0], senses[1]


def _acceleration(speed: Pair, torque: Pair, senses: Pair, twin: Twin) -> Pair:
    own, cross = twin.inertia
    damping = twin.damping
    left = torque[0] - damping * speed[0] - senses[0] * twin.friction(speed[0], 0)
    right = torque[1] - damping * speed[1] - senses[1] * twin.friction(speed[1], 1)
    if senses[0] and senses[1]:
        det = own * own - cross * cross
        return (own * left - cross * right) / det, (own * right - cross * left) / det
    return (left / own if senses[0] else 0.0), (right / own if senses[1] else 0.0)


def _runge_kutta(speed: Pair, torque: Pair, senses: Pair, step: float, twin: Twin) -> Pair:
    w_l, w_r = speed
    half = 0.5 * step
    a_l, a_r = _acceleration(speed, torque, senses, twin)
    b_l, b_r = _acceleration((w_l + half * a_l, w_r + half * a_r), torque, senses, twin)
    c_l, c_r = _acceleration((w_l + half * b_l, w_r + half * b_r), torque, senses, twin)
    d_l, d_r = _acceleration((w_l + step * c_l, w_r + step * c_r), torque, senses, twin)
    sixth = step / 6.0
    return (
        w_l + sixth * (a_l + 2.0 * (b_l + c_l) + d_l),
        w_r + sixth * (a_r + 2.0 * (b_r + c_r) + d_r),
    )


def _sign(value: float) -> float:
    return float(value > 0.0) - float(value < 0.0)
