"""Two tanks in cascade: an example of a grey box."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import UsageError
from sysid.runners.single import together
from sysid.structures.grey_box.physics import Constant, Physics, Rung, Signal
from sysid.structures.grey_box.structure import GreyBox, grey_box_traits
from sysid.structures.traits import Traits

SMALL = 1e-3
"""Head below which outflow is smoothed, as a share of the sensor's unit."""

LEVEL = 1.25
"""Level about which time constants are stated: low for a sensor that counts up to ten volts."""


@dataclass(frozen=True)
class TanksPhysics(Physics):
    """Two tanks, one above the other: a pump fills the upper one, which drains into the lower.

        ḣ1 = max(k3 u + k4, 0) − k1 h1^a1   h1 ≤ limit1: what the pump brings beyond it
        ḣ2 =  k1 h1^a1 − k2 (h2 + d2)^a2    overflows, a share of it into the lower tank
        y  =  h2 ≤ limit2

    (Schoukens, Mattsson, Wigren & Noël 2016, "Cascaded tanks benchmark"; Torricelli's law has
    a1 = a2 = ½, laminar flow 1.) Levels are in the units of the sensor; that of the upper tank
    counts from its outlet and in water that would raise the lower one as much, because no other
    zero and unit could be found from these. d2 is the depth of the lower outlet below the sensor's
    zero.
    """

    takes_floats: ClassVar[bool] = True

    @classmethod
    def from_options(cls, given: Mapping[str, str], nu: int, ny: int) -> Self:
        if (nu, ny) != (1, 1):
            raise UsageError(
                f"tanks needs one input (pump) and one output (lower level), got {nu} and {ny}"
            )
        return cls(nu, ny)

    @property
    def constants(self) -> tuple[Constant, ...]:
        return (
            Constant("k1", "1/s", 0.05, 0.0, spread=2.0, words="outflow of the upper tank"),
            Constant("k2", "1/s", 0.05, 0.0, spread=2.0, words="outflow of the lower tank"),
            Constant("k3", "{y}/{u}/s", 0.05, 0.0, spread=2.0, words="inflow per volt"),
            Constant("k4", "{y}/s", 0.0, spread=0.3, free=False, words="inflow without command"),
            Constant("limit1", "{y}", 10.0, 0.0, spread=1.5, words="level at which it overflows"),
            Constant("share", "", 0.5, 0.0, 1.0, words="overflow that is caught below"),
            Constant("limit2", "{y}", 1e3, 0.0, free=False, words="highest level below"),
            Constant("d2", "{y}", 0.0, spread=0.5, free=False, words="lower outlet below zero"),
            Constant("a1", "", 0.5, 0.3, 1.0, spread=1.3, words="exponent of the upper outflow"),
            Constant("a2", "", 0.5, 0.3, 1.0, spread=1.3, words="exponent of the lower outflow"),
        )

    @property
    def state_names(self) -> tuple[str, ...]:
        return ("h1", "h2")

    def ladder(self) -> tuple[Rung, ...]:
        return (
            Rung("overflow of the lower tank", ("limit2",)),
            Rung("depth of the lower outlet", ("d2",)),
            Rung("inflow without command", ("k4",)),
        )

    def rung_starts(self, theta: Array, rung: Rung, records: Sequence[Record]) -> tuple[Array, ...]:
        """Limits at several heights of the record's own range."""
        p = self.unpack(np, theta)
        top = max(float(np.max(r.y)) for r in records)
        if "limit2" in rung.names:
            return (self.pack(p | {"limit2": 0.99 * top}),)
        if "d2" in rung.names:
            return tuple(self.pack(p | {"d2": f * top}) for f in (0.05, -0.1))
        return (theta,)

    def advance(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal], h: float) -> Signal:
        """Runge-Kutta 4 between limits; what rises above the upper one has run over the rim."""
        free = super().advance(xp, x, u, p, h)
        over = xp.maximum(free[0] - p["limit1"], 0.0)
        upper = xp.maximum(free[0] - over, 0.0)
        caught = p["share"] * over
        lower = xp.minimum(xp.maximum(free[1] + caught, xp.minimum(-p["d2"], 0.0)), p["limit2"])
        return together(xp, [upper, lower])

    def rates(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal]) -> Signal:
        through = _outflow(xp, x[0], p["a1"])
        out = _outflow(xp, x[1] + p["d2"], p["a2"])
        return together(
            xp,
            [
                xp.maximum(p["k3"] * u[0] + p["k4"], 0.0) - p["k1"] * through,
                p["k1"] * through - p["k2"] * out,
            ],
        )

    def reading(self, xp: Any, x: Signal, p: Mapping[str, Signal]) -> Signal:
        return x[1:]

    def first_guess(self, records: Sequence[Record]) -> tuple[tuple[str, Array], ...]:
        """Both tanks alike; filling times of several sizes, gains from mean level and command."""
        level = max(float(np.mean(np.concatenate([r.y for r in records]))), 1e-3)
        top = max(float(np.max(r.y)) for r in records)
        command = max(float(np.mean(np.concatenate([r.u for r in records]))), 1e-3)
        guesses = []
        for samples in (5.0, 10.0, 20.0, 40.0):
            # linearised time constant 2 √h / k
            k = 2.0 * np.sqrt(level) / (samples * records[0].dt)
            flow = k * np.sqrt(level)
            p = {"k1": k, "k2": k, "k3": flow / command}
            for limit in (0.7, 1.0):
                words = f"time constants of {samples:g} samples, rim at {limit:g} of the range"
                guesses.append((words, self.pack(p | {"limit1": limit * top})))
        return tuple(guesses)

    def state_guess(self, theta: Array, u: Array, y: Array, dt: float) -> Array:
        """The lower tank at the first level read, the upper one where it keeps it there."""
        p = self.unpack(np, theta)
        out = p["k2"] * float(_outflow(np, y[0, 0] + p["d2"], p["a2"]))
        upper = (max(out, 1e-12) / max(float(p["k1"]), 1e-12)) ** (1.0 / float(p["a1"]))
        return np.array([min(upper, float(p["limit1"])), float(y[0, 0])])

    def time_scale(self, theta: Array, dt: float) -> float:
        """Four samples: within a quarter of one the upper tank may begin to overflow."""
        return 4.0 * dt

    def time_constants(self, theta: Array) -> Array:
        """2 √h / k of both tanks, linearised about a low level h."""
        p = self.unpack(np, theta)
        rates = np.maximum([float(p["k1"]), float(p["k2"])], 1e-6)
        return np.asarray(2.0 * np.sqrt(LEVEL) / rates)


class Tanks(GreyBox[TanksPhysics]):
    """Two tanks, one above the other, as a structure."""

    name: ClassVar[str] = "tanks"
    traits: ClassVar[Traits] = grey_box_traits(
        title="Two tanks in cascade: a grey box with outflow and overflow",
        equation="dh1/dt = max(k3·u + k4, 0) - k1·h1^a1, dh2/dt = k1·h1^a1 - k2·(h2+d2)^a2",
        when="levels of two tanks, one draining into the other, fed by a pump",
    )
    physics_class: ClassVar[type[Physics]] = TanksPhysics


def _outflow(xp: Any, head: Signal, exponent: Signal) -> Signal:
    """head^exponent, zero below the outlet; smooth there, so that its derivative stays finite."""
    positive = xp.maximum(head, 0.0)
    return positive * (positive + SMALL) ** (exponent - 1.0)
