"""Frequency response without a model: Welch, Blackman–Tukey, and local models, with bands.

Around each frequency a polynomial or a rational function explains the lines of the Fourier
transform (``local_models``). A periodic input has power on lines far apart: its response is the
ratio of the mean periods on these lines, and the spread among periods, or realisations of the
phases, is the band (Pintelon & Schoukens 2012, ch. 3 and 4).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri, stdtrit

from sysid.data.frequency_response import FrequencyResponse
from sysid.data.record import Array, Record
from sysid.errors import DataError
from sysid.estimation.assessment.spectra import centred, spectra
from sysid.estimation.look.distortion import periods_of
from sysid.estimation.look.local_models import Complex, LocalModel, half_width, local_model

LINES = 150
"""Frequencies at most, evenly spread over their logarithm."""

TRUSTED = 0.3
"""A response whose standard error is below this share of it can be trusted."""

BETTER = 0.8
"""A rational function is taken where its squared errors at lines left out are below this share of a
polynomial's: where both serve, the simpler one has the narrower choice."""

SQRT2 = np.sqrt(2.0)


@dataclass(frozen=True, eq=False)
class FrequencyEstimate:
    """Responses of all outputs to all inputs.

    Attributes:
        w: angular frequencies [rad/s], (n,).
        value: (n, ny, nu).
        error: standard error of its complex value, √E|Ĝ − G|², (n, ny, nu).
        noise: power spectral density of what the inputs do not explain, (n, ny).
        coherence: share of each output's power that they explain, (n, ny).
        freedom: complex degrees of freedom that the error was estimated with, (n,).
        method: in words.
    """

    w: Array
    value: Complex
    error: Array
    noise: Array
    coherence: Array
    freedom: Array
    method: str

    @property
    def band(self) -> Array:
        """Half-width of the 95 % interval of the gain: Student's t over √2 errors, (n, ny, nu)."""
        return np.asarray(stdtrit(2.0 * self.freedom, 0.975)[:, None, None] * self.error / SQRT2)

    @property
    def radius(self) -> Array:
        """Of the 95 % circle in the complex plane: |Ĝ − G|²/σ̂² is F of 2 and 2·freedom."""
        return np.asarray(np.sqrt(fdtri(2.0, 2.0 * self.freedom, 0.95))[:, None, None] * self.error)

    def as_data(self, record: Record) -> FrequencyResponse:
        """What another program or a fit takes: the frequencies at which all paths have an error."""
        known = np.all(np.isfinite(self.error), axis=(1, 2))
        if not known.any():
            raise DataError(f"{record.name}: no frequency has power of every input")
        return FrequencyResponse(
            self.w[known] / (2.0 * np.pi),
            self.value[known],
            self.error[known] ** 2,
            record.inputs,
            record.outputs,
            record.dt,
            self.coherence[known],
            record.name,
        )

    def trusted_up_to(self, i: int, j: int) -> float:
        """Highest frequency [rad/s] below which most of the response has a narrow band; 0: none."""
        good = self.error[:, i, j] < TRUSTED * np.abs(self.value[:, i, j])
        share = np.cumsum(good) / np.arange(1, len(good) + 1)
        kept = np.flatnonzero(good & (share > 0.8))
        return float(self.w[kept[-1]]) if len(kept) else 0.0


def frequency_response(records: Sequence[Record]) -> FrequencyEstimate:
    """By periods where one input repeats itself in all records, else by local models.

    Raises:
        DataError: the records are too short.
    """
    return periodic(records) or local_models(records)


def periodic(records: Sequence[Record]) -> FrequencyEstimate | None:
    """The best linear response on the lines that a periodic input excites.

    Ĝ is the mean over realisations of Y/U of the mean periods. Its variance is that among
    realisations, which holds noise and stochastic nonlinear distortion; with a single one that of
    the noise, among its periods.

    Returns:
        None where the input is not periodic, or there are several.
    """
    every = [periods_of(r) for r in records]
    found = [p for p in every if p is not None]
    if records[0].nu != 1 or len(found) < len(every) or len({p.length for p in found}) > 1:
        return None
    lines = np.flatnonzero(np.all([p.excited for p in found], axis=0))
    if not len(lines):
        return None
    P, dt = found[0].length, records[0].dt
    ratios = np.array([p.Y[lines] / p.U[lines] for p in found])
    noise = np.mean([p.noise[lines] * p.count for p in found], axis=0)
    value = ratios.mean(axis=0)
    freedom = len(found) - 1 or found[0].count - 1
    if len(found) > 1:
        squares = np.sum(np.abs(ratios - value) ** 2, axis=0) / (len(found) * freedom)
    else:
        squares = found[0].noise[lines] / np.abs(found[0].U[lines]) ** 2
    power = np.mean([np.abs(p.Y[lines]) ** 2 for p in found], axis=0) + noise
    error: Array = np.sqrt(squares)[:, :, None]
    return FrequencyEstimate(
        np.asarray(2.0 * np.pi * lines / (P * dt), dtype=np.float64),
        value[:, :, None],
        error,
        np.asarray(2.0 * noise * P * dt),
        np.clip(1.0 - noise / np.maximum(power, 1e-300), 0.0, 1.0),
        np.full(len(lines), float(freedom)),
        f"mean of {sum(p.count for p in found)} periods"
        + (f", {len(found)} realisations" if len(found) > 1 else ""),
    )


def local_models(records: Sequence[Record], rational: bool = True) -> FrequencyEstimate:
    """Responses by local polynomials, or rational functions where these predict lines better.

    Of each frequency that of both is taken which errs less at lines that were left out of its fit;
    records share the choice and the variance of the noise. At frequencies where the inputs do not
    tell the paths apart the error is infinite.

    Args:
        rational: whether rational functions are tried.
    """
    nu = records[0].nu
    half = half_width(nu, rational=False)
    longest = max(records, key=len)
    if len(longest) // 2 <= 2 * half + 1:
        raise DataError(
            f"{longest.name}: {len(longest)} samples are too few for a frequency response; at "
            f"least {4 * half + 4} are needed"
        )
    lines = np.unique(np.geomspace(1, len(longest) // 2 - 1, LINES).round())
    w = 2.0 * np.pi * lines / (len(longest) * longest.dt)
    found, unseen = _joined(records, w, rational=False)
    if not rational:
        return found
    if len(longest) // 2 > 2 * half_width(nu, rational=True) + 1:
        other, of_other = _joined(records, w, rational=True)
        with np.errstate(divide="ignore", invalid="ignore"):  # all outputs together
            taken = np.log(of_other / unseen).mean(axis=1) < np.log(BETTER)
        found = _where(taken, other, found)
    return replace(found, method="local models")


def _where(taken: NDArray[np.bool_], one: FrequencyEstimate, other: FrequencyEstimate) -> Any:
    """By frequency the one estimate or the other."""
    chosen = {}
    for name in ("value", "error", "noise", "coherence", "freedom"):
        first, second = getattr(one, name), getattr(other, name)
        chosen[name] = np.where(taken.reshape(-1, *[1] * (first.ndim - 1)), first, second)
    return replace(other, **chosen)


def _joined(records: Sequence[Record], w: Array, rational: bool) -> tuple[FrequencyEstimate, Array]:
    """Local models of all records, and the mean square of errors at lines left out, (n, ny)."""
    half, dt = half_width(records[0].nu, rational), records[0].dt
    every = [_of_record(r, half, w, rational) for r in records if len(r) // 2 > 2 * half + 1]

    def stacked(name: str) -> Any:
        """By record and frequency."""
        return np.array([[getattr(model, name) for model in models] for models in every])

    freedom, lines = stacked("freedom").sum(axis=0), stacked("lines").sum(axis=0)
    variance = stacked("left").sum(axis=0) / freedom[:, None]
    power = np.maximum(stacked("power").mean(axis=0), 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = 1.0 / stacked("spread")  # 0 where a record says nothing
        total = weights.sum(axis=0)
        mean = np.where(total > 0.0, np.sum(stacked("value") * weights, axis=0) / total, 0.0)
        error = np.sqrt(variance[:, :, None] / total)
    coherence = np.clip(1.0 - variance / power, 0.0, 1.0)
    unseen = stacked("unseen").sum(axis=0) / lines[:, None]
    words = "local polynomials"
    return FrequencyEstimate(w, mean, error, 2.0 * variance * dt, coherence, freedom, words), unseen


def _of_record(r: Record, half: int, w: Array, rational: bool) -> list[LocalModel]:
    """The model at each frequency."""
    nu, samples = r.nu, len(r)
    F = np.fft.rfft(centred(r), axis=0) / np.sqrt(samples)
    count, found = len(F), []
    for centre in w * samples * r.dt / (2.0 * np.pi):
        low = int(np.clip(round(float(centre)) - half, 1, max(count - 2 * half - 1, 1)))
        at = np.arange(low, min(low + 2 * half + 1, count))
        found.append(local_model(F[at, :nu], F[at, nu:], (at - centre) / half, rational))
    return found


def welch(records: Sequence[Record]) -> FrequencyEstimate:
    """Responses by averaged windows (``assessment.spectra``)."""
    s = spectra(records)
    error = np.abs(s.response) * np.sqrt(2.0) * s.gain_error[:, :, None]
    noise = s.outputs * (1.0 - s.coherence)
    freedom = np.full(len(s.w), max(float(s.windows - records[0].nu), 1.0))
    return FrequencyEstimate(s.w, s.response, error, noise, s.coherence, freedom, "Welch")


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
        z = centred(r)
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
    inverse = np.linalg.pinv(uu, rcond=1e-9, hermitian=True)
    value = yu @ inverse
    power = np.einsum("faa->fa", S).real[:, nu:]
    explained = np.einsum("fij,fij->fi", value, yu.conj()).real
    coherence = np.clip(explained / np.maximum(power, 1e-300), 0.0, 1.0)
    noise = np.maximum(power, 0.0) * (1.0 - coherence)
    # variance of a smoothed spectrum: Σ window² / N of the periodogram's (Ljung 1999, 6.74)
    share = float(np.sum(window**2)) / samples
    spread = np.einsum("faa->fa", inverse).real
    error = np.sqrt(np.maximum(share * noise[:, :, None] * spread[:, None, :], 0.0))
    free = np.full(len(w), max(1.0 / share - nu, 1.0))
    return FrequencyEstimate(w, value, error, 2.0 * noise, coherence, free, "Blackman–Tukey")
