"""Structure: dynamics that can be fitted; NamedStructure: one that users choose by name."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Self

import numpy as np

from sysid.data.record import Array, Channel, Index
from sysid.errors import UsageError
from sysid.fitting.problem import Parameter
from sysid.structures.dynamics import Dynamics
from sysid.structures.orders import ORDER_WORDS


@dataclass(frozen=True)
class Structure(Dynamics):
    """Dynamics with what a fit is judged by: parameters, prediction errors and their slopes.

    Everything is a pure function of one parameter vector θ. Subclasses are frozen dataclasses.
    Residuals of structures that are not ``linear`` are tested for what a nonlinear model may have
    missed, too.
    """

    order_names: ClassVar[tuple[str, ...]]
    has_noise_model: ClassVar[bool]
    tells: ClassVar[str] = "the response only, no physical parameters"
    """What a person can read off its parameters, in a few words."""
    physical: ClassVar[bool] = False
    """Whether θ counts from the channels' own zeros, so that nothing may be removed from data."""
    linear: ClassVar[bool] = False
    stable_by_meaning: ClassVar[bool] = False
    """Whether unstable parameters mean nothing: such a predictor cannot be evaluated for long."""
    chooses_products: ClassVar[bool] = False
    """Whether a fit chooses among products of past signals."""
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

    @abstractmethod
    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names, units and bounds of θ."""

    @abstractmethod
    def first_sample(self) -> int:
        """First sample whose one-step prediction needs no value before the record."""

    @abstractmethod
    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """State x0 (n_states,) that meets the first ``samples`` of y best in free run."""

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
    def gradient_columns(self, theta: Array, u: Array, y: Array, output: int) -> Array:
        """∂ŷ/∂θ of one output's one-step prediction on a record, (N, k), zero rows where NaN."""

    def gradient_index(self, theta: Array, output: int) -> Index:
        """The k entries of θ that the columns of ``gradient_columns`` belong to; all by default."""
        return np.arange(len(theta))


@dataclass(frozen=True)
class NamedStructure(Structure):
    """A structure that users ask for by its ``name``; the registry holds nothing else."""

    when: ClassVar[str]
    """For which machines and logs, in a few words."""
    options: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Each option that ``from_orders`` accepts, with a sentence."""
    order_words: ClassVar[Mapping[str, str]] = ORDER_WORDS
    """What each order is, in a few words."""
    by_default: ClassVar[bool] = False
    """Whether it is fitted where the user names no structure."""
    search_cost: ClassVar[float] = 1.0
    """Rough cost of fitting one candidate order, against others: the longest searches go first."""
    solved_at_once: ClassVar[bool] = False
    """Whether all candidate orders share one pass of linear algebra, so that none is a start;
    true of ARX and what derives from it."""

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
    def constant_words(cls) -> tuple[Mapping[str, str], ...]:
        """Name, meaning, unit and estimation of each physical constant; none by default."""
        return ()

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        return cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]))


def refuse_options(structure: str, options: Mapping[str, str] | None, known: Sequence[str]) -> None:
    """Refuse options that the structure does not have.

    Raises:
        UsageError: there is one; the sentence lists those that exist.
    """
    for name in options or {}:
        if name not in known:
            has = f"its options are {', '.join(known)}" if known else "it has none"
            raise UsageError(f"`structure_options`: {structure} has no option {name!r}; {has}")
