"""A grey box: a driven pendulum, its angle read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import UsageError
from sysid.structures.grey_box.physics import Constant, Physics, Signal
from sysid.structures.grey_box.structure import GreyBox, grey_box_traits
from sysid.structures.traits import Traits


@dataclass(frozen=True)
class PendulumPhysics(Physics):
    """φ̈ = k u − d φ̇ − ω² sin φ,  y = φ [rad]."""

    @classmethod
    def from_options(cls, given: Mapping[str, str], nu: int, ny: int) -> "PendulumPhysics":
        """One drive, one angle; no options besides those of every grey box."""
        if (nu, ny) != (1, 1):
            raise UsageError(f"pendulum needs one input and one output, got {nu} and {ny}")
        return cls(nu, ny)

    constants = (
        Constant("gain", "rad/s²/{u}", 1.0, words="acceleration per unit of drive"),
        Constant("damping", "1/s", 0.1, 0.0, words="share of the speed lost in a second"),
        Constant("omega", "rad/s", 3.0, 1e-3, words="frequency of small swings"),
    )
    state_names = ("angle", "speed")

    def rates(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal]) -> Signal:
        """(φ̇, φ̈)."""
        swing = p["gain"] * u[0] - p["damping"] * x[1] - p["omega"] ** 2 * xp.sin(x[0])
        return xp.stack([x[1], swing])

    def reading(self, xp: Any, x: Signal, p: Mapping[str, Signal]) -> Signal:
        """The angle."""
        return x[:1]

    def first_guess(self, records: Sequence[Record]) -> tuple[tuple[str, Array], ...]:
        """The equation itself by least squares, on differences of the angle."""
        r = records[0]
        speed = np.gradient(r.y[:, 0], r.dt)
        terms = np.column_stack([r.u[:, 0], -speed, -np.sin(r.y[:, 0])])
        gain, damping, square = np.linalg.lstsq(terms, np.gradient(speed, r.dt), rcond=None)[0]
        guess = {"gain": gain, "damping": max(damping, 0.0), "omega": max(square, 1.0) ** 0.5}
        return (("differences of the angle", self.pack(guess)),)


class Pendulum(GreyBox[PendulumPhysics]):
    """The pendulum as a structure."""

    name: ClassVar[str] = "pendulum"
    traits: ClassVar[Traits] = grey_box_traits(
        title="Pendulum with a drive at its axle: a grey box",
        equation="d²φ/dt² = gain·u − damping·dφ/dt − omega²·sin φ",
        when="an arm that hangs and swings, its angle measured in radians",
    )
    physics_class: ClassVar[type[Physics]] = PendulumPhysics
