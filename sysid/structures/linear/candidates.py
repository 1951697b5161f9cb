"""Orders of polynomial structures that are tried when the user gives none."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

from sysid.data.record import Channel

if TYPE_CHECKING:
    from sysid.structures.linear.polynomial import PolynomialStructure

EQUATIONS_EACH = 10
"""Samples that stand behind every coefficient of an output."""

Orders = Mapping[str, Any]


def affordable(
    cls: "type[PolynomialStructure]",
    grid: Sequence[Orders],
    nu: int,
    ny: int,
    samples: int,
    nk: Any,
) -> tuple[Orders, ...]:
    """The orders of a grid that the data bear, delayed; the lowest ones where they bear none.

    Args:
        grid: orders without delay.
        nu, ny: number of inputs and outputs.
        samples: N.
        nk: delay of each pair.
    """
    delayed = [{**o, "nk": nk} for o in grid]
    kept = tuple(o for o in delayed if _bears(cls, o, nu, ny, samples))
    # a record that bears no order at all still gets the lowest one: the fit itself will refuse
    return kept or (dict.fromkeys(cls.traits.order_names, 1),)


def denominator_orders(nu: int, ny: int, samples: int) -> range:
    """1 … 4 of a single pair, fewer of several or of a short record."""
    return range(1, _largest(nu, ny, samples) + 1)


def numerators(n: int) -> list[int]:
    """Numbers of numerator coefficients that go with a denominator of order n."""
    return sorted({max(n - 1, 1), n, n + 1} if n < 3 else {n - 1, n})


def arx_grid(nu: int, ny: int, samples: int) -> list[Orders]:
    """Every pair up to two more than the others get: it costs next to nothing."""
    orders = range(1, _largest(nu, ny, samples) + 3)
    return [{"na": na, "nb": nb} for na, nb in product(orders, repeat=2)]


def _largest(nu: int, ny: int, samples: int) -> int:
    by_size = 4 if nu * ny == 1 else 3 if nu * ny <= 4 else 2
    return max(1, min(by_size, samples // (40 * (nu + 1))))


def _bears(
    cls: "type[PolynomialStructure]", orders: Orders, nu: int, ny: int, samples: int
) -> bool:
    structure = cls.from_orders(orders, nu, ny)
    inputs = [Channel(f"u{k}") for k in range(nu)]
    outputs = [Channel(f"y{k}") for k in range(ny)]
    each = len(structure.parameters(inputs, outputs)) / ny
    return samples >= EQUATIONS_EACH * each + structure.first_sample()
