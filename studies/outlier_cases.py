"""Simulated machines of every structure, struck by outliers in the disturbance or in the reading.

Each case draws a record of a known system whose noise has the standard deviation σ; two samples in
a hundred get 10 σ more, either in the disturbance, which the plant then answers, or in the reading
alone, which the plant never sees.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from sysid.data.record import Channel, Record
from sysid.structures.base import Structure
from sysid.structures.grey_box.dc_motor.structure import DCMotor, MotorPhysics
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.grey_box.tanks import Tanks, TanksPhysics
from sysid.structures.registry import structure_class

Array = NDArray[np.float64]

SHARE, TIMES = 0.02, 10.0
"""Outliers a sample, and their size in standard deviations of the noise."""

KINDS = ("disturbance", "reading")


@dataclass(frozen=True)
class Drawn:
    """What chance gave one record: noise of size one, and outliers of TIMES that size."""

    noise: Array
    outliers: Array

    @staticmethod
    def of(seed: int, samples: int, share: float = SHARE) -> "Drawn":
        """The draw of a seed."""
        rng = np.random.default_rng([seed, 1])
        struck = rng.random(samples) < share
        return Drawn(
            rng.standard_normal(samples),
            np.where(struck, TIMES * rng.choice([-1.0, 1.0], samples), 0.0),
        )

    def disturbance(self, kind: str) -> Array:
        """Noise that acts within the plant."""
        return self.noise + (self.outliers if kind == "disturbance" else 0.0)

    def reading(self, kind: str) -> Array:
        """What is misread."""
        return self.outliers if kind == "reading" else np.zeros_like(self.outliers)


Simulated = Callable[[Array, Array], Array]
"""(input (N,), disturbance (N,)) → output (N,)."""


@dataclass(frozen=True)
class Case:
    """One machine.

    Attributes:
        structure: what is fitted.
        orders, options: its orders and options.
        truth: values of its parameters, those that are to be compared.
        run: how the machine moves.
        drive: seed → input (N,).
        sigma: standard deviation of the noise.
        samples: length of a record.
        dt: sample time [s].
        channels: input and output, where the structure asks for units.
    """

    structure: str
    orders: Mapping[str, object]
    truth: Mapping[str, float]
    run: Simulated
    drive: Callable[[int, int], Array]
    sigma: float
    options: Mapping[str, str] = field(default_factory=dict)
    samples: int = 1000
    dt: float = 0.1
    channels: tuple[Channel, Channel] | None = None

    def made(self) -> Structure:
        """The structure as the command makes it."""
        found: Structure = structure_class(self.structure).from_orders(
            dict(self.orders), 1, 1, dict(self.options)
        )
        return found

    def record(self, seed: int, kind: str, share: float = SHARE) -> Record:
        """A record struck by outliers of one kind; ``clean`` strikes none."""
        drawn = Drawn.of(seed, self.samples, share)
        u = self.drive(seed, self.samples)
        y = self.run(u, self.sigma * drawn.disturbance(kind)) + self.sigma * drawn.reading(kind)
        named = {} if self.channels is None else {
            "inputs": self.channels[:1], "outputs": self.channels[1:]
        }  # fmt: skip
        return Record(u, y, self.dt, name=f"seed {seed}", **named)


def levels(held: int, noise: float = 0.3) -> Callable[[int, int], Array]:
    """Random steps up and down held for some samples, with some noise that reaches all levels."""

    def drive(seed: int, samples: int) -> Array:
        rng = np.random.default_rng([seed, 2])
        steps = np.repeat(rng.choice([-1.0, 1.0], samples // held + 1), held)[:samples]
        return steps + noise * rng.standard_normal(samples)

    return drive


def heights(held: int, size: float, middle: float = 0.0) -> Callable[[int, int], Array]:
    """Steps of random height held for some samples."""

    def drive(seed: int, samples: int) -> Array:
        rng = np.random.default_rng([seed, 3])
        raw = rng.uniform(-1.0, 1.0, samples // held + 1)
        return middle + size * np.repeat(raw, held)[:samples]

    return drive


def linear(
    B: tuple[float, ...], A: tuple[float, ...] = (1.0,), F: tuple[float, ...] = (1.0,),
    C: tuple[float, ...] = (1.0,), D: tuple[float, ...] = (1.0,),
) -> Simulated:  # fmt: skip
    """A y = B/F u + C/D e."""

    def run(u: Array, e: Array) -> Array:
        driven = lfilter(B, np.convolve(A, F), u)
        return np.asarray(driven + lfilter(C, np.convolve(A, D), e))

    return run


def dead_zone(x: Array, low: float, high: float) -> Array:
    """What is left of x beyond its edges."""
    return np.maximum(x - high, 0.0) + np.minimum(x - low, 0.0)


def hammerstein(u: Array, e: Array) -> Array:
    """A dead zone, then a lag that the disturbance enters."""
    return np.asarray(
        lfilter([0.0, 0.5], [1.0, -0.7], dead_zone(u, -0.2, 0.3)) + lfilter([1.0], [1.0, -0.7], e)
    )


def wiener(u: Array, e: Array) -> Array:
    """A lag, then a sensor that saturates; noise on its reading."""
    return np.asarray(np.clip(lfilter([0.0, 0.4], [1.0, -0.6], u), -0.7, 0.8) + e)


def wiener_hammerstein(u: Array, e: Array) -> Array:
    """A lag, a dead zone and another lag, which the disturbance enters."""
    before = lfilter([0.5], [1.0, -0.5], u)
    return np.asarray(
        lfilter([0.0, 0.6], [1.0, -0.8], dead_zone(before, -0.25, 0.35))
        + lfilter([1.0], [1.0, -0.8], e)
    )


def narmax(u: Array, e: Array) -> Array:
    """A bilinear equation with a cubic term."""
    y = np.zeros(len(u))
    for t in range(2, len(u)):
        y[t] = (
            0.8 * y[t - 1] - 0.2 * y[t - 2] + 0.5 * u[t - 1] - 0.2 * u[t - 1] * y[t - 2] ** 2 + e[t]
        )
    return y


def curved(u: Array, e: Array) -> Array:
    """A spring that stiffens and an input that saturates: no polynomial, no network."""
    y = np.zeros(len(u))
    for t in range(1, len(u)):
        y[t] = 0.7 * y[t - 1] - 0.15 * np.tanh(y[t - 1]) ** 3 + 0.6 * np.tanh(1.5 * u[t - 1]) + e[t]
    return y


def grey(made: GreyBox[Any], values: Mapping[str, float]) -> Simulated:
    """A grey box whose first state the disturbance moves."""

    def run(u: Array, e: Array) -> Array:
        theta = made.physics.pack(dict(values))
        step, x, rows = made.step(theta), np.zeros(made.n_states(theta)), []
        for row, kick in zip(u[:, None], e, strict=True):
            x, y = step(x, row)
            x = x + np.concatenate([[kick], np.zeros(len(x) - 1)])
            rows.append(y[0])
        return np.array(rows)

    return run


MOTOR = {"gain": 2.0, "time_constant": 0.3, "coulomb": 0.6}
TANKS = {"k1": 0.05, "k2": 0.04, "k3": 0.05, "limit1": 8.0, "share": 0.4}


def _motor() -> DCMotor:
    physics = MotorPhysics.from_options({"friction": "coulomb", "input": "voltage"}, 1, 1)
    return DCMotor(physics, Sampling(0.05, 10))


def _tanks() -> Tanks:
    return Tanks(TanksPhysics(1, 1), Sampling(4.0, 4))


CASES: Mapping[str, Case] = {
    "arx": Case(
        "arx", {"na": 2, "nb": 2, "nk": 1}, {"a1": -1.5, "a2": 0.7, "b1": 1.0, "b2": 0.5},
        linear((0.0, 1.0, 0.5), A=(1.0, -1.5, 0.7)), levels(3), 0.5,
    ),
    "armax": Case(
        "armax", {"na": 2, "nb": 2, "nc": 1, "nk": 1},
        {"a1": -1.5, "a2": 0.7, "b1": 1.0, "b2": 0.5, "c1": -0.4},
        linear((0.0, 1.0, 0.5), A=(1.0, -1.5, 0.7), C=(1.0, -0.4)), levels(3), 0.5,
    ),
    "oe": Case(
        "oe", {"nb": 2, "nf": 2, "nk": 1}, {"b1": 1.0, "b2": 0.5, "f1": -1.5, "f2": 0.7},
        linear((0.0, 1.0, 0.5), F=(1.0, -1.5, 0.7), D=(1.0, -0.6)), levels(3), 0.5,
    ),
    "bj": Case(
        "bj", {"nb": 2, "nf": 2, "nc": 1, "nd": 1, "nk": 1},
        {"b1": 1.0, "b2": 0.5, "f1": -1.5, "f2": 0.7, "c1": 0.5, "d1": -0.8},
        linear((0.0, 1.0, 0.5), F=(1.0, -1.5, 0.7), C=(1.0, 0.5), D=(1.0, -0.8)), levels(3), 0.5,
    ),
    "hammerstein-wiener": Case(
        "hammerstein-wiener", {"nb": 1, "nf": 1, "nk": 1},
        {"b1": 0.5, "f1": -0.7, "input.d_low": -0.2, "input.d_high": 0.3},
        hammerstein, heights(4, 1.0), 0.03,
        {"input": "dead-zone", "output": "identity"},
    ),
    "hammerstein-wiener, sensor saturates": Case(
        "hammerstein-wiener", {"nb": 1, "nf": 1, "nk": 1},
        {"b1": 0.4, "f1": -0.6, "output.s_low": -0.7, "output.s_high": 0.8},
        wiener, heights(4, 1.2), 0.03,
        {"input": "identity", "output": "saturation"},
    ),
    "wiener-hammerstein": Case(
        "wiener-hammerstein", {"nb1": 1, "nf1": 1, "nb": 1, "nf": 1, "nk": 1},
        {"first.f1": -0.5, "f1": -0.8}, wiener_hammerstein, heights(4, 1.2), 0.02,
        {"static": "dead-zone"},
    ),
    "narmax": Case(
        "narmax", {"na": 2, "nb": 1, "nk": 1},
        {"y(t-1)": 0.8, "y(t-2)": -0.2, "u(t-1)": 0.5, "y(t-2)^2*u(t-1)": -0.2},
        narmax, levels(3), 0.05,
        {"terms": "y(t-1), y(t-2), u(t-1), u(t-1)*y(t-2)^2"},
    ),
    "narx-wavelet": Case(
        "narx-wavelet", {"na": 1, "nb": 1, "nk": 1}, {}, curved, heights(4, 1.2), 0.03,
    ),
    "dc-motor": Case(
        "dc-motor", {}, MOTOR, grey(_motor(), MOTOR), heights(15, 6.0), 0.05,
        {"friction": "coulomb"}, 600, 0.05, (Channel("u", "V"), Channel("w", "rad/s")),
    ),
    "tanks": Case(
        "tanks", {}, TANKS, grey(_tanks(), TANKS), heights(25, 2.5, 2.5), 0.02, samples=600, dt=4.0,
    ),
}  # fmt: skip
"""Every structure, driven so that its parameters are seen."""
