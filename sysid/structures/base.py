"""The abstractions of fitting: Parameter, Problem and Structure."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Channel, Index, Record
from sysid.effects.ground import Ground
from sysid.errors import UsageError


class Focus(Enum):
    """What a fit minimises: one-step prediction errors or free-run simulation errors."""

    PREDICTION = "prediction"
    SIMULATION = "simulation"


class Initial(Enum):
    """Where a fit starts each experiment from."""

    AUTO = "auto"
    ZERO = "zero"
    ESTIMATED = "estimated"
    BACKCAST = "backcast"


@dataclass(frozen=True)
class Parameter:
    """One number of a structure: its name, unit and admissible range.

    Attributes:
        name: as users see and type it, e.g. ``a1`` or ``b1[omega_l,pwm_r]``.
        unit: unit, empty for a pure number.
        lower, upper: bounds, infinite when free.
        fixed: the value it is held at, or None when it is estimated.
    """

    name: str
    unit: str = ""
    lower: float = -np.inf
    upper: float = np.inf
    fixed: float | None = None


class Problem(ABC):
    """A least-squares problem min ½‖r(p)‖² that determines some entries of θ.

    p stacks θ[index] and then the initial states, experiment after experiment.

    Attributes:
        index: which entries of the structure's θ this problem determines.
        n_initial: how many initial states follow them in p.
        lengths: how many residuals each stretch of time contributes, in order; noise is not
            correlated across stretches.
        channels: output of each of these stretches.
        counts: which residuals count at all, (M,); None when all do. Those that do not are zero.
    """

    index: Index
    n_initial: int
    lengths: tuple[int, ...]
    channels: tuple[int, ...]
    counts: NDArray[np.bool_] | None = None

    @abstractmethod
    def residual(self, p: Array) -> Array:
        """Errors ε, shape (M,); huge but finite where p is inadmissible."""

    @abstractmethod
    def jacobian(self, p: Array) -> Array:
        """∂ε/∂p, shape (M, len(p))."""

    def initial_columns(self, p: Array) -> Array:
        """∂ε/∂(initial states), shape (M, n_initial): the last columns of the Jacobian."""
        return self.jacobian(p)[:, len(self.index) :]

    def given(self, theta: Array) -> "Problem":
        """This problem when the entries of θ outside ``index`` are those of ``theta``."""
        return self

    def initial_guess(self, theta: Array) -> Array:
        """p with θ's entries and zero initial states."""
        return np.concatenate([theta[self.index], np.zeros(self.n_initial)])


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

    @classmethod
    def applies(cls, record: Record) -> bool:
        """Whether the structure can mean anything for such a record."""
        return True

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

    @abstractmethod
    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """State x0 (n_states,) that meets the first ``samples`` of y best in free run."""

    @abstractmethod
    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run from x0 (rest when None): outputs (N, ny)."""

    @abstractmethod
    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y): the free run sample by sample, from the same states."""

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
