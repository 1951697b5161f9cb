"""Structure: what can be fitted, and what every part of the workbench may ask of it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sysid.data.record import Array, Channel, Index, Record
from sysid.effects.ground import Ground
from sysid.errors import UsageError
from sysid.fitting.problem import Focus, Initial, Parameter, Problem
from sysid.structures.c_step import CStep

if TYPE_CHECKING:
    from sysid.structures.outcome import Fitter, Refitter, Warm


@dataclass(frozen=True)
class Structure(ABC):
    """What to fit. Everything is a pure function of one parameter vector θ.

    Subclasses are frozen dataclasses; ``name`` is what users type. Residuals of structures that
    are not ``linear`` are tested for what a nonlinear model may have missed, too.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    when: ClassVar[str]
    order_names: ClassVar[tuple[str, ...]]
    has_noise_model: ClassVar[bool]
    options: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Each option that ``from_orders`` accepts, with a sentence."""
    physical: ClassVar[bool] = False
    """Whether θ counts from the channels' own zeros, so that nothing may be removed from data."""
    linear: ClassVar[bool] = False
    has_losses: ClassVar[bool] = True
    """Whether its fit knows Huber's loss, not the quadratic one alone."""
    takes_inputs: ClassVar[bool] = True
    """Whether it is driven by inputs; one that is not models a signal from its own past."""

    @property
    def counts_from_zero(self) -> bool:
        """Whether what θ says is about the channels' own zeros, so that nothing may be removed."""
        return self.physical

    @property
    def lacks_constant(self) -> str:
        """Why a structure that counts from zero has no level of its own; empty where it has."""
        return ""

    @property
    @abstractmethod
    def nu(self) -> int:
        """Number of inputs."""

    @property
    @abstractmethod
    def ny(self) -> int:
        """Number of outputs."""

    @classmethod
    @abstractmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> "Structure":
        """The structure with these orders and options (text, as users type them).

        Raises:
            UsageError: an order or option does not exist, is missing or does not fit.
        """

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> "tuple[Mapping[str, Any], ...]":
        """Orders worth trying on a log when the user gives none, the smallest first."""
        return ()

    @abstractmethod
    def order_values(self) -> dict[str, Any]:
        """Orders in their shortest form, as ``from_orders`` reads them."""

    @abstractmethod
    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names, units and bounds of θ."""

    @abstractmethod
    def problems(
        self, records: Sequence[Record], focus: Focus, initial: Initial, stable: bool
    ) -> tuple[Problem, ...]:
        """The independent least-squares problems that together determine θ.

        They are solved in order; a later one may need the θ found before (``Problem.given``).
        """

    @abstractmethod
    def first_sample(self) -> int:
        """First sample whose one-step prediction needs no value before the record."""

    @abstractmethod
    def n_states(self, theta: Array) -> int:
        """Number of states of the free run."""

    def forgets_after(self, theta: Array) -> float:
        """Samples after which the free run has forgotten its initial state, 0 when unknown."""
        return 0.0

    def fitter(self) -> "Fitter":
        """How it is fitted: by search from its starts, unless a structure says otherwise."""
        from sysid.structures.search import by_search

        return by_search

    def refitter(self) -> "Refitter | None":
        """How a fit is repeated on nearly the same data; None where that is a fit like any."""
        return None

    def starts(self, records: Sequence[Record], focus: Focus) -> "Warm":
        """Named starting values of θ for a search."""
        return ()

    def stabilised(self, theta: Array) -> Array:
        """The nearest known θ whose free run is bounded; θ itself where none is known."""
        return theta

    def level_entries(self) -> Index:
        """Entries of θ that are levels: coefficients of a constant input."""
        return np.zeros(0, dtype=np.intp)

    def open_directions(self, records: Sequence[Record]) -> Array:
        """Directions of θ that such inputs leave open although slopes do not show it, (n, k)."""
        return np.zeros((0, 0))

    @abstractmethod
    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """State x0 (n_states,) that meets the first ``samples`` of y best in free run."""

    @abstractmethod
    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run from x0 (rest when None): outputs (N, ny)."""

    @abstractmethod
    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y): the free run sample by sample, from the same states.

        Written over the namespace of its arrays, ``xp = x.__array_namespace__()``, it runs in
        NumPy and JAX, and an exporter can record it: C needs nothing else.
        """

    def c_step(self, theta: Array) -> CStep | None:
        """C of its own for a step; None: it is recorded from ``step``."""
        return None

    @abstractmethod
    def errors(self, theta: Array, u: Array, y: Array, window: int) -> Array:
        """One-step prediction errors (N, ny).

        Initial states come from the first ``window`` samples; samples that need values before
        the record are NaN.
        """

    @abstractmethod
    def predict(self, theta: Array, u: Array, y: Array, horizon: int, window: int) -> Array:
        """k-step-ahead predictions (N, ny), NaN where values before the record are needed."""

    @abstractmethod
    def stable(self, theta: Array) -> bool:
        """Whether the free run is bounded for bounded inputs."""

    @abstractmethod
    def gradient_columns(self, theta: Array, u: Array, y: Array, output: int) -> Array:
        """∂ŷ/∂θ of one output's one-step prediction on a record, (N, k), zero rows where NaN."""

    def gradient_index(self, theta: Array, output: int) -> Index:
        """The k entries of θ that the columns of ``gradient_columns`` belong to; all by default."""
        return np.arange(len(theta))

    @abstractmethod
    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The fitted equations, one line each, as a person would write them."""

    @abstractmethod
    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        """Poles, zeros, static gain …: JSON-able facts that follow from θ."""

    def ground(self, theta: Array) -> Ground:
        """Effects between tracks and ground: they change the pose, no output; none by default."""
        return Ground()

    def settings(self) -> dict[str, Any]:
        """What besides orders makes the structure: options, and what was read off the data."""
        return {}

    def to_json(self) -> dict[str, Any]:
        """{structure, orders, settings, nu, ny}: what ``from_json`` needs."""
        return {
            "structure": self.name,
            "orders": self.order_values(),
            "settings": self.settings(),
            "nu": self.nu,
            "ny": self.ny,
        }

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "Structure":
        """Undo ``to_json``."""
        return cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]))


def refuse_options(structure: str, options: Mapping[str, str] | None, known: Sequence[str]) -> None:
    """Refuse options that the structure does not have.

    Raises:
        UsageError: there is one; the sentence lists those that exist.
    """
    for name in options or {}:
        if name not in known:
            has = f"its options are {', '.join(known)}" if known else "it has none"
            raise UsageError(f"--option: {structure} has no option {name!r}; {has}")
