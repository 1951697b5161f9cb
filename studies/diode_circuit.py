"""A Wiener–Hammerstein circuit to practise on: filter, diode-like saturation, filter.

Stand-in for the circuit of the Wiener–Hammerstein benchmark (Schoukens, Suykens & Ljung 2009): a
Chebyshev low-pass of third order (0.5 dB ripple, 4.4 kHz), a one-sided saturation by a diode and
resistors, an inverse Chebyshev low-pass of third order (40 dB, 5 kHz) whose stop-band zeros lie in
the band of the input. All of it in continuous time: simulated at ten times the sample rate.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, cheby1, cheby2, sosfilt

from sysid.data.record import Array, Channel, Record

SAMPLE_RATE = 51_200.0
OVERSAMPLING = 10
NOISE = 0.2e-3
"""Standard deviation of the measurement noise [V]."""

RISE = 0.7
"""Voltage from which the diode conducts [V]."""


@dataclass(frozen=True, eq=False)
class Circuit:
    """A measured record and the noise-free output."""

    record: Record
    truth: Array


def diode(v: Array, width: float = 0.06) -> Array:
    """One-sided saturation: slope 1 far below ``RISE``, 0.2 far above it, bent over ``width``."""
    return v - 0.8 * width * np.logaddexp(0.0, (v - RISE) / width)


def simulated(
    samples: int = 100_000, seed: int = 1, noise: float = NOISE, width: float = 0.06
) -> Circuit:
    """Response of the circuit to Gaussian noise of 10 kHz bandwidth, after it has settled."""
    rng = np.random.default_rng(seed)
    fast = SAMPLE_RATE * OVERSAMPLING
    settle = 500
    n = (samples + settle) * OVERSAMPLING
    u = sosfilt(butter(6, 10_000.0, fs=fast, output="sos"), rng.normal(size=n))
    u *= 0.64 / u.std()
    v = sosfilt(cheby1(3, 0.5, 4_400.0, fs=fast, output="sos"), u)
    y = sosfilt(cheby2(3, 40.0, 5_000.0, fs=fast, output="sos"), diode(v, width))
    u, y = u[::OVERSAMPLING][settle:], y[::OVERSAMPLING][settle:]
    measured = y + noise * rng.normal(size=len(y))
    record = Record(
        u,
        measured,
        1.0 / SAMPLE_RATE,
        (Channel("u", "V"),),
        (Channel("y", "V"),),
        name="diode circuit",
    )
    return Circuit(record, y[:, None])
