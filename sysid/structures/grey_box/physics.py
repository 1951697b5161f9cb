"""Physics of a grey box: its constants, its equation, and what is read from its state."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Ge, Le

from sysid.data.record import Array, Channel, Record
from sysid.runners.loops import repeated
from sysid.runners.single import ahead
from sysid.vehicle.motors import TorqueSource

MAX_SUBSTEPS = 1000

Signal = Any
"""An array of the namespace in use (numpy or jax.numpy)."""


@dataclass(frozen=True)
class Constant:
    """One physical constant of a grey box.

    Attributes:
        name: as users see it; the output's name follows in brackets where every output has one.
        unit: unit; ``{u}`` and ``{y}`` stand for those of the first input and output.
        value: what it is held at when it is not estimated, and where searches begin.
        lower, upper: physical bounds.
        free: whether it is estimated unless something else is asked for.
        spread: starts vary it by about this factor (a constant of either sign: by this share).
        each: whether every output has its own.
        jumps: whether runs change by jumps or kinks with it, so that slopes do not give its error.
    """

    name: str
    unit: str = ""
    value: float = 1.0
    lower: float = -np.inf
    upper: float = np.inf
    free: bool = True
    spread: float = 3.0
    each: bool = False
    words: str = ""
    jumps: bool = False


@dataclass(frozen=True)
class Rung:
    """One step of a ladder: constants that are estimated only where held-out data pay for them."""

    words: str
    names: tuple[str, ...]


@dataclass(frozen=True)
class Sampling:
    """How a record drives a grey box: the input is held, each sample cut into equal steps.

    Attributes:
        dt: sample time [s]; 0 before a fit.
        substeps: steps in a sample, 0 before a fit when it is to be chosen.
        input_range: lowest and highest value of each input; empty before a fit.
    """

    dt: Annotated[float, Ge(0.0)] = 0.0
    substeps: Annotated[int, Ge(0), Le(MAX_SUBSTEPS)] = 0
    input_range: tuple[tuple[float, float], ...] = ()

    @property
    def steps(self) -> int:
        """Steps in a sample, at least one."""
        return max(self.substeps, 1)

    @property
    def h(self) -> float:
        """Length of a step [s]."""
        return self.dt / self.steps


@dataclass(frozen=True)
class Physics(ABC):
    """ẋ = f(x, u, p), y = g(x, p) with physical constants p; y(k) is read before u(k) acts.

    Subclasses give ``constants``, ``state_names``, ``rates`` (or ``advance``, for difference
    equations and exact discretisations), ``reading`` and ``first_guess``. In all of these x is
    (n, runs) and u (nu, runs); a constant is a number, or (ny, 1) where every output has one.

    Attributes:
        nu, ny: numbers of inputs and outputs.
    """

    nu: int
    ny: int

    takes_floats: ClassVar[bool] = False
    """Whether ``advance`` and ``reading`` also serve one run on plain numbers, which is ten times
    faster: x and u are lists of floats then, constants floats or, one an output, lists."""

    @classmethod
    def from_options(cls, given: Mapping[str, str], nu: int, ny: int) -> Self:
        """With these options of its own; other options may be among them.

        Raises:
            UsageError: it has no such numbers of channels, or an option cannot be read.
        """
        return cls(nu, ny)

    # ----------------------------------------------------------------- constants, θ and p

    @property
    @abstractmethod
    def constants(self) -> tuple[Constant, ...]:
        """The physical constants, in the order of θ."""

    def unpack(self, xp: Any, theta: Signal) -> dict[str, Signal]:
        """p: the constants by name."""
        return {
            c.name: theta[at].reshape(self.ny, 1) if c.each else theta[at.start]
            for c, at in self._places()
        }

    def pack(self, p: Mapping[str, Any]) -> Array:
        """θ from constants by name; those that are missing take their default value."""
        parts = [
            np.broadcast_to(np.ravel(p.get(c.name, c.value)), (at.stop - at.start,))
            for c, at in self._places()
        ]
        return np.concatenate(parts, dtype=np.float64)

    def entries(self, name: str) -> list[int]:
        """Places in θ of the constant called ``name``."""
        return [k for c, at in self._places() if c.name == name for k in range(at.start, at.stop)]

    def by_entry(self, value: Callable[[Constant], float]) -> Array:
        """One number of each constant, for every entry of θ."""
        return self.pack({c.name: value(c) for c in self.constants})

    def _places(self) -> list[tuple[Constant, slice]]:
        """Each constant, and where it stands in θ."""
        edges = np.cumsum([0, *(self.ny if c.each else 1 for c in self.constants)]).tolist()
        return [(c, slice(*edges[k : k + 2])) for k, c in enumerate(self.constants)]

    # ----------------------------------------------------------------- the equation

    @property
    @abstractmethod
    def state_names(self) -> tuple[str, ...]:
        """What the states are."""

    @abstractmethod
    def reading(self, xp: Any, x: Signal, p: Mapping[str, Signal]) -> Signal:
        """y (ny, runs) of the state x (n, runs)."""

    def rates(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal]) -> Signal:
        """ẋ (n, runs)."""
        raise TypeError(f"{type(self).__name__} must define rates or advance")

    def advance(self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal], h: float) -> Signal:
        """x after a step h with u held: classical Runge-Kutta 4 unless overridden."""
        a = self.rates(xp, x, u, p)
        b = self.rates(xp, ahead(xp, x, 0.5 * h, a), u, p)
        c = self.rates(xp, ahead(xp, x, 0.5 * h, b), u, p)
        d = self.rates(xp, ahead(xp, x, h, c), u, p)
        total = ahead(xp, ahead(xp, a, 2.0, ahead(xp, b, 1.0, c)), 1.0, d)
        return ahead(xp, x, h / 6.0, total)

    def sample(
        self, xp: Any, x: Signal, u: Signal, p: Mapping[str, Signal], h: Signal, steps: Signal
    ) -> Signal:
        """x one sample later, u held for ``steps`` steps of length h."""
        return repeated(xp, steps, lambda x: self.advance(xp, x, u, p, h), x)

    def prepared(self, xp: Any, p: dict[str, Signal], h: Signal) -> Mapping[str, Signal]:
        """p for ``advance`` and ``reading``, with whatever need be computed only once a run."""
        return p

    def bare(self) -> Self:
        """The equation alone: equal where a compilation of one serves the other."""
        return self

    # ----------------------------------------------------------------- where a fit begins

    @abstractmethod
    def first_guess(self, records: Sequence[Record]) -> tuple[tuple[str, Array], ...]:
        """Named θ read off the data: where the search begins."""

    def state_guess(self, theta: Array, u: Array, y: Array, dt: float) -> Array:
        """A state that suits the head of a record: the first outputs, and zeros."""
        x = np.zeros(len(self.state_names))
        n = min(len(x), y.shape[1])
        if len(y):
            x[:n] = y[0, :n]
        return x

    def estimated_states(self) -> tuple[bool, ...]:
        """Which first states are estimated; the others are what ``state_guess`` says."""
        return (True,) * len(self.state_names)

    def for_record(self, record: Record) -> Self:
        """With what is read off a record's channels."""
        return self

    def ladder(self) -> tuple[Rung, ...]:
        """What held-out data decide on, in the order in which it is tried."""
        return ()

    def rung_starts(self, theta: Array, rung: Rung, records: Sequence[Record]) -> tuple[Array, ...]:
        """Where to begin when the constants of a rung become free: where they are, by default."""
        return (theta,)

    # ----------------------------------------------------------------- what follows from θ

    def time_constants(self, theta: Array) -> Array:
        """Time constants [s], one a motion, infinite for an integral; empty when unknown.

        From the slowest follows how long an initial state is remembered.
        """
        return np.zeros(0)

    def time_scale(self, theta: Array, dt: float) -> float:
        """Shortest time constant [s], from which the substeps follow; infinite when unknown."""
        return float(np.min(self.time_constants(theta), initial=np.inf))

    def stable(self, theta: Array) -> bool | None:
        """Whether runs stay bounded, where the equation says it; None where runs have to show."""
        return None

    def sentences(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The equation with its numbers, where there is more to say than a list of constants."""
        return ()

    def properties(self, theta: Array) -> dict[str, Any]:
        """Further facts that follow from θ, JSON-able."""
        return {}

    def torque_source(self, theta: Any) -> TorqueSource | None:
        """The motors as sources of torque; None where speeds are all that is known."""
        return None

    def friction_entries(self) -> tuple[int, ...]:
        """Entries of θ that are dry friction."""
        return ()
