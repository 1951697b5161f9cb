"""Frequency response without a model: Welch, Blackman–Tukey, and local polynomials, with bands.

A local polynomial takes the spectrum around a line of the Fourier transform as

    Y(k+r) = (g₀ + g₁ r + g₂ r²) U(k+r) + t₀ + t₁ r + t₂ r² + V(k+r)

so that the transient of a record that is no whole period is estimated instead of leaking into the
response; what is left is the noise, whose variance gives the band (Schoukens, Vandersteen, Barbé &
Pintelon 2009, IEEE Trans. Instrum. Meas. 58, 786; Pintelon & Schoukens 2012, ch. 7).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.errors import DataError
from sysid.estimation.assessment.spectra import spectra

DEGREE = 2
"""Of the polynomials."""

SPARE = 6
"""Lines more than there are unknowns."""

LINES = 150
"""Frequencies at most, evenly spread over their logarithm."""

TRUSTED = 0.3
"""A response whose standard error is below this share of it can be trusted."""

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class FrequencyEstimate:
    """Responses of all outputs to all inputs.

    Attributes:
        w: angular frequencies [rad/s], (n,).
        value: (n, ny, nu).
        error: standard error of its complex value, √E|Ĝ − G|², (n, ny, nu).
        noise: power spectral density of what the inputs do not explain, (n, ny).
        coherence: share of each output's power that they explain, (n, ny).
    """

    w: Array
    value: Complex
    error: Array
    noise: Array
    coherence: Array

    def trusted_up_to(self, i: int, j: int) -> float:
        """Highest frequency [rad/s] below which most of the response has a narrow band; 0: none."""
        good = self.error[:, i, j] < TRUSTED * np.abs(self.value[:, i, j])
        share = np.cumsum(good) / np.arange(1, len(good) + 1)
        kept = np.flatnonzero(good & (share > 0.8))
        return float(self.w[kept[-1]]) if len(kept) else 0.0


def local_polynomial(records: Sequence[Record]) -> FrequencyEstimate:
    """Responses by local polynomials, averaged over records by their weights.

    Raises:
        DataError: the records are too short.
    """
    nu = records[0].nu
    unknowns = (DEGREE + 1) * (nu + 1)
    half = (unknowns + SPARE) // 2
    longest = max(records, key=len)
    if len(longest) // 2 <= 2 * half + 1:
        raise DataError(
            f"{longest.name}: {len(longest)} samples are too few for a frequency response; at "
            f"least {4 * half + 4} are needed"
        )
    parts = [_of_record(r, half, longest) for r in records if len(r) // 2 > 2 * half + 1]
    w = parts[0][0]
    weights = [1.0 / np.maximum(p[2], 1e-300) for p in parts]
    total = np.sum(weights, axis=0)
    value = np.sum([p[1] * g for p, g in zip(parts, weights, strict=True)], axis=0) / total
    noise = np.mean([p[3] for p in parts], axis=0)
    power = np.mean([p[4] for p in parts], axis=0)
    coherence = np.clip(1.0 - noise / np.maximum(power, 1e-300), 0.0, 1.0)
    return FrequencyEstimate(w, value, np.sqrt(1.0 / total), noise, coherence)


def _of_record(r: Record, half: int, longest: Record) -> tuple[Array, Complex, Array, Array, Array]:
    """w, Ĝ, its variance, noise and power of the outputs, at the lines of the longest record."""
    nu, ny, samples = r.nu, r.ny, len(r)
    z = np.column_stack([r.u, r.y])
    known = np.all(np.isfinite(z), axis=1)
    z = np.where(known[:, None], z - z[known].mean(axis=0), 0.0)
    F = np.fft.rfft(z, axis=0) / np.sqrt(samples)
    count = len(F)
    lines = np.unique(np.geomspace(1, len(longest) // 2 - 1, LINES).round()).astype(int)
    w = 2.0 * np.pi * lines / (len(longest) * longest.dt)
    value = np.zeros((len(w), ny, nu), dtype=np.complex128)
    variance, noise = np.full((len(w), ny, nu), np.inf), np.zeros((len(w), ny))
    power = np.zeros((len(w), ny))
    for m, frequency in enumerate(w):
        centre = round(frequency * samples * r.dt / (2.0 * np.pi))
        low = int(np.clip(centre - half, 1, max(count - 2 * half - 1, 1)))
        at = np.arange(low, min(low + 2 * half + 1, count))
        steps = ((at - centre) / half)[:, None] ** np.arange(DEGREE + 1)
        U, Y = F[at, :nu], F[at, nu:]
        columns = [U[:, [j]] * steps for j in range(nu)] + [steps.astype(np.complex128)]
        K = np.hstack(columns)
        inverse = np.linalg.pinv(K, rcond=1e-9)
        theta = inverse @ Y
        rank = np.linalg.matrix_rank(K, tol=1e-9 * np.linalg.norm(K, 2))
        left = np.sum(np.abs(Y - K @ theta) ** 2, axis=0) / max(len(at) - rank, 1)
        places = [j * (DEGREE + 1) for j in range(nu)]
        value[m] = theta[places].T
        spread = np.sum(np.abs(inverse[places]) ** 2, axis=1)
        variance[m] = np.outer(left, spread)
        noise[m] = left * r.dt
        power[m] = np.mean(np.abs(Y) ** 2, axis=0) * r.dt
    return w, value, variance, noise, power


def welch(records: Sequence[Record]) -> FrequencyEstimate:
    """Responses by averaged windows (``assessment.spectra``)."""
    s = spectra(records)
    error = np.abs(s.response) * np.sqrt(2.0) * s.gain_error[:, :, None]
    noise = s.outputs * (1.0 - s.coherence)
    return FrequencyEstimate(s.w, s.response, error, noise, s.coherence)


def blackman_tukey(records: Sequence[Record], lags: int | None = None) -> FrequencyEstimate:
    """Responses from correlations up to a lag, weighed by a Hann window of lags.

    Args:
        lags: the longest; a tenth of the longest record, at most 200, unless given.
    """
    longest = max(len(r) for r in records)
    M = lags or int(np.clip(longest // 10, 16, 200))
    nu = records[0].nu
    total: Any = 0.0
    samples = 0
    for r in records:
        z = np.column_stack([r.u, r.y])
        known = np.all(np.isfinite(z), axis=1)
        z = np.where(known[:, None], z - z[known].mean(axis=0), 0.0)
        F = np.fft.rfft(z, 2 * len(z), axis=0)
        R = np.fft.irfft(F[:, :, None] * F[:, None, :].conj(), axis=0)
        total = total + np.concatenate([R[-M:], R[: M + 1]])
        samples += len(z)
    lag = np.arange(-M, M + 1)
    window = 0.5 * (1.0 + np.cos(np.pi * lag / M))
    w = np.geomspace(np.pi / M, np.pi, LINES) / records[0].dt
    turn = np.exp(-1j * np.outer(w * records[0].dt, lag)) * window
    S = np.einsum("fl,lab->fab", turn, np.asarray(total) / samples) * records[0].dt
    uu, yu = S[:, :nu, :nu], S[:, nu:, :nu]
    value = yu @ np.linalg.pinv(uu, rcond=1e-9, hermitian=True)
    power = np.einsum("faa->fa", S).real[:, nu:]
    explained = np.einsum("fij,fij->fi", value, yu.conj()).real
    coherence = np.clip(explained / np.maximum(power, 1e-300), 0.0, 1.0)
    noise = power * (1.0 - coherence)
    # variance of a smoothed spectrum: Σ window² / N of the periodogram's (Ljung 1999, 6.74)
    share = float(np.sum(window**2)) / samples
    inverse = np.linalg.pinv(uu, rcond=1e-9, hermitian=True)
    spread = np.einsum("faa->fa", inverse).real
    error = np.sqrt(np.maximum(share * noise[:, :, None] * spread[:, None, :], 0.0))
    return FrequencyEstimate(w, value, error, noise, coherence)
