"""Evidence for an effect: likelihood, paired blocks, held-out error."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.criteria.coloured import effective_sample_size
from sysid.data.record import Array
from sysid.diagnosis.policies import RULE
from sysid.fitting.holdout import Errors

BLOCKS = 24
"""Blocks that before and after are compared on; each still holds many time constants."""


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
    parameters: float,
    tried: int,
    touched: NDArray[np.bool_],
    samples: Array,
    needed: float = RULE.held_out,
) -> Evidence:
    """Evidence from free-run errors before and after.

    Args:
        touched: outputs that the effect changes, (ny,).
        samples: effective number of estimation samples of each output, common to all compared.
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
