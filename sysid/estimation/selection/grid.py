"""Read the orders to try, as users write them."""

import re
from collections.abc import Sequence
from itertools import product
from math import prod
from typing import Any

from sysid.errors import UsageError
from sysid.outside_text import whole
from sysid.structures.orders import MAX_ORDER, parse_orders
from sysid.structures.registry import structure_class

RawOrders = dict[str, Any]
MAX_GRID = 5000


def parse_grid(text: str) -> list[RawOrders]:
    """All orders named by ``"na=1:4 nb=2 nk=0:3"``; a range ``low:high`` includes its ends."""
    choices: dict[str, list[Any]] = {}
    plain: list[str] = []
    for item in text.split():
        name, _, value = item.partition("=")
        if ":" in value:
            low, _, high = value.partition(":")
            first, last = whole(low), whole(high)
            if first is None or last is None or not first <= last <= MAX_ORDER:
                apart = "; put spaces between orders, no commas" if item.count("=") > 1 else ""
                raise UsageError(
                    f"`orders`: {item!r} is not a range such as {name or 'na'}=1:4, up to "
                    f"{MAX_ORDER}{apart}"
                )
            if name in choices:
                raise UsageError(f"`orders`: {name} is given twice; give each order once")
            choices[name] = list(range(first, last + 1))
        else:
            plain.append(item)
    if plain or not choices:
        for name, fixed in parse_orders(" ".join(plain)).items():
            if name in choices:
                raise UsageError(f"`orders`: {name} is given twice; give each order once")
            choices[name] = [fixed]
    size = prod(len(c) for c in choices.values())
    if size > MAX_GRID:
        raise UsageError(f"`orders` names {size} combinations; at most {MAX_GRID} are searched")
    return [dict(zip(choices, values, strict=True)) for values in product(*choices.values())]


def parse_grids(text: str, names: Sequence[str]) -> dict[str, list[RawOrders]]:
    """Orders to try for each of several structures.

    ``"arx: na=2 nb=2; oe: nb=2 nf=2"`` gives each its own; a structure left out is searched.
    ``"na=2 nb=2 nf=2"`` is one set, from which each takes the orders it has.
    """
    heads = list(_HEAD.finditer(text))
    if not heads:
        return _shared_grids(text, names)
    if text[: heads[0].start()].strip():
        raise UsageError(
            f"`orders`: {text[: heads[0].start()].strip()!r} comes before the first structure; "
            f'write orders behind their structure, such as "{names[0]}: …; {names[-1]}: …"'
        )
    ends = [*(h.start() for h in heads[1:]), len(text)]
    grids: dict[str, list[RawOrders]] = {}
    for head, end in zip(heads, ends, strict=True):
        name = head[1].lower()
        if name not in names:
            raise UsageError(
                f"`orders`: {name} is not one of the structures to fit: {', '.join(names)}"
            )
        if name in grids:
            raise UsageError(f"`orders`: {name} is given twice; give each structure once")
        grids[name] = parse_grid(text[head.end() : end])
    return grids


_HEAD = re.compile(r"(?:^|;)\s*([A-Za-z][\w-]*)\s*:")
"""A structure's name and a colon, at the beginning or behind a semicolon: the semicolons between
the rows of a matrix are followed by digits."""


def _shared_grids(text: str, names: Sequence[str]) -> dict[str, list[RawOrders]]:
    grid = parse_grid(text)
    if len(names) == 1:
        return {names[0]: grid}
    known = {name: structure_class(name).traits.order_names for name in names}
    for order in grid[0]:
        if not any(order in orders for orders in known.values()):
            raise UsageError(f"`orders`: none of {', '.join(names)} has an order {order}")
    grids = {}
    for name, orders in known.items():
        grid_of_structure = [{k: v for k, v in raw.items() if k in orders} for raw in grid]
        grids[name] = [o for k, o in enumerate(grid_of_structure) if o not in grid_of_structure[:k]]
    return grids
