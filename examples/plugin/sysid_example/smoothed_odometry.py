"""A navigation filter: odometry of wheel speeds behind a low-pass filter, for coarse encoders."""

from typing import Any, NamedTuple

from sysid.robot.mission.contracts import Body, NavigationInputs, Scene
from sysid.robot.mission.motion.kinematic import moved
from sysid.robot.mission.settings import Positive, Settings
from sysid.vehicle.kinematics import Real


class Smoothed(NamedTuple):
    """What the filter remembers: the last estimate and the smoothed wheel speeds [rad/s]."""

    estimate: Body
    omega_l: Real
    omega_r: Real


class SmoothedOdometry(Settings):
    """ω̂ ← ω̂ + (1 − e^(−dt/lag))(ω − ω̂), then the kinematics.

    Attributes:
        lag: time constant of the filter [s].
    """

    lag: Positive = 0.2

    def start(self, scene: Scene, xp: Any) -> Smoothed:
        """At rest in the start pose."""
        return Smoothed(Body(scene.start, 0.0, 0.0), 0.0, 0.0)

    def step(
        self, state: Smoothed, inputs: NavigationInputs, dt: Real, xp: Any
    ) -> tuple[Smoothed, Body]:
        """The estimate ``dt`` seconds later."""
        share = 1.0 - xp.exp(-dt / self.lag)
        left = state.omega_l + share * (inputs.measurements["omega_l"] - state.omega_l)
        right = state.omega_r + share * (inputs.measurements["omega_r"] - state.omega_r)
        estimate = moved(state.estimate, left, right, inputs.scene.geometry, dt, xp)
        return Smoothed(estimate, left, right), estimate
