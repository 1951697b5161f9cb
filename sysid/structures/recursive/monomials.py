"""Polynomial terms in lagged signals: what they are called, how they are written and evaluated.

A term is a product of factors such as y(t−1), u₂(t−3) or e(t−1); the empty product is the
constant. Its value at time t is the product of the lagged samples (Billings 2013, eq. 2.8).
"""

import re
from collections.abc import Sequence
from itertools import combinations_with_replacement
from math import comb
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array, Channel
from sysid.errors import UsageError
from sysid.structures.orders import Orders

MAX_POOL = 2500
"""Candidate terms an output: beyond it the products outgrow the data that could tell them apart."""


class Factor(NamedTuple):
    """One lagged signal: kind ``y``, ``u`` or ``e``, its channel, its lag in samples."""

    kind: str
    channel: int
    lag: int


Term = tuple[Factor, ...]
"""A product of factors in ascending order; () is the constant."""


def term(factors: Sequence[Factor]) -> Term:
    """The product of these factors in the one order in which terms are compared and printed."""
    return tuple(sorted(factors, key=lambda f: ("yue".index(f.kind), f.channel, f.lag)))


def factors_of(orders: Orders, output: int) -> tuple[Factor, ...]:
    """The lagged signals that the equation of ``output`` may use."""
    past = [Factor("y", j, k) for j, n in enumerate(orders.na[output]) for k in range(1, n + 1)]
    around = [
        Factor("u", j, orders.nk[output][j] + k)
        for j, n in enumerate(orders.nb[output])
        for k in range(n)
    ]
    return (*past, *around)


def pool(orders: Orders, output: int, degree: int) -> tuple[Term, ...]:
    """All monomials up to ``degree`` in the lags of ``output``, the constant first.

    Raises:
        UsageError: there are more than MAX_POOL of them.
    """
    factors = factors_of(orders, output)
    size = comb(len(factors) + degree, degree)
    if size > MAX_POOL:
        raise UsageError(
            f"narmax: degree {degree} in {len(factors)} lagged signals makes {size} candidate "
            f"terms, more than {MAX_POOL}; lower na, nb or --option degree"
        )
    return tuple(
        term(c) for d in range(degree + 1) for c in combinations_with_replacement(factors, d)
    )


def noise_pool(orders: Orders, output: int, lags: int, degree: int) -> tuple[Term, ...]:
    """e(t−1) … e(t−lags) of the output's own errors, alone and, from degree 2 on, times one lag.

    Every noise term holds one error only, so that the predictor is linear in the past errors.
    """
    errors = [Factor("e", output, k) for k in range(1, lags + 1)]
    single: list[Term] = [(e,) for e in errors]
    if degree < 2:
        return tuple(single)
    return (*single, *(term((f, e)) for e in errors for f in factors_of(orders, output)))


def is_noise(t: Term) -> bool:
    """Whether a term holds a past error."""
    return any(f.kind == "e" for f in t)


def largest_lag(terms: Sequence[Term], kind: str, channel: int) -> int:
    """The largest lag of one signal in these terms, 0 where it does not occur."""
    lags = [f.lag for t in terms for f in t if f.kind == kind and f.channel == channel]
    return max(lags, default=0)


def columns(terms: Sequence[Term], u: Array, y: Array, e: Array | None = None) -> Array:
    """Values of the terms at every sample, (N, K); samples before the record count as zero."""
    signals = {"y": y, "u": u, "e": np.zeros_like(y) if e is None else e}
    known: dict[Term, Array] = {(): np.ones(len(y))}

    def value(t: Term) -> Array:
        if t not in known:
            known[t] = value(t[:-1]) * lagged(signals[t[-1].kind][:, t[-1].channel], t[-1].lag)
        return known[t]

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


def _powers(t: Term) -> list[tuple[Factor, int]]:
    found: dict[Factor, int] = {}
    for f in t:
        found[f] = found.get(f, 0) + 1
    return list(found.items())


def channel_name(f: Factor, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """The signal's name: its channel's, ``e`` with the output's name for errors."""
    if f.kind == "u":
        return inputs[f.channel].name
    if f.kind == "y":
        return outputs[f.channel].name
    return "e" if len(outputs) == 1 else f"e_{outputs[f.channel].name}"


def typed_name(t: Term, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """``y(t-1)^2*u(t-1)``: the term as a parameter is called; the constant is ``constant``."""
    parts = []
    for f, power in _powers(t):
        when = "t" if f.lag == 0 else f"t-{f.lag}"
        raised = "" if power == 1 else f"^{power}"
        parts.append(f"{channel_name(f, inputs, outputs)}({when}){raised}")
    return "*".join(parts) or "constant"


def printed(t: Term, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """``y(t−1)²·u(t−1)``: the term as a person would write it; empty for the constant."""
    parts = []
    for f, power in _powers(t):
        when = "t" if f.lag == 0 else f"t−{f.lag}"
        raised = "" if power == 1 else str(power).translate(_SUPERSCRIPT)
        parts.append(f"{channel_name(f, inputs, outputs)}({when}){raised}")
    return "·".join(parts)


_FACTOR = re.compile(r"([yue])(\d*)\(t(?:-(\d+))?\)(?:\^(\d+))?")


def parsed(text: str, nu: int, ny: int, output: int) -> Term:
    """Read ``y(t-1)^2*u2(t-1)``; y and u without a number are the first channel.

    Raises:
        UsageError: the text is no such product, or names a channel that is not there.
    """
    if text == "constant":
        return ()
    found: list[Factor] = []
    for part in text.split("*"):
        match = _FACTOR.fullmatch(part)
        if match is None:
            raise UsageError(
                f"--option terms: cannot read {part!r} in {text!r}; write products such as "
                '"y(t-1)^2*u2(t-1)", or constant'
            )
        kind, number, lag, power = match.groups()
        channel = output if kind == "e" and not number else int(number or 1) - 1
        f = Factor(kind, channel, int(lag or 0))
        if not 0 <= channel < (nu if kind == "u" else ny):
            raise UsageError(f"--option terms: {part!r} names a channel that is not there")
        if f.kind != "u" and f.lag == 0:
            raise UsageError(f"--option terms: {part!r} is what the equation is to give; lag it")
        found += [f] * int(power or 1)
    if len(found) > MAX_DEGREE:
        raise UsageError(
            f"--option terms: {text!r} has degree {len(found)}, at most {MAX_DEGREE} is kept"
        )
    if sum(f.kind == "e" for f in found) > 1 or any(
        f.kind == "e" and f.channel != output for f in found
    ):
        raise UsageError(
            f"--option terms: {text!r} must hold at most one past error, the output's own"
        )
    return term(found)


MAX_DEGREE = 6


def to_json(t: Term) -> list[list[object]]:
    """The term as JSON: [[kind, channel, lag], …]."""
    return [[f.kind, f.channel, f.lag] for f in t]


def from_json(raw: Sequence[Sequence[object]]) -> Term:
    """Undo ``to_json``."""
    found = []
    for kind, channel, lag in raw:
        if kind not in ("y", "u", "e"):
            raise ValueError(f"unknown signal {kind!r} in a term")
        found.append(Factor(str(kind), int(str(channel)), int(str(lag))))
    return term(found)
