"""Constants of the DC motor: lumped, or those of the bench, and the shape of friction."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.structures.grey_box.physics import Constant, Signal

if TYPE_CHECKING:
    from sysid.structures.grey_box.dc_motor.structure import MotorPhysics

NO_LIMIT = 1e9
"""A command no log contains: the limit of a drive that has none."""

OPTIONAL_EACH = ("breakaway", "stribeck", "limit", "time_constant", "offset", "drag")
"""Constants that two tracks may share."""


def lumped(m: "MotorPhysics") -> tuple[Constant, ...]:
    """Gain, time constant, coupling and sliding friction: what commands and speeds determine."""
    gain = "{y}/{u}" if m.output != "position" else "({y}/s)/{u}"
    alike = "time_constant" in m.shared
    dry = not m.lacks(["coulomb"])
    carried = "inertia shared through the body over a track's own"
    taken = "sliding friction as the command it takes away"
    constants = (
        Constant(
            "gain", gain, each=True, spread=1.5, words="speed per unit of command, without friction"
        ),
        Constant("time_constant", "s", 0.2, 0.0, each=not alike, words="inertia over damping"),
        Constant("coupling", "", 0.0, -0.95, 0.95, spread=0.3, words=carried),
        Constant("coulomb", "{u}", 0.0, 0.0, free=dry, each=True, words=taken),
    )
    return tuple(c for c in constants if c.name != "coupling" or m.ny == 2)


def shape(m: "MotorPhysics") -> tuple[Constant, ...]:
    """What friction does beside sliding evenly, the limit of the drive and a constant load."""
    pwm, position = m.input == "pwm", m.output == "position"
    speed, per_speed = ("{y}/s", "s/{y}") if position else ("{y}", "1/({y})")
    top = PWM_FULL_SCALE if pwm else np.inf
    at_rest = "friction at standstill over sliding friction"
    gone = "speed at which half of the extra friction is gone"
    most = "command beyond which the drive gives no more"
    load = "constant load as the command it takes away"
    square = "resistance that grows with the square of speed"

    def constant(
        name: str, unit: str, value: float, low: float, high: float, words: str
    ) -> Constant:
        """One of the shape: free where friction has it, one value where both tracks share it."""
        return Constant(
            name,
            unit,
            value,
            low,
            high,
            free=not m.lacks([name]),
            each=name not in m.shared,
            words=words,
        )

    return (
        replace(constant("breakaway", "", 1.0, 1.0, 10.0, at_rest), spread=1.5, jumps=True),
        replace(constant("stribeck", speed, 1.0, 0.0, np.inf, gone), jumps=True),
        replace(
            constant("limit", "{u}", PWM_FULL_SCALE if pwm else NO_LIMIT, 0.0, top, most),
            free=m.friction == "full" and pwm,
            spread=1.3,
        ),
        replace(
            constant("offset", "{u}", 0.0, -np.inf, np.inf, load),
            free=position or not m.lacks(["offset"]),
            spread=0.5,
        ),
        replace(
            constant("coulomb_back", "", 1.0, 0.0, 10.0, "dry friction backward over forward"),
            spread=1.5,
        ),
        replace(
            constant("viscous_back", "", 1.0, 0.1, 10.0, "damping backward over forward"),
            spread=1.5,
        ),
        constant("drag", per_speed, 0.0, 0.0, np.inf, square),
    )


def bench(m: "MotorPhysics") -> tuple[Constant, ...]:
    """Constants of the bench (thesis §5.2) and of the Devastator; m: on the motor side."""
    fixed: dict[str, Any] = {"free": False, "lower": 0.0}
    body: tuple[Constant, ...] = (
        (
            Constant("mass", "kg", 1.5, 0.0, words="body"),
            Constant("yaw_inertia", "kg m²", 0.065, 0.0, words="body about the vertical"),
            Constant("sprocket_radius", "m", 0.0215, **fixed, words="r"),
            Constant("track_distance", "m", 0.186, **fixed, words="B"),
        )
        if m.ny == 2
        else (Constant("load_inertia", "kg m²", 1e-3, 0.0, words="behind the gear"),)
    )
    return (
        *(
            (Constant("supply", "V", 7.5, **fixed, words="at the bridge"),)
            if m.input != "voltage"
            else ()
        ),
        Constant("resistance", "Ω", 3.1, **fixed, words="R, armature"),
        Constant("back_emf", "V/(rad/s)", 0.0023, **fixed, words="Kem, m"),
        Constant("torque_constant", "Nm/A", 8.6626e-4, **fixed, words="Kc, m"),
        Constant("motor_viscous", "Nm/(rad/s)", 1.0651e-7, **fixed, words="ftot, m"),
        Constant("motor_inertia", "kg m²", 1e-7, **fixed, words="Jtot, m"),
        Constant("motor_friction", "Nm", 0.0, **fixed, words="C0, m, beside friction_torque"),
        Constant("gear", "", 120.0, **fixed, words="turns of the motor for one of the sprocket"),
        *body,
        Constant(
            "bridge_gain",
            "",
            1.0,
            0.0,
            each=True,
            spread=1.3,
            words="share of the nominal voltage that reaches the motor",
        ),
        Constant(
            "friction_torque",
            "Nm",
            0.02,
            0.0,
            free=not m.lacks(["coulomb"]),
            each=True,
            words="sliding friction at the sprocket, gear and track together",
        ),
    )


def from_bench(m: "MotorPhysics", xp: Any, p: Mapping[str, Signal]) -> dict[str, Signal]:
    """Lumped motion that follows from bench constants (2.53–2.61, L di/dt neglected).

    Beside it the torque per unit of input, damping, inertia of a motor without the body, and
    friction at the sprocket.
    """
    n = p["gear"]
    per_volt = n * p["torque_constant"] / p["resistance"]
    damping = n * n * (p["torque_constant"] * p["back_emf"] / p["resistance"] + p["motor_viscous"])
    volts = p["supply"] / PWM_FULL_SCALE if m.input != "voltage" else 1.0
    rotor = n * n * p["motor_inertia"]
    own, cross = rotor, 0.0
    if m.ny == 2:
        forward = p["mass"] * p["sprocket_radius"] ** 2 / 4.0
        turning = p["yaw_inertia"] * (p["sprocket_radius"] / p["track_distance"]) ** 2
        inertia, cross = rotor + forward + turning, (forward - turning) / damping
    else:
        inertia = own = rotor + p["load_inertia"]
    torque = per_volt * volts * p["bridge_gain"]
    friction = p["friction_torque"] + n * p["motor_friction"]
    return {
        "gain": torque / damping,
        "inertia": (xp.zeros((m.ny, 1)) + inertia / damping, cross),
        "coulomb": friction / damping,
        "torque": torque,
        "damping": damping,
        "own_inertia": own,
        "sprocket_friction": friction,
    }


def bench_guess(m: "MotorPhysics", gain: Array, level: Array) -> dict[str, Any]:
    """Bridge gains and friction torques that give the lumped gain and Coulomb level."""
    plain = m.unpack(np, m.pack({}))
    q = from_bench(m, np, plain)
    share = np.abs(gain) / np.ravel(q["gain"])
    at_motor = plain["gear"] * plain["motor_friction"]
    damping = 1.0 / (q["coulomb"] / (plain["friction_torque"] + at_motor))
    return {
        "bridge_gain": share,
        "friction_torque": np.abs(gain) * level * np.ravel(damping) - at_motor,
    }
