"""A skid-steer vehicle as a rigid body on four wheels with dry friction, for logs to fit to.

Nothing of it stands in the product: each wheel slides over the ground with a velocity s and is held
back by −μN s/√(|s|² + v₀²); width, slip and lags are what comes out of that.
"""

import math
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Channel, Record

FINE = 0.001
"""Step of the integration [s]."""

G = 9.81


@dataclass(frozen=True)
class Vehicle:
    """A vehicle and the ground under it; SI units.

    Attributes:
        mass, inertia: of the body, about its vertical.
        half_length, half_width: where the wheels stand from the centre of mass.
        radius: of the wheels.
        friction: μ of the ground.
        soft: velocity v₀ below which wheels hardly slide.
        fastest: wheel speed of full drive.
        lag: by which wheels follow their commands.
        late: by which the pose comes late.
        marker: where its point lies, ahead and to the left.
    """

    mass: float = 590.0
    inertia: float = 400.0
    half_length: float = 0.37
    half_width: float = 0.54
    radius: float = 0.3
    friction: float = 0.6
    soft: float = 0.3
    fastest: float = 8.0
    lag: float = 0.3
    late: float = 0.3
    marker: tuple[float, float] = (0.2, 0.0)


def commands(seconds: float, fastest: float, seed: int) -> Array:
    """Wheel speeds that jump to new levels every few seconds, (N, 2) [rad/s]."""
    rng = np.random.default_rng(seed)
    n = round(seconds / FINE)
    out, k = np.zeros((n, 2)), 0
    while k < n:
        length = int(rng.uniform(1.5, 5.0) / FINE)
        forward, turn = rng.uniform(-0.4, 1.0) * fastest, rng.uniform(-0.6, 0.6) * fastest
        out[k : k + length] = [forward - turn, forward + turn]
        k += length
    return out


def driven(v: Vehicle, wanted: Array) -> Array:
    """ω left and right, x, y, ψ at every step, (N, 5)."""
    load = v.mass * G / 4.0
    wheels = [
        (a, b, 0 if b > 0 else 1)
        for a in (v.half_length, -v.half_length)
        for b in (v.half_width, -v.half_width)
    ]
    omega, x, y, psi, vx, vy, rate = [0.0, 0.0], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    out = np.zeros((len(wanted), 5))
    for i, row in enumerate(wanted.tolist()):
        for k in (0, 1):
            omega[k] += (row[k] - omega[k]) * FINE / v.lag
        fx = -0.02 * v.mass * G * math.tanh(vx / 0.05)
        fy = moment = 0.0
        for a, b, k in wheels:
            sx, sy = vx - rate * b - v.radius * omega[k], vy + rate * a
            q = v.friction * load / math.sqrt(sx * sx + sy * sy + v.soft * v.soft)
            fx, fy, moment = fx - q * sx, fy - q * sy, moment - a * q * sy + b * q * sx
        ax, ay = fx / v.mass + rate * vy, fy / v.mass - rate * vx
        c, s = math.cos(psi), math.sin(psi)
        x, y = x + FINE * (c * vx - s * vy), y + FINE * (s * vx + c * vy)
        psi, vx, vy = psi + FINE * rate, vx + FINE * ax, vy + FINE * ay
        rate += FINE * moment / v.inertia
        out[i] = (*omega, x, y, psi)
    return out


def log_of(v: Vehicle, name: str, seconds: float = 150.0, seed: int = 1) -> Record:
    """A log in rows of 50 ms whose lidar pose comes every fifth row, late and with noise."""
    rng = np.random.default_rng(seed)
    wanted = commands(seconds, v.fastest, seed)
    body = driven(v, wanted)
    rows = np.arange(round(1.0 / FINE), len(body), round(0.05 / FINE))
    x, y, psi = body[rows - round(v.late / FINE), 2:].T
    ahead, left = v.marker
    pose = np.column_stack(
        [
            x + np.cos(psi) * ahead - np.sin(psi) * left + 0.02 * rng.normal(size=len(rows)),
            y + np.sin(psi) * ahead + np.cos(psi) * left + 0.02 * rng.normal(size=len(rows)),
            psi + 0.01 * rng.normal(size=len(rows)),
        ]
    )
    held = np.arange(len(rows)) - np.arange(len(rows)) % 5
    return Record(
        wanted[rows],
        body[rows, :2],
        0.05,
        (Channel("u_l", "rad/s"), Channel("u_r", "rad/s")),
        (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
        pose[held],
        name=name,
    )
