"""Consistency of a filter: errors and innovations against their covariances.

Where model and noise are right, the normalised error eᵀP⁻¹e (NEES) and the normalised innovation
νᵀS⁻¹ν (NIS) are χ² with as many degrees of freedom as numbers (Bar-Shalom, Li & Kirubarajan 2001,
§5.4). Both are given per degree of freedom here, so that 1 is right, more is over-confident and
less too cautious.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.vehicle.kinematics import wrap_angle

POSE = ("x", "y", "psi")
"""States of a pose, whose errors and covariances a log holds."""


@dataclass(frozen=True)
class Mean:
    """A mean with the bounds that it keeps to where model and noise are right.

    Attributes:
        mean: per degree of freedom; 1 is right.
        bounds: that hold it with the probability asked for.
    """

    mean: float
    bounds: tuple[float, float]

    @property
    def verdict(self) -> str:
        """``consistent``, ``over-confident`` or ``too cautious``."""
        low, high = self.bounds
        if self.mean > high:
            return "over-confident"
        return "too cautious" if self.mean < low else "consistent"


@dataclass(frozen=True)
class Consistency:
    """How a filter's errors compare with what it believes of them.

    Attributes:
        nis: of the innovations; None where nothing was read.
        nees: of the pose; None where the truth is not known.
    """

    nis: Mean | None
    nees: Mean | None
    runs: int

    @property
    def sentence(self) -> str:
        verdicts = {m.verdict for m in (self.nis, self.nees) if m is not None}
        if "over-confident" in verdicts:
            return (
                "The filter is over-confident: its errors exceed its covariance. Raise q or r, or "
                "add the missing states."
            )
        if "too cautious" in verdicts:
            return "The filter is too cautious: its errors are below its covariance. Lower q or r."
        return "The filter is consistent: its errors match its covariance."


def consistency(runs: Sequence[Mapping[str, Array]], probability: float = 0.99) -> Consistency:
    """Judge a filter by the logs of runs.

    Innovations are independent in time, so that their sum is χ² of all their degrees of freedom.
    Errors of a pose are not: their bounds count as many independent samples as the
    autocorrelation of the NEES leaves.

    Args:
        runs: columns by name, ``nis, nis_dof`` and, for the NEES, ``x, y, psi`` beside
            ``x_est, y_est, psi_est`` and the entries of P; samples in which one is NaN are left
            out of it.
        probability: with which the bounds hold a mean where model and noise are right; as in the
            tests of residuals, one verdict in a hundred may be wrong.
    """
    nis, nees = mean_nis(runs, probability), mean_nees(runs, POSE, probability)
    return Consistency(nis, nees, len(runs))


def mean_nis(runs: Sequence[Mapping[str, Array]], probability: float) -> Mean | None:
    """Of the innovations of runs; None where nothing was read."""
    read = sum(float(np.nansum(run["nis_dof"])) for run in runs)
    total = sum(float(np.nansum(run["nis"])) for run in runs)
    return _mean(total / read, read, probability) if read > 0 else None


def mean_nees(
    runs: Sequence[Mapping[str, Array]], states: Sequence[str], probability: float
) -> Mean | None:
    """Of the errors of some states of the pose; None where the truth is not known."""
    series = [errors for run in runs if (errors := nees(run, states)) is not None and len(errors)]
    if not series:
        return None
    independent = sum(len(s) for s in series) / samples_in_one(series)
    mean = float(np.concatenate(series).mean()) / len(states)
    return _mean(mean, len(states) * max(independent, len(series)), probability)


def _mean(mean: float, dof: float, probability: float) -> Mean:
    low, high = chi2_bounds(dof, probability)
    return Mean(mean, (low / dof, high / dof))


def nees(run: Mapping[str, Array], states: Sequence[str] = POSE) -> Array | None:
    """eᵀP⁻¹e of states of the pose at every sample after the first, which is given; None where the
    truth is not known."""
    if not {*states} <= run.keys():
        return None
    error = np.stack([run[f"{name}_est"] - run[name] for name in states], axis=1)[1:]
    error = np.where(np.array(states) == "psi", wrap_angle(error), error)
    P = np.stack([run[_entry(a, b)][1:] for a in states for b in states], axis=1)
    P = P.reshape(-1, len(states), len(states))
    known = np.isfinite(error).all(axis=1) & np.isfinite(P).all(axis=(1, 2))
    error, P = error[known], P[known]
    squared: Array = np.einsum("ti,ti->t", error, np.linalg.solve(P, error[:, :, None])[:, :, 0])
    return squared


def _entry(a: str, b: str) -> str:
    """The column of an entry of P: P_xx, P_x_psi, P_psi …"""
    first, second = sorted((a, b), key=POSE.index)
    if second != "psi":
        return f"P_{first}{second}"
    return "P_psi" if first == "psi" else f"P_{first}_psi"


def chi2_bounds(dof: float, probability: float) -> tuple[float, float]:
    """Quantiles of χ² that hold it with a probability."""
    from scipy.special import gammaincinv

    outside = 0.5 * (1.0 - probability)
    low, high = (2.0 * float(gammaincinv(0.5 * dof, p)) for p in (outside, 1.0 - outside))
    return low, high


def samples_in_one(series: Sequence[Array]) -> float:
    """Samples worth one independent sample: 1 + 2Σρ, summed while ρ is above 0 (Bartlett)."""
    mean = float(np.concatenate(series).mean())
    off = [s - mean for s in series]
    power = sum(float(o @ o) for o in off)
    if power == 0.0:
        return float(max(map(len, off)))
    total = 1.0
    for lag in range(1, max(map(len, off)) // 2):
        rho = sum(float(o[lag:] @ o[:-lag]) for o in off if len(o) > lag) / power
        if rho <= 0:  # beyond the first zero there is noise alone
            break
        total += 2.0 * rho
    return total
