"""Options of a NARMAX structure, as users type them."""

from collections.abc import Mapping, Sequence

from sysid.errors import UsageError
from sysid.structures.orders import Orders
from sysid.structures.recursive.monomials import (
    Term,
    factors_of,
    is_noise,
    parsed,
)

SELECTIONS = ("auto", "err", "simulation")
MARGIN = 0.15
"""How far beyond its training range an output may go in free run, as a share of that range."""


def selection_of(given: Mapping[str, str]) -> str:
    """What chooses the terms; UsageError when it is none of SELECTIONS."""
    selection = given.get("selection", "auto")
    if selection not in SELECTIONS:
        raise UsageError(f"--option selection={selection}: choose one of {', '.join(SELECTIONS)}")
    return selection


def whole_number(given: Mapping[str, str], name: str, low: int, high: int, default: int) -> int:
    """An option that is a whole number; UsageError when it is not one, or out of range."""
    text = given.get(name)
    if text is None or (text == "auto" and name == "degree"):
        return default
    if not text.strip().isdigit() or not low <= int(text) <= high:
        raise UsageError(
            f"--option {name}={text}: narmax needs a whole number from {low} to {high}"
        )
    return int(text)


def margin_of(given: Mapping[str, str]) -> float:
    """The margin of the free run; UsageError when it is no sensible share."""
    text = given.get("margin", str(MARGIN))
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 10.0:
        raise UsageError(f"--option margin={text}: give a share from 0 to 10, such as 0.15")
    return value


def explicit_terms(text: str, orders: Orders) -> tuple[tuple[Term, ...], ...]:
    """The terms a user names: outputs divided by ``;``, terms by ``,``.

    Raises:
        UsageError: a term cannot be read, stands twice, or has a lag that the orders do not have.
    """
    rows = text.split(";")
    if len(rows) != orders.ny:
        raise UsageError(
            f"--option terms names terms of {len(rows)} outputs but there are {orders.ny}; divide "
            "the outputs by ;"
        )
    found = []
    for i, row in enumerate(rows):
        terms = [parsed(part, orders.nu, orders.ny, i) for part in row.split(",") if part]
        if len(set(terms)) != len(terms) or not any(not is_noise(t) for t in terms):
            raise UsageError(
                f"--option terms: {row!r} must name at least one term without e, each once"
            )
        # terms of the process first: they are what the noise terms are added to
        found.append(tuple(sorted(terms, key=is_noise)))
    require_inside(found, orders)
    return tuple(found)


def require_inside(rows: Sequence[Sequence[Term]], orders: Orders) -> None:
    """Refuse terms with lags that the orders do not have."""
    for i, row in enumerate(rows):
        allowed = set(factors_of(orders, i))
        for f in (f for t in row for f in t if f.kind != "e"):
            if f not in allowed:
                raise UsageError(
                    f"--option terms: {f.kind}{f.channel + 1}(t-{f.lag}) in the equation of "
                    f"output {i + 1} lies outside na, nb and nk; raise the orders"
                )
