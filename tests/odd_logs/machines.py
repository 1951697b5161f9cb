"""Machines with known constants, and the signals that drive them: what the odd logs are made of.

Everything is simulated exactly between samples (zero-order hold), so that the truth is the truth.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

Array = NDArray[np.float64]


def levels(rng: np.random.Generator, samples: int, values: Sequence[float], hold: int) -> Array:
    """Random levels, each held for ``hold`` samples."""
    drawn = rng.choice(np.asarray(values, dtype=np.float64), samples // hold + 1)
    return np.repeat(drawn, hold)[:samples]


def lag(
    u: Array, dt: float, gain: float, times: Sequence[float], delay: int = 0, start: float = 0.0
) -> Array:
    """y = K/∏(Tᵢs + 1) u, ``delay`` samples late, from rest at ``start``; y[k] is read at u[k]."""
    bottom = np.ones(1)
    for t in times:
        bottom = np.polymul(bottom, [t, 1.0])
    top, den, _ = cont2discrete(([gain], bottom), dt, method="zoh")
    late = np.concatenate([np.full(delay, start), u])[: len(u)]
    return gain * start + lfilter(np.ravel(top), den, late - start)


def integrate(u: Array, dt: float, gain: float, time: float) -> Array:
    """Position of a motor: K/(s (T s + 1)) u from rest."""
    top, den, _ = cont2discrete(([gain], [time, 1.0, 0.0]), dt, method="zoh")
    return lfilter(np.ravel(top), den, u)


def dead_zone(u: Array, low: float, high: float) -> Array:
    """What is left of a command behind a dead zone."""
    return np.where(u > high, u - high, np.where(u < low, u - low, 0.0))


def closed_loop(
    reference: Array,
    dt: float,
    gain: float,
    time: float,
    controller: tuple[float, float],
    rng: np.random.Generator,
    noise: float,
) -> tuple[Array, Array]:
    """(u, y) of a first-order plant with process noise under a PI law that answers in the row.

    The controller reads y[k] and writes u[k] at once, as a loop on a microcontroller does.
    """
    pole = float(np.exp(-dt / time))
    proportional, integral = controller
    u, y = np.zeros_like(reference), np.zeros_like(reference)
    state = total = 0.0
    for k, wanted in enumerate(reference):
        y[k] = state
        error = wanted - y[k]
        total += error * dt
        u[k] = proportional * error + integral * total
        state = pole * state + gain * (1.0 - pole) * u[k] + noise * rng.standard_normal()
    return u, y


def robot(
    rng: np.random.Generator, samples: int, dt: float, radius: float, width: float, hold: int = 20
) -> dict[str, Array]:
    """Two first-order tracks (10 and 9 rad/s at full drive, 0.25 s) and the pose they drive."""
    drive = np.column_stack([levels(rng, samples, (-0.6, -0.3, 0.0, 0.4, 0.8), hold) for _ in "lr"])
    omega = np.column_stack(
        [lag(d, dt, k, (0.25,)) for d, k in zip(drive.T, (10.0, 9.0), strict=True)]
    )
    v = radius / 2.0 * omega.sum(axis=1)
    turn = radius / width * (omega[:, 1] - omega[:, 0])
    psi = np.concatenate([[0.0], np.cumsum(turn[:-1] * dt)])
    x = np.concatenate([[0.0], np.cumsum((v * np.cos(psi))[:-1] * dt)])
    y = np.concatenate([[0.0], np.cumsum((v * np.sin(psi))[:-1] * dt)])
    omega = omega + 0.02 * rng.standard_normal(omega.shape)
    return {
        "drive_l": drive[:, 0],
        "drive_r": drive[:, 1],
        "omega_l": omega[:, 0],
        "omega_r": omega[:, 1],
        "x": x,
        "y": y,
        "psi": psi,
    }
