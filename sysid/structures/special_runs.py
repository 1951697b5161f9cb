"""Other ways to run a structure: each follows from its step unless its family has a better one.

A family registers a function with ``@readout.register`` and the like, whose first argument is
annotated with its class.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.structures.base import Structure


@singledispatch
def rest(structure: Structure, theta: Array) -> Array:
    """State in which nothing moves at the operating point, (n_states,)."""
    return np.zeros(structure.n_states(theta))


@singledispatch
def readout(structure: Structure, theta: Array) -> Callable[[Array, Array], Array]:
    """(x, u) → y alone, as ``step`` gives it; a step of its own unless y comes cheaper."""
    step = structure.step(theta)
    return lambda x, u: step(x, u)[1]


@singledispatch
def traced_step(
    structure: Structure, theta: Any, like: Array
) -> Callable[[Any, Any], tuple[Any, Any]]:
    """``step`` of a θ whose numbers a compiler traces, for many θ in one compiled run.

    By default ``step`` itself: enough where it takes θ apart with functions of
    ``theta.__array_namespace__()``. What fails is run one after the other instead.

    Args:
        theta: traced, (n,).
        like: a θ of numbers; x has the states that it has.
    """
    return structure.step(theta)


@singledispatch
def stable_each(structure: Structure, thetas: Array) -> NDArray[np.bool_]:
    """``stable`` of every row of thetas (K, n), (K,) of bool."""
    return np.array([structure.stable(theta) for theta in thetas], dtype=bool)


@singledispatch
def stable_parts(structure: Structure) -> tuple[Index, ...]:
    """Entries of θ of each part that is stable or not by itself, such as the path of an input;
    none where stability is a matter of the whole."""
    return ()


@dataclass(frozen=True)
class CStep:
    """One step of a model as C99.

    The body finds the inputs as deviations from the operating point in ``v[]``, the states in
    ``x[]`` (zero at rest), and adds the outputs to ``out[]``; then it advances ``x[]``. The names
    ``state``, ``u`` and ``y`` are taken.

    Attributes:
        words: lines of the comment at the head of the file: how the code works.
        body: lines between reading the inputs and writing the outputs.
        support: constant tables and functions that the body needs.
    """

    n_states: int
    words: tuple[str, ...]
    body: tuple[str, ...]
    support: tuple[str, ...] = ()


@singledispatch
def c_step(structure: Structure, theta: Array) -> CStep | None:
    """C of its own for a step; None: it is recorded from ``step``."""
    return None
