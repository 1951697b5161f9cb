"""How linear is it? Noise, even and odd distortions, and the best linear response.

A multisine of period P excites some lines of the Fourier transform. Over whole periods noise is
what differs from period to period; a nonlinearity puts power on lines that are not excited: an even
one (x²) on even lines, an odd one (x³) on odd lines. With several realisations of the phases the
mean response is the best linear approximation, and what varies beyond the noise is the stochastic
nonlinear distortion (Pintelon & Schoukens 2012, ch. 3 and 4).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record

Complex = NDArray[np.complex128]

SAME = 1e-6
"""Largest relative difference of an input to itself a period later."""

SEEN = 3.0
"""Standard errors of the noise's power that a distortion must exceed."""

SHORTEST = 8
"""Samples of a period at least."""

EXCITED = 1e-3
"""A line is excited from this share of the strongest one's amplitude on."""


@dataclass(frozen=True, eq=False)
class Distortions:
    """What one output shows, levels in dB of its excited lines' power.

    Attributes:
        period: samples.
        periods: whole periods after the first, by record.
        noise: power of the noise of the mean period.
        even, odd: power on lines that are not excited, less the noise; what it is below of where
            it is not seen; NaN where there are no such lines.
        even_seen, odd_seen: whether it is beyond the noise.
        nonlinear: variance of the response among realisations beyond the noise; NaN with one.
        lines: of the mean output's spectrum: frequency [Hz], amplitude, kind (0 excited, 1 odd,
            2 even), noise, (n, 4).
    """

    period: int
    periods: tuple[int, ...]
    noise: float
    even: float
    odd: float
    even_seen: bool
    odd_seen: bool
    nonlinear: float
    lines: Array


@dataclass(frozen=True, eq=False)
class Periods:
    """Means of whole periods of one record, as coefficients of the Fourier transform over P.

    Attributes:
        length: P [samples].
        count: periods behind the means.
        U, Y: (P//2 + 1, nu) and (P//2 + 1, ny).
        noise: variance of Y, of the mean, (P//2 + 1, ny).
    """

    length: int
    count: int
    U: Complex
    Y: Complex
    noise: Array

    @property
    def excited(self) -> NDArray[np.bool_]:
        """Lines on which an input has power."""
        size = np.max(np.abs(self.U), axis=1)
        size[0] = 0.0
        return np.asarray(size > EXCITED * size.max())


def periods_of(record: Record) -> Periods | None:
    """The periods of a record without rests at its ends; None without two after the transient."""
    found = _periodic_rows(record)
    if found is None:
        return None
    P, first, stop = found
    whole = (stop - first) // P
    if whole > 2:  # the first period holds the transient
        first, whole = first + P, whole - 1
    rows = slice(first, first + whole * P)
    y = record.y[rows].reshape(whole, P, record.ny)
    if not np.all(np.isfinite(y)):
        return None
    Y = np.fft.rfft(y, axis=1) / P
    mean = Y.mean(axis=0)
    noise = np.sum(np.abs(Y - mean) ** 2, axis=0) / (whole * (whole - 1))
    return Periods(P, whole, np.fft.rfft(record.u[first : first + P], axis=0) / P, mean, noise)


def _periodic_rows(record: Record) -> tuple[int, int, int] | None:
    """Period, first and one past the last row of the inputs' motion between rests at its ends."""
    moves = np.flatnonzero(np.any(record.u[1:] != record.u[:-1], axis=1))
    if not len(moves) or not np.all(np.isfinite(record.u)):
        return None
    first, stop = int(moves[0]), int(moves[-1]) + 2
    first += int(first > 0)  # a rest's last row is no part of the motion
    stop -= int(stop < len(record))
    u = record.u[first:stop] - record.u[first:stop].mean(axis=0)
    size, n = float(np.max(np.abs(u), initial=0.0)), len(u)
    F = np.fft.rfft(u, 2 * n, axis=0)
    R = np.fft.irfft(np.abs(F) ** 2, axis=0)[:n].sum(axis=1)
    alike = R / R[0] * n / np.arange(n, 0, -1)
    for P in np.flatnonzero(alike[: n // 2 + 1] > 0.98)[1:].tolist():
        if P >= SHORTEST and np.max(np.abs(u[P:] - u[:-P])) < SAME * size:
            return P, first, stop
    return None


def distortions(records: Sequence[Record], output: int) -> Distortions | None:
    """Distortions of one output; None where inputs are not periodic or periods too few."""
    found = [p for r in records if (p := periods_of(r)) is not None]
    if len(found) < len(records) or len({p.length for p in found}) > 1:
        return None
    P = found[0].length
    means = [p.Y[:, output] for p in found]
    inputs = [p.U for p in found]
    excited = np.any([p.excited for p in found], axis=0)
    line = np.arange(len(excited))
    power = np.mean([np.abs(m) ** 2 for m in means], axis=0)
    noise = np.mean([p.noise[:, output] for p in found], axis=0)
    whole_power = float(power[excited].sum())
    top = int(np.flatnonzero(excited)[-1])
    inside = (line > 0) & (line <= 2 * top) & ~excited
    every = int(excited.sum())

    free = sum(p.count - 1 for p in found)

    def level(rows: NDArray[np.bool_]) -> tuple[float, bool]:
        if not rows.any():
            return float("nan"), False
        mean = float(np.mean(noise[rows]))
        extra = float(np.mean(power[rows])) - mean
        least = SEEN * mean * float(np.sqrt((1.0 / len(found) + 1.0 / free) / rows.sum()))
        size = max(extra, least, 1e-14 * whole_power / every)
        return float(10.0 * np.log10(size * every / whole_power)), extra > least

    even, odd = level(inside & (line % 2 == 0)), level(inside & (line % 2 == 1))
    kinds = np.where(excited, 0, np.where(line % 2 == 1, 1, 2))
    frequency = line / (P * records[0].dt)
    shown = (line > 0) & (line <= 2 * top)
    table = np.column_stack([frequency, np.sqrt(power), kinds, np.sqrt(noise)])[shown]
    return Distortions(
        P,
        tuple(p.count for p in found),
        float(10.0 * np.log10(max(float(noise[excited].sum()), 1e-300) / whole_power)),
        even[0],
        odd[0],
        even[1],
        odd[1],
        _among(means, inputs, noise, excited, whole_power),
        table,
    )


def _among(
    means: Sequence[Complex],
    inputs: Sequence[Complex],
    noise: Array,
    excited: NDArray[np.bool_],
    whole: float,
) -> float:
    """Variance of the output among realisations beyond the noise, at the same input, in dB."""
    if len(means) < 2 or inputs[0].shape[1] != 1:
        return float("nan")
    G = np.array([m[excited] / u[excited, 0] for m, u in zip(means, inputs, strict=True)])
    size = np.mean([np.abs(u[excited, 0]) ** 2 for u in inputs], axis=0)
    spread = np.sum(np.abs(G - G.mean(axis=0)) ** 2, axis=0) / (len(G) - 1) * size
    extra = max(float(np.sum(spread - noise[excited])), 1e-12 * whole)
    return float(10.0 * np.log10(extra / whole))
