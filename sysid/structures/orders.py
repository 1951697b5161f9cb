"""Orders of polynomial models: read, spread over channels, write."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from types import MappingProxyType
from typing import Any

from sysid.errors import UsageError

Matrix = tuple[tuple[int, ...], ...]
RawOrders = Mapping[str, int | Sequence[int] | Sequence[Sequence[int]]]

MAX_ORDER = 200
"""Largest order or delay accepted: beyond it a polynomial in float64 has no meaning."""

ORDER_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "na": "past outputs in the equation",
        "nb": "input coefficients",
        "nc": "order of the noise's numerator",
        "nd": "order of the noise's denominator",
        "nf": "order of the denominator of each input",
        "nk": "input delay in samples (0: acts at once)",
    }
)
"""What the usual orders are."""


@dataclass(frozen=True)
class Orders:
    """Orders of A y = (B/F) u + (C/D) e (Ljung 1999, eq. 4.33; thesis 3.15).

    Attributes:
        na: lags of output j in the equation of output i, (ny, ny).
        nb: number of B coefficients from input j to output i, (ny, nu).
        nc: order of C per output, (ny,).
        nd: order of D per output, (ny,).
        nf: order of F from input j to output i, (ny, nu).
        nk: input delay in samples, 0 = direct feed-through, (ny, nu).
        constant: whether the last input is the constant 1, whose coefficients are levels.
    """

    na: Matrix
    nb: Matrix
    nc: tuple[int, ...]
    nd: tuple[int, ...]
    nf: Matrix
    nk: Matrix
    constant: bool = False

    @property
    def ny(self) -> int:
        return len(self.na)

    @property
    def nu(self) -> int:
        return len(self.nb[0])

    @property
    def coupled(self) -> bool:
        """Whether some output depends on past values of another."""
        return any(n for i, row in enumerate(self.na) for j, n in enumerate(row) if i != j)

    def value(self, letter: str) -> int | list[int] | list[list[int]]:
        """The order named ``letter`` in its shortest form: a number for one-by-one systems."""
        raw = getattr(self, letter)
        if letter in ("nc", "nd"):
            return int(raw[0]) if self.ny == 1 else list(raw)
        return int(raw[0][0]) if self.ny == 1 and len(raw[0]) == 1 else [list(r) for r in raw]


def parse_orders(text: str) -> dict[str, int | list[list[int]]]:
    """Read ``"na=2 nb=2 nk=1"``; matrices as ``na=1,0;0,1`` (rows by ``;``)."""
    orders: dict[str, int | list[list[int]]] = {}
    for item in text.split():
        name, sign, value = item.partition("=")
        if not sign or not name or not value:
            raise UsageError(
                f'`orders`: cannot read {item!r}; write name=value pairs such as "na=2 nb=2 nk=1"'
            )
        if name in orders:
            raise UsageError(f"`orders`: {name} is given twice; give each order once")
        try:
            rows = [[int(cell) for cell in row.split(",")] for row in value.split(";")]
        except ValueError:
            raise UsageError(
                f"`orders`: {item!r} is not a whole number or a matrix such as {name}=1,0;0,1"
            ) from None
        if len({len(row) for row in rows}) != 1:
            raise UsageError(f"`orders`: the rows of {item!r} differ in length")
        if any(not 0 <= cell <= MAX_ORDER for row in rows for cell in row):
            raise UsageError(f"`orders`: {item!r} must lie between 0 and {MAX_ORDER}")
        scalar = "," not in value and ";" not in value
        orders[name] = rows[0][0] if scalar else rows
    if not orders:
        raise UsageError("`orders` is empty; write for example `orders='na=2 nb=2 nk=1'`")
    return orders


def spread(raw: RawOrders, letters: str, nu: int, ny: int, structure: str) -> Orders:
    """Complete the orders of one structure for ``nu`` inputs and ``ny`` outputs.

    A scalar na stands on the diagonal, the other scalars in every entry. nk defaults to 1; the
    structure's other orders must be given.
    """
    require_names(raw, [f"n{letter}" for letter in letters], structure)
    get = {name: raw.get(name, 1 if name == "nk" else 0) for name in ("na", *_SHAPES)}
    orders = Orders(
        na=_matrix("na", get["na"], ny, ny, diagonal=True),
        nb=_matrix("nb", get["nb"], ny, nu),
        nc=vector("nc", get["nc"], ny),
        nd=vector("nd", get["nd"], ny),
        nf=_matrix("nf", get["nf"], ny, nu),
        nk=_matrix("nk", get["nk"], ny, nu),
    )
    if nu and not any(any(row) for row in orders.nb):
        raise UsageError(f"`orders`: {structure} with nb=0 has no input; give nb of at least 1")
    return orders


def require_names(raw: Mapping[str, Any], needed: Sequence[str], structure: str) -> None:
    """Refuse orders that a structure does not have, and a lack of those it needs beside nk."""
    known = [*needed, "nk"]
    for name in raw:
        if name not in known:
            raise UsageError(
                f"`orders`: {structure} has no order {name!r}; its orders are {' '.join(known)}"
            )
    for name in needed:
        if name not in raw:
            raise UsageError(
                f"`orders`: {structure} needs {name}; give all of {' '.join(needed)} (nk is 1 "
                "unless given)"
            )


_SHAPES = ("nb", "nc", "nd", "nf", "nk")


def _matrix(name: str, value: object, rows: int, columns: int, diagonal: bool = False) -> Matrix:
    if not isinstance(value, list | tuple):
        order = _checked(name, value)
        return tuple(
            tuple(order if not diagonal or i == j else 0 for j in range(columns))
            for i in range(rows)
        )
    cells = _rows(value)
    if len(cells) == columns and rows == 1 and all(len(row) == 1 for row in cells):
        cells = [[row[0] for row in cells]]
    if len(cells) != rows or any(len(row) != columns for row in cells):
        got = f"{len(cells)}x{len(cells[0]) if cells else 0}"
        raise UsageError(
            f"`orders`: {name} must be a number or a {rows}x{columns} matrix (outputs x "
            f"{'outputs' if diagonal else 'inputs'}), got {got}"
        )
    return tuple(tuple(_checked(name, cell) for cell in row) for row in cells)


def vector(name: str, value: object, rows: int) -> tuple[int, ...]:
    """An order each, from a number, a row or a column."""
    if not isinstance(value, list | tuple):
        return (_checked(name, value),) * rows
    flat = [cell for row in _rows(value) for cell in row]
    if len(flat) != rows:
        raise UsageError(f"`orders`: {name} must be a number or {rows} numbers, got {len(flat)}")
    return tuple(_checked(name, cell) for cell in flat)


def require_orders(orders: Mapping[str, Any]) -> None:
    """Refuse orders that no structure can have, in numbers, rows or matrices."""
    for name, value in orders.items():
        for row in _rows(value):
            for cell in row:
                _checked(name, cell)


def _rows(value: Any) -> list[list[Any]]:
    """A number, a row or a matrix as rows."""
    rows = value if isinstance(value, list | tuple) else [value]
    return [list(row) if isinstance(row, list | tuple) else [row] for row in rows]


def _checked(name: str, value: Any) -> int:
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole or not 0 <= int(value) <= MAX_ORDER:
        raise UsageError(f"{name}: orders are whole numbers from 0 to {MAX_ORDER}, got {value!r}")
    return int(value)


def orders_text(orders: Mapping[str, Any]) -> str:
    """``na=2 nb=2 nk=1``, matrices as ``na=1,0;0,1``, as short as they are read back."""
    return " ".join(f"{name}={_shortest(name, _rows(value))}" for name, value in orders.items())


def _shortest(name: str, cells: list[list[Any]]) -> str:
    flat = [c for row in cells for c in row]
    same = len(set(flat)) == 1
    if name == "na" and len(cells) > 1:
        own_values = {row[i] for i, row in enumerate(cells)}
        same = len(own_values) == 1 and sum(flat) == sum(row[i] for i, row in enumerate(cells))
    if same:
        return str(cells[0][0])
    if all(len(row) == 1 for row in cells) and name in ("nc", "nd"):
        return ",".join(str(c) for c in flat)
    return ";".join(",".join(str(c) for c in row) for row in cells)
