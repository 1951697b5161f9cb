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

EXCITED = 1e-3
"""A line is excited from this share of the strongest one's amplitude on."""


@dataclass(frozen=True, eq=False)
class Distortions:
    """What one output shows, levels in dB of its excited lines' power.

    Attributes:
        period: samples.
        periods: whole periods after the first, by record.
        noise: power of the noise of the mean period.
        even, odd: power on lines that are not excited, less the noise; NaN where there are none.
        nonlinear: variance of the response among realisations beyond the noise; NaN with one.
        lines: of the mean output's spectrum: frequency [Hz], amplitude, kind (0 excited, 1 odd,
            2 even), noise, (n, 4).
    """

    period: int
    periods: tuple[int, ...]
    noise: float
    even: float
    odd: float
    nonlinear: float
    lines: Array


def period_of(record: Record) -> int | None:
    """The shortest period of all inputs [samples], at least two of which are in the record."""
    u = record.u - record.u.mean(axis=0)
    size = float(np.max(np.abs(u), initial=0.0))
    if not size or not np.all(np.isfinite(u)):
        return None
    n = len(u)
    F = np.fft.rfft(u, 2 * n, axis=0)
    R = np.fft.irfft(np.abs(F) ** 2, axis=0)[:n].sum(axis=1)
    overlap = np.arange(n, 0, -1)
    alike = R / R[0] * n / overlap
    for P in np.flatnonzero(alike[: n // 2 + 1] > 0.98)[1:]:
        if P >= 8 and np.max(np.abs(u[P:] - u[:-P])) < SAME * size:
            return int(P)
    return None


def distortions(records: Sequence[Record], output: int) -> Distortions | None:
    """Distortions of one output; None where inputs are not periodic or periods too few."""
    found = [(r, period_of(r)) for r in records]
    P = found[0][1]
    if P is None or any(p != P for _, p in found):
        return None
    means, noises, inputs, counts = [], [], [], []
    for r, _ in found:
        whole = len(r) // P
        first = 1 if whole > 2 else 0  # the first period holds the transient
        y = r.y[first * P : whole * P, output].reshape(-1, P)
        if len(y) < 2:
            return None
        Y = np.fft.rfft(y, axis=1) / P
        means.append(Y.mean(axis=0))
        noises.append(_variance(Y))
        inputs.append(np.fft.rfft(r.u[:P], axis=0) / P)
        counts.append(len(y))
    size = np.max(np.abs(inputs), axis=(0, 2))
    size[0] = 0.0
    excited = size > EXCITED * size.max()
    line = np.arange(len(size))
    power = np.mean([np.abs(m) ** 2 for m in means], axis=0)
    noise = np.mean(noises, axis=0)
    whole_power = float(power[excited].sum())
    top = int(np.flatnonzero(excited)[-1])
    inside = (line > 0) & (line <= 2 * top) & ~excited
    every = int(excited.sum())

    def level(rows: NDArray[np.bool_]) -> float:
        if not rows.any():
            return float("nan")
        extra = max(float(np.mean(power[rows] - noise[rows])), 1e-12 * whole_power / every)
        return float(10.0 * np.log10(extra * every / whole_power))

    kinds = np.where(excited, 0, np.where(line % 2 == 1, 1, 2))
    frequency = line / (P * records[0].dt)
    shown = (line > 0) & (line <= 2 * top)
    table = np.column_stack([frequency, np.sqrt(power), kinds, np.sqrt(noise)])[shown]
    return Distortions(
        P,
        tuple(counts),
        float(10.0 * np.log10(max(float(noise[excited].sum()), 1e-300) / whole_power)),
        level(inside & (line % 2 == 0)),
        level(inside & (line % 2 == 1)),
        _among(means, inputs, noise, excited, whole_power),
        table,
    )


def _variance(Y: Complex) -> Array:
    """Variance of the mean of some periods, line by line."""
    n = len(Y)
    return np.asarray(np.sum(np.abs(Y - Y.mean(axis=0)) ** 2, axis=0) / (n * (n - 1)))


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
