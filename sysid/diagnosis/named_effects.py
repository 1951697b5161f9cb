"""Accepted effects and their numbers, as frozen nouns and as JSON."""

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Value:
    """One number of a named effect.

    Attributes:
        name: with the output that it belongs to in brackets.
        value: NaN where the log never goes where the number acts.
        std_error: None where the log does not tell it.
        unit: of value, error and interval.
        interval: a 95 % interval where slopes tell no standard error; an end that the log leaves
            open is None.
        in_file: the same number in the unit of the file's input, where full drive is not declared
            and a share of it is one of the largest command of the log; else None.
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
        """The number as a reader of the log's columns meets it."""
        return self.in_file or self

    @property
    def visited(self) -> bool:
        """Whether the log goes where the number acts."""
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
        """The number in a sentence, after its name."""
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
        own = {} if self.in_file is None else {"in_file": self.in_file.to_json()}
        return {
            "name": self.name,
            "value": self.value if self.visited else None,
            "std_error": self.std_error,
            "unit": self.unit,
            "interval": None if self.interval is None else list(self.interval),
            "visited": self.visited,
            "on_bound": self.bounded,
            **own,
        }


def _percent(share: float) -> str:
    return "less than 1 %" if abs(share) < 1.0 else f"{share:.0f} %"


@dataclass(frozen=True)
class NamedEffect:
    """One accepted effect.

    Attributes:
        id: in the catalogue.
        stage: actuator, motor, vehicle, sensor or any.
        channels: outputs on which it shows.
        parameters: its numbers with standard errors.
        delta_bic, p_value, heldout_gain: evidence; the gain is the share of the held-out RMSE that
            went when the effect came.
        indistinguishable: other effects that explain this log as well.
        sentence: what it is and how large, in plain words.
        explains_percent: share of the gap of its outputs that it closes beside the other effects;
            None where it lowers no error.
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
    explains_percent: float | None = None
    remains: str = ""

    @property
    def fit_words(self) -> str:
        """How well its law fits: what it explains, and what is left; empty where unknown."""
        if self.explains_percent is None:
            return ""
        share = f"Explains {_percent(self.explains_percent)} of the gap"
        return f"{share}; {self.remains}." if self.remains else f"{share}."

    def to_json(self) -> dict[str, Any]:
        """As ``diagnosis.json`` holds it."""
        return {
            "id": self.id,
            "stage": self.stage,
            "channels": list(self.channels),
            "parameters": [p.to_json() for p in self.parameters],
            "evidence": {
                "delta_bic": self.delta_bic,
                "p_value": self.p_value,
                "heldout_gain": self.heldout_gain,
            },
            "indistinguishable": list(self.indistinguishable),
            "sentence": self.sentence,
            "explains_percent": self.explains_percent,
            "remains": self.remains,
        }


@dataclass(frozen=True)
class Dropped:
    """An effect that was found and does not stand, with the evidence against it."""

    id: str
    reason: str

    def to_json(self) -> dict[str, str]:
        """{id, reason}."""
        return {"id": self.id, "reason": self.reason}
