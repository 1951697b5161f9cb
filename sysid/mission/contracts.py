"""What passes between the parts of the closed loop, and the protocol of each part.

A part is a *law* with explicit state: ``start(scene, xp) -> state`` and
``step(state, inputs, dt, xp) -> (state, output)``. Both are pure: equal arguments give equal
results and nothing is kept elsewhere. A state is a number, an array, or a tuple, named tuple or
dict of states, of the same shape after every step; ``xp`` has NumPy's functions. Laws written so
(``xp.where`` instead of ``if`` on a number) serve one run and a compiled batch of runs unchanged.

Inputs are named tuples: a field that is added later does not concern the laws that do not read it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.vehicle.kinematics import Geometry, Real

State = Any
"""What a law remembers: a number, an array, or a tuple or dict of states."""


# Values -------------------------------------------------------------------------------------------


class Pose(NamedTuple):
    """X, Y [m] and ψ [rad], ψ in (−π, π], in the inertial frame."""

    x: Real
    y: Real
    psi: Real


class Body(NamedTuple):
    """Where a vehicle is and how it moves: truly, as motion says, or as navigation believes.

    Attributes:
        pose: X, Y [m], ψ [rad].
        speed: forward speed V_x [m/s].
        yaw_rate: ψ̇ [rad/s].
    """

    pose: Pose
    speed: Real
    yaw_rate: Real


class Disc(NamedTuple):
    """A round obstacle: the place of its point [m] and the radius of its surface [m]."""

    x: Real
    y: Real
    radius: Real


class Scene(NamedTuple):
    """What one run is about; it stays the same during a run and may differ between runs.

    Attributes:
        start: initial pose.
        goal: X, Y to reach [m].
        tolerance: the goal counts as reached within this distance [m].
        obstacles: what to keep clear of.
        geometry: lengths of the vehicle.
    """

    start: Pose
    goal: tuple[Real, Real]
    tolerance: Real
    obstacles: tuple[Disc, ...]
    geometry: Geometry

    def to_goal(self, pose: Pose, xp: Any) -> Real:
        """The distance from a pose to the goal [m]."""
        return xp.hypot(pose.x - self.goal[0], pose.y - self.goal[1])


class References(NamedTuple):
    """What guidance asks of control.

    Attributes:
        speed: V_ref [m/s].
        psi: ψ_ref [rad] in (−π, π].
        arrived: the "end of simulation" signal: there is nothing more to drive to.
    """

    speed: Real
    psi: Real
    arrived: Real


class Command(NamedTuple):
    """What control decides: speed and yaw command [drive], 1 is full drive."""

    v_cmd: Real
    psi_cmd: Real


# Inputs -------------------------------------------------------------------------------------------


class GuidanceInputs(NamedTuple):
    """What guidance knows at a control instant ``t`` [s]."""

    t: Real
    estimate: Body
    scene: Scene


class ControlInputs(NamedTuple):
    """What control knows at a control instant ``t`` [s]."""

    t: Real
    references: References
    estimate: Body
    scene: Scene


class NavigationInputs(NamedTuple):
    """What navigation is given at a sample ``t`` [s].

    Attributes:
        readings: what the sensors read, by name: ``omega_l``, ``omega_r`` [rad/s]; NaN where a
            sensor read nothing.
    """

    t: Real
    readings: Mapping[str, Real]
    scene: Scene


class MotionInputs(NamedTuple):
    """What moves the vehicle at a sample ``t`` [s]: the track speeds on the ground [rad/s]."""

    t: Real
    omega_l: Real
    omega_r: Real
    scene: Scene


# Parts --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class GuidanceAdvice:
    """What to change in a guidance law, for sentences about missions that failed; may be empty.

    Attributes:
        faster, slower: to drive faster, or slower, e.g. "lower v_max".
        wider: to keep farther from obstacles.
        closer: to let obstacles push less.
    """

    faster: str = ""
    slower: str = ""
    wider: str = ""
    closer: str = ""


@dataclass(frozen=True)
class ControlAdvice:
    """What to change in a controller.

    Attributes:
        stronger: to command more.
        steer: to steer harder.
    """

    stronger: str = ""
    steer: str = ""


@runtime_checkable
class Guidance(Protocol):
    """From the estimated pose to references of speed and yaw, once a control period."""

    @property
    def reach(self) -> float:
        """Distance from an obstacle's point within which it changes the way [m]; 0 never."""
        ...

    @property
    def advice(self) -> GuidanceAdvice:
        """What to change when a mission fails."""
        ...

    def start(self, scene: Scene, xp: Any) -> State: ...

    def step(
        self, state: State, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[State, References]: ...

    def to_go(self, state: State, pose: Pose, scene: Scene, xp: Any) -> Real:
        """The way still to go from a true pose [m]; a mission where it stops shrinking is stuck."""
        ...


@runtime_checkable
class Controller(Protocol):
    """From references and estimate to the speed and the yaw command, every ``period`` seconds."""

    @property
    def period(self) -> float: ...

    @property
    def advice(self) -> ControlAdvice: ...

    def start(self, scene: Scene, xp: Any) -> State: ...

    def step(
        self, state: State, inputs: ControlInputs, dt: Real, xp: Any
    ) -> tuple[State, Command]: ...


@runtime_checkable
class Navigation(Protocol):
    """From what the sensors read to where the robot thinks it is, at every sample of the plant.

    The first step, at t = 0, has ``dt`` = 0.
    """

    def start(self, scene: Scene, xp: Any) -> State: ...

    def step(
        self, state: State, inputs: NavigationInputs, dt: Real, xp: Any
    ) -> tuple[State, Body]: ...


@runtime_checkable
class Motion(Protocol):
    """From the speeds of the tracks on the ground to where the vehicle is, at every sample.

    The first step, at t = 0, has ``dt`` = 0.
    """

    def start(self, scene: Scene, xp: Any) -> State: ...

    def step(self, state: State, inputs: MotionInputs, dt: Real, xp: Any) -> tuple[State, Body]: ...


ROBOT_INPUTS = (Channel("pwm_l", "µs"), Channel("pwm_r", "µs"))
ROBOT_OUTPUTS = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))
"""Channels of a plant that is a robot, in this order."""


class SteppablePlant(Protocol):
    """A sampled system that the loop can run: u(k) held over [k dt, (k + 1) dt).

    Attributes:
        dt: sample time [s].
        inputs, outputs: the channels of u (nu,) and y (ny,), in physical units.
        input_range: lowest and highest value of each input in the data it was identified from;
            empty where nobody knows.
        u_offset: the value of each input around which it was identified, (nu,).
        ground: what the tracks lose on their way to the ground.
    """

    @property
    def dt(self) -> float: ...

    @property
    def inputs(self) -> tuple[Channel, ...]: ...

    @property
    def outputs(self) -> tuple[Channel, ...]: ...

    @property
    def input_range(self) -> tuple[tuple[float, float], ...]: ...

    @property
    def u_offset(self) -> Array: ...

    @property
    def ground(self) -> Ground: ...

    def initial_state(self) -> Array:
        """Return the state at rest."""
        ...

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """Return the next state and the output y(k) at this sample; ``state`` stays as it is."""
        ...
