"""A vehicle with mass as estimated: its numbers, what they are worth, and how they are shown."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.data.record import Array
from sysid.errors import DataError
from sysid.robot.calibration.dynamic_runs import NUMBERS, Log, Machine, Runs, pieces_of
from sysid.robot.calibration.numbers import (
    Correlations,
    VehicleNumber,
    capital,
    derived,
    undetermined,
)
from sysid.robot.calibration.slip_estimate import INVERSE, SlipFit, in_units
from sysid.robot.calibration.slip_model import TERMS, Motion
from sysid.robot.calibration.trajectory import Trajectory
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.tracked import G

IMBALANCE, DELAY = NUMBERS.index("imbalance"), NUMBERS.index("delay")

N = len(NUMBERS)

LENGTHS = ("radius_left", "radius_right", "effective_width")
"""Quantities that the slip model holds, too; here they act where slip is taken off."""

LEFT_OUT = 0.005
"""Share of a mass or a friction that stays uncertain at least: what steps of 5 ms and a uniform
pressure leave out moves them by so much on made logs."""

STIFFNESS_LEFT_OUT = 0.04
"""Share of the thrust stiffness likewise: the law of shear is a chord of its curve in each step."""

IDENTIFIABLE_SHARE = 0.25
"""A quantity is identifiable if its standard error is below this share of it …"""

SLIGHT: Mapping[str, float] = {"rolling_friction": 0.0125, "turning_friction": 0.125}
"""… or less than this: a quarter of what such coefficients differ by from floor to floor. A floor
that hardly resists is known, too."""

SHOWN_BY: Mapping[str, str] = {
    "mass": "hard starts and stops on a straight line, with the torque of the motors known",
    "yaw_inertia": "quick turns on the spot that start, stop and reverse",
    "rolling_resistance": "straight runs at several speeds, slow ones too, and coasting down",
    "rolling_friction": "straight runs at several speeds, slow ones too, and coasting down",
    "turning_resistance": "slow, steady turns on the spot, both ways",
    "turning_friction": "slow, steady turns on the spot, both ways",
    "thrust_stiffness": "hard starts and stops from several speeds with an exact pose",
    "centre_of_mass": "turns on the spot with the pose of a known point of the vehicle",
    "command_delay": "hard starts and stops, a few samples apart from any other change",
    "straight_lag": "hard starts and stops on a straight line",
    "turning_lag": "quick turns on the spot that start, stop and reverse",
    "straight_friction": "straight runs at several speeds, slow ones too",
    "turning_friction_level": "slow, steady turns on the spot, both ways",
    "top_speed_per_command": "straight runs at several commands",
}
"""The manoeuvre that determines each quantity."""

MEANING: Mapping[str, tuple[str, str]] = {
    "mass": ("kg", "what the whole vehicle weighs"),
    "yaw_inertia": ("kg m²", "its yaw inertia about its centre of mass"),
    "rolling_resistance": ("N", "rolling resistance of the whole vehicle, straight ahead"),
    "rolling_friction": ("1", "rolling resistance over weight"),
    "turning_resistance": ("Nm", "what resists a slow turn on the spot"),
    "turning_friction": ("1", "lateral friction coefficient, for even track pressure"),
    "thrust_stiffness": ("N", "thrust of a track per unit of slip, at small slip"),
    "centre_of_mass": ("m", "how far the centre of mass lies ahead of the point of the pose"),
    "command_delay": ("s", "delay of the commands after their log entry"),
    "straight_lag": ("s", "lag of straight runs: moving mass over the motors' damping"),
    "turning_lag": ("s", "lag of turns on the spot, likewise"),
    "straight_friction": ("", "command lost to resistance in straight runs"),
    "turning_friction_level": ("", "command lost to resistance in turns on the spot"),
    "top_speed_per_command": ("", "speed of the wheels per unit of command, without friction"),
}

TIMES_AND_PLACES = ("centre_of_mass", "command_delay")
"""Quantities that may well be 0."""

CLOSE = 0.1
"""They are identifiable within this share of the length on the ground, and of a sample."""

INCLUDES: Mapping[str, str] = {
    "mass": "It includes the rotors' share 2J/r², because only their torque is known.",
    "yaw_inertia": "It includes the rotors' share, because only their torque is known.",
    "rolling_resistance": "It includes the motors' dry friction, because only their torque is "
    "known.",
    "rolling_friction": "Resistance and weight include the motors' share.",
    "turning_friction": "The weight includes the rotors' share, because only their torque is "
    "known.",
}
"""What a quantity means where damping and inertia of the motors are not known."""

RATIOS = (
    "straight_lag",
    "turning_lag",
    "straight_friction",
    "turning_friction_level",
    "top_speed_per_command",
)
"""Quantities identifiable without a torque."""

WEIGHED = tuple(name for name in MEANING if name not in RATIOS)
"""What needs one."""

THRUST_OVER = {"compliance": "thrust_stiffness", **INVERSE}
"""Numbers of the model, and the quantities that are one over them."""


@dataclass(frozen=True, eq=False)
class Powered:
    """What drives a vehicle, as far as it is known.

    Attributes:
        machine: lengths, motors and soil; its masses are where a search starts.
        logs: commands and speeds of every trajectory.
        spreads: standard errors of the motors' torque, damping, inertia and friction over their
            values, (4,); 0 for what counts as exact.
        torque_known: whether the torque per unit of command is known. Else damping is 1, and all
            other numbers come in units of it.
        rotors_known: whether the motors' damping and inertia are known, too. Else what moves with
            the rotors counts as the vehicle's.
        unit: of the commands.
        notes: what was assumed, in sentences.
    """

    machine: Machine
    logs: tuple[Log, ...]
    spreads: Array
    torque_known: bool = True
    rotors_known: bool = True
    unit: str = ""
    notes: tuple[str, ...] = ()

    @cached_property
    def runs(self) -> Runs:
        """Runs over all logs."""
        times = sorted({log.dt for log in self.logs})
        if times[-1] > 1.001 * times[0]:
            raise DataError(
                f"the logs have sample times from {times[0]:g} to {times[-1]:g} s: give logs of "
                "one sample time (`ts`), or fit them separately"
            )
        return Runs(self.machine, pieces_of(self.logs))

    def log_of(self, trajectory: Trajectory) -> int:
        return next(k for k, log in enumerate(self.logs) if log.trajectory is trajectory)


@dataclass(frozen=True, eq=False)
class DynamicFit(Motion):
    """The motion with mass: numbers found, and what they are worth.

    Attributes:
        p: every number as it is searched: logarithms of masses, others over where they start, the
            motors' logarithms, imbalance and delay, then those of the slip model.
        free: which of them are in the model.
        covariance: of the free ones; infinite where the log says nothing.
        geometry: lengths that the slip model's numbers multiply.
        before: the slip model with lengths, marker and lags alone.
    """

    powered: Powered
    p: Array
    free: tuple[int, ...]
    covariance: Array
    geometry: Geometry
    before: SlipFit

    @property
    def theta(self) -> Array:
        return theta_of(self.powered.machine, self.p)

    @property
    def q(self) -> Array:  # type: ignore[override]
        return self.p[N:]

    @cached_property
    def slipped(self) -> Array:
        return self.powered.runs.outputs(self.theta)[1]

    def added(self, trajectory: Trajectory) -> Array:
        """Way and turn that slip adds in each step of a trajectory's grid, (N, 3) [m, m, rad]."""
        return on_grid(self.powered, trajectory, self.slipped)

    def correlations(self) -> Correlations:
        names = [NUMBERS[k] if k < N else TERMS[k - N].name for k in self.free]
        return Correlations.of(names, self.covariance, THRUST_OVER)

    def numbers(self, given: Geometry | None = None) -> tuple[VehicleNumber, ...]:
        """Every quantity, with the reason where it is not identifiable."""
        known = np.where(np.isfinite(self.covariance), self.covariance, 0.0)
        size = np.sqrt(np.diag(known))
        moved = np.flatnonzero(size > 0.0)
        at = np.array(self.free)[moved]
        most = 1e-3 * np.maximum(np.abs(self.p[at]), 1.0)

        def of(q: Array) -> Mapping[str, float]:
            p = self.p.copy()
            p[at] = q
            return quantities(self, p)

        steps = np.minimum(0.01 * size[moved], most)
        values = derived(of, self.p[at], known[np.ix_(moved, moved)], steps)
        if self.powered.torque_known:
            shown, untold = WEIGHED, []
        else:
            shown = (*TIMES_AND_PLACES, *RATIOS)
            untold = [_untold(n) for n in WEIGHED if n not in TIMES_AND_PLACES]
        numbers = [_number(self, n, *values[n]) for n in shown]
        return (*untold, *numbers, *(_length(n, *values[n]) for n in LENGTHS))

    @property
    def silent(self) -> frozenset[str]:
        """Names of ``NUMBERS`` of which the log says nothing."""
        silent = zip(self.free, np.isfinite(np.diag(self.covariance)), strict=True)
        return frozenset(NUMBERS[k] for k, known in silent if k < N and not known)


def theta_of(machine: Machine, p: Array) -> Array:
    """``NUMBERS`` of a vector as it is searched."""
    theta = machine.numbers()
    theta[:2] *= np.exp(p[:2])
    theta[2:5] *= p[2:5]
    theta[5:10] = np.exp(p[5:10])
    theta[IMBALANCE], theta[DELAY] = p[IMBALANCE], p[DELAY]
    return theta


def on_grid(powered: Powered, trajectory: Trajectory, slipped: Array) -> Array:
    """Speeds of all samples in the pieces, (S, T, 3), as increments on a grid, (N, 3)."""
    which = powered.log_of(trajectory)
    dt = powered.logs[which].dt
    rows = powered.runs.pieces.joined(slipped, which)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(rows * dt, axis=0)])
    at = np.arange(len(total)) * dt
    columns = [np.interp(trajectory.nodes, at, total[:, k]) for k in range(3)]
    return np.diff(np.column_stack(columns), axis=0)


def quantities(fit: DynamicFit, p: Array) -> dict[str, float]:
    """Every quantity of a vector as it is searched."""
    theta = dict(zip(NUMBERS, theta_of(fit.powered.machine, p).tolist(), strict=True))
    vehicle = fit.powered.machine.vehicle
    m, J, R, M = (theta[n] for n in NUMBERS[:4])
    r, B = vehicle.geometry.r, vehicle.geometry.B
    named = in_units(p[N:], fit.geometry)
    motor = fit.powered.machine.motors[0]
    torque, damping = motor.torque * theta["torque"], motor.damping * theta["damping"]
    rotor = motor.inertia * theta["rotor_inertia"]
    values = {
        "mass": m,
        # the pose shows how far the vehicle turns for the lever that its forces have
        "yaw_inertia": J * named["effective_width"] / B,
        "rolling_resistance": R,
        "turning_resistance": M,
        "thrust_stiffness": 1.0 / theta["compliance"],
        "rolling_friction": R / (m * G),
        "turning_friction": 4.0 * M / (m * G * vehicle.contact_length),
        "centre_of_mass": -named["marker_x"],
        "command_delay": theta["delay"],
        "straight_lag": (rotor + 0.5 * m * r * r) / damping,
        "turning_lag": (rotor + 2.0 * J * (r / B) ** 2) / damping,
        "straight_friction": 0.5 * R * r / torque,
        "turning_friction_level": (M / B + 0.5 * R) * r / torque,
        "top_speed_per_command": torque / damping,
    }
    return values | {name: named[name] for name in LENGTHS}


def _number(fit: DynamicFit, name: str, value: float, error: float) -> VehicleNumber:
    powered, vehicle = fit.powered, fit.powered.machine.vehicle
    unit, meaning = MEANING[name]
    limit = max(IDENTIFIABLE_SHARE * abs(value), SLIGHT.get(name, 0.0))
    if name in TIMES_AND_PLACES:
        limit = CLOSE * (vehicle.contact_length if unit == "m" else powered.logs[0].dt)
    else:
        share = STIFFNESS_LEFT_OUT if name == "thrust_stiffness" else LEFT_OUT
        error = math.hypot(error, share * abs(value))
    if name in fit.silent or (name == "thrust_stiffness" and "compliance" in fit.silent):
        error = math.inf
    if not unit and name in RATIOS:
        command = powered.unit or "command"
        unit = f"(rad/s)/{command}" if name == "top_speed_per_command" else command
    sentence = f"{capital(meaning)}."
    if not error < limit:
        sentence = _why_not(name, value, error)
    elif not powered.rotors_known and name in INCLUDES:
        sentence += f" {INCLUDES[name]}"
    elif name in ("mass", "yaw_inertia"):
        sentence += _rests_on(fit, name, value)
    elif name == "turning_friction":
        sentence += f" Their contact length is assumed to be {vehicle.contact_length:.3g} m."
    elif name == "centre_of_mass":
        sentence += (
            " The log does not distinguish it from the position of that point on the vehicle; the "
            "value is the centre of rotation."
        )
    return VehicleNumber(name, value, error, unit, error < limit, sentence)


def _length(name: str, value: float, error: float) -> VehicleNumber:
    """Lengths that act where slip is taken off."""
    what, identifiable = f"the {name.replace('_', ' ')}", error < 0.1 * value
    sentence = f"{capital(what)} after subtracting the slip under these forces."
    if not identifiable:
        sentence = undetermined(what, "straight runs and turns both ways")
    return VehicleNumber(name, value, error, "m", identifiable, sentence)


def _why_not(name: str, value: float, error: float) -> str:
    what, how = f"the {name.replace('_', ' ')}", ""
    if name == "thrust_stiffness":
        least = value / (1.0 + 2.0 * error / value) if math.isfinite(error) else 0.0
        how = f", because the tracks hardly slip (at least {least:.2g} N per unit of slip)"
    elif math.isfinite(error) and value != 0.0:
        how = f" to better than {100 * error / abs(value):.0f} %"
    return undetermined(what, SHOWN_BY[name], how)


def _rests_on(fit: DynamicFit, name: str, value: float) -> str:
    """How far the quantity hangs on the inertia of the motors."""
    machine = fit.powered.machine
    rotor = machine.motors[0].inertia * float(fit.theta[NUMBERS.index("rotor_inertia")])
    r, B = machine.vehicle.geometry.r, machine.vehicle.geometry.B
    rotor_share = 2.0 * rotor / r**2 if name == "mass" else 0.5 * rotor * (B / r) ** 2
    share = rotor_share / value
    if share < 0.2:
        return ""
    return f" It depends on the motors' inertia: 1 % of that is {share:.1f} % of this."


def _untold(name: str) -> VehicleNumber:
    unit, meaning = MEANING[name]
    sentence = (
        f"The log does not determine {meaning}, because no torque is known. Give the motors' "
        "parameters (`motors`) or the torque per unit of command (the torque constant), and drive "
        f"{SHOWN_BY[name]}."
    )
    return VehicleNumber(name, math.nan, math.inf, unit, False, sentence, in_model=False)
