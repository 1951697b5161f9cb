"""Results of a diagnosis of several logs: what each shows, what agrees, what differs."""

from dataclasses import dataclass, field
from typing import Any

SIGNIFICANT, ABSENT, INCONCLUSIVE = "significant", "absent", "inconclusive"
"""What a log says of an effect: it shows it; it would show it and does not; it cannot show it."""


SURE = 1e-6
"""Smaller p-values are only bounded."""


def chance(p: float) -> str:
    """A p-value in words."""
    return f"p < {SURE:g}" if p < SURE else f"p = {p:.2g}"


@dataclass(frozen=True)
class LogParameter:
    """A parameter as one log alone has it.

    Attributes:
        name: with its output in brackets.
        value: None where the log alone does not determine it.
        std_error: the same.
        unit: of both.
    """

    name: str
    value: float | None
    std_error: float | None
    unit: str

    @property
    def words(self) -> str:
        """Value and error; a dash where there is none."""
        if self.value is None:
            return "–"
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        if self.std_error is None:
            return f"{self.value:.4g}{unit}"
        return f"{self.value:.4g} ± {self.std_error:.2g}{unit}"


@dataclass(frozen=True)
class LogEffect:
    """What one log shows of one effect.

    Attributes:
        id: of the effect.
        state: ``significant``, ``absent`` or ``inconclusive``.
        parameters: the log's own.
        error_ratio: RMS error of the log with the effect over that without it; None where that
            was not measured.
    """

    id: str
    state: str
    parameters: tuple[LogParameter, ...]
    error_ratio: float | None = None

    def to_json(self) -> dict[str, Any]:
        """{state, parameters, error_ratio}."""
        return {
            "state": self.state,
            "parameters": self.parameters,
            "error_ratio": self.error_ratio,
        }


@dataclass(frozen=True)
class LogView:
    """One log beside the others.

    Attributes:
        name: of the log.
        validation: whether it was only used for validation.
        effects: what it shows of each effect that was found.
        base: gain and time constant of each output as the log alone has them.
        noise: noise of each output in this log, by name.
    """

    name: str
    validation: bool
    effects: tuple[LogEffect, ...]
    base: tuple[LogParameter, ...]
    noise: dict[str, float]

    def to_json(self) -> dict[str, Any]:
        """{name, validation, effects: {id: …}, base, noise}."""
        return {
            "name": self.name,
            "validation": self.validation,
            "effects": {e.id: e for e in self.effects},
            "base": self.base,
            "noise": self.noise,
        }


@dataclass(frozen=True)
class Constancy:
    """Whether the estimates of a parameter agree across logs.

    Attributes:
        owner: effect, or ``base``.
        name, unit: of the parameter.
        value, std_error: weighted mean over the logs.
        chi_squared, degrees: Σ((value_k − mean)/error_k)², and the logs less one.
        p_value: chance of as much or more if it is the same.
        same: whether it is, at 1 % over all parameters tested.
        sentence: in words.
    """

    owner: str
    name: str
    unit: str
    value: float
    std_error: float
    chi_squared: float
    degrees: int
    p_value: float
    same: bool
    sentence: str


@dataclass(frozen=True)
class Difference:
    """What differs between logs and is no effect: admitted by the rule that effects are, too.

    Attributes:
        id: ``gain-by-log`` or ``load-by-log``.
        channels: outputs on which it shows.
        parameters: of each log (its place in ``logs``), for each output.
        p_value: chance of its gain among all that was tried.
        error_ratio_without: held-out RMSE without it over that with it.
        sentence: in words.
    """

    id: str
    channels: tuple[str, ...]
    parameters: dict[str, tuple[LogParameter, ...]] = field(metadata={"alias": "logs"})
    p_value: float
    error_ratio_without: float
    sentence: str


@dataclass(frozen=True)
class SeveralLogs:
    """What several logs say together; empty for one.

    Attributes:
        logs: each log.
        constancy: each parameter that two logs determine.
        differences: what differs and is no effect.
    """

    logs: tuple[LogView, ...] = ()
    constancy: tuple[Constancy, ...] = ()
    differences: tuple[Difference, ...] = field(default=())


ONE_LOG = SeveralLogs()
"""What one log says of several."""
