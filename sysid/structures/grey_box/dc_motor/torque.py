"""The DC motor as a torque source for vehicles."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import PWM_FULL_SCALE
from sysid.vehicle.kinematics import Real
from sysid.vehicle.motors import Motor, TorqueSource, lumped_motor

if TYPE_CHECKING:
    from sysid.structures.grey_box.dc_motor.structure import DCMotor


def torque_source(m: "DCMotor", theta: Any) -> TorqueSource | None:
    """The motors of the model, their drive in its own unit of input.

    With constants of the bench the rotors are known apart from the body; of lumped constants the
    stall torque shows what is torque. None where the model says speeds only.
    """
    if m.parametrisation != "bench" and not m.torque_per_input:
        return None
    xp: Any = theta.__array_namespace__()
    p = m.unpack(xp, theta)

    def one(name: str, track: int) -> Real:
        value = p[name]
        return _plain(value[track, 0] if value.ndim == 2 else value)

    motors = []
    for track in range(m.ny):
        known = {name: one(name, track) for name in p}
        base = _bench(m, known) if m.parametrisation == "bench" else _lumped(m, known)
        motors.append(
            base._replace(
                breakaway=known["breakaway"],
                stribeck=known["stribeck"],
                limit=known["limit"],
                offset=known["offset"],
                friction_back=known["coulomb_back"],
                damping_back=known["viscous_back"],
                drag=known["drag"] * base.damping,
            )
        )
    inertia, cross = m.motion(xp, p)["inertia"]
    shared = xp.sum(cross) / xp.sqrt(inertia[0, 0] * inertia[-1, 0]) if m.ny == 2 else 0.0
    body = m.parametrisation == "bench" and m.ny == 2
    carried = 1.0 - motors[0].inertia / (inertia[0, 0] * motors[0].damping) if body else 0.0
    return TorqueSource(tuple(motors), _plain(abs(shared) + abs(carried)))


def _bench(m: "DCMotor", p: Mapping[str, Real]) -> Motor:
    n = p["gear"]
    per_volt = n * p["torque_constant"] / p["resistance"]
    volts = p["supply"] / PWM_FULL_SCALE if m.input != "voltage" else 1.0
    return Motor(
        torque=per_volt * volts * p["bridge_gain"],
        damping=n * (per_volt * p["back_emf"] + n * p["motor_viscous"]),
        inertia=n * n * p["motor_inertia"] + (p["load_inertia"] if m.ny == 1 else 0.0),
        friction=abs(p["friction_torque"] + n * p["motor_friction"]),
    )


def _lumped(m: "DCMotor", p: Mapping[str, Real]) -> Motor:
    return lumped_motor(m.torque_per_input, p["gain"], p["time_constant"], abs(p["coulomb"]))


def _plain(value: Any) -> Real:
    """A plain number of one that is known; what a compiler traces stays as it is."""
    return float(value) if isinstance(value, np.ndarray | np.generic) else value
