"""Which orders to try: grids given by the user, and the small default grids of each structure."""

from collections.abc import Mapping
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
                raise UsageError(f"--orders: {item!r} is not a range such as {name or 'na'}=1:4")
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
