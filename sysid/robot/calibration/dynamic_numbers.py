"""Estimates of a vehicle with mass, as quantities with units and sentences."""

import math
from collections.abc import Mapping

import numpy as np

from sysid.data.record import Array
from sysid.robot.calibration.dynamic_fit import DynamicFit, N, theta_of
from sysid.robot.calibration.dynamic_runs import NUMBERS
from sysid.robot.calibration.numbers import Correlations, VehicleNumber, derived
from sysid.robot.calibration.slip_model import TERMS
from sysid.robot.calibration.slip_numbers import in_units
from sysid.vehicle.tracked import G

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
    lengths = ("radius_left", "radius_right", "effective_width")
    return values | {name: named[name] for name in lengths}


def numbers_of(fit: DynamicFit) -> tuple[VehicleNumber, ...]:
    """Every quantity, with the reason where it is not identifiable."""
    known = np.where(np.isfinite(fit.covariance), fit.covariance, 0.0)
    every = np.zeros((len(fit.p), len(fit.p)))
    every[np.ix_(fit.free, fit.free)] = known
    size = np.sqrt(np.diag(every))
    most = 1e-3 * np.maximum(np.abs(fit.p), 1.0)
    steps = np.where(size > 0.0, np.minimum(0.01 * size, most), 1.0)
    moved = np.flatnonzero(size > 0.0)

    def of(q: Array) -> Mapping[str, float]:
        p = fit.p.copy()
        p[moved] = q
        return quantities(fit, p)

    derived_values = derived(of, fit.p[moved], every[np.ix_(moved, moved)], steps[moved])
    unknown = _without_information(fit)
    more = [n for n in _weighed(fit, derived_values, unknown) if n is not None]
    lengths = [
        _length(name, *derived_values[name])
        for name in derived_values
        if name not in (*WEIGHED, *RATIOS)
    ]
    return (*more, *lengths)


def _without_information(fit: DynamicFit) -> frozenset[str]:
    """Names of ``NUMBERS`` of which the log says nothing."""
    silent = ~np.isfinite(np.diag(fit.covariance))
    return frozenset(NUMBERS[k] for k, s in zip(fit.free, silent, strict=True) if s and k < N)


def _weighed(
    fit: DynamicFit, derived_values: Mapping[str, tuple[float, float]], silent: frozenset[str]
) -> list[VehicleNumber]:
    if not fit.powered.torque_known:
        always_shown = ("centre_of_mass", "command_delay")
        untold = [_untold(name) for name in WEIGHED if name not in always_shown]
        plain = [_number(fit, name, *derived_values[name]) for name in always_shown]
        return [*untold, *plain, *(_ratio(fit, name, *derived_values[name]) for name in RATIOS)]
    numbers = []
    for name in WEIGHED:
        value, error = derived_values[name]
        if name not in TIMES_AND_PLACES:
            share = STIFFNESS_LEFT_OUT if name == "thrust_stiffness" else LEFT_OUT
            error = math.hypot(error, share * abs(value))
        if name in silent or (name == "thrust_stiffness" and "compliance" in silent):
            error = math.inf
        numbers.append(_number(fit, name, value, error))
    return numbers


def _number(fit: DynamicFit, name: str, value: float, error: float) -> VehicleNumber:
    unit, meaning = MEANING[name]
    identifiable = error < IDENTIFIABLE_SHARE * abs(value) or error < SLIGHT.get(name, 0.0)
    if name in TIMES_AND_PLACES:
        length = fit.powered.machine.vehicle.contact_length
        identifiable = error < CLOSE * (
            length if name == "centre_of_mass" else fit.powered.logs[0].dt
        )
    sentence = f"{meaning[:1].upper()}{meaning[1:]}."
    if not identifiable:
        sentence = _why_not(fit, name, value, error)
    elif not fit.powered.rotors_known and name in INCLUDES:
        sentence += f" {INCLUDES[name]}"
    elif name in ("mass", "yaw_inertia"):
        sentence += _rests_on(fit, name, value)
    elif name == "turning_friction":
        length = fit.powered.machine.vehicle.contact_length
        sentence += f" Their contact length is assumed to be {length:.3g} m."
    elif name == "centre_of_mass":
        sentence += (
            " The log does not distinguish it from the position of that point on the vehicle; the "
            "value is the centre of rotation."
        )
    return VehicleNumber(name, value, error, unit, identifiable, sentence)


def _why_not(fit: DynamicFit, name: str, value: float, error: float) -> str:
    what = name.replace("_", " ")
    if name == "thrust_stiffness":
        least = value / (1.0 + 2.0 * error / value) if math.isfinite(error) else 0.0
        return (
            f"The log does not determine the {what}, because the tracks hardly slip (at least "
            f"{least:.2g} N per unit of slip); {SHOWN_BY[name]} would."
        )
    known = math.isfinite(error) and value != 0.0
    how = f" to better than {100 * error / abs(value):.0f} %" if known else ""
    return f"The log does not determine the {what}{how}; {SHOWN_BY[name]} would."


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


def _ratio(fit: DynamicFit, name: str, value: float, error: float) -> VehicleNumber:
    unit, meaning = MEANING[name]
    command = fit.powered.unit or "command"
    unit = unit or (f"(rad/s)/{command}" if name == "top_speed_per_command" else command)
    error = math.hypot(error, LEFT_OUT * abs(value))
    identifiable = error < IDENTIFIABLE_SHARE * abs(value)
    sentence = f"{meaning[:1].upper()}{meaning[1:]}."
    if not identifiable:
        sentence = f"The log does not determine the {meaning}; {SHOWN_BY[name]} would."
    return VehicleNumber(name, value, error, unit, identifiable, sentence)


def _length(name: str, value: float, error: float) -> VehicleNumber:
    """Lengths that act where slip is taken off."""
    identifiable = error < 0.1 * value
    what = name.replace("_", " ")
    sentence = f"The {what} after subtracting the slip under these forces."
    if not identifiable:
        sentence = (
            f"The log does not determine the {what}; straight runs and turns both ways would."
        )
    return VehicleNumber(name, value, error, "m", identifiable, sentence)


def correlations_of(fit: DynamicFit) -> Correlations:
    """How far errors of masses, resistances and compliance go together, and with lengths."""
    names = [NUMBERS[k] if k < N else TERMS[k - N].name for k in fit.free]
    keep = [i for i in range(len(names)) if np.isfinite(fit.covariance[i, i])]
    inverse = ("effective_width", "compliance")
    turned = np.array([-1.0 if names[i] in inverse else 1.0 for i in keep])
    named = ["thrust_stiffness" if names[i] == "compliance" else names[i] for i in keep]
    covariance = fit.covariance[np.ix_(keep, keep)] * np.outer(turned, turned)
    return Correlations.of(named, covariance)
