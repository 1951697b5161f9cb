"""Assessment of a fitted model as one JSON-able document."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sysid.criteria.verdicts import ResidualReport
from sysid.data.documents import by_field, plain_object
from sysid.data.record import Record
from sysid.estimation.assessment.advice import advice, beyond_range
from sysid.estimation.assessment.figures import (
    Figures,
    Start,
    figures,
    residual_tests,
)
from sysid.estimation.assessment.own_motion import own_modes
from sysid.estimation.assessment.step_response import StepResponse, step_responses
from sysid.estimation.robust_fit import judged
from sysid.structures.model import Model


@dataclass(frozen=True, eq=False)
class DataFigures:
    """Figures of one model on one set of data under one initial-state policy.

    Attributes:
        k_step: further horizons asked for.
    """

    free_run: Figures
    one_step: Figures
    k_step: tuple[Figures, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Free-run figures at the top, the others beside them."""
        return plain_object(
            {
                **self.free_run.to_json(),
                "one_step": self.one_step,
                "k_step": self.k_step,
            }
        )


@dataclass(frozen=True)
class Policy:
    """How figures are made: initial states, skipped samples, further horizons."""

    start: Start = field(default=Start.ESTIMATED, metadata={"alias": "initial_state"})
    skip: int = 0
    horizons: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Assessment:
    """A model with its figures, residual tests, what it does to a step, and warnings.

    Attributes:
        criteria: over the samples that all models fitted with it predict.
    """

    model: Model
    estimation: DataFigures
    validation: DataFigures | None
    residuals: ResidualReport
    warnings: tuple[str, ...]
    seconds: float
    chosen: Mapping[str, Any] = field(default_factory=dict)
    policy: Policy = field(default_factory=Policy)
    steps: tuple[StepResponse, ...] = ()
    criteria: Mapping[str, float] = field(default_factory=dict)

    @property
    def judged(self) -> DataFigures:
        """Figures on validation data where there are any, else on estimation data."""
        return self.validation or self.estimation

    def to_json(self) -> dict[str, Any]:
        m = self.model
        return plain_object(
            {
                "structure": m.structure.name,
                "orders": m.structure.order_values(),
                "parameters": m.parameter_table(),
                "policy": self.policy,
                "estimation": self.estimation,
                "validation": self.validation,
                "one_step": {
                    "estimation": self.estimation.one_step,
                    "validation": self.validation and self.validation.one_step,
                },
                "criteria": self.criteria or m.criteria,
                "residuals": self.residuals.as_dict(),
                "termination": {"code": m.termination.code, "message": m.termination.value},
                "properties": m.structure.properties(m.theta, m.dt),
                "own_modes": own_modes(m),
                "step_response": self.steps,
                "equations": m.equations(),
                "sample_time": m.dt,
                "offsets": by_field(m.detrend)
                | by_field(m.operating_point)
                | {"text": m.operating_point_sentence()},
                "n_estimated": m.n_estimated,
                "starts": m.starts,
                "order_search": self.chosen,
                "seconds": self.seconds,
                "warnings": self.warnings,
            }
        )


def figures_on(model: Model, records: Sequence[Record], data: str, policy: Policy) -> DataFigures:
    """Free run, one step and further horizons on one set of data, under one policy."""
    records = judged(model, records)

    def at(horizon: int | None) -> Figures:
        return figures(model, records, data, horizon, policy.start, policy.skip)

    return DataFigures(at(None), at(1), tuple(at(k) for k in policy.horizons))


def assess(
    model: Model,
    estimation: tuple[Sequence[Record], str],
    validation: tuple[Sequence[Record], str] | None,
    policy: Policy,
    seconds: float,
    chosen: Mapping[str, Any] | None = None,
    notes: Sequence[str] = (),
    criteria: Mapping[str, float] | None = None,
) -> Assessment:
    """Figures, residual tests and warnings of one model.

    Args:
        estimation: the estimation records and what to call them.
        validation: the same for held-out data, or None.
        chosen: facts about the order search.
        notes: warnings known before.
        criteria: over the samples that all models fitted with it predict; None for its own.
    """
    inside = figures_on(model, *estimation, policy)
    outside = None if validation is None else figures_on(model, *validation, policy)
    beyond = () if validation is None else beyond_range(model, judged(model, validation[0]))
    struck = 0 if outside is None else outside.one_step.left_out
    residuals = residual_tests(model, estimation[0])
    spoken = advice(
        model,
        inside.free_run,
        inside.one_step,
        None if outside is None else outside.free_run,
        residuals,
    )
    return Assessment(
        model,
        inside,
        outside,
        residuals,
        (*notes, *model.warnings, *_left_out(struck), *beyond, *spoken),
        seconds,
        chosen or {},
        policy,
        step_responses(model),
        criteria or model.criteria,
    )


def _left_out(samples: int) -> tuple[str, ...]:
    """What the figures on validation data do not count."""
    if samples == 0:
        return ()
    seen = "1 outlier" if samples == 1 else f"{samples} outliers"
    was = "was" if samples == 1 else "were"
    return (f"{seen} of the validation data {was} left out of the figures.",)
