"""Compensation of identified effects, where commands become PWM of each track."""

from dataclasses import dataclass
from typing import Any

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.effects.compensation import Identified, can_be_compensated
from sysid.errors import ModelError
from sysid.robot.mission.contracts import Body, Command, SteppablePlant
from sysid.robot.mission.settings import IDENTIFIED, Compensate
from sysid.robot.mission.tracks.robot_plant import RobotPlant, identified_effects
from sysid.vehicle.kinematics import Geometry, Real, wheel_speeds


@dataclass(frozen=True, eq=False)
class Compensation:
    """The command module of a robot whose plant holds effects that can be undone.

    Attributes:
        ids: the effects to make up for.
        identified: all effects of the plant, left and right.
        at_zero, per_drive: drive of the plant = at_zero + per_drive · command of the track, (2,).
        at_rest, per_speed: speed of the plant = at_rest + per_speed · wheel speed [rad/s], (2,).
    """

    ids: tuple[str, ...]
    identified: Identified
    at_zero: Array
    per_drive: Array
    at_rest: Array
    per_speed: Array
    geometry: Geometry

    def __call__(
        self, command: Command, estimate: Body, t: Real, xp: Any
    ) -> tuple[tuple[Real, Real], Command]:
        """PWM of both tracks [µs], and what of the command it gives as far as is known [drive].

        Args:
            estimate: how the robot moves, as navigation believes.
            t: time [s].
        """
        tracks = xp.array((command.v_cmd - command.psi_cmd, command.v_cmd + command.psi_cmd))
        wheels = xp.array(wheel_speeds(estimate.speed, estimate.yaw_rate, self.geometry))
        speed = self.at_rest + self.per_speed * wheels
        wanted = self.at_zero + self.per_drive * tracks
        raised, added = self.identified.undone(self.ids, wanted, speed, t, xp)
        given = xp.minimum(xp.maximum((raised - self.at_zero) / self.per_drive, -1.0), 1.0)
        acting = self.at_zero + self.per_drive * given
        got = self.identified.done(self.ids, acting, added, speed, t, xp)
        left, right = (got - self.at_zero) / self.per_drive
        pwm = PWM_FULL_SCALE * given
        return (pwm[0], pwm[1]), Command(0.5 * (left + right), 0.5 * (right - left))


def compensation_of(
    plant: SteppablePlant, compensate: Compensate, geometry: Geometry
) -> Compensation | None:
    """What makes up for effects of a plant; None where nothing is to be made up for.

    Args:
        plant: a robot; only what was identified with effects holds any.
        compensate: ids, or all that were identified and can be undone.
    """
    if not compensate:
        return None
    identified = plant.identified if isinstance(plant, RobotPlant) else Identified()
    known = [id for id in identified.effects if id in can_be_compensated()]
    if compensate != IDENTIFIED:
        missing = [id for id in compensate if id not in known]
        if missing:
            raise ModelError(
                f"control.compensate names {missing[0]}, which the plant does not contain; it "
                "contains "
                f"{', '.join(known) or 'nothing that can be undone'}; export an augmented model "
                "of a diagnosis, or remove the name"
            )
        known = [id for id in known if id in compensate]
    if not known or not isinstance(plant, RobotPlant):
        return None
    at = list(plant.driven)
    full = identified.full
    return Compensation(
        ids=tuple(known),
        identified=identified,
        at_zero=(plant.centre - plant.plant.u_offset)[at] / full,
        per_drive=plant.span / full,
        at_rest=plant.zero,
        per_speed=1.0 / plant.scale,
        geometry=geometry,
    )


def nothing_to_undo(plant: SteppablePlant, compensate: Compensate) -> tuple[str, ...]:
    """A sentence where all that was identified is to be made up for, and nothing was."""
    known = identified_effects(plant)
    if compensate != IDENTIFIED or set(known) & set(can_be_compensated()):
        return ()
    return (
        "Nothing is compensated, because the plant contains no invertible effect; export an "
        "augmented model of a diagnosis.",
    )
