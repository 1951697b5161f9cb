"""Fits without a noise model to logs of a controller at work: inputs that hold no noise.

A controller hands the disturbance v on to the input, so that the free run y = G u + v of a model
without noise model is fitted to inputs that depend on v, and its estimate is biased unless v is
white. Where the reference r is in the log, two stages avoid that (Van den Hof & Schrama 1993,
Automatica 29, 1523):

    u = S r + (what v does),   û = Ŝ r,      y = G û + (what v does)

û depends on r only, and so not on v. Ŝ is an ARX model of high order. What the parameters err by
follows from y − G u, not from the smaller y − G û that was minimised: the same noise moves Ŝ, as in
two-stage least squares, whose instruments the slopes with û are. With white v the direct fit is
unbiased and has the smaller errors: it stays where its residuals are white.

Where nobody recorded r, what is new in u beside the past of u and y may stand for it: (u, y) is one
time series that the innovations of u and of y drive, and what of u follows from its own does not
hold v (joint input–output: Söderström & Stoica 1989, System Identification, §10.5). It takes a
sample of delay in the plant. On request only: it errs more than a direct fit with a noise model.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.criteria.coloured import ar_fit
from sysid.data.facts import LogFacts
from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record
from sysid.errors import DataError, UsageError
from sysid.estimation.soundness import BIASED
from sysid.fitting.marquardt import Method
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.fitting.uncertainty import portmanteau_white, uncertainty
from sysid.structures.linear.long_arx import arx_errors, long_arx_output
from sysid.structures.linear.predictor import RowLayout
from sysid.structures.model import Model
from sysid.structures.motion import initial_state_window

EXPLAINED = 0.02
"""Share of an input's power that has to follow from the references."""

LAGS = 20
"""Lags of the regression whose errors are the innovations of the inputs, a tenth of the samples at
most; with as many as a reference's steps last they stand for its clock instead."""

STAGED = "inputs_by_reference"
"""What the provenance of a model has whose inputs were replaced."""

STAGES = (Method.TWO_STAGE, Method.JOINT)
"""Methods that replace the inputs."""

SENTENCE = (
    "A controller was running and the direct fit's residuals are not white: the input was replaced "
    "by its part that follows from {names} (two stages), which biases it less."
)

ASKED = "The input was replaced by its part that follows from {names}, as `method='{way}'` asks."


def biased_by_feedback(model: Model, facts: LogFacts, options: FitOptions) -> bool:
    """Whether feedback biases a fit: linear, direct, of free runs, and its residuals not white."""
    traits = model.structure.traits
    free_run = not traits.has_noise_model or options.focus is Focus.SIMULATION
    if not (free_run and traits.linear and traits.takes_inputs and facts.closed_loop):
        return False
    if STAGED in model.provenance.options:
        return False
    errors = [model.residuals(r) for r in facts.records]
    columns = [[e[np.isfinite(e[:, i]), i] for e in errors] for i in range(model.structure.ny)]
    return not all(portmanteau_white(c) for c in columns)


def _with_option(model: Model, name: str, value: object) -> Model:
    """The model with one more fact on how it was made."""
    options = {**model.provenance.options, name: value}
    return replace(model, provenance=replace(model.provenance, options=options))


def marked(model: Model, facts: LogFacts, options: FitOptions) -> Model:
    """The model, with a note for who ranks it where feedback biases it (``soundness``)."""
    biased = biased_by_feedback(model, facts, options)
    return _with_option(model, BIASED, True) if biased else model


def inputs_by_reference(
    records: Sequence[Record], method: Method | None = None
) -> tuple[Record, ...] | None:
    """The records with û in place of u; None where an input follows too little from references.

    Both count from their first samples, before which the loop is taken to have rested. By the
    joint method the innovations of the inputs are the references, whatever is recorded.
    """
    records = with_innovations(records) if method is Method.JOINT else records
    columns = []
    for j in range(records[0].nu):
        driven = [_as_system(r, j) for r in records]
        count = driven[0].nu
        lay = RowLayout(0, (0,), (1,) * count, (0,) * count, 0, 0, (1,) * count, constant=True)
        runs = [r.y[:, 0] for r in long_arx_output(driven, lay)]
        power = sum(float(np.sum((r.y[:, 0] - r.y.mean()) ** 2)) for r in driven)
        rest = sum(
            float(np.sum((e - e.mean()) ** 2))
            for e in (r.y[:, 0] - x for r, x in zip(driven, runs, strict=True))
        )
        if not EXPLAINED * power < power - rest < power:
            return None
        columns.append([x + r.u[0, j] for x, r in zip(runs, records, strict=True)])
    return tuple(
        replace(r, u=np.column_stack([c[k] for c in columns])) for k, r in enumerate(records)
    )


def whitened(records: Sequence[Record], model: Model) -> tuple[Record, ...]:
    """L u and L y with L y = G L u + white: L is an autoregression of what a model leaves of y.

    Slow errors differ by chance for as long as they last; those of the filtered records are
    independent, so that orders are distinguished as far as they can be.
    """
    s, theta = model.structure, model.theta
    errors = [s.errors(theta, r.u, r.y, initial_state_window(s, theta)) for r in records]
    spread = np.nanstd(np.concatenate(errors), axis=0)
    columns = [c - np.nanmean(c) for e in errors for c in (e / np.maximum(spread, 1e-300)).T]
    alpha = ar_fit(columns).alpha
    return tuple(
        replace(r, u=lfilter(alpha, [1.0], r.u, axis=0), y=lfilter(alpha, [1.0], r.y, axis=0))
        for r in records
    )


def with_innovations(records: Sequence[Record]) -> tuple[Record, ...]:
    """The records, their references what the past of all channels and y(t) leave of the inputs."""
    swapped = [
        _bare(r, np.column_stack([r.y - r.y[0], np.ones(len(r))]), r.u - r.u[0]) for r in records
    ]
    nu, n = records[0].nu, records[0].ny + 1
    order = max(1, min(LAGS, sum(map(len, records)) // (10 * (nu + n))))
    lags = (*(order + 1,) * (n - 1), 1)
    each = [
        arx_errors(
            swapped, RowLayout(j, (order,) * nu, lags, (0,) * n, 0, 0, (0,) * n, constant=True)
        )
        for j in range(nu)
    ]
    names = tuple(f"innovations of {name}" for name in records[0].input_names)
    return tuple(
        replace(r, references=np.column_stack(columns), reference_names=names)
        for r, columns in zip(records, zip(*each, strict=True), strict=True)
    )


def _as_system(record: Record, j: int) -> Record:
    """References → input j, with the constant 1."""
    assert record.references is not None
    r = record.references - record.references[0]
    return _bare(record, np.column_stack([r, np.ones(len(r))]), record.u[:, [j]] - record.u[0, j])


def _bare(record: Record, u: Array, y: Array) -> Record:
    """A record of other inputs and outputs."""
    return replace(
        record,
        u=u,
        y=y,
        inputs=(),
        outputs=(),
        weights=None,
        pose=None,
        references=None,
        reference_names=(),
        since=None,
        as_logged=None,
    )


def without_feedback(facts: LogFacts) -> LogFacts | None:
    """Facts of the records, which hold references, with û for u; None where û is not to be had."""
    staged = inputs_by_reference(facts.records)
    return None if staged is None else LogFacts(staged, facts.reading)


def as_asked(facts: LogFacts, method: Method) -> LogFacts:
    """Facts of the records with û for u, by the method that was asked for."""
    way = method.value
    if method is Method.TWO_STAGE and any(r.references is None for r in facts.records):
        raise UsageError(
            f"`method='{way}'` needs the controller's reference in every log, a column that "
            "sysid inspect calls a set-point; `method='joint'` does without"
        )
    staged = inputs_by_reference(facts.records, method)
    if staged is None:
        source = "the reference" if method is Method.TWO_STAGE else "its own innovations"
        raise DataError(
            f"{facts.records[0].name}: under {100.0 * EXPLAINED:.0f} % of an input follows from "
            f"{source}, too little for `method='{way}'`; omit `method`"
        )
    return LogFacts(staged, facts.reading)


def in_two_stages(
    model: Model, facts: LogFacts, seen: LogFacts, method: Method | None = None
) -> Model:
    """A model that was fitted to inputs by references, with its errors and a sentence on it.

    Args:
        method: what was asked for; None where the log decided.
    """
    names = list(facts.records[0].reference_names)
    if method is Method.JOINT:
        names = ["its own innovations"]
    words = SENTENCE if method is None else ASKED
    said = words.format(names=", ".join(names), way=method and method.value)
    noted = replace(_with_option(model, STAGED, names), warnings=(*model.warnings, said))
    return replace(noted, covariance=_covariance(model, facts.records, seen.records))


def _covariance(model: Model, logged: Sequence[Record], seen: Sequence[Record]) -> Array:
    """Of θ, from slopes with û and errors with u; levels are among what is estimated.

    Structures with a noise model, whose slopes are those one step ahead, keep theirs.
    """
    s, theta = model.structure, model.theta
    if s.traits.has_noise_model:
        return model.covariance
    free = [k for k, p in enumerate(model.parameters) if p.fixed is None]
    slopes, errors, stretches = [], [], []
    for r, x in zip(logged, map(model.detrend.remove, seen), strict=True):
        left = model.residuals(r)
        for i, J in enumerate(s.gradients(theta, x.u, x.y)[:, :, free]):
            levels = np.tile(np.eye(s.ny)[i], (len(r), 1))
            kept = np.isfinite(left[:, i]) & (np.arange(len(r)) >= s.first_sample())
            slopes.append(np.hstack([J, levels])[kept])
            errors.append(left[kept, i])
            stretches.append((i, int(kept.sum())))
    e = np.concatenate(errors)
    found = uncertainty(np.concatenate(slopes), e, stretches, np.ones(len(e))).covariance
    out, n, place = model.covariance.copy(), len(free), np.ix_(free, free)
    out[place] = np.where(np.isinf(out[place]), out[place], found[:n, :n])
    return out
