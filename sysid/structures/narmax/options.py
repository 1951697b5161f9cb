"""Options of a NARMAX structure, as users type them."""

from collections.abc import Sequence

from sysid.errors import UsageError
from sysid.structures.difference_equations.monomials import Term, is_noise, parsed
from sysid.structures.difference_equations.options import by_output
from sysid.structures.difference_equations.signals import lagged_signals
from sysid.structures.orders import Orders

SELECTIONS = ("auto", "err", "simulation")
"""What chooses the terms, the usual one first."""


def explicit_terms(text: str, orders: Orders) -> tuple[tuple[Term, ...], ...]:
    """The terms a user names: outputs divided by ``;``, terms by ``,``.

    Raises:
        UsageError: a term cannot be read, stands twice, or has a lag that the orders do not have.
    """
    equations = []
    for i, entries in enumerate(by_output(text, "terms", orders.ny, one_for_all=False)):
        terms = [parsed(entry, orders.nu, orders.ny, i) for entry in entries]
        if len(set(terms)) != len(terms) or not any(not is_noise(t) for t in terms):
            raise UsageError(
                f"`structure_options['terms']`: {','.join(entries)!r} must name at least one term "
                "without e, each once"
            )
        # terms of the process first: they are what the noise terms are added to
        equations.append(tuple(sorted(terms, key=is_noise)))
    require_inside(equations, orders)
    return tuple(equations)


def require_inside(rows: Sequence[Sequence[Term]], orders: Orders) -> None:
    """Refuse terms with lags that the orders do not have."""
    for i, row in enumerate(rows):
        allowed = set(lagged_signals(orders, i))
        for f in (f for t in row for f in t if f.kind != "e"):
            if f not in allowed:
                raise UsageError(
                    f"`structure_options['terms']`: {f.kind}{f.channel + 1}(t-{f.lag}) in the "
                    f"equation of output {i + 1} lies outside na, nb and nk; raise the orders"
                )
