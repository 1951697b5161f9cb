"""What passes between the parts of the closed loop, and the protocol of each part.

A part is a *law* with explicit state: ``start(scene, xp) -> state`` and
``step(state, inputs, dt, xp) -> (state, output)``. Both are pure: equal arguments give equal
results and nothing is kept elsewhere. A state is a number, an array, or a tuple, named tuple or
dict of states, of the same shape after every step; ``xp`` has NumPy's functions. Laws written so
(``xp.where`` instead of ``if`` on a number) serve one run and a compiled batch of runs unchanged.

Inputs are named tuples: a field that is added later does not concern the laws that do not read it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, runtime_checkable

from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.robot.mission.axis import PUBLISHED, Nominal
from sysid.robot.mission.traits import ControlAdvice, GuidanceAdvice, GuidanceTraits, Hold
from sysid.vehicle.floor import Floor
from sysid.vehicle.kinematics import Geometry, Real
from sysid.vehicle.motors import Motor
from sysid.vehicle.tracked import TrackedVehicle

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
        lateral: speed to the left V_y [m/s]; tracks that do not slide sideways have none.
    """

    pose: Pose
    speed: Real
    yaw_rate: Real
    lateral: Real = 0.0


class Disc(NamedTuple):
    """A round obstacle, which may move at constant velocity.

    Attributes:
        x, y: place of its point at t = 0 [m].
        radius: of its surface [m].
        vx, vy: velocity of its point [m/s].
    """

    x: Real
    y: Real
    radius: Real
    vx: Real = 0.0
    vy: Real = 0.0

    def at(self, t: Real) -> "Disc":
        """The obstacle with its place at ``t`` [s]."""
        if type(self.vx) is type(self.vy) is float and self.vx == self.vy == 0.0:
            return self
        return self._replace(x=self.x + self.vx * t, y=self.y + self.vy * t)


Point = tuple[Real, Real]
"""X, Y [m]."""


class Wall(NamedTuple):
    """A thin wall along straight pieces from point to point; that of a polygon ends where it began.

    Attributes:
        points: two or more.
    """

    points: tuple[Point, ...]


class Limits(NamedTuple):
    """What the identified plant can do at most; infinite where unknown.

    Attributes:
        speed: of the body [m/s].
        acceleration: of the body [m/s²].
        yaw_rate: [rad/s].
        yaw_acceleration: [rad/s²].
    """

    speed: Real = math.inf
    acceleration: Real = math.inf
    yaw_rate: Real = math.inf
    yaw_acceleration: Real = math.inf


class Scene(NamedTuple):
    """What one run is about; it stays the same during a run and may differ between runs.

    Attributes:
        goal: X, Y to reach [m].
        tolerance: the goal counts as reached within this distance [m].
        obstacles, walls: what to keep clear of.
        way: points to pass on the way to the goal.
        path: points of the line to follow to the goal, for laws that follow one.
        limits: what the plant can do.
        nominal: what the plant answers to both commands, for controllers that need a model.
        sensors: what navigation reads besides the wheels, by kind, with its figures.
        dt: time between two samples [s]; the loop puts the plant's here.
        car: lengths, mass and inertia, for motions that ask.
        floor: what it stands on, likewise.
        motors: of the left and the right track, where the motion turns the tracks.
    """

    start: Pose
    goal: Point
    tolerance: Real
    obstacles: tuple[Disc, ...]
    geometry: Geometry
    walls: tuple[Wall, ...] = ()
    way: tuple[Point, ...] = ()
    path: tuple[Point, ...] = ()
    limits: Limits = Limits()
    nominal: Nominal = PUBLISHED
    sensors: Mapping[str, "Sensor"] = MappingProxyType({})
    dt: float = 0.1
    car: TrackedVehicle | None = None
    floor: Floor | None = None
    motors: tuple[Motor, Motor] | None = None

    @property
    def targets(self) -> tuple[Point, ...]:
        """The waypoints and the goal, in the order in which they are to be reached."""
        return (*self.way, self.goal)

    def to_goal(self, pose: Pose, xp: Any) -> Real:
        """The distance from a pose to the goal [m]."""
        return xp.hypot(pose.x - self.goal[0], pose.y - self.goal[1])


class Figures(NamedTuple):
    """What a filter has to know of one measurement of a sensor.

    Attributes:
        variance: of its white error, quantisation included [unit²].
        bias_variance: of the bias it starts with [unit²].
        bias_drift: what the bias's variance gains a second [unit²/s].
        interval: time between two measurements [s].
        delay: samples of the plant between the instant that a measurement is of and the sample at
            which navigation gets it.
        dropout: probability that a measurement is lost.
    """

    variance: float
    bias_variance: float = 0.0
    bias_drift: float = 0.0
    interval: float = 0.0
    delay: int = 0
    dropout: float = 0.0


class References(NamedTuple):
    """What guidance asks of control.

    Attributes:
        speed: V_ref [m/s].
        psi: ψ_ref [rad] in (−π, π].
        arrived: the "end of simulation" signal: there is nothing more to drive to.
        hold: what keeps the robot from coming closer, as a number of :class:`Hold`.
        detour: it is led away from the goal on purpose, so that coming no closer is no fault.
        gives_up: there is no way that the law could lead; ``hold`` says why.
    """

    speed: Real
    psi: Real
    arrived: Real
    hold: Real = 0
    detour: Real = False
    gives_up: Real = False


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
    """What control knows at a control instant ``t`` [s].

    Attributes:
        applied: what of the last command reached the tracks, as far as is known [drive].
    """

    t: Real
    references: References
    estimate: Body
    scene: Scene
    applied: Command = Command(0.0, 0.0)


class NavigationInputs(NamedTuple):
    """What navigation is given at a sample ``t`` [s].

    Attributes:
        measurements: what the sensors read, by name: ``omega_l``, ``omega_r`` [rad/s] and the names
            of every sensor of the scene; NaN where a sensor read nothing.
        drive: left and right command held since the sample before [drive], 1 is full drive.
    """

    t: Real
    measurements: Mapping[str, Real]
    scene: Scene
    drive: tuple[Real, Real] = (0.0, 0.0)


class SensorInputs(NamedTuple):
    """What a sensor is exposed to at a sample ``t`` [s].

    Attributes:
        body: where the vehicle truly is and how it moves.
        omega_l, omega_r: true wheel speeds [rad/s].
        draws: independent standard normal numbers of this sample, as many as the sensor asks for.
    """

    t: Real
    body: Body
    omega_l: Real
    omega_r: Real
    draws: Sequence[Real]
    scene: Scene


class MotionInputs(NamedTuple):
    """What moves the vehicle at a sample ``t`` [s].

    Attributes:
        omega_l, omega_r: the track speeds on the ground [rad/s]; those of the sample before where
            the motion turns the tracks itself.
        drive: left and right command held since the sample before [drive], 1 is full drive.
        lateral: speed to the left on the ground [m/s], None for none; forces of a motion overrule.
    """

    t: Real
    omega_l: Real
    omega_r: Real
    scene: Scene
    drive: tuple[Real, Real] = (0.0, 0.0)
    lateral: Real | None = None


# Parts --------------------------------------------------------------------------------------------


@runtime_checkable
class Guidance(Protocol):
    """From the estimated pose to references of speed and yaw, once a control period."""

    @property
    def reach(self) -> float:
        """Distance from an obstacle's point within which it changes the way [m]; 0 never."""

    @property
    def advice(self) -> GuidanceAdvice:
        """What to change when a mission fails."""

    @property
    def traits(self) -> GuidanceTraits:
        """What it can do and needs."""

    def start(self, scene: Scene, xp: Any) -> State: ...

    def step(
        self, state: State, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[State, References]: ...

    def to_go(self, state: State, pose: Pose, scene: Scene, xp: Any) -> Real:
        """The way still to go from a true pose [m]; a mission where it stops shrinking is stuck."""


@runtime_checkable
class HasPotential(Protocol):
    """A guidance law that descends a potential."""

    def potential(self, x: Real, y: Real, scene: Scene, xp: Any) -> Real:
        """The potential at X, Y [m]; its unit is the law's own."""


@runtime_checkable
class Controller(Protocol):
    """From references and estimate to the speed and the yaw command, every ``period`` seconds."""

    @property
    def period(self) -> float: ...

    @property
    def advice(self) -> ControlAdvice: ...

    @property
    def uses_plant(self) -> bool:
        """Whether it needs ``scene.nominal`` of the identified plant, which is then measured."""

    @property
    def compensate(self) -> tuple[str, ...] | str:
        """Ids of the plant's effects to make up for on the way to the tracks, or all of them."""

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


@runtime_checkable
class TurnsTracks(Protocol):
    """A motion that turns the tracks itself, by ``scene.motors`` against the ground.

    The plant is not stepped then. At a sample such a motion comes first: from the last sample to
    this one under the command held in between. What it says of wheels and body is what sensors
    read, what navigation, guidance and control decide on, and what the log holds.
    """

    def wheel_speeds(self, state: State) -> tuple[Real, Real]:
        """ω of the left and the right track after a step [rad/s]."""


@runtime_checkable
class Sensor(Protocol):
    """From the true motion to what is read of it, at every sample of the plant.

    Randomness comes in from outside, as standard normal numbers, so that one run and a batch of
    runs see the same noise. The first step, at t = 0, has ``dt`` = 0.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """What it reads, as navigation and the log call it, e.g. ``gyro_z``."""

    @property
    def draws(self) -> int:
        """Standard normal numbers that a sample needs."""

    def figures(self, dt: float) -> Mapping[str, Figures]:
        """How well it reads, by name, where the plant's sample time is ``dt`` [s]."""

    def start(self, scene: Scene, xp: Any) -> State: ...

    def step(
        self, state: State, inputs: SensorInputs, dt: Real, xp: Any
    ) -> tuple[State, tuple[Real, ...]]:
        """The measurements in the order of ``names``; NaN where nothing is read at this sample."""


@runtime_checkable
class Holding(Protocol):
    """A law of guidance that knows where it may hold a robot back."""

    def hold(self, scene: Scene, t: Array, x: Array, y: Array) -> Hold:
        """What held a robot that was at these places [m] at ``t`` [s] and got nowhere."""


@runtime_checkable
class Reporting(Protocol):
    """A law that shows what it remembers, in columns of the mission's log."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, with none of another part."""

    def report(self, state: State, xp: Any) -> tuple[Real, ...]:
        """Their values after a step."""


ROBOT_INPUTS = (Channel("pwm_l", "µs"), Channel("pwm_r", "µs"))
ROBOT_OUTPUTS = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))
"""Channels of a plant that is a robot, in this order."""


class SteppablePlant(Protocol):
    """A sampled system that the loop can run: u(k) held over [k dt, (k + 1) dt).

    Attributes:
        dt: sample time [s].
        inputs, outputs: the channels of u (nu,) and y (ny,), in physical units.
        input_range: lowest and highest value of each input in the data it was identified from;
            empty where unknown.
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

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """Return the next state and the output y(k) at this sample; ``state`` stays as it is."""


Readout = Callable[[Array, Array], Array]
"""(state, u) → y(k)."""


@runtime_checkable
class ReadablePlant(Protocol):
    """A plant that computes y(k) without a step; a loop reads before it decides on u(k)."""

    def readout(self, state: Array, u: Array) -> Array: ...


def readout_of(plant: SteppablePlant) -> Readout:
    """What reads y(k) of a plant: its own readout, or the output of a step."""
    if isinstance(plant, ReadablePlant):
        return plant.readout
    return lambda state, u: plant.step(state, u)[1]
