"""Delay between every input and output, with its uncertainty, estimated without a model.

A regression on lags sees a second small lag as delay, and lends a slow input the delay of a quick
one. A model of two lags and a continuous dead time for every input (``process.py``) does neither;
it is believed where it predicts nearly as well as a long regression, and refines the delays then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.checks.far_delay import (
    NEAR,
    far_lags,
    first_seen,
    longest_delay,
)
from sysid.data.impulse import (
    LongRegression,
    bic,
    chance,
    chosen_order,
    long_regression,
    regressors,
)
from sysid.data.process import ProcessFit, fit_process
from sysid.data.record import Array, Record
from sysid.data.speed import Speed
from sysid.errors import DataError

LIKELY = 10.0
"""Delays whose −2 ln L lies within this of the best one are possible (about 99 %, with a margin
for the shape of the window, which is a choice)."""
TIE = 2.0
"""Difference of −2 ln L below which two delays cannot be distinguished: the longer is simpler."""
ACTS = 16.0
"""An input that lowers −2 ln L by less than this has no visible effect on the output."""
SURE = 1e-6
"""Level at which lags of the full regression are certain to act."""
RELEVANT = 0.1
"""A coefficient below this fraction of the pair's largest one does not matter for the delay."""
WINDOW = 2
"""Lags of the scanned input that are in the regression at a time."""


@dataclass(frozen=True)
class Delay:
    """The delay of one input–output pair in samples.

    Attributes:
        input, output: channel names.
        delay: the most likely number of samples (1 is a plant without dead time), or None where
            the input has no visible effect on this output.
        low, high: the shortest and longest delay the data allow.
        evidence: by how much the input lowers −2 ln L of this output, 0 for no effect.
        dead_s, error_s: dead time and its standard error [s], NaN where no process shows them.
    """

    input: str
    output: str
    delay: int | None
    low: int
    high: int
    evidence: float = 0.0
    dead_s: float = float("nan")
    error_s: float = float("nan")

    @property
    def certain(self) -> bool:
        """Whether the data allow one delay only."""
        return self.delay is not None and self.low == self.high


def estimate_delays(
    records: Sequence[Record], longest: int = 20, *, shortest: int = 0
) -> tuple[Delay, ...]:
    """The delay of every pair, output by output, up to a quarter of the record.

    Output j is regressed on its past, on all lags of the other inputs, and on WINDOW lags
    d, d + 1, … of input i; d is moved from 0 to ``longest``, and around the lag where the
    cross-correlation of whitened signals first sees the input (``far_delay.py``), if that is
    later. With N samples and residual variance V(d), −2 ln L = N ln V(d) + constant: its minimum is
    the estimate, the interval holds every d within LIKELY of it. A window is too short for a rich
    response, so a second verdict bounds the delay from above: the first lag k of the regression on
    all lags at which b_0 = … = b_k = 0 is rejected (Wald test at SURE) with
    |b_k| ≥ RELEVANT · max|b|. Inputs that move in proportion share one delay. (Ljung 1999, §16.3;
    the interval is a profile likelihood.)

    Args:
        records: experiments with the same channels.
        longest: the longest delay looked for everywhere, seen by the correlation or not [samples].
        shortest: 1 where a response within the sample is known to be a controller's, else 0.
    """
    twins = _proportional(records)
    kept = sorted(set(twins))
    names = [records[0].input_names[i] for i in kept]
    part = [r.select(names, r.output_names) for r in records]
    seen = first_seen(part)
    far = [far_lags(row, max(longest, NEAR)) for row in seen]
    outputs = records[0].output_names
    if not any(len(lags) for lags in far):
        delays = _pairs(part, longest, far[0], shortest)
    else:  # each output's far lags are its own, and they are costly
        delays = [
            d
            for output, lags in zip(outputs, far, strict=True)
            for d in _pairs([r.select(names, [output]) for r in part], longest, lags, shortest)
        ]
    by_pair = {(d.output, d.input): d for d in delays}
    return tuple(
        replace(by_pair[output, records[0].input_names[twins[i]]], input=name)
        for output in outputs
        for i, name in enumerate(records[0].input_names)
    )


def _pairs(
    part: Sequence[Record], longest: int, far: NDArray[np.int64], shortest: int
) -> list[Delay]:
    """The delays of all pairs of records without proportional inputs."""
    order = chosen_order(part, far=far)
    if not order and len(far):  # too short a record for so wide a search
        order, far = chosen_order(part), far[:0]
    if not order:
        raise DataError(f"{part[0].name}: too few samples to estimate a delay; record longer")
    fit, last = _best_regression(part, order, longest, far)
    longest = min(longest, longest_delay(part))
    tried = np.union1d(np.arange(shortest, max(longest, shortest) + 1), far)
    profiles, without_input = _profiles(part, order, last, tried, far)
    return [
        _bounded(
            _verdict(profiles[i, :, j], tried, float(without_input[i, j]), name, output),
            _surely_by(fit, j, i, shortest),
        )
        for j, output in enumerate(part[0].output_names)
        for i, name in enumerate(part[0].input_names)
    ]


def _verdict(
    profile: Array, tried: NDArray[np.int64], without_input: float, name: str, output: str
) -> Delay:
    best = float(profile.min())
    possible = tried[profile <= best + LIKELY]
    low, high = int(possible[0]), int(possible[-1])
    if without_input - best < ACTS:
        return Delay(name, output, None, low, high)
    likely = int(tried[profile <= best + TIE][-1])
    return Delay(name, output, likely, low, high, without_input - best)


def _profiles(
    records: Sequence[Record],
    order: int,
    window: int,
    tried: NDArray[np.int64],
    far: NDArray[np.int64],
) -> tuple[Array, Array]:
    """−2 ln L by (input, delay tried, output), and without the input by (input, output)."""
    usual = np.union1d(np.arange(window + 1), far)
    lags = np.unique(np.concatenate([usual, *(tried + k for k in range(WINDOW))]))
    X, Y, _ = regressors(records, order, lags)
    nu, ny, n = records[0].nu, records[0].ny, len(X)
    # One QR of all columns; every candidate is then a small problem on rows of R.
    R: Array = np.asarray(np.linalg.qr(np.hstack([X, Y]), mode="r"))
    targets = R[:, X.shape[1] :]
    # Below 1e-10 of the output there is only round-off, which must not choose between delays.
    floor = 1e-20 * np.sum(Y**2, axis=0) + np.finfo(float).tiny

    def score(columns: NDArray[np.int64]) -> Array:
        basis, values, _ = np.linalg.svd(R[:, columns], full_matrices=False)
        basis = basis[:, values > 1e-10 * values[0]]
        rest = targets - basis @ (basis.T @ targets)
        return np.asarray(n * np.log(np.maximum(np.sum(rest**2, axis=0), floor)))

    past = np.arange(ny * order)
    near = [ny * order + i * len(lags) + np.searchsorted(lags, usual) for i in range(nu)]
    scores, without = np.empty((nu, len(tried), ny)), np.empty((nu, ny))
    for i in range(nu):
        others = np.concatenate([past, *(near[k] for k in range(nu) if k != i)])
        without[i] = score(others)
        for at, d in enumerate(tried):
            moved = ny * order + i * len(lags) + np.searchsorted(lags, d + np.arange(WINDOW))
            scores[i, at] = score(np.concatenate([others, moved]))
    return scores, without


def _best_regression(
    records: Sequence[Record], order: int, longest: int, far: NDArray[np.int64]
) -> tuple[LongRegression, int]:
    """The regression whose last near input lag has lowest BIC, and that lag.

    Tried from the order to the longest delay, always with the far lags.
    """
    fits = [(long_regression(records, order, far=far), order)]
    for last in sorted({order + 4, longest // 2 + 2, longest + 2}):
        if last > order:
            try:
                fits.append((long_regression(records, order, 0, last, far), last))
            except DataError:
                break
    return min(fits, key=lambda f: bic(f[0], fits[-1][0].samples))


def _surely_by(regression: LongRegression, j: int, i: int, shortest: int) -> int | None:
    """The first lag, from ``shortest`` on, by which input i certainly acts on output j."""
    b, width = np.abs(regression.b[j, i]), len(regression.lags)
    if not np.all(np.isfinite(regression.b_error[j, i])) or not np.max(b) > 0:
        return None
    for k in range(shortest, width):
        p = chance(regression, j, i * width + np.arange(shortest, k + 1))
        if p < SURE and b[k] >= RELEVANT * np.max(b):
            return int(regression.lags[k])
    return None


def _bounded(seen: Delay, sure: int | None) -> Delay:
    if sure is None or seen.delay is None or seen.delay <= sure:
        return seen
    return replace(seen, delay=sure, low=min(seen.low, sure), high=sure)


def _proportional(records: Sequence[Record]) -> list[int]:
    """For every input the first input that it is proportional to (itself, usually)."""
    u = np.concatenate([r.u - r.u.mean(axis=0) for r in records])
    norm = np.linalg.norm(u, axis=0)
    unit = u / np.where(norm > 0, norm, 1.0)
    angle = np.abs(unit.T @ unit)
    return [int(np.argmax(angle[i, : i + 1] > 1.0 - 1e-9)) for i in range(u.shape[1])]


BELIEVED = 1.1
"""Variance of the errors, over that of a long regression, up to which the process is believed."""

ORDER = 8
"""Lags of that regression."""

WIDTH = 2.6
"""Standard errors to either side: 99 %."""

LAGS = (3.0, 12.0, 48.0)
"""Sums of lags [samples] to start from where the speed of an output is unknown."""

MOST_INPUTS = 6
"""Inputs up to which the search is worth its time."""

PLAIN = 1
"""The delay of a plant without dead time, and of one that nothing shows to respond at once."""


def refined_delays(
    delays: Sequence[Delay], processes: Sequence[ProcessFit | None], dt: float, shortest: int
) -> tuple[Delay, ...]:
    """The delays with intervals of the process of each output, where there is one.

    Args:
        delays: of every pair, output by output.
        dt: sample time [s].
        shortest: 1 where a response within the sample is known to be a controller's, else 0.
    """
    inputs = len(delays) // max(len(processes), 1)
    refined: list[Delay] = []
    for k, d in enumerate(delays):
        fit = processes[k // inputs]
        if fit is not None:
            refined.append(_refined(d, fit, k % inputs, dt, shortest))
        else:
            unsure = d.delay is not None and d.low <= PLAIN < d.delay
            refined.append(replace(d, delay=PLAIN) if unsure else d)
    return tuple(refined)


def process_of(
    records: Sequence[Record], j: int, row: Sequence[Delay], speed: Speed
) -> ProcessFit | None:
    """The process of output j from its delays on, None where it is not believed.

    Args:
        row: the delays of all inputs to this output.
        speed: of this output.
    """
    if not 0 < len(row) <= MOST_INPUTS or all(d.delay is None for d in row):
        return None
    seen = [float(PLAIN if d.delay is None else d.delay) for d in row]
    plain = [float(PLAIN)] * len(row)
    starts = [seen, plain]
    if len(row) > 1:
        starts += [[*seen[:i], plain[i], *seen[i + 1 :]] for i in range(len(row))]
    unique = list(dict.fromkeys(map(tuple, starts)))
    quick = LAGS if not speed.time_constant else None
    samples = (speed.time_constant or 0.0) / records[0].dt
    lags = quick or (max(samples, 0.5), max(samples - max(seen), samples / 4.0, 0.5))
    fit = fit_process(records, j, unique, tuple(dict.fromkeys(lags)))
    if fit is None:
        return None
    far = [round(x) + k for x in fit.dead for k in (-1, 0, 1, 2) if round(x) + k > ORDER]
    alone = [r.select(r.input_names, [r.output_names[j]]) for r in records]
    try:
        long = long_regression(alone, ORDER, min(PLAIN, round(min(fit.dead))), ORDER, far)
    except (DataError, IndexError):
        return None
    return fit if fit.variance <= BELIEVED * float(long.variance[0]) else None


def _refined(d: Delay, fit: ProcessFit, i: int, dt: float, shortest: int) -> Delay:
    if d.delay is None:
        return d
    late, error = float(fit.dead[i]), float(fit.dead_error[i])
    dead = late - fit.held(i) + PLAIN
    low, high = (
        max(int(np.ceil(dead + side * WIDTH * error - 0.5)), shortest) for side in (-1.0, 1.0)
    )
    delay = max(int(np.ceil(dead - 0.5)), shortest)
    if late - WIDTH * error <= PLAIN <= high:
        delay = PLAIN  # no dead time where none is shown
    seconds = max(dead - PLAIN, 0.0) * dt
    return replace(d, delay=delay, low=low, high=high, dead_s=seconds, error_s=error * dt)
