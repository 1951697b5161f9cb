"""Traits: what the class of a structure says of all its members."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from sysid.data.record import Record
from sysid.structures.orders import ORDER_WORDS


@dataclass(frozen=True, kw_only=True)
class Traits:
    """What users read about a structure, and what decides how it is treated.

    Attributes:
        equation: in one line.
        when: for which machines and logs, in a few words.
        order_names: orders that ``from_orders`` needs.
        order_words: what each order is, in a few words.
        options: each option that ``from_orders`` accepts, with a sentence.
        tells: what a person can read off its parameters, in a few words.
        has_noise_model: whether one-step errors use past outputs, and should be white.
        linear: whether residuals are not tested for what a nonlinear model may have missed.
        physical: whether θ counts from the channels' own zeros, so that nothing may be removed.
        from_zero: the same of what nobody asked to remove.
        stable_by_meaning: whether unstable parameters mean nothing: such a predictor cannot be
            evaluated for long.
        chooses_products: whether a fit chooses among products of past signals.
        takes_inputs: whether it is driven by inputs, not modelling a signal from its own past.
        by_default: whether it is fitted where the user names no structure.
        default_orders: orders to try on records beside those structures; None for none.
        search_cost: rough cost of fitting one candidate order, against others: the longest
            searches go first.
        solved_at_once: whether all candidate orders share one pass of linear algebra, so that none
            is a start.
    """

    title: str
    equation: str
    when: str = ""
    order_names: tuple[str, ...] = ()
    order_words: Mapping[str, str] = field(default_factory=lambda: ORDER_WORDS)
    options: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    tells: str = "the response only, no physical parameters"
    has_noise_model: bool = False
    linear: bool = False
    physical: bool = False
    from_zero: bool = False
    stable_by_meaning: bool = False
    chooses_products: bool = False
    takes_inputs: bool = True
    by_default: bool = False
    default_orders: Callable[[Sequence[Record]], tuple[Mapping[str, Any], ...]] | None = None
    search_cost: float = 1.0
    solved_at_once: bool = False
