"""Regressors of a NARX model: the lagged signals its orders name, and expressions of the user.

Standard regressors of output i are y_j(t−1) … y_j(t−na_ij) and u_j(t−nk_ij) … u_j(t−nk_ij−nb_ij+1)
(thesis 3.28–3.30); custom ones are expressions in lagged signals. All are evaluated over an array
namespace, sample by sample, along whole records or for many runs at once.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from sysid.data.record import Array, Channel, Index
from sysid.errors import UsageError
from sysid.structures.orders import Orders
from sysid.structures.recursive.expressions import (
    FLOATS,
    Expression,
    Signal,
    evaluate,
    parse,
    replaced,
    signals,
    written,
)

MAX_REGRESSORS = 120
"""Regressors of one output at most: a network in more dimensions finds no neighbours."""

Row = tuple[Expression, ...]


def standard(orders: Orders, output: int) -> Row:
    """The lagged signals that the orders name for one output: its own past, that of others, u."""
    first = sorted(range(orders.ny), key=lambda j: j != output)
    past = [Signal("y", j, k) for j in first for k in range(1, orders.na[output][j] + 1)]
    around = [
        Signal("u", j, orders.nk[output][j] + k)
        for j, n in enumerate(orders.nb[output])
        for k in range(n)
    ]
    return (*past, *around)


def custom(text: str, orders: Orders) -> tuple[Row, ...]:
    """Custom regressors of each output from ``|u|, y*u; …``.

    Expressions are divided by commas, outputs by semicolons; one group serves all outputs. A
    signal without a time stands for each of its standard lags in turn, several in step: ``|u|`` is
    |u(t-1)|, |u(t-2)| … and ``y*u`` is y(t-1)·u(t-1), y(t-2)·u(t-2) … with nk = 1.

    Raises:
        UsageError: an expression cannot be read, or the number of groups is not that of outputs.
    """
    groups = text.split(";")
    if len(groups) not in (1, orders.ny):
        raise UsageError(
            f"--option regressors names those of {len(groups)} outputs but there are {orders.ny}; "
            "divide the outputs by ; or give one group for all"
        )
    groups = groups * orders.ny if len(groups) == 1 else groups
    found = []
    for i, group in enumerate(groups):
        row: dict[Expression, None] = {}
        for part in _parts(group):
            for e in _expanded(parse(part, orders.nu, orders.ny), orders, i, part):
                row[e] = None
        found.append(tuple(e for e in row if e not in standard(orders, i)))
    return tuple(found)


def _parts(group: str) -> list[str]:
    """Pieces between commas that are outside all parentheses; empty ones left out."""
    parts, depth, piece = [], 0, ""
    for c in group:
        depth += (c == "(") - (c == ")")
        if c == "," and depth == 0:
            parts.append(piece)
            piece = ""
        else:
            piece += c
    return [p for p in (*parts, piece) if p.strip()]


def _expanded(e: Expression, orders: Orders, output: int, text: str) -> list[Expression]:
    bare = [s for s in signals(e) if s.lag is None]
    if not bare:
        return [e]
    lags = {s: _usual(s, orders, output) for s in bare}
    count = min(len(v) for v in lags.values())
    if count == 0:
        raise UsageError(
            f"--option regressors: {text.strip()!r} has a signal without a time and the orders "
            "name no lag of it; write one, such as u(t-1)"
        )
    return [
        replaced(e, lambda s, k=k: Signal(s.kind, s.channel, lags[s][k]) if s.lag is None else s)  # type: ignore[misc]
        for k in range(count)
    ]


def _usual(s: Signal, orders: Orders, output: int) -> list[int]:
    own = [r for r in standard(orders, output) if isinstance(r, Signal)]
    return [lag_of(r) for r in own if (r.kind, r.channel) == (s.kind, s.channel)]


def lag_of(s: Signal) -> int:
    """The signal's lag; every regressor has one."""
    if s.lag is None:
        raise ValueError(f"{s} has no lag")
    return s.lag


def largest_lag(rows: Sequence[Row], kind: str, channel: int) -> int:
    """The largest lag of one signal in these regressors, 0 where it does not occur."""
    lags = [
        lag_of(s)
        for row in rows
        for e in row
        for s in signals(e)
        if (s.kind, s.channel) == (kind, channel)
    ]
    return max(lags, default=0)


def holds_output(e: Expression) -> bool:
    """Whether a regressor depends on past outputs, and so on the run itself."""
    return any(s.kind == "y" for s in signals(e))


def columns(row: Row, u: Array, y: Array) -> Array:
    """Values of the regressors at every sample, (N, d); samples before the record count as zero."""
    known = {"y": y, "u": u}

    def lookup(s: Signal) -> Array:
        x, lag = known[s.kind][:, s.channel], lag_of(s)
        out = np.zeros(len(y))
        out[lag:] = x[: len(x) - lag]
        return out

    out = np.empty((len(y), len(row)))
    for k, e in enumerate(row):
        out[:, k] = evaluate(e, lookup, np)
    return out


class Window:
    """Where past samples lie in a state that stacks y_j(t−1) … y_j(t−depth_j), then u_j likewise.

    Args:
        rows: regressors of each output.
        nu: number of inputs.
    """

    def __init__(self, rows: Sequence[Row], nu: int) -> None:
        self.nu, self.ny = nu, len(rows)
        self.y_depth = [largest_lag(rows, "y", j) for j in range(self.ny)]
        self.u_depth = [largest_lag(rows, "u", j) for j in range(nu)]
        self.depth = max(*self.y_depth, 1)
        self.before = max([0, *self.u_depth])
        self.feeds_back = any(self.y_depth)
        starts = np.cumsum([0, *self.y_depth, *self.u_depth]).tolist()
        self.y_at, self.u_at = starts[: self.ny], starts[self.ny : -1]
        self.n_states = int(starts[-1])

    @property
    def first(self) -> int:
        """First sample whose regressors lie inside the record."""
        return max(self.before, *self.y_depth)

    def past(self, x0: Array | None) -> tuple[Array, Array]:
        """State → past outputs (depth, ny) and inputs (before, nu), oldest first."""
        y, u = np.zeros((self.depth, self.ny)), np.zeros((self.before, self.nu))
        if x0 is not None:
            edges = pairwise(np.cumsum([0, *self.y_depth, *self.u_depth]).tolist())
            for k, (a, b) in enumerate(edges):
                past, j = (y, k) if k < self.ny else (u, k - self.ny)
                past[len(past) - (b - a) :, j] = x0[a:b][::-1]
        return y, u

    def state(self, y: Array, u: Array) -> Array:
        """Past outputs and inputs, oldest first and at least as long as needed → state."""
        parts = [
            s[len(s) - n :, j][::-1]
            for s, depths in ((y, self.y_depth), (u, self.u_depth))
            for j, n in enumerate(depths)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def place(self, s: Signal) -> int:
        """Index of a signal in the list of the state followed by the inputs of now."""
        lag = lag_of(s)
        if s.kind == "y":
            return int(self.y_at[s.channel]) + lag - 1
        return self.n_states + s.channel if lag == 0 else int(self.u_at[s.channel]) + lag - 1

    def shift(self) -> Index:
        """Where every entry of x⁺ stands in (x, y, u): one place along, the newest in u and y."""
        n = self.n_states
        source = np.arange(-1, n - 1)
        pool = ((self.y_at, self.y_depth, n), (self.u_at, self.u_depth, n + self.ny))
        for at, depths, first in pool:
            for j, (a, depth) in enumerate(zip(at, depths, strict=True)):
                if depth:
                    source[a] = first + j
        return source


def named(e: Expression, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """The regressor as text with the channels' names."""

    def name(s: Signal) -> str:
        return (inputs if s.kind == "u" else outputs)[s.channel].name

    return written(e, name)


def scalar(e: Expression, place: Callable[[Signal], int]) -> Callable[[list[float]], float]:
    """The regressor as a function of the list that ``Window.place`` indexes."""
    if isinstance(e, Signal):
        at = place(e)
        return lambda known: known[at]

    places = {s: place(s) for s in signals(e)}

    def value(known: list[float]) -> float:
        return float(evaluate(e, lambda s: known[places[s]], FLOATS))

    return value
