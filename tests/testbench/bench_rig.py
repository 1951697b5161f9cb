"""A motor on the bench by its physics: circuit and mechanics by Runge-Kutta 4, an encoder."""

import math
from pathlib import Path

import numpy as np

from sysid.testbench.motor.equations import MotorConstants

Array = np.ndarray

TRUE = MotorConstants(R=2.4, Kem=0.004, Kc=0.004, f=2e-7, C0=8e-5, J=1.5e-7, L=4e-3, gear=60.0)
"""No motor of the thesis; without losses in its field, Kc = Kem."""

STEP = 1e-4
"""Integration step [s]: a sixteenth of L/R, whose Runge-Kutta error is 1e-6."""


def run(c: MotorConstants, voltage: Array, h: float = STEP) -> Array:
    """Current, motor speed and motor angle before each step with its voltage, (N, 3)."""
    out = np.zeros((len(voltage), 3))
    i = w = angle = 0.0
    for k, v in enumerate(voltage.tolist()):
        out[k] = i, w, angle
        sense = (w > 0.0) - (w < 0.0) or (c.Kc * i > c.C0) - (c.Kc * i < -c.C0)

        def rates(i: float, w: float, v: float = v, s: int = sense) -> tuple[float, float]:
            torque = (c.Kc * i - c.f * w - c.C0 * s) / c.J if s else 0.0
            return (v - c.R * i - c.Kem * w) / c.L, torque

        a = rates(i, w)
        b = rates(i + h / 2 * a[0], w + h / 2 * a[1])
        d = rates(i + h / 2 * b[0], w + h / 2 * b[1])
        e = rates(i + h * d[0], w + h * d[1])
        after = w + h / 6 * (a[1] + 2 * b[1] + 2 * d[1] + e[1])
        i += h / 6 * (a[0] + 2 * b[0] + 2 * d[0] + e[0])
        if w and after * w < 0.0:  # it stops inside the step; what torque is left acts on the rest
            net = math.copysign(max(abs(c.Kc * i) - c.C0, 0.0), i)
            after = h * after / (after - w) * net / c.J
        angle += h / 2 * (w + after)
        w = after
    return out


def staircase(seconds: float, hold: float, seed: int, lowest: float = -6.0) -> Array:
    """Random levels up to 6 V, each held so long [s], from standstill; one value a step."""
    rng = np.random.default_rng(seed)
    steps = round(hold / STEP)
    levels = np.round(rng.uniform(lowest, 6.0, round(seconds / hold)), 1)
    levels[0] = 0.0
    return np.repeat(levels, steps)


def drive_log(
    path: Path, c: MotorConstants, voltage: Array, dt: float, ticks: int = 0, seed: int = 0
) -> Path:
    """A log of a drive: quantised current with noise, and a speed with noise or encoder ticks."""
    rng = np.random.default_rng(seed + 1000)
    every = round(dt / STEP)
    ran = run(c, voltage)[::every]
    n = len(ran)
    current = 1e-3 * np.round((ran[:, 0] + 5e-3 * rng.standard_normal(n)) / 1e-3)
    if ticks:
        name, answer = "ticks", np.floor(ran[:, 2] / c.gear / (2.0 * np.pi) * ticks)
    else:
        name, answer = "speed_rad_s", ran[:, 1] / c.gear + 0.05 * rng.standard_normal(n)
    rows = zip(dt * np.arange(n), voltage[::every], current, answer, strict=True)
    lines = [f"{t:.4f},{v:.2f},{i:.3f},{y:.6g}" for t, v, i, y in rows]
    path.write_text("\n".join([f"time_s,voltage_V,current_A,{name}", *lines]) + "\n")
    return path
