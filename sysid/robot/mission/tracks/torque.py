"""The motors of a robot plant: torque at the sprockets for a share of full drive."""

import math

import numpy as np

from sysid.errors import ModelError
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.vehicle.kinematics import Real
from sysid.vehicle.motors import Motor, TorqueSource

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
    """Left and right motor of a robot plant, driven by shares of full drive.

    Raises:
        ModelError: the plant has no torques, or zero drive is not zero for its motors.
    """
    source = _source(plant)
    if not isinstance(plant, RobotPlant) or source is None:
        raise ModelError(_SPEEDS_ONLY)
    left, right = (_motor(plant, source, track) for track in (0, 1))
    return left, right


def check_lifted(plant: SteppablePlant, lifted: bool | None) -> tuple[str, ...]:
    """Refuse motors that were identified on the ground; a note where it cannot be checked.

    Args:
        lifted: what the mission says; None judges by what the tracks share.

    Raises:
        ModelError: as for :func:`motors_of`; or the plant was driven on the ground.
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
    return motor._replace(
        torque=motor.torque * span,
        limit=_shares(motor.limit, span),
        offset=motor.offset / span,
    )


def _shares(limit: Real, span: float) -> Real:
    if isinstance(limit, float | np.floating) and not math.isfinite(limit):
        return limit
    return limit / abs(span)
