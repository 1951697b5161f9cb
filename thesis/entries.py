"""What the report on the thesis is made of: items of the inventory, sheets and their rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.report.missions.plan_drawing import PlanPicture
from sysid.report.panels import Curve, PanelPicture

DRAWN = "drawn"
"""Stands for a published value where the thesis has a curve and prints no number of it."""

AGREES, DISAGREES = "as described", "not so"
"""What a behaviour that is described in words comes to here."""

MISPRINT = "misprint"

MOST_POINTS = 160
"""Points of a line in a picture: more than a panel of 3 in shows."""


class Kind(StrEnum):
    """Whether there is anything to compute."""

    COMPUTED = "computed"
    PICTURE = "photograph or drawing"
    DIAGRAM = "block diagram"
    MISSING = "not computable"


@dataclass(frozen=True)
class Item:
    """One figure or table of the thesis.

    Attributes:
        number: as the thesis numbers it, ``5.8`` or ``Table 5.1``.
        title: its caption in short.
        kind: whether there is anything to compute.
        missing: the datum that is not printed; of an item that is computed as far as it goes, too.
    """

    number: str
    title: str
    kind: Kind
    missing: str = ""


@dataclass(frozen=True)
class Row:
    """One number, curve or outcome.

    Attributes:
        figure: number of its item, or the paragraph of the thesis, ``§5.5``.
        what: in words.
        published, ours, difference: as text, so that they never change by themselves.
        why: the reason of the difference.
    """

    figure: str
    what: str
    published: str
    ours: str
    difference: str
    why: str


@dataclass(frozen=True, eq=False)
class Sheet:
    """A picture, or none, and the rows that belong to it.

    Attributes:
        rows: in the order of the thesis.
        file: of the picture, below ``reports/thesis``; empty where there is none.
        picture: what is drawn.
        drawn_elsewhere: a picture of another report that shows the same, below ``reports``.
    """

    rows: tuple[Row, ...]
    file: str = ""
    picture: PanelPicture | PlanPicture | None = None
    drawn_elsewhere: str = ""


def compared(
    figure: str, what: str, published: float, ours: float, form: str = ".3g", why: str = ""
) -> Row:
    """A row of two numbers and their relative difference.

    Args:
        figure: number of the item.
        what: in words, with the unit.
        published: as printed.
        ours: made here.
        form: format of both; a difference that it does not show is none.
        why: the reason of the difference.
    """
    left, right = number(published, form), number(ours, form)
    if left == right:
        difference = "none"
    elif published == 0:
        difference = number(ours - published, form)
    else:
        percent = 100 * (ours / published - 1)
        difference = number(percent, "+.0f" if abs(percent) >= 10 else "+.2g") + " %"
    return Row(figure, what, left, right, difference, why)


def verdict(holds: bool | np.bool_) -> str:
    """Whether a behaviour is as described."""
    return AGREES if holds else DISAGREES


def falls(values: Sequence[str]) -> bool:
    """Whether numbers at the beginning of each text get smaller from one to the next."""
    numbers = [float(v.split()[0]) for v in values]
    return all(a > b for a, b in pairwise(numbers))


def number(value: float, form: str = ".3g") -> str:
    """A number as text, with a minus sign that is one."""
    return format(float(value) + 0.0, form).replace("-", "−")


def place(x: float, y: float, digits: int = 2) -> str:
    """A point of the plane as text."""
    form = f".{digits}f"
    return f"({number(x, form)}, {number(y, form)})"


def line(
    name: str, x: NDArray[np.float64], y: NDArray[np.float64], reference: bool = False
) -> Curve:
    """A line of a picture with no more points than it can show; steps stay steps."""
    bent = np.abs(np.diff(y, 2)) + np.abs(np.diff(x, 2)) > 1e-9  # between neighbours on a line
    corner = np.flatnonzero(np.concatenate([[True], bent, [True]]))
    step = max(1, -(-len(corner) // MOST_POINTS))
    keep = np.unique(np.append(corner[::step], len(x) - 1))
    return Curve(name, np.asarray(x)[keep], np.asarray(y)[keep], colour=-int(reference))
