"""Evidence for an effect: likelihood, paired blocks, held-out error; and the noise floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.criteria.coloured import effective_sample_size
from sysid.data.reading.stale import fresh_only, refreshes
from sysid.data.record import Array, Record
from sysid.diagnosis.policies import RULE
from sysid.fitting.holdout import Errors

BLOCKS = 24
"""Blocks that before and after are compared on; each still holds many time constants."""

MIN_SETTLED_DIFFERENCES = 200
"""Third differences on which no command changes, at least, to read the noise from them alone."""

WITHIN_THREE = 0.98658
"""Standard deviation of a normal law cut off at three of its own."""


@dataclass(frozen=True)
class Evidence:
    """How two models of the same data compare, over the outputs that the effect changes.

    Attributes:
        delta_bic: Σ N_eff ln(V₁/V₀) + k ln N_eff; negative speaks for the richer model.
        t: paired t of the blocks' mean squared errors; positive speaks for the richer model.
        share_better: share of the touched blocks whose error falls.
        ratio: held-out RMSE after over before.
        p_value: chance of such a t, times the number of effects tried (Bonferroni).
        needed: what ``ratio`` must fall below.
    """

    delta_bic: float
    t: float
    share_better: float
    ratio: float
    p_value: float
    needed: float = RULE.held_out

    @property
    def accepted(self) -> bool:
        """The rule of acceptance that held on real records; see the decision page."""
        return self.significant and self.share_better > RULE.blocks and self.ratio < self.needed

    @property
    def significant(self) -> bool:
        """Whether the gain is more than chance, however small it is.

        Effects that act seldom change few blocks by much, and t stays below 2: there the ranks of
        the touched blocks decide, corrected for the number of effects tried.
        """
        return self.delta_bic < RULE.bic and (self.t > RULE.t or self.p_value < RULE.p)


def effective_samples(errors: Sequence[Array]) -> Array:
    """Samples that the coloured errors are worth, (ny,), between 10 and N."""
    ny = errors[0].shape[1]
    counts = []
    for i in range(ny):
        parts = [e[np.isfinite(e[:, i]), i][:, None] for e in errors]
        total = sum(len(p) for p in parts)
        scale = float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) + 1e-300
        n = effective_sample_size([p / scale for p in parts])
        counts.append(float(np.clip(n, 10.0, max(total, 10))))
    return np.array(counts)


def compare_errors(
    before: Errors,
    after: Errors,
    parameters: int,
    tried: int,
    touched: NDArray[np.bool_],
    samples: Array,
    needed: float = RULE.held_out,
) -> Evidence:
    """Evidence from free-run errors before and after.

    Args:
        before, after: errors of both models on the same samples.
        parameters: parameters the richer model adds.
        tried: effects that were tried, for the correction.
        touched: outputs that the effect changes, (ny,).
        samples: effective number of estimation samples of each output, common to all compared.
        needed: what the held-out ratio must fall below.
    """
    from scipy.stats import t as student

    (v0, h0), (v1, h1) = before.mean_squares(), after.mean_squares()
    at = np.flatnonzero(touched)
    if not len(at):
        return Evidence(0.0, 0.0, 0.0, 1.0, 1.0, needed)
    n = samples[at]
    delta = float(np.sum(n * np.log((v1[at] + 1e-300) / (v0[at] + 1e-300))))
    delta += parameters * float(np.log(np.sum(n)))
    scale = np.sqrt(v0[at]) + 1e-300
    gains, moved = _block_gains(
        [e[:, at] / scale for e in (*before.estimation, *before.holdout)],
        [e[:, at] / scale for e in (*after.estimation, *after.holdout)],
    )
    t = _t(gains)
    # few blocks may hold most of an effect: then ranks say more than means; twice the smaller
    chance = 2.0 * min(float(student.sf(t, max(len(gains) - 1, 1))), _by_ranks(gains[moved]))
    ratio = float(np.sqrt(np.mean((h1[at] + 1e-300) / (h0[at] + 1e-300))))
    better = float(np.mean(gains[moved] > 0)) if moved.any() else 0.0
    return Evidence(delta, t, better, ratio, min(1.0, chance * tried), needed)


def difference(best: Errors, other: Errors) -> tuple[float, float]:
    """How two rival models differ: (t of the blocks' squared errors, ratio of RMSE other/best).

    Each output counts in units of the best model's error.
    """
    v = np.nanmean(np.concatenate([*best.estimation, *best.holdout]) ** 2, axis=0)
    scale = np.sqrt(v) + 1e-300
    gains, _ = _block_gains(
        [e / scale for e in (*other.estimation, *other.holdout)],
        [e / scale for e in (*best.estimation, *best.holdout)],
    )
    w = np.nanmean(np.concatenate([*other.estimation, *other.holdout]) ** 2, axis=0)
    return _t(gains), float(np.sqrt(np.mean((w + 1e-300) / (v + 1e-300))))


def alike(best: Errors, other: Errors) -> bool:
    """Whether two models run alike: they differ by little against what the better one leaves."""
    a = np.concatenate([*best.estimation, *best.holdout])
    b = np.concatenate([*other.estimation, *other.holdout])
    size = np.sqrt(np.nanmean(a**2, axis=0)) + 1e-300
    return bool(np.all(np.sqrt(np.nanmean((a - b) ** 2, axis=0)) < RULE.alike * size))


def _by_ranks(gains: Array) -> float:
    """Chance of such gains under a symmetric law (Wilcoxon's signed ranks)."""
    from scipy.stats import wilcoxon

    if len(gains) < 6 or not np.any(gains):
        return 1.0
    return float(wilcoxon(gains, alternative="greater", method="approx").pvalue)


def _t(gains: Array) -> float:
    spread = float(np.std(gains, ddof=1)) / np.sqrt(len(gains)) if len(gains) > 2 else np.inf
    return float(np.mean(gains)) / spread if spread > 0 else 0.0


WORST = 1e150
"""Loss of a block in which a run has no end: its square is still a number."""


def _block_gains(
    before: Sequence[Array], after: Sequence[Array]
) -> tuple[Array, NDArray[np.bool_]]:
    total = sum(len(e) for e in before)
    size = max(total // BLOCKS, 8)
    gains, moved = [], []
    for old, new in zip(before, after, strict=True):
        for low in range(0, len(old) - size // 2, size):
            a, b = old[low : low + size], new[low : low + size]
            if np.isfinite(a - b).any():
                gains.append(float(np.nanmean(a**2) - np.nanmean(b**2)))
                moved.append(float(np.sqrt(np.nanmean((a - b) ** 2))) > RULE.touched)
            elif np.isfinite(a).any():  # a run that had no end there
                gains.append(-WORST)
                moved.append(True)
    return np.array(gains), np.array(moved, dtype=bool)


def noise_floor(records: Sequence[Record]) -> Array:
    """Measurement noise of each output from the data alone, (ny,), at least q/√12 of resolution q.

    Third differences of a smooth signal vanish; over √20 (the norm of 1, −3, 3, −1) they are white
    measurement noise. Where commands rest often enough, only samples without a recent change count,
    by their root mean square without outliers; otherwise the median absolute deviation of all. Of a
    sensor slower than the log only fresh measurements count.
    """
    slow = refreshes(records)
    if any(slow):
        each = [_floor(fresh_only(records, i, s)) for i, s in enumerate(slow)]
        return np.concatenate(each)
    return _floor(records)


def settled(records: Sequence[Record]) -> NDArray[np.bool_]:
    """Outputs whose commands rest often enough to read the noise between their changes, (ny,)."""
    calm = [_calm(r) for r in records if len(r) > 3]
    return np.asarray(np.concatenate(calm).sum(axis=0) >= MIN_SETTLED_DIFFERENCES)


def _floor(records: Sequence[Record]) -> Array:
    """``noise_floor`` of measurements that are all fresh."""
    third = np.concatenate([np.diff(r.y, n=3, axis=0) for r in records if len(r) > 3])
    calm = np.concatenate([_calm(r) for r in records if len(r) > 3])
    rough = 1.4826 * np.median(np.abs(third), axis=0)
    spreads = [
        _spread(third[calm[:, i], i], rough[i])
        if calm[:, i].sum() >= MIN_SETTLED_DIFFERENCES
        else rough[i]
        for i in range(third.shape[1])
    ]
    rounding = _step(records) / np.sqrt(12.0)
    return np.asarray(np.maximum(np.array(spreads) / np.sqrt(20.0), rounding))


def _step(records: Sequence[Record]) -> Array:
    """Resolution of each output, (ny,): the smallest difference between two measurements."""
    values = np.concatenate([r.y for r in records])
    steps = np.zeros(values.shape[1])
    for i, column in enumerate(values.T):
        apart = np.diff(np.unique(column))
        # rounding of a computation is no step of a sensor
        apart = apart[apart > 1e-9 * float(np.max(np.abs(column), initial=0.0))]
        steps[i] = float(np.min(apart, initial=np.inf))
    return np.where(np.isfinite(steps), steps, 0.0)


def _calm(record: Record) -> NDArray[np.bool_]:
    """Third differences (N − 3, ny) on which no command changes, nor in the two samples before.

    Measurements that rest on zero or on their largest size (a clip) do not show the noise.
    """
    u, y = record.u, record.y
    changes = np.any(np.abs(np.diff(u, axis=0)) > 1e-3 * np.max(np.abs(u), axis=0), axis=1)
    before = np.concatenate([[0], np.cumsum(changes)])
    first = np.arange(len(u) - 3)
    calm = before[first + 3] == before[np.maximum(first - 2, 0)]
    size = np.abs(y[:-3])
    same = np.all([y[k : len(y) - 3 + k] == y[:-3] for k in (1, 2, 3)], axis=0)
    stuck = same & ((size == 0.0) | (size == np.max(np.abs(y), axis=0)))
    return np.asarray(calm[:, None] & ~stuck)


def _spread(x: Array, start: float) -> float:
    """Root mean square within three times itself, for a normal law."""
    size = max(start, 1.4826 * float(np.median(np.abs(x))))
    for _ in range(5):
        inside = x[np.abs(x) <= 3.0 * size]
        size = float(np.sqrt(np.mean(inside**2))) / WITHIN_THREE if len(inside) else size
    return size
