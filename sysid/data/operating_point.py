"""Operating point of a model: zero, the rest, an estimate, or means that were removed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated

import numpy as np

from sysid.data.decision import Decision
from sysid.data.preprocess import Detrend
from sysid.data.record import Channel
from sysid.data.schema import Null


class Origin(Enum):
    """What the numbers in a ``Detrend`` are."""

    ZERO = "zero"
    REST = "rest"
    ESTIMATED = "estimated"
    MEANS = "means"
    LINES = "lines"
    INSIDE = "inside"


_Error = Annotated[float, Null(np.inf)]


@dataclass(frozen=True)
class OperatingPoint:
    """How the offsets of a model were found, and their standard errors.

    Attributes:
        origin: what was done.
        u_error, y_error: standard errors of the offsets, one a channel; zero where the offset is
            no estimate, infinite where the data hold no information. Empty for all zeros.
        estimated: numbers estimated along with the structure's parameters.
        why: why so, as a sentence; empty where there was no choice.
    """

    origin: Origin = Origin.ZERO
    u_error: tuple[_Error, ...] = field(default=(), metadata={"alias": "u_std_error"})
    y_error: tuple[_Error, ...] = field(default=(), metadata={"alias": "y_std_error"})
    estimated: int = 0
    why: str = ""

    @property
    def decision(self) -> Decision:
        """The origin as one of the decisions on a log."""
        return Decision("offsets", _DECIDED[self.origin], ("detrend",))

    @staticmethod
    def of_detrend(detrend: Detrend) -> "OperatingPoint":
        """The operating point of a model that only knows what was removed, as in files of "
        "version 0.1.0."""
        if detrend.is_none:
            return OperatingPoint()
        sloped = np.any(detrend.u_slope) or np.any(detrend.y_slope)
        return OperatingPoint(Origin.LINES if sloped else Origin.MEANS)

    def sentence(
        self, detrend: Detrend, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> str:
        """One line with numbers and units, empty where there is nothing to say."""
        u = _values(inputs, detrend.u_offset.tolist(), self.u_error)
        y = _values(outputs, detrend.y_offset.tolist(), self.y_error)
        why = f"; {self.why}" if self.why else ""
        if self.origin is Origin.ZERO:
            return f"Operating point: zero{why}." if self.why else ""
        if self.origin is Origin.INSIDE:
            return f"Operating point: no offset was removed; the model uses the log as it is{why}."
        if self.origin is Origin.MEANS:
            both = " and ".join(filter(None, (y, u)))
            return (
                f"Operating point: the means {both} were removed; the model is of deviations{why}."
            )
        if self.origin is Origin.LINES:
            return (
                "Operating point: straight lines were removed from every channel, at t = 0 s "
                f"{y} and {u}; the model is of deviations{why}."
            )
        how = (
            "read at the rest before the first command"
            if self.origin is Origin.REST
            else "estimated"
        )
        if any(self.u_error):
            return f"Operating point: nothing drifts at {u} (output counted from {y}); {how}{why}."
        return f"Operating point: {y} at {u}; {how}{why}."


_DECIDED = {
    Origin.ZERO: "none",
    Origin.REST: "at rest before the first command",
    Origin.ESTIMATED: "estimated with the model",
    Origin.MEANS: "means removed",
    Origin.LINES: "straight lines removed",
    Origin.INSIDE: "none removed",
}


def shifted(channels: Sequence[Channel], offsets: Sequence[float]) -> tuple[Channel, ...]:
    """The channels named as an equation in physical numbers needs them: ``(y - 71.3)``."""
    return tuple(
        Channel(f"({c.name} {'+' if v < 0 else '-'} {abs(v):.5g})" if v else c.name, c.unit)
        for c, v in zip(channels, offsets, strict=True)
    )


def _values(channels: Sequence[Channel], offsets: Sequence[float], errors: Sequence[float]) -> str:
    """``y = 71.3 ± 0.2 °C``, every channel."""
    known = errors or (0.0,) * len(channels)
    return ", ".join(
        f"{c.name} = {_value(c, float(v), e)}"
        for c, v, e in zip(channels, offsets, known, strict=True)
    )


def _value(channel: Channel, value: float, error: float) -> str:
    """``71.3 ± 0.2 rpm (7.47 ± 0.02 rad/s)``."""
    if value == 0.0:
        factor, unit = channel.to_file
        return f"{value_with_error(0.0, factor * error)} {unit}".strip()
    return channel.worded(lambda f: value_with_error(f * value, f * error))


def value_with_error(value: float, error: float) -> str:
    """``71.3 ± 0.2``: rounded at the second digit of the error, which is left out where it is 0."""
    if not np.isfinite(error):
        return f"{value:.4g} (unknown)"
    if error <= 0.0:
        return f"{value:.5g}"
    digits = max(1 - int(np.floor(np.log10(error))), 0)
    if digits > 8:
        return f"{value:.6g} ± {error:.2g}"
    return f"{value:.{digits}f} ± {error:.{digits}f}" if digits else f"{value:.0f} ± {error:.2g}"
