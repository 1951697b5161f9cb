"""The DC motor as a torque source for vehicles."""

from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.vehicle.kinematics import Real
from sysid.vehicle.motors import Motor, TorqueSource, lumped_motor

if TYPE_CHECKING:
    from sysid.structures.grey_box.dc_motor.structure import MotorPhysics


def torque_source(m: "MotorPhysics", theta: Any) -> TorqueSource | None:
    """The motors of the model, their drive in its own unit of input.

    With constants of the bench the rotors are known apart from the body; of lumped constants the
    stall torque shows what is torque. None where the model says speeds only.
    """
    if m.parametrisation != "bench" and not m.torque_per_input:
        return None
    xp: Any = theta.__array_namespace__()
    p = m.unpack(xp, theta)
    q = m.motion(xp, p)
    motors = []
    for track in range(m.ny):
        of = {name: _plain(v[track, 0] if np.ndim(v) == 2 else v) for name, v in p.items()}
        if m.parametrisation == "bench":
            base = Motor(
                torque=_plain(q["torque"][track, 0]),
                damping=_plain(q["damping"]),
                inertia=_plain(q["own_inertia"]),
                friction=abs(_plain(q["sprocket_friction"][track, 0])),
            )
        else:
            base = lumped_motor(
                m.torque_per_input, of["gain"], of["time_constant"], abs(of["coulomb"])
            )
        motors.append(
            base._replace(
                breakaway=of["breakaway"],
                stribeck=of["stribeck"],
                limit=of["limit"],
                offset=of["offset"],
                friction_back=of["coulomb_back"],
                damping_back=of["viscous_back"],
                drag=of["drag"] * base.damping,
            )
        )
    inertia, cross = q["inertia"]
    shared = xp.sum(cross) / xp.sqrt(inertia[0, 0] * inertia[-1, 0]) if m.ny == 2 else 0.0
    body = m.parametrisation == "bench" and m.ny == 2
    carried = 1.0 - motors[0].inertia / (inertia[0, 0] * motors[0].damping) if body else 0.0
    return TorqueSource(tuple(motors), _plain(abs(shared) + abs(carried)))


def _plain(value: Any) -> Real:
    """A plain number of one that is known; what a compiler traces stays as it is."""
    return float(value) if isinstance(value, np.ndarray | np.generic) else value
