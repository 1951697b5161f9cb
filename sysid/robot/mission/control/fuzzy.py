"""Fuzzy control along one axis: a small rule table and its evaluation."""

from typing import Annotated, Any, NamedTuple

from pydantic import Field

from sysid.robot.mission.axis import AxisInputs
from sysid.robot.mission.control.linear import conditional
from sysid.robot.mission.settings import AxisSettings, Gain, Search
from sysid.vehicle.kinematics import Real

Scale = Annotated[float, Field(gt=0, le=1e3)]

ERRORS = (-1.0, -0.3, 0.0, 0.3, 1.0)
"""Errors of which these words are wholly true, in shares of the scale: there is far too much, too
much, enough, too little, far too little."""

RATES = (-1.0, 0.0, 1.0)
"""Rates at which a value wholly falls, stands and rises, in shares of the scale."""

BACK, EASE, HOLD, PUSH, DRIVE = -1.0, -0.4, 0.0, 0.4, 1.0
"""What a rule commands, in shares of the strongest command."""

RULES = (
    #  falls  stands  rises
    (BACK, BACK, BACK),  # asked far less than there is
    (HOLD, EASE, BACK),  # less
    (PUSH, HOLD, EASE),  # as much as there is
    (DRIVE, PUSH, HOLD),  # more
    (DRIVE, DRIVE, DRIVE),  # far more
)
"""Error (down) and rate (across) → command."""


class FuzzyState(NamedTuple):
    """What fuzzy control remembers: the integral of its rules [drive], and the filtered rate."""

    integral: Real
    rate: Real


class Fuzzy(AxisSettings):
    """d = sat(K F(e/E, v̇/R) + I), I ← I + K_i F T, F the weighted mean of the rules.

    Each rule weighs as much as its two words are true; of neighbouring words one is as true as the
    other is not (triangles), so that all weights sum to one.

    Attributes:
        strength: K, strongest command of the rules [drive].
        ki: K_i, of the integral of what the rules say [drive/s].
        error_scale: E, error that is far [m/s, rad].
        rate_scale: R, rate that is fast [m/s², rad/s].

    Source: Takagi and Sugeno, IEEE Trans. SMC 15 (1985) 116–132, of order zero.
    """

    strength: Annotated[Gain, Search(0.05, 2.0)] = 0.5
    ki: Annotated[Gain, Search(0.0, 5.0)] = 0.9
    error_scale: Annotated[Scale, Search(0.05, 2.0)] = 0.25
    rate_scale: Annotated[Scale, Search(0.2, 10.0)] = 2.0

    def start(self, scene: Any, xp: Any) -> FuzzyState:
        return FuzzyState(0.0, 0.0)

    def step(
        self, state: FuzzyState, inputs: AxisInputs, dt: Real, xp: Any
    ) -> tuple[FuzzyState, Real]:
        """What the rules say, within the limits; the integral stands while on one."""
        rate = 0.5 * (state.rate + inputs.rate)  # of two samples: differences are noisy
        says = inferred(inputs.error / self.error_scale, rate / self.rate_scale, xp)
        grown = state.integral + self.ki * says * dt
        command = self.strength * says + grown
        kept = conditional(grown, state.integral, command, (inputs.low, inputs.high), xp)
        return FuzzyState(kept, rate), xp.clip(command, inputs.low, inputs.high)


class YawFuzzy(Fuzzy):
    """Fuzzy control of the yaw, which integrates by itself."""

    strength: Annotated[Gain, Search(0.05, 1.0)] = 0.3
    ki: Annotated[Gain, Search(0.0, 1.0)] = 0.0
    error_scale: Annotated[Scale, Search(0.1, 3.0)] = 0.8
    rate_scale: Annotated[Scale, Search(0.2, 10.0)] = 3.0


def inferred(error: Real, rate: Real, xp: Any) -> Real:
    """F: the mean of what the rules command, weighted by how true their words are.

    Args:
        error, rate: in shares of their scales.
    """
    far, quick = memberships(error, ERRORS, xp), memberships(rate, RATES, xp)
    said = 0.0
    for row, true in zip(RULES, far, strict=True):
        for command, also in zip(row, quick, strict=True):
            if command:
                said = said + true * also * command
    return said


def memberships(x: Real, centres: tuple[float, ...], xp: Any) -> list[Real]:
    """How true each word is of a number: one at its centre, falling to none at the next one's."""
    values = []
    for k, centre in enumerate(centres):
        true = 1.0
        if k > 0:
            true = xp.minimum(true, (x - centres[k - 1]) / (centre - centres[k - 1]))
        if k + 1 < len(centres):
            true = xp.minimum(true, (centres[k + 1] - x) / (centres[k + 1] - centre))
        values.append(xp.maximum(true, 0.0))
    return values
