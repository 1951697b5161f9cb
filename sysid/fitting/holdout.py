"""Hold out estimation data, so that validation data choose nothing."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record

MANY = 4
"""From this many records on each is cut once: every piece costs initial states to estimate."""

ONCE = ((0.7, 1.0),)
TWICE = ((0.35, 0.5), (0.85, 1.0))
THRICE = ((0.2, 0.3), (0.5, 0.6), (0.8, 0.9))
"""Parts of a record that are held out, 30 % in all."""

CUTS = ((600, THRICE), (200, TWICE), (0, ONCE))
"""Shortest record [samples] for each way to cut: the more blocks, the better they cover a record
that is ordered by level or sign; the shorter the pieces, the more their initial states cost."""


CLOSE = 0.01
"""Held-out errors that differ by less than this fraction are the same for all purposes."""

STILL = 0.02
"""An input that moves by less than this part of its spread within every block is still there."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of one model on what it was fitted to and on what was held out.

    Attributes:
        estimation: (N, ny) of each estimation record, NaN where a sample does not count.
        holdout: the same of the held-out samples.
    """

    estimation: tuple[Array, ...]
    holdout: tuple[Array, ...]

    def mean_squares(self) -> tuple[Array, Array]:
        """Mean squared errors of both parts, (ny,) each."""
        return (
            np.nanmean(np.concatenate(self.estimation) ** 2, axis=0),
            np.nanmean(np.concatenate(self.holdout) ** 2, axis=0),
        )


@dataclass(frozen=True, eq=False)
class HoldOut:
    """Estimation data cut into what is fitted and what chooses.

    Attributes:
        train: pieces to fit on, each with an initial state of its own.
        holdout: the pieces held out.
        whole: the records uncut: a free run goes through all of a record, because a state fitted
            to the head of a short block would hide a model that drifts.
        counted: by record, the samples of ``whole`` that are held out, (N,) each.
        one_step: whether held-out samples are judged one step ahead instead of in free run, as
            data of a closed loop, or with what is left of a drift, have to be.
    """

    train: tuple[Record, ...]
    holdout: tuple[Record, ...]
    whole: tuple[Record, ...]
    counted: tuple[NDArray[np.bool_], ...]
    words: str
    one_step: bool = False

    def of(self, changed: Callable[[Record], Record]) -> "HoldOut":
        """The same split of records that are changed sample by sample."""
        train, holdout, whole = (
            tuple(changed(r) for r in part) for part in (self.train, self.holdout, self.whole)
        )
        return HoldOut(train, holdout, whole, self.counted, self.words, self.one_step)

    def same_cuts_of(self, whole: Sequence[Record]) -> "HoldOut":
        """The same samples of other records held out."""
        parts: tuple[list[Record], list[Record]] = [], []
        for r, mask in zip(whole, self.counted, strict=True):
            edges = [0, *(np.flatnonzero(np.diff(mask)) + 1).tolist(), len(r)]
            for a, b in pairwise(edges):
                parts[int(mask[a])].append(r.rows(a, b))
        return replace(self, train=tuple(parts[0]), holdout=tuple(parts[1]), whole=tuple(whole))

    @property
    def samples(self) -> int:
        return sum(len(r) for r in self.train)

    @property
    def excited(self) -> bool:
        """Whether an input moves in a held-out block: without, these judge levels and noise only.

        The one step of a short record stands in what is fitted.
        """
        spread = np.std(np.concatenate([r.u for r in self.whole]), axis=0)
        within = [np.std(r.u, axis=0) for r in self.holdout]
        return not spread.size or bool(np.any(np.max(within, axis=0) > STILL * spread))


def hold_out(records: Sequence[Record], dead_time: int = 0) -> HoldOut:
    """Split estimation data into a part to fit on and a part to choose on.

    30 % of every record are held out: in interleaved blocks, so that they cover the operating
    range even where a record is ordered by level or sign; at its end where it is short or one
    of many.

    Args:
        dead_time: the longest delay [samples]. Every piece loses as many at its head; records are
            cut less often where that would cost a piece more than half of its samples.
    """
    counted, cuts = [], []
    for r in records:
        n = len(r)
        cut = ONCE if len(records) >= MANY else _cut(n, dead_time)
        mask = np.zeros(n, dtype=bool)
        for a, b in cut:
            mask[round(a * n) : round(b * n)] = True
        counted.append(mask)
        cuts.append(cut)
    return HoldOut((), (), (), tuple(counted), _words(cuts)).same_cuts_of(records)


def longest_of(nk: int | Sequence[Sequence[int]]) -> int:
    """The longest of the delays of all pairs."""
    return nk if isinstance(nk, int) else max(max(row) for row in nk)


def _cut(samples: int, dead_time: int) -> tuple[tuple[float, float], ...]:
    """The way to cut a record: the most blocks that its length and the delay allow."""
    for least, cut in CUTS:
        bounds = [0.0, *(share for block in cut for share in block), 1.0]
        shortest = min(
            (b - a) * samples for a, b in zip(bounds[::2], bounds[1::2], strict=True) if b > a
        )
        if samples >= least and shortest >= 2 * dead_time:
            return cut
    return ONCE


def _words(cuts: Sequence[object]) -> str:
    if all(c is ONCE for c in cuts):
        each = "" if len(cuts) == 1 else "each piece of "
        return f"the last 30 % of {each}the estimation data"
    return "the 30 % of the estimation data that were held out"


def tie_margin(holdout: Sequence[Record]) -> float:
    """Fraction by which an RMS error on these records is uncertain: one standard error.

    N independent errors give their RMS with a relative standard error of 1/√(2N). Among models
    within one standard error of the best the smallest is taken (Breiman et al. 1984, §3.4.3):
    the best of many candidates owes part of its lead to chance.
    """
    samples = sum(len(r) * r.ny for r in holdout)
    return max(CLOSE, 1.0 / float(np.sqrt(2.0 * max(samples, 1))))


def error_margin(series: Sequence[Array]) -> float:
    """Fraction by which the RMS of held-out errors is uncertain: one standard error.

    N errors with autocorrelation ρ(k) give their RMS with a relative standard error of √(Σ ρ²/2N)
    over all lags (Bartlett 1946), which is 1/√(2N) where they are independent. Errors of a free run
    are alike for as long as the plant remembers, so that a short record holds out few independent
    ones, and the best of many candidates owes its lead to a transient or two.

    Args:
        series: held-out errors of each output and record, (N,) in order of time, zero where a
            sample does not count.
    """
    longest = max(len(e) for e in series)
    products, pairs = np.zeros(longest), np.zeros(longest)
    for e in series:
        products[: len(e)] += _lagged(e)
        pairs[: len(e)] += _lagged((e != 0.0).astype(np.float64))
    power, samples = products[0], pairs[0]
    if not power > 0.0:
        return CLOSE
    # independent errors have products, too: of a variance of σ⁴ each pair
    beyond = float(np.sum((products[1:] / power) ** 2 - pairs[1:] / samples**2))
    return max(CLOSE, float(np.sqrt((1.0 + 2.0 * max(beyond, 0.0)) / (2.0 * samples))))


def independent_samples(errors: Sequence[Array], change: Sequence[Array]) -> float:
    """As how many independent samples these say whether a change of the errors is chance.

    M = N / (1 + 2 Σ ρ_e(k) ρ_d(k)), k = 1 … N − 1, since Σ e d of unrelated series has the
    variance N σ_e² σ_d² Σ ρ_e ρ_d over all lags (Bartlett 1946). Errors of a free run follow each
    other for as long as the plant remembers: a change of the level looks like them, a quick one
    does not.

    Args:
        errors: of each output and record, (N,) in order of time, zero where a sample does not
                count.
        change: what another model makes of them less these, of the same shapes.

    Returns:
        1 … N; N where either is zero throughout.
    """
    longest = max(len(e) for e in errors)
    products = np.zeros((2, longest))
    for e, d in zip(errors, change, strict=True):
        products[:, : len(e)] += [_lagged(e), _lagged(d)]
    samples = sum(int(np.count_nonzero(e)) for e in errors)
    powers = products[:, 0]
    if not np.all(powers > 0.0):
        return float(samples)
    alike = float(np.prod(products[:, 1:] / powers[:, None], axis=0).sum())
    return max(samples / (1.0 + 2.0 * max(alike, 0.0)), 1.0)


def _lagged(x: Array) -> Array:
    """Σ_t x(t) x(t + k) for k = 0 … N − 1."""
    n = len(x)
    return np.asarray(np.fft.irfft(np.abs(np.fft.rfft(x, 2 * n)) ** 2, 2 * n)[:n])
