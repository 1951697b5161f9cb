"""Polynomial terms in lagged signals: what they are called, how they are written and evaluated.

A term is a product of factors such as y(t−1), u₂(t−3) or e(t−1); the empty product is the
constant. Its value at time t is the product of the lagged samples (Billings 2013, eq. 2.8).
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations_with_replacement
from math import comb

import numpy as np

from sysid.data.record import Array, Channel
from sysid.errors import UsageError
from sysid.structures.difference_equations.expressions import (
    Call,
    Expression,
    Number,
    cannot_read,
    parse,
)
from sysid.structures.difference_equations.signals import Signal, lagged_signals
from sysid.structures.orders import Orders

MAX_POOL = 2500
"""Candidate terms an output: beyond it the data could no longer distinguish the products."""


MAX_DEGREE = 6
"""Largest degree of a term: beyond it products of float64 measurements span too many decades."""

Term = tuple[Signal, ...]
"""A product of factors in ascending order; () is the constant."""


def _place(f: Signal) -> tuple[int, int, int]:
    return "yue".index(f.kind), f.channel, f.lag


def term(factors: Sequence[Signal]) -> Term:
    """The product of these factors in the one order in which terms are compared and printed."""
    return tuple(sorted(factors, key=_place))


def pool(orders: Orders, output: int, degree: int) -> tuple[Term, ...]:
    """All monomials up to ``degree`` in the lags of ``output``, the constant first."""
    factors = sorted(lagged_signals(orders, output), key=_place)
    size = comb(len(factors) + degree, degree)
    if size > MAX_POOL:
        raise UsageError(
            f"narmax: degree {degree} in {len(factors)} lagged signals makes {size} candidate "
            f"terms, more than {MAX_POOL}; lower na, nb or `structure_options['degree']`"
        )
    return tuple(
        term(c) for d in range(degree + 1) for c in combinations_with_replacement(factors, d)
    )


def noise_pool(orders: Orders, output: int, lags: int, degree: int) -> tuple[Term, ...]:
    """e(t−1) … e(t−lags) of the output's own errors, alone and, from degree 2 on, times one lag.

    Every noise term holds one error only, so that the predictor is linear in the past errors.
    """
    errors = [Signal("e", output, k) for k in range(1, lags + 1)]
    single: list[Term] = [(e,) for e in errors]
    if degree < 2:
        return tuple(single)
    around = sorted(lagged_signals(orders, output), key=_place)
    return (*single, *(term((f, e)) for e in errors for f in around))


def is_noise(t: Term) -> bool:
    """Whether a term holds a past error."""
    return any(f.kind == "e" for f in t)


def products(signal: Callable[[Signal], Array], one: Array) -> Callable[[Term], Array]:
    """Values of terms where ``signal`` gives those of their factors; each product once."""
    known: dict[Term, Array] = {(): one}

    def value(t: Term) -> Array:
        if t not in known:
            known[t] = value(t[:-1]) * signal(t[-1])
        return known[t]

    return value


def columns(terms: Sequence[Term], u: Array, y: Array, e: Array | None = None) -> Array:
    """Values of the terms at every sample, (N, K); samples before the record count as zero."""
    known = {"y": y, "u": u, "e": np.zeros_like(y) if e is None else e}
    value = products(lambda s: lagged(known[s.kind][:, s.channel], s.lag), np.ones(len(y)))
    out = np.empty((len(y), len(terms)))
    for k, t in enumerate(terms):
        out[:, k] = value(t)
    return out


def lagged(x: Array, lag: int) -> Array:
    """x(t − lag), zero before the record."""
    out = np.zeros_like(x)
    out[lag:] = x[: len(x) - lag]
    return out


# ------------------------------------------------------------------------------- names

_SUPERSCRIPT = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def channel_name(f: Signal, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """The signal's name: its channel's, ``e`` with the output's name for errors."""
    if f.kind == "u":
        return inputs[f.channel].name
    if f.kind == "y":
        return outputs[f.channel].name
    return "e" if len(outputs) == 1 else f"e_{outputs[f.channel].name}"


def typed_name(t: Term, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """``y(t-1)^2*u(t-1)``: the term as a parameter is called; the constant is ``constant``."""
    parts = _written(t, inputs, outputs, "-")
    return "*".join(f"{s}^{power}" if power > 1 else s for s, power in parts) or "constant"


def printed(t: Term, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """``y(t−1)²·u(t−1)``: the term as a person would write it; empty for the constant."""
    parts = _written(t, inputs, outputs, "−")
    return "·".join(s + str(power).translate(_SUPERSCRIPT) * (power > 1) for s, power in parts)


def _written(
    t: Term, inputs: Sequence[Channel], outputs: Sequence[Channel], minus: str
) -> Iterator[tuple[str, int]]:
    """Each signal as text, and its power."""
    for f in dict.fromkeys(t):
        when = "t" if f.lag == 0 else f"t{minus}{f.lag}"
        yield f"{channel_name(f, inputs, outputs)}({when})", t.count(f)


def parsed(text: str, nu: int, ny: int, output: int) -> Term:
    """Read ``y(t-1)^2*u2(t-1)``; y and u without a number are the first channel."""
    if text.strip() == "constant":
        return ()
    factors_of_term = list(_factors(parse(text, nu, ny, "terms", output), text))
    if len(factors_of_term) > MAX_DEGREE:
        raise UsageError(
            f"`structure_options['terms']`: {text!r} has degree {len(factors_of_term)}, at most "
            f"{MAX_DEGREE} is kept"
        )
    errors = [f for f in factors_of_term if f.kind == "e"]
    if len(errors) > 1 or any(f.channel != output for f in errors):
        raise UsageError(
            f"`structure_options['terms']`: {text!r} must hold at most one past error, "
            "the output's own"
        )
    return term(factors_of_term)


def _factors(e: Expression, text: str) -> Iterator[Signal]:
    """The signals whose product an expression is."""
    if isinstance(e, Signal):
        yield e
    elif isinstance(e, Call) and e.name == "*":
        for a in e.args:
            yield from _factors(a, text)
    elif isinstance(e, Call) and e.name == "^" and isinstance(e.args[1], Number):
        yield from list(_factors(e.args[0], text)) * int(e.args[1].value)
    else:
        raise cannot_read("terms", text, "it is no product of signals with a time")
