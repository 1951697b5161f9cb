"""Adaptive control along one axis: model reference, or gains scheduled on a recursive estimate.

Motions count in shares of the nominal speed at full drive, μ = v/g and ρ = r/g, so that the same
rates of adaptation serve any plant: τ μ̇ = b d + c − μ, nominally with b = 1 and c = 0.
"""

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from sysid.robot.mission.axis import AxisInputs
from sysid.robot.mission.control.model_based import AngleGain, target
from sysid.robot.mission.settings import AxisSettings, Search
from sysid.vehicle.kinematics import Real

FARTHEST = 3.0
"""Most that an adapted gain departs from its nominal value; 1 is a plant that answers twice."""

WEAKEST = 0.2
"""Smallest answer to a command that a law divides by, as a share of the nominal one."""

UNSURE = 100.0
"""Prior variance of the estimated numbers over that of μ, and the most that forgetting makes of it.

Numbers that are 0.3 off, and measurements within 0.03 of full speed.
"""


class Followed(NamedTuple):
    """What model reference remembers: the model's motion, and how far the gains have departed."""

    model: Real
    on_reference: Real
    on_motion: Real
    level: Real


class Estimated(NamedTuple):
    """What the recursive estimate remembers.

    Attributes:
        a, b, c: departure of μ⁺ = a μ + b d + c from the nominal numbers.
        variance: of these, the upper half row by row: aa, ab, ac, bb, bc, cc.
        motion: μ of the instant before.
    """

    a: Real
    b: Real
    c: Real
    variance: tuple[Real, Real, Real, Real, Real, Real]
    motion: Real
    begun: Real


class Adaptive(AxisSettings):
    """A law whose gains follow the plant.

    Attributes:
        method: ``gain-scheduled`` on the recursive estimate, or ``model-reference``.
        model_time: T_m, time constant that the answer is to have [s].
        rate: γ, how fast model reference adapts [1/s].
        memory: how far back the recursive estimate looks [s].

    Source: Åström and Wittenmark, Adaptive Control (1995), sections 5.4 (Lyapunov rule), 5.3
    (normalised), 2.2 and 3.5 (recursive least squares with forgetting, self-tuning regulator).
    """

    method: Literal["gain-scheduled", "model-reference"] = "gain-scheduled"
    model_time: Annotated[float, Field(ge=0.01, le=60), Search(0.1, 2.0)] = 0.4
    rate: Annotated[float, Field(ge=0, le=100), Search(0.1, 10.0)] = 1.0
    memory: Annotated[float, Field(ge=0.1, le=1e4)] = 10.0

    @property
    def uses_plant(self) -> bool:
        return True

    def start(self, scene: Any, xp: Any) -> Followed | Estimated:
        if self.method == "model-reference":
            return Followed(0.0, 0.0, 0.0, 0.0)
        return Estimated(0.0, 0.0, 0.0, (UNSURE, 0.0, 0.0, UNSURE, 0.0, UNSURE), 0.0, 0.0)

    def step(
        self, state: Any, inputs: AxisInputs, dt: Real, xp: Any
    ) -> tuple[Followed | Estimated, Real]:
        reachable = target(self, inputs, xp).motion / inputs.plant.gain
        asked = xp.clip(reachable, inputs.low, inputs.high)
        motion = inputs.motion / inputs.plant.gain
        by = self._followed if self.method == "model-reference" else self._scheduled
        return by(state, asked, motion, inputs, dt, xp)

    def _followed(
        self, state: Followed, asked: Real, motion: Real, inputs: AxisInputs, dt: Real, xp: Any
    ) -> tuple[Followed, Real]:
        """d = k_r ρ − k_m μ + k_0; k̇_r = −γ ε ρ/n, k̇_m = γ ε μ/n, k̇_0 = −γ ε/n, ε = μ − μ_m.

        n = 1 + ρ² + μ² keeps the rate of adaptation from growing with the signals. While the
        command is on a limit, nothing is learnt and the model waits where the robot is.
        """
        quicker = inputs.plant.lag / self.model_time
        command = (quicker + state.on_reference) * asked
        command = command - (quicker - 1.0 + state.on_motion) * motion + state.level
        acts = xp.clip(command, inputs.low, inputs.high)
        free = acts == command
        behind = motion - state.model
        pace = xp.where(free, self.rate * dt / (1.0 + asked**2 + motion**2), 0.0) * behind
        follows = state.model + (1.0 - xp.exp(-dt / self.model_time)) * (asked - state.model)
        after = Followed(
            model=xp.where(free, follows, motion),
            on_reference=_near(state.on_reference - pace * asked, xp),
            on_motion=_near(state.on_motion + pace * motion, xp),
            level=_near(state.level - pace, xp),
        )
        return after, acts

    def _scheduled(
        self, state: Estimated, asked: Real, motion: Real, inputs: AxisInputs, dt: Real, xp: Any
    ) -> tuple[Estimated, Real]:
        """d = ((p − a) μ + (1 − p) ρ − c)/b with p = e^{−T/T_m}, a, b, c as estimated until now."""
        keeps = xp.exp(-dt / xp.maximum(inputs.plant.lag, 1e-3 * dt))
        after = self._estimate(state, motion, keeps, inputs, dt, xp)
        a, b = keeps + after.a, xp.maximum(1.0 - keeps + after.b, WEAKEST * (1.0 - keeps))
        pole = xp.exp(-dt / self.model_time)
        command = ((pole - a) * motion + (1.0 - pole) * asked - after.c) / b
        return after, xp.clip(command, inputs.low, inputs.high)

    def _estimate(
        self, state: Estimated, motion: Real, keeps: Real, inputs: AxisInputs, dt: Real, xp: Any
    ) -> Estimated:
        """One step of recursive least squares with exponential forgetting.

        K = P φ/(λ + φᵀ P φ), θ ← θ + K (μ − φᵀ θ), P ← (P − K φᵀ P)/λ with φ = (μ, d, 1) of the
        instant before and λ = e^{−T/memory}; without news P grows to its prior and no further.
        """
        aa, ab, ac, bb, bc, cc = state.variance
        u, d = state.motion, inputs.applied
        forget = xp.exp(-dt / self.memory)
        pa, pb, pc = aa * u + ab * d + ac, ab * u + bb * d + bc, ac * u + bc * d + cc
        share = state.begun / (forget + u * pa + d * pb + pc)
        said = (keeps + state.a) * u + (1.0 - keeps + state.b) * d + state.c
        news = share * (motion - said)
        residual = (
            *(aa - share * pa * pa, ab - share * pa * pb, ac - share * pa * pc),
            *(bb - share * pb * pb, bc - share * pb * pc, cc - share * pc * pc),
        )
        grown = tuple(v / forget for v in residual)
        largest = xp.maximum(xp.maximum(grown[0], grown[3]), grown[5])
        within = xp.minimum(1.0, UNSURE / xp.maximum(largest, 1e-12))
        aa, ab, ac, bb, bc, cc = (v * within for v in grown)
        theta = (state.a + news * pa, state.b + news * pb, state.c + news * pc)
        return Estimated(*theta, (aa, ab, ac, bb, bc, cc), motion + 0.0 * u, 1.0 + 0.0 * u)


class YawAdaptive(Adaptive):
    """Adaptive control of the yaw rate, which the yaw error asks for.

    Attributes:
        angle_gain: K_ψ, yaw rate asked for per yaw error [1/s].
    """

    angle_gain: Annotated[AngleGain, Search(0.5, 5.0)] = 1.5


def _near(departure: Real, xp: Any) -> Real:
    return xp.clip(departure, -FARTHEST, FARTHEST)
