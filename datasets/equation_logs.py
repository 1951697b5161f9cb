"""Write the logs beside the examples of equations again: ``python datasets/equation_logs.py``.

Their truth shares no code with the workbench: classical Runge-Kutta 4 in plain Python, a hundred
steps a sample, so that a fit can be held against numbers that it did not make.
"""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

State = tuple[float, ...]

PENDULUM = {"gravity": 24.5, "damping": 0.8, "dry": 1.2, "gain": 4.2, "slow": 0.05}
TANKS = {
    "k1": 0.04, "k2": 0.05, "k3": 0.06, "k4": -0.03, "rim": 9.0, "share": 0.4, "top": 9.5,
    "d2": 0.2, "a1": 0.5, "a2": 0.5,
}  # fmt: skip

STEPS = 100


def pendulum_rate(x: State, u: float) -> State:
    """Angle [rad] and speed [rad/s] under u [V]."""
    p, (angle, speed) = PENDULUM, x
    friction = p["damping"] * speed + p["dry"] * math.tanh(speed / p["slow"])
    return speed, p["gain"] * u - friction - p["gravity"] * math.sin(angle)


def tanks_rate(x: State, u: float) -> State:
    """Levels of both tanks [V of the sensor] under the pump's voltage."""
    p, (upper, lower) = TANKS, x
    through = p["k1"] * max(upper, 0.0) ** p["a1"]
    out = p["k2"] * max(lower + p["d2"], 0.0) ** p["a2"]
    return max(p["k3"] * u + p["k4"], 0.0) - through, through - out


def overflow(x: State) -> State:
    """What is above the rim has run over, a share of it into the lower tank."""
    p, (upper, lower) = TANKS, x
    over = max(upper - p["rim"], 0.0)
    return max(upper - over, 0.0), min(lower + p["share"] * over, p["top"])


def run(
    rate: Callable[[State, float], State],
    after: Callable[[State], State],
    x: State,
    commands: np.ndarray,
    dt: float,
    shown: int,
) -> np.ndarray:
    """One state at the samples; the command of a sample acts until the next one."""
    h, out = dt / STEPS, []

    def ahead(x: State, d: State, step: float) -> State:
        return tuple(v + step * r for v, r in zip(x, d, strict=True))

    for u in commands.tolist():
        out.append(x[shown])
        for _ in range(STEPS):
            a = rate(x, u)
            b = rate(ahead(x, a, h / 2), u)
            c = rate(ahead(x, b, h / 2), u)
            d = rate(ahead(x, c, h), u)
            mean = tuple((i + 2 * j + 2 * k + m) / 6 for i, j, k, m in zip(a, b, c, d, strict=True))
            x = after(ahead(x, mean, h))
    return np.array(out)


def write(folder: Path) -> list[Path]:
    """``pendulum.csv`` and ``two_tanks.csv``; seeds and digits are fixed."""
    rng = np.random.default_rng(3)
    volts = np.repeat(rng.choice([-3.0, -1.5, 0.0, 1.5, 3.0], 40), 20)
    angle = run(pendulum_rate, lambda x: x, (0.3, 0.0), volts, 0.02, 0)
    pump = np.repeat(rng.uniform(1.0, 5.5, 30), 20).round(3)
    level = run(tanks_rate, overflow, (3.0, 4.0), pump, 4.0, 1)
    files = []
    for name, heads, dt, u, y, noise, seed in (
        ("pendulum", "t_s,u_V,theta_rad", 0.02, volts, angle, 0.005, 4),
        ("two_tanks", "t_s,pump_V,level_V", 4.0, pump, level, 0.03, 6),
    ):
        y = y + noise * np.random.default_rng(seed).standard_normal(len(y))
        rows = [f"{dt * k:.2f},{a:g},{b:.4f}" for k, (a, b) in enumerate(zip(u, y, strict=True))]
        files.append(folder / f"{name}.csv")
        files[-1].write_text("\n".join([heads, *rows, ""]), encoding="utf-8")
    return files


if __name__ == "__main__":
    for file in write(Path(__file__).resolve().parent / "equations"):
        print(file)
