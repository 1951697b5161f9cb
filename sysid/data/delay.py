"""The delay between every input and output, with its uncertainty, from the data alone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.impulse import (
    LongRegression,
    bic,
    chance,
    chosen_order,
    long_regression,
    regressors,
)
from sysid.data.record import Array, Record
from sysid.errors import DataError

LIKELY = 10.0
"""Delays whose −2 ln L lies within this of the best one are possible (about 99 %, with a margin
for the shape of the window, which is a choice)."""
TIE = 2.0
"""Differences of −2 ln L below this do not tell two delays apart: the longer one is simpler."""
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
    """

    input: str
    output: str
    delay: int | None
    low: int
    high: int
    evidence: float = 0.0

    @property
    def certain(self) -> bool:
        """Whether the data allow one delay only."""
        return self.delay is not None and self.low == self.high


def estimate_delays(records: Sequence[Record], longest: int = 20) -> tuple[Delay, ...]:
    """The delay of every pair, output by output.

    Output j is regressed on its past, on all lags of the other inputs, and on WINDOW lags
    d, d + 1, … of input i; d is moved from 0 to ``longest``. With N samples and residual variance
    V(d), −2 ln L = N ln V(d) + constant: its minimum is the estimate, the interval holds every d
    within LIKELY of it. A window is too short for a rich response, so a second verdict bounds the
    delay from above: the first lag k of the regression on all lags at which b_0 = … = b_k = 0 is
    rejected (Wald test at SURE) with |b_k| ≥ RELEVANT · max|b|. Inputs that move in proportion
    share one delay. (Ljung 1999, §16.3; the interval is a profile likelihood.)

    Args:
        records: experiments with the same channels.
        longest: the longest delay looked for [samples].

    Raises:
        DataError: there are too few samples for a regression.
    """
    twins = _proportional(records)
    kept = sorted(set(twins))
    names = [records[0].input_names[i] for i in kept]
    part = [r.select(names, r.output_names) for r in records]
    order = chosen_order(part)
    if not order:
        raise DataError(f"{records[0].name}: too few samples to estimate a delay; record longer")
    fit = _best_regression(part, order, longest)
    longest = min(longest, min(len(r) for r in part) // 4)
    profiles, alone = _profiles(part, order, int(fit.lags[-1]), longest)
    found = []
    for j, output in enumerate(records[0].output_names):
        for i, name in enumerate(records[0].input_names):
            k = kept.index(twins[i])
            seen = _verdict(profiles[k, :, j], float(alone[k, j]), name, output)
            found.append(_bounded(seen, _surely_by(fit, j, k)))
    return tuple(found)


def _verdict(profile: Array, alone: float, name: str, output: str) -> Delay:
    best = float(profile.min())
    possible = np.flatnonzero(profile <= best + LIKELY)
    low, high = int(possible[0]), int(possible[-1])
    if alone - best < ACTS:
        return Delay(name, output, None, low, high)
    likely = int(np.flatnonzero(profile <= best + TIE)[-1])
    return Delay(name, output, likely, low, high, alone - best)


def _profiles(
    records: Sequence[Record], order: int, window: int, longest: int
) -> tuple[Array, Array]:
    """−2 ln L by (input, delay, output), and without the input by (input, output)."""
    lags = np.arange(0, max(longest + WINDOW, window + 1))
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
    near = [ny * order + i * len(lags) + np.arange(window + 1) for i in range(nu)]
    scores, without = np.empty((nu, longest + 1, ny)), np.empty((nu, ny))
    for i in range(nu):
        others = np.concatenate([past, *(near[k] for k in range(nu) if k != i)])
        without[i] = score(others)
        for d in range(longest + 1):
            moved = ny * order + i * len(lags) + d + np.arange(WINDOW)
            scores[i, d] = score(np.concatenate([others, moved]))
    return scores, without


def _best_regression(records: Sequence[Record], order: int, longest: int) -> LongRegression:
    """The regression whose last input lag, from the order to the longest delay, has lowest BIC."""
    fits = [long_regression(records, order)]
    for last in sorted({order + 4, longest // 2 + 2, longest + 2}):
        if last > order:
            try:
                fits.append(long_regression(records, order, 0, last))
            except DataError:
                break
    return min(fits, key=lambda f: bic(f, fits[-1].samples))


def _surely_by(fit: LongRegression, j: int, i: int) -> int | None:
    """The first lag by which input i certainly acts on output j."""
    b, width = np.abs(fit.b[j, i]), len(fit.lags)
    if not np.all(np.isfinite(fit.b_error[j, i])) or not np.max(b) > 0:
        return None
    for k in range(width):
        p = chance(fit, j, i * width + np.arange(k + 1))
        if p < SURE and b[k] >= RELEVANT * np.max(b):
            return k
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


def _only_inputs(records: Sequence[Record], kept: Sequence[int]) -> list[Record]:
    names = [records[0].input_names[i] for i in kept]
    return [r.select(names, r.output_names) for r in records]
