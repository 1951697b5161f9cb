"""Regressors of a model: the lagged signals its orders name, and expressions of the user.

Standard regressors of output i are y_j(t−1) … y_j(t−na_ij) and u_j(t−nk_ij) … u_j(t−nk_ij−nb_ij+1)
(thesis 3.28–3.30); custom ones are expressions in lagged signals. All are evaluated over an array
namespace, sample by sample, along whole records or for many runs at once.
"""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Channel
from sysid.errors import UsageError
from sysid.structures.difference_equations.expressions import (
    EveryLag,
    Expression,
    evaluate,
    parse,
    replaced,
    signals,
    without_time,
    written,
)
from sysid.structures.difference_equations.monomials import lagged
from sysid.structures.difference_equations.signals import lagged_signals
from sysid.structures.options import by_output
from sysid.structures.orders import Orders

MAX_REGRESSORS = 120
"""Regressors of one output at most: a network in more dimensions finds no neighbours."""

Row = tuple[Expression, ...]


def custom(text: str, orders: Orders) -> tuple[Row, ...]:
    """Custom regressors of each output from ``|u|, y*u; …``.

    Expressions are divided by commas, outputs by semicolons; one group serves all outputs. A
    signal without a time stands for each of its standard lags in turn, several in step: ``|u|`` is
    |u(t-1)|, |u(t-2)| … and ``y*u`` is y(t-1)·u(t-1), y(t-2)·u(t-2) … with nk = 1.
    """
    expressions = []
    for i, entries in enumerate(by_output(text, "regressors", orders.ny, one_for_all=True)):
        row: dict[Expression, None] = {}
        for entry in entries:
            row |= dict.fromkeys(_expanded(parse(entry, orders.nu, orders.ny), orders, i, entry))
        standard = lagged_signals(orders, i)
        expressions.append(tuple(e for e in row if e not in standard))
    return tuple(expressions)


def _expanded(e: Expression, orders: Orders, output: int, text: str) -> list[Expression]:
    lags_of_output = lagged_signals(orders, output)
    lags = {
        s: [r for r in lags_of_output if (r.kind, r.channel) == (s.kind, s.channel)]
        for s in without_time(e)
    }
    if not lags:
        return [e]
    count = min(len(v) for v in lags.values())
    if count == 0:
        raise UsageError(
            f"`structure_options['regressors']`: {text.strip()!r} has a signal without a time and "
            "the orders name no lag of it; write one, such as u(t-1)"
        )
    return [replaced(e, EveryLag, lambda s, k=k: lags[s][k]) for k in range(count)]  # type: ignore[misc]


def holds_output(e: Expression) -> bool:
    """Whether a regressor depends on past outputs, and so on the run itself."""
    return any(s.kind == "y" for s in signals(e))


def columns(row: Row, u: Array, y: Array) -> Array:
    """Values of the regressors at every sample, (N, d); samples before the record count as zero."""
    known = {"y": y, "u": u}
    out = np.empty((len(y), len(row)))
    for k, e in enumerate(row):
        out[:, k] = evaluate(e, lambda s: lagged(known[s.kind][:, s.channel], s.lag), np)
    return out


def named(e: Expression, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """The regressor as text with the channels' names."""
    return written(e, lambda s: (inputs if s.kind == "u" else outputs)[s.channel].name)
