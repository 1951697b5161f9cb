"""Motion by forces: two motors turn the tracks against the ground (thesis 2.37–2.42)."""

from typing import Annotated, Any, ClassVar

from pydantic import Field

from sysid.robot.mission.contracts import Body, MotionInputs, Pose, Scene
from sysid.robot.mission.vehicle_spec import Physics
from sysid.vehicle.dynamics import VehicleState, step, substeps_for
from sysid.vehicle.kinematics import Real


class Dynamic(Physics):
    """The vehicle moves as the torques of its motors, the ground and its inertia have it.

    The plant gives the motors; its own step, which knows no ground, is not run.

    Attributes:
        part: longest part of a sample that is computed in one go [s].
    """

    wanted: ClassVar[tuple[str, ...]] = ("soil", "mass", "yaw_inertia", "L", "track_width")
    columns: ClassVar[tuple[str, ...]] = ("v_y", "thrust_l", "thrust_r")
    """Speed of the centre of mass to the left [m/s], thrust of the tracks [N]."""

    part: Annotated[float, Field(ge=1e-4, le=0.1)] = 0.005

    def report(self, state: VehicleState, xp: Any) -> tuple[Real, ...]:
        return (state.vy, *state.forces.thrust)

    def start(self, scene: Scene, xp: Any) -> VehicleState:
        return VehicleState(*scene.start)

    def step(
        self, state: VehicleState, inputs: MotionInputs, dt: Real, xp: Any
    ) -> tuple[VehicleState, Body]:
        scene = inputs.scene
        car, floor, motors = scene.car, scene.floor, scene.motors
        assert car is not None
        assert floor is not None
        assert motors is not None
        scheme = substeps_for(scene.dt, self.part)
        after = step(state, inputs.drive, dt, car, motors, floor, xp, scheme)
        lateral = after.vy - car.centre * after.yaw_rate
        body = Body(Pose(after.x, after.y, after.psi), after.vx, after.yaw_rate, lateral)
        return after, body

    def wheel_speeds(self, state: VehicleState) -> tuple[Real, Real]:
        """ω of the left and the right track [rad/s]."""
        return state.omega
