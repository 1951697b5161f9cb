"""A bank of filters, one for each hypothesis, with their probabilities."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field, field_validator, model_validator

from sysid.robot.mission.axis import FirstOrder
from sysid.robot.mission.navigation.delays import BufferedSample
from sysid.robot.mission.navigation.design import LEAST_VARIANCE, Design
from sysid.robot.mission.navigation.ekf import measured, predicted
from sysid.robot.mission.navigation.fusion import COLUMNS, Density, Filter, Sight
from sysid.robot.mission.navigation.gaussian import Gaussian, Innovation, around, reset, wrapped
from sysid.robot.mission.navigation.process import POSE_AND_SPEEDS, PSI, Process, is_angle
from sysid.robot.mission.settings import Positive, Settings
from sysid.vehicle.kinematics import Geometry, Real

MOST = 8
"""Hypotheses at once: each costs an extended filter."""
LEAST_PROBABILITY = 1e-12
"""A weight does not fall below this, where it would vanish by rounding."""


class Hypothesis(Settings):
    """What may hold of the vehicle; what is not given is the vehicle's, or walks at random.

    Attributes:
        slip: part of the track speeds that is lost on both sides (2.24).
        lag, top_speed: how the speed follows the drive, v̇ = (top_speed·drive − v)/lag [s], [m/s];
            a payload makes a robot slower to answer. Both or none.
        radius, width: of sprockets and between the tracks [m].
        speed: density of the speed's walk [m²/s³], instead of the filter's.
    """

    slip: Annotated[float, Field(ge=0, lt=1)] = 0.0
    lag: Positive | None = None
    top_speed: Positive | None = None
    radius: Positive | None = None
    width: Positive | None = None
    speed: Density | None = None

    @model_validator(mode="after")
    def _both(self) -> "Hypothesis":
        if (self.lag is None) != (self.top_speed is None):
            raise ValueError("a hypothesis needs lag and top_speed together: give both or none")
        return self

    def process(self, common: Process) -> Process:
        response = None
        if self.lag is not None and self.top_speed is not None:
            response = FirstOrder(self.top_speed, self.lag)
        speed = common.speed if self.speed is None else self.speed
        return replace(common, speed=speed, response=response, slip=self.slip)

    def geometry(self, vehicle: Geometry) -> Geometry:
        return Geometry(self.radius or vehicle.r, self.width or vehicle.B)


class Bank(NamedTuple):
    """What a bank believes.

    Attributes:
        weight: probability of each hypothesis, (m,).
        x, P: mean and covariance under each, (m, n) and (m, n, n).
    """

    weight: Any
    x: Any
    P: Any


class FiniteModel(Filter):
    """An extended filter for each of a finite set of models; they exchange what they believe.

    An interacting-multiple-model filter (Blom & Bar-Shalom 1988): a hypothesis that holds goes on
    holding for ``dwell`` seconds on average and then any other follows. What each filter believes
    is mixed accordingly before each step, and the likelihood of every measurement moves the
    probabilities. The estimate is the mean over all hypotheses.

    Slip is a matter of the hypotheses here and no state.

    Attributes:
        hypotheses: by name; the log shows the probability of each as ``p_<name>``.
        dwell: mean time for which one holds [s].
    """

    default_sensors: ClassVar[tuple[str, ...]] = ("encoders", "gyroscope", "visual_odometry")

    hypotheses: Mapping[str, Hypothesis] = Field(
        default_factory=lambda: {"grip": Hypothesis(), "slip": Hypothesis(slip=0.3)}
    )
    dwell: Positive = 5.0

    @field_validator("hypotheses")
    @classmethod
    def _several(cls, given: Mapping[str, Hypothesis]) -> Mapping[str, Hypothesis]:
        if not 2 <= len(given) <= MOST:
            raise ValueError(f"hypotheses are {len(given)}: give 2 to {MOST} of them")
        for name in given:
            if not name.isidentifier():
                raise ValueError(f"a hypothesis is called {name!r}: use letters, digits and _")
        return given

    @property
    def columns(self) -> tuple[str, ...]:
        return (*COLUMNS, *(f"p_{name}" for name in self.hypotheses))

    @property
    def densities(self) -> Mapping[str, float]:
        """What is known of the densities; slip is left to the hypotheses."""
        return {**self.q, "slip": 0.0}

    def first(self, one: Gaussian, xp: Any) -> Bank:
        """The same under every hypothesis, all of them as likely."""
        m = len(self.hypotheses)
        return Bank(xp.full(m, 1.0 / m), xp.array([one.x] * m), xp.array([one.P] * m))

    def predicted(
        self, of: Bank, plan: Design, geometry: Geometry, sample: BufferedSample, xp: Any
    ) -> Bank:
        m = len(self.hypotheses)
        stay = xp.exp(-sample.dt / self.dwell)
        change = stay * xp.eye(m) + (1.0 - stay) / (m - 1) * (1.0 - xp.eye(m))
        joint = of.weight[:, None] * change  # from hypothesis i to j
        weight = joint.sum(axis=0)
        beliefs = []
        for j, hypothesis in enumerate(self.hypotheses.values()):
            mixed = mixture(Bank(joint[:, j] / weight[j], of.x, of.P), plan.process.names, xp)
            lengths, process = hypothesis.geometry(geometry), hypothesis.process(plan.process)
            beliefs.append(predicted(mixed, process, lengths, sample, xp))
        return Bank(weight, xp.array([g.x for g in beliefs]), xp.array([g.P for g in beliefs]))

    def corrected(self, of: Bank, plan: Design, sight: Sight, xp: Any) -> tuple[Bank, Innovation]:
        """What is believed after one group of measurements; rejected where no hypothesis has it."""
        open_gate = (math.inf,) * len(sight.quantiles)
        innovations = []
        for j, hypothesis in enumerate(self.hypotheses.values()):
            setting = sight.setting._replace(
                geometry=hypothesis.geometry(sight.setting.geometry), slip=hypothesis.slip
            )
            seen = sight._replace(setting=setting, quantiles=open_gate)
            innovations.append(measured(Gaussian(of.x[j], of.P[j]), plan.process.names, seen, xp))
        nis = xp.array([innovation.nis for _, innovation in innovations])
        likely = xp.array([innovation.log_likelihood for _, innovation in innovations])
        dof = innovations[0][1].dof
        passes = nis.min() <= xp.array(sight.quantiles)[xp.array(dof).astype(int)]
        # At least this probable, so that what was ruled out can come back.
        weight = xp.maximum(of.weight * xp.exp(likely - likely.max()), LEAST_PROBABILITY)
        after = Bank(
            weight / weight.sum(),
            xp.array([g.x for g, _ in innovations]),
            xp.array([g.P for g, _ in innovations]),
        )
        kept = Bank(*(xp.where(passes, new, old) for new, old in zip(after, of, strict=True)))
        return kept, Innovation(of.weight @ nis, dof, 1.0 - passes, of.weight @ likely)

    def moments(self, of: Bank, xp: Any) -> Gaussian:
        return mixture(of, POSE_AND_SPEEDS, xp)

    def set_since(self, of: Bank, T: Any, xp: Any) -> Bank:
        return Bank(of.weight, *reset(Gaussian(of.x, of.P), T, LEAST_VARIANCE, xp))

    def slip(self, of: Bank) -> Real:
        return sum(of.weight[j] * h.slip for j, h in enumerate(self.hypotheses.values()))

    def extra(self, of: Bank) -> tuple[Real, ...]:
        return tuple(of.weight[j] for j in range(len(self.hypotheses)))


def mixture(bank: Bank, names: tuple[str, ...], xp: Any) -> Gaussian:
    """Mean and covariance over all hypotheses.

    Args:
        names: of the states, in front; those behind them are no headings.
    """
    n = bank.x.shape[-1]
    angles = xp.array([i < len(names) and is_angle(names[i]) for i in range(n)])
    off = around(bank.x, angles, xp)
    mean = bank.weight @ off
    off = off - mean
    inner = (bank.weight[:, None, None] * (bank.P + off[:, :, None] * off[:, None, :])).sum(axis=0)
    return Gaussian(wrapped(bank.x[0] + mean, PSI, xp), inner)
