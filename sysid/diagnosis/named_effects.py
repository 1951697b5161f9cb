"""Accepted effects and their parameters, as frozen dataclasses and as JSON."""

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Value:
    """One number of a named effect.

    Attributes:
        name: with the output that it belongs to in brackets.
        value: NaN where the log never goes where the parameter acts.
        std_error: None where the log does not determine it.
        unit: of value, error and interval.
        interval: a 95 % interval where gradients give no standard error; an end that the log leaves
            open is None.
        in_file: the same parameter in the file's units where they are others: a speed, and a share
            of full drive where that is not declared but the largest command of the log; else None.
        bounded: whether it ended on the bound of the search, beyond which it may lie.
    """

    name: str
    value: float
    std_error: float | None
    unit: str
    interval: tuple[float | None, float | None] | None = None
    in_file: "Value | None" = None
    bounded: bool = False

    @property
    def in_log_units(self) -> "Value":
        """The parameter as a reader of the log's columns meets it."""
        return self.in_file or self

    @property
    def visited(self) -> bool:
        """Whether the log goes where the parameter acts."""
        return not math.isnan(self.value)

    @property
    def words(self) -> str:
        """What is known beside the value: an error, an interval, or why there is none."""
        if not self.visited:
            return "not seen in this log"
        if self.interval is not None:
            low, high = self.interval
            if low is None and high is None:
                return "not determined"
            if low is None or high is None:
                return f"at most {high:.4g}" if low is None else f"at least {low:.4g}"
            return f"{low:.4g} to {high:.4g}"
        if self.bounded:
            return "on the bound of the search"
        return "" if self.std_error is None else f"± {self.std_error:.2g}"

    @property
    def shown(self) -> str:
        """The parameter in a sentence, after its name."""
        unit = f" {self.unit}" if self.unit else ""
        if not self.visited:
            return "is not seen in this log"
        if self.interval is None:
            if self.bounded:
                return f"= {self.value:.3g}{unit} ({self.words})"
            return f"= {self.value:.3g} {self.words}{unit}".replace("  ", " ")
        if None in self.interval:
            return f"is {self.words}{unit}"
        return f"= {self.value:.4g} ({self.words}){unit}"

    def to_json(self) -> dict[str, Any]:
        """{name, value, std_error, unit, interval, visited, on_bound}, and the same ``in_file``."""
        in_file = {} if self.in_file is None else {"in_file": self.in_file}
        return {
            "name": self.name,
            "value": self.value,
            "std_error": self.std_error,
            "unit": self.unit,
            "interval": self.interval,
            "visited": self.visited,
            "on_bound": self.bounded,
            **in_file,
        }


@dataclass(frozen=True)
class NamedEffect:
    """One accepted effect.

    Attributes:
        stage: actuator, motor, vehicle, sensor or any.
        delta_bic, p_value, heldout_gain: evidence; the gain is the relative fall of the held-out
            RMSE, 1 − with/without.
        indistinguishable: other effects that explain this log as well.
        remains: what stays there although it is added, in words; empty where that is noise.
    """

    id: str
    stage: str
    channels: tuple[str, ...]
    parameters: tuple[Value, ...]
    delta_bic: float
    p_value: float
    heldout_gain: float
    indistinguishable: tuple[str, ...]
    sentence: str
    remains: str = ""

    @property
    def error_ratio_without(self) -> float | None:
        """Held-out RMSE without the effect over that with it; None where it lowers no error."""
        return None if self.delta_bic == 0.0 else 1.0 / max(1.0 - self.heldout_gain, 1e-3)

    @property
    def fit_words(self) -> str:
        """The held-out error without the effect, and what remains; empty where unknown."""
        if self.error_ratio_without is None:
            return ""
        ratio = f"Without it the held-out error is {self.error_ratio_without:.3g} times as large"
        return f"{ratio}; {self.remains}." if self.remains else f"{ratio}."

    def to_json(self) -> dict[str, Any]:
        """As ``diagnosis.json`` holds it."""
        return {
            "id": self.id,
            "stage": self.stage,
            "channels": self.channels,
            "parameters": self.parameters,
            "evidence": {
                "delta_bic": self.delta_bic,
                "p_value": self.p_value,
                "heldout_gain": self.heldout_gain,
            },
            "indistinguishable": self.indistinguishable,
            "sentence": self.sentence,
            "error_ratio_without": self.error_ratio_without,
            "remains": self.remains,
        }


@dataclass(frozen=True)
class RejectedEffect:
    """An effect that was selected first and rejected later, with the reason."""

    id: str
    reason: str
