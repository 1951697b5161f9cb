"""Rounds of one function, in the namespace that a computation is written over."""

from collections.abc import Callable
from typing import Any

import numpy as np

from sysid.runners import floats


def repeated(xp: Any, times: Any, advance: Callable[[Any], Any], x: Any) -> Any:
    """x after ``times`` rounds of ``advance``: one loop where a namespace can say so."""
    if xp is np or xp is floats:
        for _ in range(times):
            x = advance(x)
        return x
    own = getattr(xp, "repeated", None)  # what records a step for an exporter
    if own is not None:
        return own(times, advance, x)
    import jax  # configured already by whoever made the arrays

    return jax.lax.fori_loop(0, times, lambda _, x: advance(x), x)


def bisected(xp: Any, times: int, ends: tuple[Any, Any], beyond: Callable[[Any], Any]) -> Any:
    """Where ``beyond`` changes from false to true between both ends, after so many halvings."""

    def halved(ends: tuple[Any, Any]) -> tuple[Any, Any]:
        low, high = ends
        middle = 0.5 * (low + high)
        passed = beyond(middle)
        return xp.where(passed, low, middle), xp.where(passed, middle, high)

    low, high = repeated(xp, times, halved, ends)
    return 0.5 * (low + high)
