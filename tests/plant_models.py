"""Models that the tests of packages, C code and commands share, fitted in milliseconds."""

from functools import cache

import numpy as np

from sysid.data.preprocess import Detrend
from sysid.data.record import Channel, Record
from sysid.estimation.pem import fit
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

ORDERS = {
    "arx": {"na": 2, "nb": 2, "nk": 1},
    "armax": {"na": 2, "nb": 2, "nc": 1, "nk": 1},
    "oe": {"nb": 2, "nf": 2, "nk": 1},
    "bj": {"nb": 2, "nc": 1, "nd": 1, "nf": 2, "nk": 1},
}


def robot_record(n: int = 600, seed: int = 3) -> Record:
    """Two independent tracks of first order: ω(t+1) = 0.7 ω(t) + g·PWM(t) + noise."""
    rng = np.random.default_rng(seed)
    u = 12000.0 * np.sign(rng.normal(size=(n, 2))).repeat(3, axis=0)[:n]
    y = np.zeros((n, 2))
    for t in range(n - 1):
        y[t + 1] = 0.7 * y[t] + np.array([3.0e-4, 3.2e-4]) * u[t]
    y += 0.05 * rng.normal(size=y.shape)
    return Record(
        u,
        y,
        0.1,
        (Channel("pwm_l", "µs"), Channel("pwm_r", "µs")),
        (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
        name="robot.csv",
    )


def bench_record(n: int = 500, nu: int = 1, ny: int = 1, feed_through: bool = False) -> Record:
    """A coupled second-order system about an operating point far from zero."""
    rng = np.random.default_rng(10 * nu + ny)
    u = rng.normal(size=(n, nu)).repeat(2, axis=0)[:n]
    y = np.zeros((n, ny))
    gain = 1.0 + np.arange(ny * nu).reshape(ny, nu)
    for t in range(2, n):
        now = u[t] if feed_through else u[t - 1]
        y[t] = 1.3 * y[t - 1] - 0.5 * y[t - 2] + gain @ now - 0.3 * gain @ u[t - 2]
        y[t] += 0.1 * y[t - 1][::-1]
    y += 0.02 * rng.normal(size=y.shape)
    return Record(5.0 + u, 40.0 + y, 0.05, name="bench.csv")


@cache
def robot_model(structure: str = "oe") -> Model:
    """A model of two tracks."""
    chosen = structure_class(structure).from_orders(ORDERS[structure], 2, 2)
    return fit(chosen, [robot_record()])


@cache
def bench_model(structure: str = "arx", nu: int = 1, ny: int = 1, nk: int = 1) -> Model:
    """A model with an operating point, of any structure and size."""
    record = bench_record(nu=nu, ny=ny, feed_through=nk == 0)
    orders: dict[str, object] = dict(ORDERS[structure] | {"nk": nk})
    if structure in ("arx", "armax") and ny > 1:
        orders["na"] = [[2] * ny] * ny  # outputs that act on each other
    chosen = structure_class(structure).from_orders(orders, nu, ny)
    return fit(chosen, [record], detrend=Detrend.means([record]))
