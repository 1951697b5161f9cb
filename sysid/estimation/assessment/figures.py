"""Error figures of a model on data, each with its horizon, initial-state policy and data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from sysid.criteria.fit import fit_percent, rmse
from sysid.criteria.residuals import residual_report
from sysid.criteria.verdicts import ResidualReport
from sysid.data.documents import by_field
from sysid.data.record import Array, Record
from sysid.errors import UsageError, argument
from sysid.estimation.offsets.states import (
    estimated_columns,
    fixed_parameter_tests_of,
    offset_column,
    uncertain_columns,
)
from sysid.estimation.robust_fit import judged
from sysid.structures.model import Model
from sysid.structures.motion import initial_state_window

JACOBIAN_NUMBERS = 20_000_000
"""Largest samples × parameters for which the tests project the model's Jacobian out; longer
records are tested on their first part, which is said."""


class Start(Enum):
    """Where the free run starts on data: the initial-state policy of every figure."""

    ESTIMATED = "estimated"
    MEASURED = "measured"
    ZERO = "zero"


@dataclass(frozen=True)
class Figures:
    """How far a model is from data.

    Attributes:
        data: which data, in words.
        horizon: prediction horizon in samples, None for the free run.
        initial_state: the initial-state policy, in words.
        samples: samples that count.
        left_out: samples that do not, because a measurement or a disturbance stands out of a robust
            fit there.
        fit_percent: 100(1 − ‖y−ŷ‖/‖y−ȳ‖) by output; NaN where y is constant.
        rmse: root mean squared error by output, in the output's unit.
    """

    data: str
    horizon: int | None
    initial_state: str
    samples: int
    fit_percent: Mapping[str, float]
    rmse: Mapping[str, float]
    left_out: int = 0

    @property
    def mean_fit(self) -> float:
        """Mean fit of the outputs that vary."""
        values = [v for v in self.fit_percent.values() if np.isfinite(v)]
        return float(np.mean(values)) if values else float("nan")

    def to_json(self) -> dict[str, Any]:
        """Its fields; a horizon of None is ``free-run``."""
        return by_field(self) | {"horizon": "free-run" if self.horizon is None else self.horizon}


def outputs(
    model: Model, record: Record, horizon: int | None, start: Start, skip: int = 0
) -> Array:
    """The model's outputs on a record under one policy, (N, ny); NaN where it predicts nothing."""
    window = _window(model, start, skip)
    if horizon is not None:
        return model.predict(record, horizon, window)
    model.check(record)
    x0 = model.fitted_state(record, window) if window else None
    return model.simulate(record.u, x0, record.t0)


def figures(
    model: Model,
    records: Sequence[Record],
    data: str,
    horizon: int | None = None,
    start: Start = Start.ESTIMATED,
    skip: int = 0,
) -> Figures:
    """Fit and RMSE of a model on records, pooled over them.

    What stands out of the errors of a robustly fitted model is left out and counted.

    Args:
        records: experiments, each with its own initial state.
        data: what to call these data.
        horizon: k-step-ahead prediction, or None for the free run; a model without inputs has
            none and is judged one step ahead.
        skip: samples at the head of each record left out of the figures; they may set the
            initial state.
    """
    require_samples(records, skip)
    if not model.inputs and horizon is None:
        horizon = 1
    records = judged(model, records)
    left_out = [~r.counted for r in records]
    with np.errstate(over="ignore", invalid="ignore"):
        runs = [
            np.where(out[:, None], np.nan, outputs(model, r, horizon, start, skip))
            for r, out in zip(records, left_out, strict=True)
        ]
        ys = [r.y for r in records]
        fits, errors = fit_percent(ys, runs, skip), rmse(ys, runs, skip)
    counted = sum(int(np.sum(np.all(np.isfinite(run[skip:]), axis=1))) for run in runs)
    names = records[0].output_names
    return Figures(
        data=data,
        horizon=horizon,
        initial_state=_sentence(model, start, skip, max(map(len, records))),
        samples=counted,
        fit_percent=dict(zip(names, fits.tolist(), strict=True)),
        rmse=dict(zip(names, errors.tolist(), strict=True)),
        left_out=sum(int(np.sum(out[skip:])) for out in left_out),
    )


def require_samples(records: Sequence[Record], skip: int) -> None:
    """Refuse to skip every sample there is."""
    longest = max(records, key=len)
    if skip >= len(longest):
        raise UsageError(
            f"{argument(skip=skip)} leaves nothing of {longest.name}, which has {len(longest)} "
            "samples to judge on; skip fewer"
        )


def residual_tests(
    model: Model, records: Sequence[Record], *, fitted: bool = True
) -> ResidualReport:
    """Residual tests; what the fit took from these data, and nothing else, is projected out.

    Nonlinear structures have to stand Billings & Voon's further tests as well.

    Args:
        fitted: whether the model was fitted to these data. On others nothing is projected out;
            what the parameters' uncertainty puts into the residuals is allowed for instead.
    """
    plain = [model.detrend.remove(r) for r in judged(model, records)]
    room = max(JACOBIAN_NUMBERS // max(len(model.theta), 1), 1000)
    kept: list[Record] = []
    for r in plain:
        if room > 0:
            kept.append(r.rows(0, min(len(r), room)))
            room -= len(kept[-1])
    window = initial_state_window(model.structure, model.theta)
    errors = [
        # an outlier is no error of the model: it counts as none
        np.where(r.left_out, 0.0, model.structure.errors(model.theta, r.u, r.y, window))
        for r in kept
    ]
    by_record = [model.structure.gradients(model.theta, r.u, r.y) for r in kept]
    jacobians = [[J[i] for J in by_record] for i in range(model.structure.ny)]
    part = estimated_columns if fitted else uncertain_columns
    parts = [
        [
            np.column_stack([part(model, c), offset_column(model, r, i, fitted)])
            for r, c in zip(kept, columns, strict=True)
        ]
        for i, columns in enumerate(jacobians)
    ]
    absorbed, uncertain = (parts, None) if fitted else (None, parts)
    report = residual_report(
        errors,
        [r.u for r in kept],
        absorbed,
        noise_model=model.structure.traits.has_noise_model,
        output_names=[c.name for c in model.outputs],
        input_names=[c.name for c in model.inputs],
        uncertain=uncertain,
        nonlinear=not model.structure.traits.linear,
    )
    if not fitted:
        return report
    return replace(report, fixed=fixed_parameter_tests_of(model, errors, jacobians, report.level))


def _window(model: Model, start: Start, skip: int) -> int:
    if start is Start.ZERO:
        return 0
    if start is Start.MEASURED:
        return model.structure.n_states(model.theta)
    return initial_state_window(model.structure, model.theta, skip)


def _sentence(model: Model, start: Start, skip: int, longest: int) -> str:
    window = _window(model, start, skip)
    if window == 0:
        return "zero" if start is Start.ZERO else "none (the model has no memory)"
    if window == model.structure.n_states(model.theta):
        return f"measured outputs of the first {window} samples"
    if window >= longest:
        return f"estimated from all {longest} samples"
    return f"estimated from the first {window} samples"
