"""A robot plant with ground forces on its motors, as controllers and limits see it."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.effects.ground import Ground
from sysid.robot.mission.contracts import Scene, SteppablePlant
from sysid.robot.mission.tracks.robot_plant import TrackChannels
from sysid.robot.mission.tracks.torque import motors_of
from sysid.runners import floats
from sysid.vehicle.dynamics import Forces, VehicleState, step, substeps_for
from sysid.vehicle.floor import Floor
from sysid.vehicle.motors import Motor
from sysid.vehicle.tracked import TrackedVehicle


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

    @property
    def ground(self) -> Ground:
        return Ground()

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
    """The plant's motors under the vehicle of a scene, on its floor without patches and slope.

    Raises:
        ModelError: the plant has no torques.
    """
    assert scene.car is not None
    assert scene.floor is not None
    floor = replace(scene.floor, patches=(), slope=(0.0, 0.0))
    return GroundedPlant(plant.dt, scene.car, motors_of(plant), floor)
