"""Structure: what a model is; NamedStructure: one that users choose by name."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any, ClassVar, Self

from sysid.data.record import Array, Channel
from sysid.errors import UsageError
from sysid.fitting.problem import Parameter
from sysid.structures.traits import Traits


@dataclass(frozen=True)
class Structure(ABC):
    """A difference equation whose numbers are one vector θ, and its prediction errors.

        x(t+1) = f(x(t), u(t); θ),  y(t) = g(x(t), u(t); θ)

    Everything is a pure function of θ. Subclasses are frozen dataclasses. How one is fitted stands
    in ``sysid.methods``, other ways to run it in ``special_runs``, its poles in ``motion``, what it
    says of a vehicle in ``physics``.
    """

    name: ClassVar[str] = ""
    traits: ClassVar[Traits]

    @property
    @abstractmethod
    def nu(self) -> int:
        """Number of inputs."""

    @property
    @abstractmethod
    def ny(self) -> int:
        """Number of outputs."""

    @abstractmethod
    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names, units and bounds of θ."""

    @abstractmethod
    def order_values(self) -> dict[str, Any]:
        """Orders in their shortest form."""

    def settings(self) -> dict[str, Any]:
        """What besides orders makes the structure: options, and what was read off the data."""
        return {}

    @abstractmethod
    def n_states(self, theta: Array) -> int:
        """Number of states of the free run."""

    def first_sample(self) -> int:
        """First sample whose one-step prediction needs no value before the record."""
        return 0

    @abstractmethod
    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y): the free run sample by sample.

        Written over the namespace of its arrays, ``xp = x.__array_namespace__()``, it runs in
        NumPy and JAX, and an exporter can record it: C needs nothing else.
        """

    @abstractmethod
    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run from x0 (rest when None): outputs (N, ny), as ``step`` gives them."""

    @abstractmethod
    def stable(self, theta: Array) -> bool:
        """Whether the free run is bounded for bounded inputs."""

    @abstractmethod
    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """State x0 (n_states,) that meets the first ``samples`` of y best in free run."""

    def errors(self, theta: Array, u: Array, y: Array, window: int) -> Array:
        """One-step prediction errors (N, ny): those of the free run where there is no noise model.

        Initial states come from the first ``window`` samples; samples that need values before
        the record are NaN.
        """
        x0 = self.fitted_state(theta, u, y, window) if window else None
        return y - self.simulate(theta, u, x0)

    def predict(self, theta: Array, u: Array, y: Array, horizon: int, window: int) -> Array:
        """k-step-ahead predictions (N, ny), NaN where values before the record are needed."""
        return y - self.errors(theta, u, y, window)

    @abstractmethod
    def gradients(self, theta: Array, u: Array, y: Array) -> Array:
        """∂ŷ/∂θ of the one-step predictions on a record, (ny, N, n), zero rows where NaN."""

    @abstractmethod
    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The equations with their numbers, one line each, as a person would write them."""

    @abstractmethod
    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        """Poles, zeros, static gain …: JSON-able facts that follow from θ, to be shown."""


@dataclass(frozen=True)
class NamedStructure(Structure):
    """A structure that users ask for by its ``name``; the registry holds nothing else."""

    @classmethod
    @abstractmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        """The structure with these orders and options (text, as users type them).

        Raises:
            UsageError: an order or option does not exist, is missing or does not fit.
        """

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Orders worth trying on a log when the user gives none, the smallest first."""
        return ()

    @classmethod
    def orders_said(cls, options: Mapping[str, str]) -> Mapping[str, Any] | None:
        """Orders that options say already; None where none does."""
        return None

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        """What a file says of it, {orders, settings, nu, ny}: undo ``order_values, settings``."""
        return cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]))


@singledispatch
def counts_from_zero(structure: Structure) -> bool:
    """Whether what θ says is about the channels' own zeros, so that nothing may be removed."""
    return structure.traits.physical or structure.traits.from_zero


@singledispatch
def lacks_constant(structure: Structure) -> str:
    """Why a structure that counts from zero has no offset of its own; empty where it has."""
    return ""


def refuse_options(structure: str, options: Mapping[str, str] | None, known: Sequence[str]) -> None:
    """Refuse options that the structure does not have.

    Raises:
        UsageError: there is one; the sentence lists those that exist.
    """
    for name in options or {}:
        if name not in known:
            has = f"its options are {', '.join(known)}" if known else "it has none"
            raise UsageError(f"`structure_options`: {structure} has no option {name!r}; {has}")
