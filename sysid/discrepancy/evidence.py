"""What speaks for an effect: effective sample size, paired blocks, held-out error, noise floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.criteria.coloured import effective_sample_size
from sysid.data.record import Array, Record

BLOCKS = 24
"""Blocks that before and after are compared on; each still holds many time constants."""

TOUCHED = 0.02
"""A block counts as touched by an effect when its predictions move by this share of their size."""


@dataclass(frozen=True)
class Evidence:
    """How two models of the same data compare.

    Attributes:
        delta_bic: N_eff ln(V₁/V₀) + k ln N_eff; negative speaks for the richer model.
        t: paired t of the blocks' mean squared errors; positive speaks for the richer model.
        share_better: share of the touched blocks whose error falls.
        ratio: held-out RMSE after over before.
        p_value: chance of such a t, times the number of effects tried (Bonferroni).
    """

    delta_bic: float
    t: float
    share_better: float
    ratio: float
    p_value: float

    @property
    def accepted(self) -> bool:
        """The rule of acceptance that held on real records; see the decision page."""
        return (
            self.delta_bic < -6.0
            and self.t > 2.0
            and self.share_better > 0.5
            and self.p_value < 0.01
            and self.ratio < 0.90
        )


def compare_errors(
    before: Sequence[Array],
    after: Sequence[Array],
    held_before: Sequence[Array],
    held_after: Sequence[Array],
    parameters: int,
    tried: int,
) -> Evidence:
    """Evidence from free-run errors (N, ny) of each record before and after.

    Args:
        before, after: errors on the estimation records.
        held_before, held_after: errors on the held-out records.
        parameters: numbers the richer model adds.
        tried: effects that were tried, for the correction.
    """
    from scipy.stats import t as student

    scale = np.sqrt(np.mean(np.concatenate(before) ** 2, axis=0)) + 1e-300
    old = np.concatenate([e / scale for e in before])
    new = np.concatenate([e / scale for e in after])
    effective = min(
        effective_sample_size([e[:, [i]] / scale[i] for e in after]) for i in range(old.shape[1])
    )
    effective = float(np.clip(effective, 10.0, len(old))) * old.shape[1]
    ratio_square = float(np.mean(new**2) / np.mean(old**2))
    delta = effective * np.log(ratio_square) + parameters * np.log(effective)
    gains, touched = _block_gains([*before, *held_before], [*after, *held_after], scale)
    spread = float(np.std(gains, ddof=1)) / np.sqrt(len(gains)) if len(gains) > 2 else np.inf
    t = float(np.mean(gains)) / spread if spread > 0 else 0.0
    chance = float(student.sf(t, max(len(gains) - 1, 1)))
    held = np.sqrt(
        np.mean(np.concatenate(held_after) ** 2) / np.mean(np.concatenate(held_before) ** 2)
    )
    better = float(np.mean(gains[touched] > 0)) if touched.any() else 0.0
    return Evidence(delta, t, better, float(held), min(1.0, chance * tried))


def _block_gains(
    before: Sequence[Array], after: Sequence[Array], scale: Array
) -> tuple[Array, Array]:
    total = sum(len(e) for e in before)
    size = max(total // BLOCKS, 8)
    gains, touched = [], []
    for old, new in zip(before, after, strict=True):
        for low in range(0, len(old) - size // 2, size):
            a, b = old[low : low + size] / scale, new[low : low + size] / scale
            gains.append(float(np.mean(a**2) - np.mean(b**2)))
            touched.append(float(np.sqrt(np.mean((a - b) ** 2))) > TOUCHED)
    return np.array(gains), np.array(touched)


def noise_floor(records: Sequence[Record]) -> Array:
    """Measurement noise of each output from the data alone, (ny,).

    Third differences of a smooth signal vanish; their median absolute deviation, divided by
    √20 (the norm of 1, −3, 3, −1), is the standard deviation of white reading noise. Fast
    transients are a minority that the median passes over.
    """
    third = np.concatenate([np.diff(r.y, n=3, axis=0) for r in records if len(r) > 3])
    return np.asarray(1.4826 * np.median(np.abs(third), axis=0) / np.sqrt(20.0))
