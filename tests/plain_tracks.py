"""Logs of two tracks of first order with nothing missing, under noise of any colour."""

import numpy as np
from scipy.signal import lfilter
from sysid_datasets.driving import STYLES

from sysid.data.record import Array, Channel, Record

DT, FULL, SIGMA = 0.05, 20000.0, 0.2
SCALES = np.array([FULL, FULL])
GAIN, POLE = np.array([20.0, 21.5]), np.array([0.8, 0.78])
CHANNELS = {
    "inputs": (Channel("pwm_l", "µs"), Channel("pwm_r", "µs")),
    "outputs": (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
}


def noise(rng: np.random.Generator, kind: str, n: int) -> Array:
    """White or AR(1) readings' noise, or the speed that a wandering load adds to white noise."""
    white = SIGMA * rng.standard_normal((n, 2))
    if kind == "ar":
        return np.asarray(lfilter([np.sqrt(1 - 0.81)], [1.0, -0.9], white, axis=0))
    if kind == "walk":
        load = 5 * SIGMA / np.sqrt(n) * np.cumsum(rng.standard_normal((n, 2)), axis=0)
        return white + np.asarray(lfilter([0.2], [1.0, -0.8], load, axis=0))
    return white


def simulate(drive: Array) -> Array:
    """First-order tracks."""
    columns = [
        lfilter([0.0, k * (1 - a)], [1.0, -a], d)
        for k, a, d in zip(GAIN, POLE, drive.T, strict=True)
    ]
    return np.column_stack(columns)


def logged(style: str, seed: int, kind: str, n: int = 1200) -> tuple[Record, Array]:
    """(record of a plain robot, its noise-free readings)."""
    rng = np.random.default_rng([seed, 7])
    u = STYLES[style](rng, n, DT).astype(np.float64)
    clean = simulate(u / FULL)
    return Record(u=u, y=clean + noise(rng, kind, n), dt=DT, **CHANNELS), clean
