"""Tests for feedback: do the inputs depend on the outputs?

*Future inputs* (Sims 1972): y(t) is regressed on its past and on the inputs before, at and after
t. In open loop the coefficients of the future inputs are zero whatever the input is, deterministic
or not, as long as the past inputs are all there: MEMORY lags of them, for a smooth input reveals at
any time what it was long ago, and lags around a long delay. Future inputs that the past predicts to
within UNPREDICTABLE_SHARE of their power say nothing about feedback and are left out.

*Reactions*: a controller that responds within the sample takes y(t) into u(t), which the regression
above mistakes for the plant. So the innovations of y are taken from a regression without u(t), and
u(t) is tested for dependence on those of the samples before, beside its own past:

    u(t) = Σ_k φ_k u(t−k) + Σ_{k≥1} γ_k w(t−k) + rest.

A reference that steps makes jumps in u that would drown the response; residuals are clipped at
three robust standard deviations, so that jumps count no more than others.

An input of two levels jumps when the output has come far enough, which no regression on innovations
shows: ``relay_law`` looks at its switchings.

A plant with feedthrough in open loop passes both. No test on one record can distinguish it from a
controller that acts within the sample only: white reference, white sensor noise, proportional
control.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from sysid.data.checks.control_law import ControlLaw, control_law
from sysid.data.checks.far_delay import NEAR, far_lags, first_seen
from sysid.data.checks.reference import (
    answers_beside_reference,
    followed_column,
    followed_difference,
    with_reference,
)
from sysid.data.checks.relay_law import RelayLaw, relay_law
from sysid.data.impulse import (
    MAX_SAMPLES,
    LongRegression,
    at_most,
    chance,
    chosen_order,
    clipped,
    least_squares,
    lengths,
    long_regression,
    orthonormal,
    regressors,
    wald,
)
from sysid.data.record import Array, Record
from sysid.errors import DataError

AHEAD = 5
"""Future inputs in the first test."""

MEMORY = 40
"""Past inputs in both tests, as far as there are samples for them: with fewer, smooth inputs
(multisines, chirps) in open loop look like feedback."""

ROWS_A_LAG = 5
"""Samples for each lag of each channel."""

UNPREDICTABLE_SHARE = 1e-4
"""A future input whose past leaves less than this share of its power open: 1 % of its size."""

ALARM = 0.01
"""Level over both tests and all inputs of an output."""

TRACE = 0.015
"""Share below which a response does no harm: round-off and small nonlinearities of long records."""

ANSWER = 4
"""Number of samples within which a command responds."""

SURE = 1e-4
"""Level at which feedback is certain enough to change how a model is searched for."""

MOSTLY, LITTLE = 0.5, 0.1
"""Share of an input that the output then explains where the two are exchanged; and how much of it
the input may explain of the output."""

STRONG = 0.05
"""Share that a response then explains at least."""

RANK = 1e-10
"""Squared length below which a combination of columns of length 1 is round-off."""


@dataclass(frozen=True)
class FeedbackTest:
    """Whether the inputs respond to one output.

    Attributes:
        output, input: the pair with the clearest response.
        p_value: of "no input responds to this output", over both tests.
        reference: the column whose difference to the output the input responds to; empty where
            there is none in the log.
        moving: whether the input changes in at least half of the samples, as a response to noisy
            outputs does.
        relay: thresholds of the output that switch the input, None where none are seen to.
        column: the unused column, moved by the output, of whose difference to the reference that
            is; empty where it is the output's own.
        law: by which the input follows the output within the sample, None where it follows none,
            or where it may as well be that of a plant. It alone, without ``seen``, does not say
            which of the two computes the other.
        exchanged: whether the input follows the output, which follows nothing of the input.
        share: part of the output's innovations that future inputs explain, or part of the input's
            unpredicted changes that the output's innovations explain, 0 … 1, of the clearer test.
    """

    output: str
    input: str
    p_value: float
    share: float
    reference: str = ""
    moving: bool = True
    law: ControlLaw | None = None
    relay: RelayLaw | None = None
    column: str = ""
    exchanged: bool = False

    @property
    def seen(self) -> bool:
        """Whether this is feedback that matters: beyond chance, and not a trace."""
        return self.p_value < ALARM and self.share > TRACE

    @property
    def sure(self) -> bool:
        """Whether this is strong feedback beyond doubt."""
        jumps = self.moving or self.relay is not None
        return self.p_value < SURE and self.share > STRONG and jumps


def feedback_tests(records: Sequence[Record]) -> tuple[FeedbackTest, ...]:
    """One verdict an output: the clearer of both tests, its p-value doubled (Bonferroni)."""
    if not records[0].nu:
        return ()
    windows = [w for row in first_seen(records) for w in row]
    far = far_lags(windows, NEAR)
    order = chosen_order(records, far=far)
    if not order and len(far):
        order, far = chosen_order(records), far[:0]
    if not order:
        raise DataError(f"{records[0].name}: too few samples to test for feedback; record longer")
    by_test = [future_tests(records, order, far), _reactions(records, order, far)]
    if with_reference(records):
        by_test.append(_beside_reference(records, order, far))
    moving = {n: _moves(records, j) for j, n in enumerate(records[0].input_names)}
    tests = []
    for of_output in zip(*by_test, strict=True):
        clearest = min(of_output, key=lambda t: t.p_value)
        p_value = min(1.0, len(by_test) * clearest.p_value)
        test = replace(clearest, p_value=p_value, moving=moving[clearest.input])
        test = _by_relay(records, _by_law(records, test))
        tests.append(replace(test, exchanged=_exchanged(records, test, order, far)))
    with_references = at_most(with_reference(records), MAX_SAMPLES)
    if not with_references:
        return tuple(tests)
    return tuple(
        replace(
            t,
            reference=followed_difference(
                with_references, i, with_references[0].input_names.index(t.input), order
            ),
        )
        if t.seen
        else _by_column(with_references, i, t)
        for i, t in enumerate(tests)
    )


def _by_column(records: Sequence[Record], i: int, test: FeedbackTest) -> FeedbackTest:
    """The verdict, over an unused column where the loop of an input is closed over one."""
    for j, name in enumerate(records[0].input_names):
        reference, column, p, share = followed_column(records, i, j)
        if column:
            moving = _moves(records, j)
            return FeedbackTest(
                test.output, name, p, share, reference, moving=moving, column=column
            )
    return test


def _by_law(records: Sequence[Record], test: FeedbackTest) -> FeedbackTest:
    """The verdict, of the input that follows the output by a law where there is one.

    A law with an integral part is a verdict by itself. Another one says which way it is only where
    the tests have shown feedback, or where it leaves nothing but rounding.
    """
    i = records[0].output_names.index(test.output)
    alone = all(r.references is None for r in records)
    for j, name in enumerate(records[0].input_names):
        law = control_law(records, i, j)
        if law is None:
            continue
        moving = _moves(records, j)
        if law.integrates and not test.sure:
            return FeedbackTest(test.output, name, 0.0, law.explained, moving=moving, law=law)
        known = law.integrates or (moving and (test.p_value < SURE or law.computed))
        if alone and known:
            return replace(test, input=name, moving=moving, law=law)
    return test


def _exchanged(
    records: Sequence[Record], test: FeedbackTest, order: int, far: NDArray[np.int64]
) -> bool:
    """Whether a column that was taken as the only input is rather what the other one causes.

    Its past says next to nothing of that one beside that one's own, which explains most of it.
    """
    one = records[0].nu == records[0].ny == 1 and test.law is None and test.relay is None
    if not (one and test.sure and test.share > MOSTLY):
        return False
    fit = long_regression(records, order, 0, order, far)
    gain, by_chance = wald(fit, 0, np.arange(fit.b.shape[1] * len(fit.lags)))
    gain = max(gain - by_chance, 0.0)
    free = fit.samples - fit.a[0].size - fit.b[0].size
    return bool(gain / (gain + free) < LITTLE * test.share)


def _by_relay(records: Sequence[Record], test: FeedbackTest) -> FeedbackTest:
    """The verdict, of the input that thresholds of the output switch where there is one."""
    i = records[0].output_names.index(test.output)
    for j, name in enumerate(records[0].input_names):
        relay = None if test.law else relay_law(records, i, j)
        if relay is not None and relay.p_value < SURE:
            return FeedbackTest(
                test.output, name, relay.p_value, 1.0, moving=test.moving, relay=relay
            )
    return test


def future_tests(
    records: Sequence[Record], order: int, far: NDArray[np.int64]
) -> tuple[FeedbackTest, ...]:
    """Sims' test, one an output: F = (SSR₀ − SSR₁)/q / (SSR₁/(N − p)).

    Args:
        records: experiments with the same channels.
        order: lags of the outputs.
        far: further lags of the inputs, around a long delay.
    """
    first = records[0]
    last = _memory(records, order)
    try:
        fit = long_regression(records, order, -AHEAD, last, far)
    except DataError:
        last = order
        fit = long_regression(records, order, -AHEAD, last, far)
    index = _open(fit, records)
    kept = np.unique(fit.lags[index % len(fit.lags)])
    if len(index) and len(kept) < AHEAD:  # what the past predicts is no regressor either
        fit = long_regression(records, order, 0, last, np.union1d(far, kept))
        index = _open(fit, records)
    tests = []
    width = len(fit.lags)
    free = fit.samples - fit.a[0].size - fit.b[0].size
    for j, output in enumerate(first.output_names):
        if not len(index):
            tests.append(FeedbackTest(output, first.input_names[0], 1.0, 0.0))
            continue
        gain, _ = wald(fit, j, index)
        each = [wald(fit, j, index[index // width == i])[0] for i in range(first.nu)]
        name = first.input_names[int(np.argmax(each))]
        tests.append(FeedbackTest(output, name, chance(fit, j, index), gain / (gain + free)))
    return tuple(tests)


def _memory(records: Sequence[Record], order: int) -> int:
    """Lags of past inputs that the records can bear."""
    samples = sum(len(r) for r in records)
    return max(order, min(MEMORY, samples // (ROWS_A_LAG * (records[0].nu + records[0].ny))))


def _open(fit: LongRegression, records: Sequence[Record]) -> NDArray[np.int64]:
    """Entries of the future inputs that the past leaves open."""
    width = len(fit.lags)
    nu = fit.b.shape[1]
    index: NDArray[np.int64] = np.concatenate(
        [i * width + np.flatnonzero(fit.lags < 0) for i in range(nu)]
    )
    index = index[np.isfinite(fit.b_error[0].ravel()[index])]
    if not len(index):
        return index
    # the inverse of their block of (XᵀX)⁻¹ is the Gram matrix of what the past does not predict
    rest = np.diag(np.linalg.pinv(fit.covariance[np.ix_(index, index)], rcond=1e-12))
    power = np.mean(np.concatenate([(r.u - r.u.mean(axis=0)) ** 2 for r in records]), axis=0)
    return np.compress(rest > UNPREDICTABLE_SHARE * fit.samples * power[index // width], index)


def _reactions(records: Sequence[Record], order: int, far: NDArray[np.int64]) -> list[FeedbackTest]:
    """The clearest reaction of an input to each output, p-values times the number of inputs."""
    first = records[0]
    last = _memory(records, order)
    lags = np.union1d(np.arange(1, last + 1), far)
    back = max(order, int(lags[-1]))
    usable = [r for r in records if len(r) > back + ANSWER + 10]
    none = [FeedbackTest(n, first.input_names[0], 1.0, 0.0) for n in first.output_names]
    moving = [j for j in range(first.nu) if _moves(records, j)]
    if not usable or not moving:
        return none
    usable = at_most(usable, MAX_SAMPLES)
    X, Y, _ = regressors(usable, order, lags)
    innovations = least_squares(X, Y, 1e-10)[1]
    edges = np.cumsum([len(r) - back for r in usable])[:-1]
    own_lags = np.union1d(np.arange(1, min(last + ANSWER, back + ANSWER) + 1), far)
    tests = []
    for i, none_of_output in enumerate(none):
        of_output = np.split(clipped(innovations[:, i]), edges)
        pairs = [(*_reaction(usable, j, of_output, back, own_lags), j) for j in moving]
        tests.append(_clearest(first, none_of_output.output, pairs))
    return tests


def _clearest(
    record: Record, output: str, pairs: Sequence[tuple[float, float, int]]
) -> FeedbackTest:
    """Of (p-value, share, input) the clearest, its p-value times their number."""
    p, share, j = min(pairs)
    return FeedbackTest(output, record.input_names[j], min(1.0, p * len(pairs)), share)


def _beside_reference(
    records: Sequence[Record], order: int, far: NDArray[np.int64]
) -> list[FeedbackTest]:
    """The clearest response to each output beside the reference, p-values times the inputs."""
    lags = np.union1d(np.arange(_memory(records, order) + 1), far)
    with_references = at_most(with_reference(records), MAX_SAMPLES)
    answers = answers_beside_reference(with_references, order, lags)
    return [
        _clearest(records[0], output, [(p, share, j) for j, (p, share) in enumerate(row)])
        for output, row in zip(records[0].output_names, answers, strict=True)
    ]


def _reaction(
    records: Sequence[Record],
    j: int,
    innovations: Sequence[Array],
    back: int,
    own_lags: NDArray[np.int64],
) -> tuple[float, float]:
    """(p-value, share) of input ``j`` that follows from the innovations of the samples before.

    Innovations begin at sample ``back`` of each record. Where the measurements of a row
    precede its command, the present surprise counts as well.
    """
    rows, targets = [], []
    start = back + ANSWER
    for r, w in zip(records, innovations, strict=True):
        past = [r.u[start - k : len(r) - k, q] for q in range(r.nu) for k in own_lags]
        begin = 0 if r.reads_before_commands else 1
        past_innovations = [w[ANSWER - k : len(w) - k] for k in range(begin, begin + ANSWER)]
        rows.append(np.column_stack([np.ones(len(r) - start), *past, *past_innovations]))
        targets.append(r.u[start:, j])
    return _explained(np.concatenate(rows), np.concatenate(targets))


def _explained(X: Array, y: Array) -> tuple[float, float]:
    """(p-value, share) of the last ANSWER columns beside the others, jumps of y clipped."""
    basis, _ = orthonormal(X[:, :-ANSWER], RANK)
    candidates = X[:, -ANSWER:] / lengths(X[:, -ANSWER:])
    more = candidates - basis @ (basis.T @ candidates)
    values, vectors = np.linalg.eigh(more.T @ more)
    known = values > RANK
    new = more @ (vectors[:, known] / np.sqrt(values[known]))
    size = float(y @ y)
    y = clipped(y - _robust(basis, y))
    before = y - basis @ (basis.T @ y)
    after = before - new @ (new.T @ before)
    a, b = float(before @ before), float(after @ after)
    free = len(y) - X.shape[1]
    if a <= 1e-20 * size or b <= 0.0 or free < X.shape[1] // 2:
        return 1.0, 0.0
    return float(fdtrc(ANSWER, free, max(a - b, 0.0) / ANSWER / (b / free))), 1.0 - b / a


def _moves(records: Sequence[Record], j: int) -> bool:
    change = np.concatenate([np.diff(r.u[:, j]) for r in records])
    return bool(len(change)) and float(np.median(np.abs(change))) > 0.0


def _robust(basis: Array, y: Array) -> Array:
    """Prediction by least squares with clipped residuals (Huber), five rounds."""
    fit = basis @ (basis.T @ y)
    for _ in range(5):
        fit = basis @ (basis.T @ (fit + clipped(y - fit)))
    return np.asarray(fit)
