"""Which orders to try: grids given by the user, and the small default grids of each structure."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from sysid.data.delay import estimate_delays
from sysid.data.record import Record
from sysid.errors import DataError, UsageError
from sysid.structures.base import structure_class
from sysid.structures.orders import parse_orders

RawOrders = dict[str, Any]
MAX_GRID = 5000
LONGEST_DELAY = 30


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


def delays(records: Sequence[Record]) -> list[Any]:
    """Input delays worth trying: the estimated one first, its neighbours where it is uncertain.

    A number when all pairs agree, else a matrix (outputs × inputs). Pairs without visible effect
    take the commonest delay.
    """
    try:
        longest = min(LONGEST_DELAY, max(min(len(r) for r in records) // 20, 2))
        found = estimate_delays(records, longest)
    except DataError:
        return [1]
    ny, nu = records[0].ny, records[0].nu
    known = [d.delay for d in found if d.delay is not None]
    common = int(np.median(known)) if known else 1
    table = {(d.output, d.input): d for d in found}
    names = [(o, i) for o in records[0].output_names for i in records[0].input_names]
    best = [common if table[n].delay is None else int(table[n].delay or 0) for n in names]
    if len(set(best)) > 1:
        matrix = np.array(best).reshape(ny, nu).tolist()
        return [matrix, common]
    low = min((d.low for d in found if d.delay is not None), default=common)
    high = max((d.high for d in found if d.delay is not None), default=common)
    near = [k for k in (common - 1, common + 1) if max(low, 0) <= k <= high]
    return [common, *near]


def default_grid(name: str, nu: int, ny: int, samples: int, nks: Sequence[Any]) -> list[RawOrders]:
    """The orders tried when the user gives none: few, low, and never more than the data bear."""
    largest = _largest_order(nu, ny, samples)
    grid: list[RawOrders] = []
    for nk in nks:
        if name == "arx":
            grid += [
                {"na": na, "nb": nb, "nk": nk}
                for na, nb in product(range(1, largest + 3), repeat=2)
            ]
        elif name == "armax":
            grid += [
                {"na": n, "nb": nb, "nc": nc, "nk": nk}
                for n in range(1, largest + 1)
                for nb in _numerators(n)
                for nc in sorted({1, min(n, 2), n})
            ]
        elif name == "oe":
            grid += [
                {"nb": nb, "nf": n, "nk": nk}
                for n in range(1, largest + 1)
                for nb in _numerators(n)
            ]
        elif name == "bj":
            grid += [
                {"nb": n, "nc": nc, "nd": nd, "nf": n, "nk": nk}
                for n in range(1, largest + 1)
                for nc, nd in ((1, 1), (2, 2))
            ]
        else:
            own = structure_class(name).candidate_orders(nu, ny, samples, nk)
            grid += [dict(orders) for orders in own]
    return [o for o in grid if _affordable(name, o, nu, ny, samples)]


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
