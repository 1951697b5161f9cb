"""The motors of a robot plant: torque at the sprockets for a share of full drive."""

import math
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.effects.ground import Ground
from sysid.errors import ModelError
from sysid.robot.mission.contracts import Scene, SteppablePlant
from sysid.robot.mission.tracks.robot_plant import RobotPlant, TrackChannels
from sysid.runners import floats
from sysid.vehicle.dynamics import Forces, VehicleState, step, substeps_for
from sysid.vehicle.floor import Floor
from sysid.vehicle.motors import Motor, TorqueSource
from sysid.vehicle.tracked import TrackedVehicle

SHARED = 0.05
"""Inertia of the body over the motors' own up to which a plant counts as identified with its tracks
lifted: estimates from lifted tracks scatter about 0 by some hundredths, and a body on the ground
adds tenths and more (the thesis's robot: 0.2)."""

_SPEEDS_ONLY = (
    "motion of kind dynamic needs the torque of two motors, and the plant has speeds only; "
    "identify a dc-motor with the tracks lifted, with parameters=bench or with its "
    "torque_constant (or take the one of `sysid bench motor`), or choose motion of kind slip"
)
_DRIVEN = (
    "motion of kind dynamic needs the motors alone, but the plant was identified from a log driven "
    "on the ground, which already contains the vehicle's mass and friction: identify it with the "
    "tracks lifted (or set vehicle: {lifted: true} if they were)"
)
_LIFTED = (
    "The plant is assumed to be identified with its tracks lifted. A log driven on the ground "
    "would count mass and friction twice; set vehicle.lifted to say which it was."
)


def motors_of(plant: SteppablePlant) -> tuple[Motor, Motor]:
    """Left and right motor of a robot plant, driven by shares of full drive."""
    source = _source(plant)
    if not isinstance(plant, RobotPlant) or source is None:
        raise ModelError(_SPEEDS_ONLY)
    left, right = (_motor(plant, source, track) for track in (0, 1))
    return left, right


def check_lifted(plant: SteppablePlant, lifted: bool | None) -> tuple[str, ...]:
    """Refuse motors that were identified on the ground; a note where it cannot be checked.

    Args:
        lifted: what the mission says; None judges by what the tracks share.
    """
    motors_of(plant)
    source = _source(plant)
    driven = source is not None and source.body > SHARED
    if lifted is False or (lifted is None and driven):
        raise ModelError(_DRIVEN)
    return () if lifted else (_LIFTED,)


def _source(plant: SteppablePlant) -> TorqueSource | None:
    return getattr(getattr(plant, "plant", None), "torque", None)


def _motor(robot: RobotPlant, source: TorqueSource, track: int) -> Motor:
    """One motor, from the unit of its input to shares of full drive."""
    driven, read = robot.driven[track], robot.read[track]
    unit = robot.plant.outputs[read].unit
    if unit not in ("rad/s", "rad"):
        raise ModelError(
            f"motion of kind dynamic needs the speed of the sprockets in rad/s, and the plant's "
            f"{robot.plant.outputs[read].name} is in {unit or 'no unit'}: give its unit when "
            "reading the log"
        )
    if driven != read or robot.scale[track] < 0.0:
        raise ModelError(
            "motion of kind dynamic needs each motor's own input and speed, both positive forward: "
            "check names and signs of the plant's columns"
        )
    span = float(robot.span[track])
    zero = float(robot.centre[driven]) - float(robot.plant.u_offset[driven])
    if abs(zero) > 1e-9 * abs(span):
        raise ModelError(
            f"motion of kind dynamic needs motors at rest at zero drive, and zero drive is "
            f"{zero:g} {robot.plant.inputs[driven].unit} here: set vehicle.command_scale"
        )
    motor = source.motors[read if len(source.motors) > 1 else 0]
    plain = isinstance(motor.limit, float | np.floating)
    limit = motor.limit if plain and math.isinf(motor.limit) else motor.limit / abs(span)
    return motor._replace(torque=motor.torque * span, limit=limit, offset=motor.offset / span)


GROUND = Ground()
"""Nothing more between tracks and ground."""


@dataclass(frozen=True)
class GroundedPlant(TrackChannels):
    """Two motors, a body and level ground of one soil; satisfies ``SteppablePlant``.

    Attributes:
        dt: sample time [s].
    """

    dt: float
    car: TrackedVehicle
    motors: tuple[Motor, Motor]
    floor: Floor
    ground = GROUND

    def initial_state(self) -> Array:
        """At rest: speeds, then what acted last."""
        return np.zeros(13)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """Advance one sample: PWM [µs] of both tracks in, wheel speeds [rad/s] out."""
        vx, vy, turn, left, right, *f = state.tolist()
        forces = Forces((f[0], f[1]), (f[2], f[3]), (f[4], f[5]), f[6], f[7])
        now = VehicleState(0.0, 0.0, 0.0, vx, vy, turn, (left, right), forces)
        drive = float(u[0]) / PWM_FULL_SCALE, float(u[1]) / PWM_FULL_SCALE
        scheme = substeps_for(self.dt)
        after = step(now, drive, self.dt, self.car, self.motors, self.floor, floats, scheme)
        a = after.forces
        values = (*a.motors, *a.thrust, *a.rolling, a.side, a.turning)
        return (
            np.array((after.vx, after.vy, after.yaw_rate, *after.omega, *values)),
            np.array((left, right)),
        )


def on_ground(plant: SteppablePlant, scene: Scene) -> GroundedPlant:
    """The plant's motors under the vehicle of a scene, on its floor without patches and slope."""
    assert scene.car is not None
    assert scene.floor is not None
    floor = replace(scene.floor, patches=(), slope=(0.0, 0.0))
    return GroundedPlant(plant.dt, scene.car, motors_of(plant), floor)
