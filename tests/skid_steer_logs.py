"""Logs of a skid-steer vehicle that is integrated in steps of a millisecond, written as CSV."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.data.record import Array

FINE = 0.001
"""Step of the integration [s]: fifty in a row of the log."""


@dataclass(frozen=True)
class Skid:
    """A vehicle and what reads its pose; every number in SI units.

    Attributes:
        radii: left and right, as they carry the vehicle.
        width: between the centres of rotation of both sides.
        marker: of the point whose pose is read, ahead and to the left.
        offset: of the heading that is read.
        lag, heading_lag: by which position and heading come late.
        slip_turning: slip in a turn on the spot.
        slip_load: lag of the speed behind the wheels.
        noise: of x and y, and of ψ.
    """

    radii: tuple[float, float] = (0.15, 0.15)
    width: float = 0.9
    marker: tuple[float, float] = (0.0, 0.0)
    offset: float = 0.0
    lag: float = 0.0
    heading_lag: float = 0.0
    slip_turning: float = 0.0
    slip_load: float = 0.0
    noise: tuple[float, float] = (0.005, 0.004)


def wheels(seconds: float, seed: int = 1, straight: bool = False) -> Array:
    """Wheel speeds that change smoothly to new levels every second or two, (N, 2) [rad/s]."""
    rng = np.random.default_rng(seed)
    times, levels = [0.0], [np.zeros(2)]
    while times[-1] < seconds:
        level = rng.uniform(-6.0, 8.0, 2)
        levels += [np.full(2, level[0]) if straight else level] * 2
        start = times[-1] + 0.3
        times += [start, start + rng.uniform(0.5, 1.5)]
    t = np.arange(round(seconds / FINE)) * FINE
    return np.column_stack([np.interp(t, times, [v[k] for v in levels]) for k in (0, 1)])


def true_pose(skid: Skid, omega: Array) -> Array:
    """x, y, ψ of the body at every millisecond, (N, 3)."""
    left, right = omega[:, 0] * skid.radii[0], omega[:, 1] * skid.radii[1]
    turning = np.abs(omega[:, 1] - omega[:, 0]) / np.maximum(np.abs(omega).sum(axis=1), 1e-9)
    kept = 1.0 - skid.slip_turning * turning
    forward, yaw_rate = 0.5 * (left + right) * kept, (right - left) * kept / skid.width
    if skid.slip_load:
        keep, speed = np.exp(-FINE / skid.slip_load), 0.0
        for k, wanted in enumerate(forward):
            speed = keep * speed + (1.0 - keep) * wanted
            forward[k] = speed
    psi = np.cumsum(yaw_rate) * FINE
    return np.column_stack(
        [np.cumsum(forward * np.cos(psi)) * FINE, np.cumsum(forward * np.sin(psi)) * FINE, psi]
    )


def columns(skid: Skid, omega: Array, dt: float = 0.05, seed: int = 1) -> dict[str, Array]:
    """What a log of the drive holds, by name, at every ``dt``."""
    rng = np.random.default_rng(seed)
    body = true_pose(skid, omega)
    t = np.arange(len(omega)) * FINE
    rows = np.arange(round(1.0 / FINE), len(omega), round(dt / FINE))  # the first second is past
    at = t[rows]
    x, y, psi = (np.interp(at - skid.lag, t, body[:, k]) for k in range(3))
    c, s = np.cos(psi), np.sin(psi)
    ahead, left = skid.marker
    place = skid.noise[0] * rng.normal(size=(len(rows), 2))
    heading = np.interp(at - skid.heading_lag, t, body[:, 2]) + skid.offset
    return {
        "t": at - at[0],
        "omega_l": omega[rows, 0],
        "omega_r": omega[rows, 1],
        "x": x + c * ahead - s * left + place[:, 0],
        "y": y + s * ahead + c * left + place[:, 1],
        "psi": heading + skid.noise[1] * rng.normal(size=len(rows)),
    }


def written(path: Path, named: Mapping[str, Array]) -> Path:
    """The columns as a CSV file."""
    rows = zip(*named.values(), strict=True)
    text = [",".join(named), *(",".join(f"{v:.9g}" for v in row) for row in rows)]
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return path
