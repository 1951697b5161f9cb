"""Motion of a vehicle whose tracks turn on an identified ground."""

from sysid.effects.ground import Ground
from sysid.robot.mission.contracts import MotionInputs, Scene, State
from sysid.vehicle.kinematics import Real, body_velocity


def on_ground(
    ground: Ground,
    state: State,
    omega: tuple[Real, Real],
    at: tuple[Real, Real],
    scene: Scene,
) -> tuple[State, MotionInputs]:
    """What moves the vehicle when its tracks turn on an identified ground.

    Args:
        ground: what stands between tracks and ground.
        omega: speeds of the left and the right track [rad/s].
        at: instant, and time since the sample before [s].
        scene: what the run is about.

    Returns:
        What the ground remembers then, and the inputs of the motion.
    """
    (left, right), after = ground.step(state, omega, at[1])
    inputs = MotionInputs(at[0], left, right, scene)
    if not ground.slides:
        return after, inputs
    speeds = body_velocity(left, right, scene.geometry)
    return after, inputs._replace(lateral=ground.lateral(*speeds))
