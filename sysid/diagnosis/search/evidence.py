"""Evidence for an effect: likelihood, paired blocks, held-out error."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.criteria.coloured import effective_sample_size
from sysid.data.record import Array, Index
from sysid.diagnosis.policies import ENDLESS, RULE
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

    def to_json(self) -> dict[str, float]:
        """{delta_bic, p_value}."""
        return {"delta_bic": self.delta_bic, "p_value": self.p_value}

    @property
    def accepted(self) -> bool:
        """The rule of acceptance that held on real records; see the decision page."""
        return self.significant and self.share_better > RULE.blocks and self.ratio < self.needed

    def rivals(self, best: "Evidence") -> bool:
        """Whether an effect may be what an accepted one is taken for.

        It is accepted itself, or only its numbers cost it that: in a short log ΔBIC decides by
        them, and two models within ``RULE.bic`` of each other may both be right. Where more is
        asked of the held-out error (``needed``), that decides whether to name, and not what.
        """
        likely = self._beyond_chance(max(RULE.bic, best.delta_bic - RULE.bic))
        return likely and self.share_better > RULE.blocks and self.ratio < RULE.held_out

    @property
    def significant(self) -> bool:
        """Whether the gain is more than chance, however small it is.

        Effects that act seldom change few blocks by much, and t stays below 2: there the ranks of
        the touched blocks decide, corrected for the number of effects tried.
        """
        return self._beyond_chance(RULE.bic)

    def _beyond_chance(self, bic: float) -> bool:
        return self.delta_bic < bic and (self.t > RULE.t or self.p_value < RULE.p)


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
    from scipy.special import stdtr

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
    chance = 2.0 * min(float(stdtr(max(len(gains) - 1, 1), -t)), _by_ranks(gains[moved]))
    ratio = float(np.sqrt(np.mean((h1[at] + 1e-300) / (h0[at] + 1e-300))))
    better = float(np.mean(gains[moved] > 0)) if moved.any() else 0.0
    return Evidence(delta, t, better, ratio, min(1.0, chance * tried), needed)


def likelihood(before: Errors, after: Errors, added: float, samples: Array) -> float:
    """Penalised likelihood ratio over both parts, in units of BIC; positive is better.

    Args:
        added: parameters that ``after`` has more.
        samples: effective number of estimation samples of each output, common to all compared.
    """
    (v0, h0), (v1, h1) = before.mean_squares(), after.mean_squares()
    parts = (before.estimation, before.holdout)
    n, m = (sum(int(np.isfinite(e).any(axis=1).sum()) for e in part) for part in parts)
    fell, held_out = (np.log((a + 1e-300) / (b + 1e-300)) for a, b in ((v0, v1), (h0, h1)))
    gain = fell + m / max(n, 1) * held_out
    return float(np.sum(samples * gain) - added * np.log(np.sum(samples)))


def needed_power(parameters: int, samples: float, below: float) -> float:
    """‖Δ⊥‖²/‖e‖² that the rule of acceptance asks of an effect, V₀/V₁ = 1 + ‖Δ⊥‖²/‖e‖².

    Args:
        samples: effective number.
        below: what the held-out error must fall below, as a share of before.
    """
    asked = (-RULE.bic + parameters * np.log(samples)) / samples
    return max(1.0 / below**2 - 1.0, float(np.expm1(min(asked, 50.0))))


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
    """Chance of such gains under a symmetric law: Wilcoxon's signed ranks, by their normal law.

    Of n gains the sum of the positive ranks has mean n(n + 1)/4 and variance n(n + 1)(2n + 1)/24,
    less Σ(t³ − t)/48 for ranks that t gains share (Wilcoxon 1945; Pratt's zeros are left out).
    """
    from scipy.special import ndtr

    if len(gains) < 6 or not np.any(gains):
        return 1.0
    gains = gains[gains != 0.0]
    _, of, shared = np.unique(np.abs(gains), return_inverse=True, return_counts=True)
    rank = (np.cumsum(shared) - 0.5 * (shared - 1))[of]
    n = len(gains)
    variance = n * (n + 1) * (2 * n + 1) / 24.0 - float(np.sum(shared**3 - shared)) / 48.0
    above = float(np.sum(rank[gains > 0.0])) - 0.25 * n * (n + 1)
    return float(ndtr(-above / np.sqrt(variance)))


def _t(gains: Array) -> float:
    spread = float(np.std(gains, ddof=1)) / np.sqrt(len(gains)) if len(gains) > 2 else np.inf
    return float(np.mean(gains)) / spread if spread > 0 else 0.0


def _block_gains(
    before: Sequence[Array], after: Sequence[Array]
) -> tuple[Array, NDArray[np.bool_]]:
    size = max(sum(map(len, before)) // BLOCKS, 8)
    gains, moved = [], []
    for old, new in zip(before, after, strict=True):
        starts = np.arange(0, len(old) - size // 2, size, dtype=np.intp)
        if not len(starts):
            continue
        rows = slice(0, int(starts[-1]) + size)
        a, b = _squares(old[rows], starts), _squares(new[rows], starts)
        with np.errstate(invalid="ignore"):
            both = _squares(old[rows] - new[rows], starts)
        seen = np.isfinite(a)
        # a run that had no end in a block moved it, and for the worse
        gained = np.where(np.isfinite(b) & np.isfinite(both), a - b, -ENDLESS)[seen]
        gains.append(np.maximum(gained, -ENDLESS))
        moved.append(~(np.sqrt(both) <= RULE.touched)[seen])
    return np.concatenate(gains or [np.zeros(0)]), np.concatenate(moved or [np.zeros(0, bool)])


def _squares(errors: Array, starts: Index) -> Array:
    """Mean square of each block, of the samples that count; NaN for one without any."""
    with np.errstate(over="ignore", invalid="ignore"):
        power = np.where(np.isnan(errors), 0.0, errors**2).sum(axis=1)
        counts = (~np.isnan(errors)).sum(axis=1)
        sums, of = np.add.reduceat(power, starts), np.add.reduceat(counts, starts)
        return np.asarray(np.where(of > 0, sums / np.maximum(of, 1), np.nan))
