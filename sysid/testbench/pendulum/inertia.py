"""Inertia of a body that swings on a bar (thesis 2.51, 5.7), and its error budget.

The errors of what is measured multiply: the period enters with its square, and the inertia about
the centre of gravity is a small difference of large numbers wherever the arm is long.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

from sysid.errors import UsageError, argument

RULER = 0.001
"""Standard error of a length read off a ruler [m]."""
SCALES = 0.001
"""Standard error of a mass read off kitchen scales [kg]."""
BAR = 1e-4
"""Standard error of the bar's inertia [kg m²]: that of a bar whose length is known to half a per
cent."""
GRAVITY = 0.005
"""Standard error of g [m/s²]: on the ground it lies between 9.78 and 9.83."""
BOX = (0.19, 0.134)
"""Length and width of the thesis's robot [m], of the box in its simulation."""


@dataclass(frozen=True)
class Hanging:
    """What hangs on the hinge, in the thesis's letters, and how well it is known.

    Attributes:
        m: mass of the body [kg].
        m1: mass of the bar [kg].
        l: distance of the body's centre of gravity from the hinge [m].
        l1: the same of the bar [m].
        I1: inertia of the bar about its centre of gravity [kg m²].
        g: acceleration of gravity [m/s²].
        errors: standard error of each of them, by letter; what is left out has its default.
    """

    m: float = 1.592
    m1: float = 0.146
    l: float = 0.7  # noqa: E741  the thesis's letter
    l1: float = 0.455
    I1: float = 0.0078
    g: float = 9.81
    errors: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in QUANTITIES:
            value, least = getattr(self, name), name in ("m", "l", "g")
            if not (math.isfinite(value) and (value > 0.0 if least else value >= 0.0)):
                bound = "above 0" if least else "of at least 0"
                raise UsageError(
                    f"{_WORDS[name]} is {value:g}: give a number {bound} in {UNITS[name]}"
                )
        for name, value in self.errors.items():
            if name not in QUANTITIES:
                known = ", ".join(QUANTITIES)
                raise UsageError(f"{name!r} has no standard error here; those that have: {known}")
            if not (math.isfinite(value) and value >= 0.0):
                raise UsageError(
                    f"the standard error of {name} is {value:g}: give a number of at least 0"
                )

    def std_error(self, name: str) -> float:
        """Standard error of one of the letters, in its unit."""
        return self.errors.get(name, DEFAULT_ERRORS[name])

    @property
    def moment(self) -> float:
        """Restoring moment of a small angle, m g l + m₁ g l₁ [Nm/rad]."""
        return self.g * (self.m * self.l + self.m1 * self.l1)

    @property
    def steiner(self) -> float:
        """What the arms add to the inertia about the hinge, m l² + m₁ l₁² + I₁ [kg m²]."""
        return self.m * self.l**2 + self.m1 * self.l1**2 + self.I1

    def inertia(self, period: float) -> float:
        """I = (T/2π)²(m g l + m₁ g l₁) − m l² − m₁ l₁² − I₁ [kg m²] (thesis 2.51).

        Args:
            period: T of small swings [s].
        """
        return (period / (2.0 * math.pi)) ** 2 * self.moment - self.steiner

    def period(self, inertia: float) -> float:
        """The period of small swings that an inertia [kg m²] means [s]: (2.51) solved for T."""
        return 2.0 * math.pi * math.sqrt((inertia + self.steiner) / self.moment)

    def sensitivities(self, period: float) -> dict[str, float]:
        """∂I/∂q of (2.51) for the period and every letter, in kg m² per unit of q."""
        square = (period / (2.0 * math.pi)) ** 2
        m, l, m1, l1, g = self.m, self.l, self.m1, self.l1, self.g  # noqa: E741
        return {
            "period": 2.0 * square / period * self.moment,
            "m": square * g * l - l**2,
            "l": square * m * g - 2.0 * m * l,
            "m1": square * g * l1 - l1**2,
            "l1": square * m1 * g - 2.0 * m1 * l1,
            "I1": -1.0,
            "g": square * (m * l + m1 * l1),
        }

    def contributions(self, period: float, period_error: float) -> dict[str, float]:
        """|∂I/∂q| σ_q [kg m²], the largest first: what each measured quantity adds to the error."""
        slopes = self.sensitivities(period)
        parts = {
            name: abs(slope) * (period_error if name == "period" else self.std_error(name))
            for name, slope in slopes.items()
        }
        return dict(sorted(parts.items(), key=lambda item: -item[1]))


UNITS = {"m": "kg", "m1": "kg", "l": "m", "l1": "m", "I1": "kg m²", "g": "m/s²", "period": "s"}
QUANTITIES = tuple(f.name for f in fields(Hanging) if f.name != "errors")
_WORDS = {
    "m": "the mass m",
    "m1": "the bar's mass m1",
    "l": "the arm l",
    "l1": "the bar's arm l1",
    "I1": "the bar's inertia I1",
    "g": "gravity g",
}
DEFAULT_ERRORS = {"m": SCALES, "m1": SCALES, "l": RULER, "l1": RULER, "I1": BAR, "g": GRAVITY}
"""Standard errors where none is given: the thesis prints none."""


def root_sum_square(parts: Mapping[str, float]) -> float:
    """√Σ: the standard error that independent contributions make."""
    return math.sqrt(math.fsum(p * p for p in parts.values()))


def box_inertia(mass: float, length: float, width: float) -> float:
    """m/12 (a² + b²) [kg m²]: a box of even density about its vertical axis.

    Args:
        mass: m [kg].
        length, width: a, b [m].
    """
    if not (math.isfinite(length) and math.isfinite(width) and length > 0 and width > 0):
        raise UsageError(f"{argument(size=(length, width))} is not a box; give two lengths above 0")
    return mass / 12.0 * (length**2 + width**2)


def small_swing_period(period: float, amplitude: float) -> float:
    """T₀ = T · agm(1, cos(θ/2)) [s]: the period of small swings from one at an amplitude.

    Exact for a pendulum without friction: T/T₀ = 2K(sin θ/2)/π = 1 + θ²/16 + 11θ⁴/3072 + …; the
    thesis's 10° make 0.19 %, and the first term is all of it to 4·10⁻⁶.

    Args:
        period: T [s].
        amplitude: θ [rad], below π.
    """
    a, b = 1.0, math.cos(0.5 * amplitude)
    while abs(a - b) > 1e-15:
        a, b = 0.5 * (a + b), math.sqrt(a * b)
    return period * a
