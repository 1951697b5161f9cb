"""The common part of all fusing filters: keys, order of work, reported columns.

Recovery of a filter that rejects one measurement after another.

A gate keeps outliers away. Once the vehicle has moved as the filter's process does not know, to the
side for instance, every right measurement lies beyond the gate as well, and the filter would never
find back. How to distinguish: outliers come alone or contradict each other; measurements
that are right stay off by the same. After a run of rejected measurements that agree, the pose is
assumed to have moved by them, Var = ν², and the next one corrects it.
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field, field_validator

from sysid.robot.mission.contracts import Body, NavigationInputs, Pose, Scene, Sensor
from sysid.robot.mission.navigation import delays
from sysid.robot.mission.navigation.delays import BufferedSample, History
from sysid.robot.mission.navigation.design import LEAST_VARIANCE, Design, Noises, design
from sysid.robot.mission.navigation.flow import compiled
from sysid.robot.mission.navigation.gaussian import (
    Gaussian,
    Innovation,
    chi2_quantiles,
    innovation,
    reset,
    symmetric,
)
from sysid.robot.mission.navigation.measurements import EXPECTED, Group, Setting
from sysid.robot.mission.navigation.process import over_ground
from sysid.robot.mission.settings import Settings
from sysid.vehicle.kinematics import Geometry, Real

RUN = 5
"""Rejected measurements in a row that agree: outliers, one in ten, make such a run once in 10⁵."""

AGREE = 0.25
"""Two innovations agree if they differ by less than half of their size, in squares."""

POSE = 3
"""States x, y, psi, the first ones of every filter."""

DOUBTS = frozenset({"position_fixes", "visual_odometry"})
"""Absolute sensors without long disturbances from the surroundings. Iron bends
the field of a magnetometer for as long as the robot is beside it, which looks the same."""


class Doubt(NamedTuple):
    """What a filter remembers of the measurements of a sensor that it rejected.

    Attributes:
        run: how many in a row were rejected and agree.
        nu: innovation of the last measurement, (m,).
    """

    run: Any
    nu: Any


def doubts(group: Group, gate: float) -> bool:
    """Whether rejected measurements of a sensor can make the filter doubt itself."""
    return gate < 1 and group.kind in DOUBTS


def doubted(
    one: Gaussian, names: tuple[str, ...], sight: Any, before: Doubt, xp: Any
) -> tuple[Doubt, Any]:
    """Judge a group of measurements, before they are used.

    Args:
        one: mean and covariance that is believed, the states of ``names`` in front.

    Returns:
        What is remembered from now on, and what is to be added to P, (n, n): 0 while the run is
        shorter than :data:`RUN`.
    """
    nu, H = sight.group.linearised(sight.z, one.x, names, sight.setting, xp)
    present = xp.isfinite(nu)
    came = present.any()
    nu, H = xp.where(present, nu, 0.0), xp.where(present[:, None], H, 0.0)
    S = H @ one.P @ H.T + sight.variance * xp.eye(len(nu))
    innovated, inverse = innovation(nu, S, sight.variance, present, sight.quantiles, xp)
    off = nu - before.nu
    agrees = 1.0 * (off @ inverse @ off <= AGREE * innovated.nis)
    run = xp.where(came, innovated.rejected * (1.0 + agrees * before.run), before.run)
    pose_part = H * xp.array([1.0 * (i < POSE) for i in range(len(one.x))])
    more = 1.0 * (run >= RUN) * came
    added = more * symmetric((pose_part.T * (nu * nu)) @ pose_part)
    return Doubt(run, xp.where(came, nu, before.nu)), added


Density = Annotated[float, Field(ge=0, le=1e6)]
Variance = Annotated[float, Field(ge=1e-12, le=1e12)]
Deviation = Annotated[float, Field(ge=1e-6, le=1e3)]

COLUMNS = (
    "x_est", "y_est", "psi_est", "v_est", "yaw_rate_est",
    "P_xx", "P_xy", "P_yy", "P_x_psi", "P_y_psi", "P_psi",
    "slip_l_est", "slip_r_est", "gyro_bias_est",
    "nis", "nis_dof", "rejected", "log_likelihood",
)  # fmt: skip
"""What every filter adds to a mission's log: estimate, covariance, and the innovations of the
measurements that came at a sample, rejected ones included; NaN where a filter has no such state."""


NOTHING_READ = Innovation(0.0, 0.0, 0.0, 0.0)
"""Innovations of the measurements that came at one sample are summed up from this."""


class Belief(NamedTuple):
    """What a filter believes after a sample.

    Attributes:
        of: mean and covariance, or what a kind of filter has instead.
        marks: of each group the time since its last measurement [s] and the numbers of that.
        doubt: of the groups that can make the filter doubt itself, by their place.
    """

    of: Any
    marks: tuple[Any, ...]
    doubt: tuple[Doubt, ...] = ()


class FilterState(NamedTuple):
    """What a filter remembers.

    Attributes:
        history: the samples that late measurements may still change.
        shown: what it reports, in the order of its columns.
    """

    belief: Belief
    history: History | tuple[()]
    shown: tuple[Real, ...]


class Sight(NamedTuple):
    """One group of measurements at one sample, ready to be used.

    Attributes:
        z: the numbers, (m,); NaN where nothing was read.
        variance: of each, (m,).
        quantiles: the gate, by the number of measurements that came.
    """

    group: Group
    z: Any
    variance: Any
    setting: Setting
    quantiles: tuple[float, ...]


class Filter(Settings):
    """Base of filters: measurements of any subset of sensors, fused in the order of the file.

    Attributes:
        q: densities of what walks at random, by state: ``speed`` [m²/s³], ``yaw_rate`` [rad²/s³],
            ``slip`` [1/s], ``gyro_z_bias`` and the like [unit²/s]; those that are not given come
            from the sensors' figures or are a small robot's.
        r: variances of measurements by name [unit²]; those that are not given are the sensors'.
        gate: a measurement whose innovation lies beyond this quantile of χ² is rejected, unless
            it is one of a run of position fixes or camera frames that agree; 1 takes everything.
        buffer: how many samples late a measurement may come [samples].
        sigma_position, sigma_heading: standard deviation of the start pose [m], [rad].
    """

    q: Mapping[str, Density] = Field(default_factory=dict)
    r: Mapping[str, Variance] = Field(default_factory=dict)
    gate: Annotated[float, Field(gt=0.5, le=1)] = 0.9999
    buffer: Annotated[int, Field(ge=0, le=1000)] = 100
    sigma_position: Deviation = 0.001
    sigma_heading: Deviation = 0.001

    linear: ClassVar[bool] = False
    default_sensors: ClassVar[tuple[str, ...]] = ("encoders", "gyroscope")

    @field_validator("q")
    @classmethod
    def _states(cls, q: Mapping[str, float]) -> Mapping[str, float]:
        known = ["speed", "yaw_rate", "slip", *(f"{name}_bias" for name in EXPECTED)]
        return _known(q, known, "a density q")

    @field_validator("r")
    @classmethod
    def _measurements(cls, r: Mapping[str, float]) -> Mapping[str, float]:
        return _known(r, list(EXPECTED), "a variance r")

    # What a filter of one kind says ---------------------------------------------------------------

    @abstractmethod
    def predicted(
        self, of: Any, plan: Design, geometry: Geometry, sample: BufferedSample, xp: Any
    ) -> Any:
        """What is believed ``sample.dt`` later."""

    @abstractmethod
    def corrected(self, of: Any, plan: Design, sight: Sight, xp: Any) -> tuple[Any, Innovation]:
        """What is believed after one group of measurements, some of them present."""

    def first(self, one: Gaussian, xp: Any) -> Any:
        return one

    def moments(self, of: Any, xp: Any) -> Gaussian:
        one: Gaussian = of
        return one

    def widened(self, of: Any, added: Any) -> Any:
        """What is believed once something has moved the vehicle that the process does not know."""
        return of._replace(P=of.P + added)

    def set_since(self, of: Any, T: Any, xp: Any) -> Any:
        """What is believed once a measurement has set states for the next one of its sensor."""
        return reset(of, T, LEAST_VARIANCE, xp)

    def slip(self, of: Any) -> Real:
        """Part of the track speeds that is lost besides the states of slip."""
        return 0.0

    def extra(self, of: Any) -> tuple[Real, ...]:
        """What a kind shows besides, in the order of its own columns."""
        return ()

    # The loop's side ------------------------------------------------------------------------------

    def plan(self, scene: Scene) -> Design:
        """The filter laid out for the sensors of a scene."""
        return self.layout(scene.sensors, scene.dt)

    @property
    def densities(self) -> Mapping[str, float]:
        return self.q

    def layout(self, sensors: Mapping[str, Sensor], dt: float) -> Design:
        """The filter for some sensors and a sample time [s]."""
        noises = Noises(
            tuple(sorted(self.densities.items())),
            tuple(sorted(self.r.items())),
            self.sigma_position,
            self.sigma_heading,
            self.buffer,
        )
        return design(sensors, dt, noises, self.linear)

    @property
    def columns(self) -> tuple[str, ...]:
        return COLUMNS

    def start(self, scene: Scene, xp: Any) -> FilterState:
        """At rest in the start pose, which is known within its standard deviation."""
        plan = self.plan(scene)
        n = len(plan.start)
        x = xp.array([*scene.start, *(0.0 * scene.start.x,) * (n - 3)])
        one = Gaussian(x, xp.array(plan.start) * xp.eye(n))
        for T in plan.since:
            one = one if T is None else reset(one, xp.array(T), LEAST_VARIANCE, xp)
        nothing = tuple(xp.full(len(g.names), xp.nan) for g in plan.groups)
        marks = tuple(xp.concatenate([xp.zeros(1), z]) for z in nothing)
        certain = [len(g.names) for g in plan.groups if doubts(g, self.gate)]
        doubt = tuple(Doubt(xp.array(0.0), xp.zeros(m)) for m in certain)
        belief = Belief(self.first(one, xp), marks, doubt)
        empty = BufferedSample(0.0, 0.0, nothing, xp.zeros(len(plan.groups)))
        history = delays.begun(belief, empty, plan.latest, xp)
        return FilterState(
            belief, history, self._shown(belief, plan, scene.geometry, NOTHING_READ, xp)
        )

    def step(
        self, state: FilterState, inputs: NavigationInputs, dt: Real, xp: Any
    ) -> tuple[FilterState, Body]:
        """The belief ``dt`` seconds later, with all that came until then."""
        scene = inputs.scene
        plan = self.plan(scene)
        z = tuple(group.values(inputs.measurements, xp) for group in plan.groups)
        drive = 0.5 * (inputs.drive[0] + inputs.drive[1])
        sample = BufferedSample(dt, drive, z, xp.ones(len(z)))

        def fuse(belief: Any, given: BufferedSample) -> tuple[Any, Innovation]:
            return self.fused(belief, plan, scene.geometry, given, xp)

        history: History | tuple[()] = ()
        if not isinstance(state.history, History):
            belief, counted = fuse(state.belief, sample)
        else:
            late = tuple(g.delay for g in plan.groups)
            history, counted = delays.advanced(fuse, state.history, sample, late, xp)
            belief = delays.newest(history)
        shown = self._shown(belief, plan, scene.geometry, counted, xp)
        return FilterState(belief, history, shown), Body(Pose(*shown[:3]), *shown[3:5])

    def report(self, state: FilterState, xp: Any) -> tuple[Real, ...]:
        return state.shown

    def fused(
        self, belief: Belief, plan: Design, geometry: Geometry, sample: BufferedSample, xp: Any
    ) -> tuple[Belief, Innovation]:
        """One sample: predict, then correct by each group in turn."""
        of = self.predicted(belief.of, plan, geometry, sample, xp)
        counted, marks, doubt = NOTHING_READ, [], list(belief.doubt)
        doubted_groups = [k for k, group in enumerate(plan.groups) if doubts(group, self.gate)]
        for k, (group, z, mark) in enumerate(zip(plan.groups, sample.z, belief.marks, strict=True)):
            elapsed, came = mark[0] + sample.dt, xp.isfinite(z).any()
            waiting = xp.concatenate([xp.array([elapsed]), mark[1:]])
            marks.append(waiting)
            if not compiled(xp) and not came:
                continue
            setting = Setting(geometry, elapsed=elapsed, known_heading=self.linear)
            values, spread = (
                group.direct_values(z, mark[1:], elapsed, xp),
                group.spread(elapsed, xp),
            )
            quantiles = chi2_quantiles(self.gate, len(group.names))
            sight = Sight(group, values, spread, setting, quantiles)
            if k in doubted_groups:
                at, names = doubted_groups.index(k), plan.process.names
                doubt[at], added = doubted(self.moments(of, xp), names, sight, doubt[at], xp)
                of = self.widened(of, added)
            of, innovated = self.corrected(of, plan, sight, xp)
            fresh = sample.fresh[k]
            counted = Innovation(*(c + fresh * f for c, f in zip(counted, innovated, strict=True)))
            T = plan.since[k]
            if T is not None:
                of = self.set_since(of, xp.where(came, xp.array(T), xp.eye(len(T))), xp)
            marks[-1] = xp.where(came, xp.concatenate([xp.zeros(1), z]), waiting)
        return Belief(of, tuple(marks), tuple(doubt)), counted

    def _shown(
        self, belief: Belief, plan: Design, geometry: Geometry, counted: Innovation, xp: Any
    ) -> tuple[Real, ...]:
        x, P = self.moments(belief.of, xp)
        s = {name: x[i] for i, name in enumerate(plan.process.names)}
        ground = over_ground(s, geometry, self.slip(belief.of))
        others = (s.get(name, xp.nan) for name in ("slip_l", "slip_r", "gyro_z_bias"))
        of_pose = P[0, 0], P[0, 1], P[1, 1], P[0, 2], P[1, 2], P[2, 2]
        seen = x[0], x[1], x[2], ground.speed, ground.yaw_rate
        shown = (*seen, *of_pose, *others, *counted, *self.extra(belief.of))
        return shown if compiled(xp) else tuple(map(float, shown))


def _known(given: Mapping[str, float], known: list[str], what: str) -> Mapping[str, float]:
    for name in given:
        if name not in known:
            raise ValueError(f"there is {what} of {name!r}: the names are {', '.join(known)}")
    return given
