"""The polynomial systems that the tests of structures and estimators share, with their truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter

from sysid.data.record import Array, Record
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.orders import parse_orders
from sysid.structures.registry import structure_class


@dataclass(frozen=True)
class System:
    """A stable system of a structure: its orders and its parameters in the structure's order."""

    structure: str
    text: str
    theta: Sequence[float]
    nu: int = 1
    ny: int = 1

    @property
    def orders(self) -> Mapping[str, Any]:
        """The orders by name."""
        return parse_orders(self.text)

    @property
    def model_structure(self) -> PolynomialStructure:
        """The structure with these orders."""
        found = structure_class(self.structure).from_orders(self.orders, self.nu, self.ny)
        assert isinstance(found, PolynomialStructure)
        return found

    @property
    def truth(self) -> Array:
        """θ."""
        return np.array(self.theta, dtype=np.float64)

    def record(
        self, samples: int, noise: float = 0.0, seed: int = 0, skip: int = 0, dt: float = 0.1
    ) -> Record:
        """White input, free run plus H e; ``skip`` first samples cut away, so not from rest."""
        rng = np.random.default_rng(seed)
        n = samples + skip
        u = rng.standard_normal((n, self.nu))
        e = noise * rng.standard_normal((n, self.ny))
        y = self.model_structure.simulate(self.truth, u)
        h = self.model_structure.noise_response(self.truth, n)
        for i in range(self.ny):
            for j in range(self.ny):
                y[:, i] += lfilter(h[:, i, j], [1.0], e[:, j])
        return Record(u[skip:], y[skip:], dt)


A, B, C, D = (-1.5, 0.7), (1.0, 0.5), (-0.9, 0.3), (-0.6, 0.2)
A2, B2 = (-1.1, 0.4), (0.6, -0.2)

SYSTEMS: Mapping[str, System] = {
    "arx": System("arx", "na=2 nb=2 nk=1", (*A, *B)),
    "arx nk=0": System("arx", "na=2 nb=2 nk=0", (*A, *B)),
    "arx MISO, mixed orders": System("arx", "na=2 nb=2,1 nk=0,3", (*A, *B, 0.8), nu=2),
    "arx MIMO, coupled": System(
        "arx",
        "na=1,1;0,2 nb=1,2;2,0 nk=1,0;2,1",
        (-0.7, 0.2, 1.0, 0.4, 0.1, *A2, 0.3, 1.0),
        nu=2,
        ny=2,
    ),
    "armax": System("armax", "na=2 nb=2 nc=2 nk=1", (*A, *B, *C)),
    "armax nk=0": System("armax", "na=1 nb=1 nc=1 nk=0", (-0.8, 1.0, 0.5)),
    "armax MISO, mixed orders": System(
        "armax", "na=2 nb=1,2 nc=1 nk=2,0", (*A, 1.0, *B2, -0.5), nu=2
    ),
    "armax MIMO, coupled": System(
        "armax",
        "na=1,1;1,1 nb=1 nc=1,2 nk=1",
        (-0.7, 0.2, 1.0, 0.4, -0.5, 0.1, -0.8, 0.3, 1.0, *C),
        nu=2,
        ny=2,
    ),
    "oe": System("oe", "nb=2 nf=2 nk=1", (*B, *A)),
    "oe nk=0": System("oe", "nb=1 nf=1 nk=0", (1.0, -0.8)),
    "oe MISO, mixed orders": System("oe", "nb=2,2 nf=2,0 nk=1,3", (*B, *B2, *A), nu=2),
    "oe MIMO": System(
        "oe",
        "nb=1,2;1,1 nf=2,1;1,2 nk=1,0;2,1",
        (1.0, *B2, *A, -0.6, 0.5, 0.8, -0.9, *A2),
        nu=2,
        ny=2,
    ),
    "bj": System("bj", "nb=2 nc=1 nd=1 nf=2 nk=1", (*B, 0.5, -0.9, *A)),
    "bj nk=0": System("bj", "nb=1 nc=0 nd=2 nf=1 nk=0", (1.0, *D, -0.8)),
    "bj MISO, mixed orders": System(
        "bj", "nb=2,1 nc=2 nd=0 nf=1,2 nk=1,2", (*B, 0.8, *C, -0.8, *A), nu=2
    ),
    "bj MIMO": System(
        "bj",
        "nb=1 nc=1,0 nd=1,2 nf=1,0;1,1 nk=1",
        (1.0, 0.5, 0.4, -0.8, -0.8, -0.4, 1.0, *D, -0.6, -0.9),
        nu=2,
        ny=2,
    ),
}
"""Every structure as SISO with and without direct term, MISO with mixed orders, and MIMO."""
