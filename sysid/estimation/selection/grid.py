"""Which orders to try: grids given by the user, and the small default grids of each structure."""

import re
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from sysid.errors import UsageError
from sysid.structures.orders import parse_orders
from sysid.structures.registry import structure_class

RawOrders = dict[str, Any]
MAX_GRID = 5000


def parse_grid(text: str) -> list[RawOrders]:
    """All orders named by ``"na=1:4 nb=2 nk=0:3"``; a range ``low:high`` includes its ends.

    Raises:
        UsageError: the text cannot be read, a range is empty, or the grid is absurdly large.
    """
    choices: dict[str, list[Any]] = {}
    plain: list[str] = []
    for item in text.split():
        name, _, value = item.partition("=")
        if ":" in value:
            low, _, high = value.partition(":")
            if not (low.isdigit() and high.isdigit() and int(low) <= int(high)):
                apart = "; put spaces between orders, no commas" if item.count("=") > 1 else ""
                raise UsageError(
                    f"--orders: {item!r} is not a range such as {name or 'na'}=1:4{apart}"
                )
            if name in choices:
                raise UsageError(f"--orders: {name} is given twice; give each order once")
            choices[name] = list(range(int(low), int(high) + 1))
        else:
            plain.append(item)
    if plain or not choices:
        for name, fixed in parse_orders(" ".join(plain)).items():
            if name in choices:
                raise UsageError(f"--orders: {name} is given twice; give each order once")
            choices[name] = [fixed]
    size = int(np.prod([len(c) for c in choices.values()]))
    if size > MAX_GRID:
        raise UsageError(f"--orders names {size} combinations; at most {MAX_GRID} are searched")
    return [dict(zip(choices, values, strict=True)) for values in product(*choices.values())]


def parse_grids(text: str, names: Sequence[str]) -> dict[str, list[RawOrders]]:
    """Orders to try for each of several structures.

    ``"arx: na=2 nb=2; oe: nb=2 nf=2"`` gives each its own; a structure left out is searched.
    ``"na=2 nb=2 nf=2"`` is one set, from which each takes the orders it has.

    Raises:
        UsageError: the text cannot be read, a structure is not fitted or named twice, or an order
            belongs to none of them.
    """
    heads = list(_HEAD.finditer(text))
    if not heads:
        return _shared_grids(text, names)
    if text[: heads[0].start()].strip():
        raise UsageError(
            f"--orders: {text[: heads[0].start()].strip()!r} stands before the first structure; "
            f'write each behind its own, such as "{names[0]}: …; {names[-1]}: …"'
        )
    ends = [*(h.start() for h in heads[1:]), len(text)]
    grids: dict[str, list[RawOrders]] = {}
    for head, end in zip(heads, ends, strict=True):
        name = head[1].lower()
        if name not in names:
            raise UsageError(
                f"--orders: {name} is not one of the structures to fit: {', '.join(names)}"
            )
        if name in grids:
            raise UsageError(f"--orders: {name} is given twice; give each structure once")
        grids[name] = parse_grid(text[head.end() : end])
    return grids


_HEAD = re.compile(r"(?:^|;)\s*([A-Za-z][\w-]*)\s*:")
"""A structure's name and a colon, at the beginning or behind a semicolon: the semicolons between
the rows of a matrix are followed by digits."""


def _shared_grids(text: str, names: Sequence[str]) -> dict[str, list[RawOrders]]:
    grid = parse_grid(text)
    if len(names) == 1:
        return {names[0]: grid}
    known = {name: structure_class(name).order_names for name in names}
    for order in grid[0]:
        if not any(order in orders for orders in known.values()):
            raise UsageError(f"--orders: none of {', '.join(names)} has an order {order}")
    found = {}
    for name, orders in known.items():
        own = [{k: v for k, v in raw.items() if k in orders} for raw in grid]
        found[name] = [o for k, o in enumerate(own) if o not in own[:k]]
    return found


def default_grid(name: str, nu: int, ny: int, samples: int, nk: Any) -> list[RawOrders]:
    """The orders tried when the user gives none: few, low, and never more than the data bear."""
    largest = _largest_order(nu, ny, samples)
    orders = range(1, largest + 1)
    grid: list[RawOrders] = []
    if name == "arx":
        grid = [{"na": na, "nb": nb} for na, nb in product(range(1, largest + 3), repeat=2)]
    elif name == "armax":
        grid = [
            {"na": n, "nb": nb, "nc": nc}
            for n in orders
            for nb in _numerators(n)
            for nc in sorted({1, min(n, 2), n})
        ]
    elif name == "oe":
        grid = [{"nb": nb, "nf": n} for n in orders for nb in _numerators(n)]
    elif name == "bj":
        grid = [{"nb": n, "nc": noise, "nd": noise, "nf": n} for n in orders for noise in (1, 2)]
    else:
        return [dict(o) for o in structure_class(name).candidate_orders(nu, ny, samples, nk)]
    delayed = [{**o, "nk": nk} for o in grid]
    return [o for o in delayed if _affordable(name, o, nu, ny, samples)]


def _largest_order(nu: int, ny: int, samples: int) -> int:
    by_size = 4 if nu * ny == 1 else 3 if nu * ny <= 4 else 2
    return max(1, min(by_size, samples // (40 * (nu + 1))))


def _numerators(n: int) -> list[int]:
    return sorted({max(n - 1, 1), n, n + 1} if n < 3 else {n - 1, n})


def _affordable(name: str, orders: Mapping[str, Any], nu: int, ny: int, samples: int) -> bool:
    """Whether ten samples stand behind every coefficient of an output."""
    structure = structure_class(name).from_orders(orders, nu, ny)
    per_output = len(_names(structure, nu, ny)) / ny
    return samples >= 10 * per_output + structure.first_sample()


def _names(structure: Any, nu: int, ny: int) -> tuple[Any, ...]:
    from sysid.data.record import Channel

    inputs = [Channel(f"u{k}") for k in range(nu)]
    outputs = [Channel(f"y{k}") for k in range(ny)]
    return tuple(structure.parameters(inputs, outputs))
