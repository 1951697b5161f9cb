"""Repetitions in laws: loops on plain numbers, one compiled loop on ``jax.numpy``."""

from collections.abc import Callable
from typing import Any

from sysid.runners.trees import mapped


def compiled(xp: Any) -> bool:
    """Whether numbers are traced, by JAX or to become C: they decide nothing about what is done."""
    return getattr(xp, "__name__", "") == "jax.numpy" or recorded(xp)


def recorded(xp: Any) -> bool:
    """Whether operations are recorded one by one, to become C."""
    return getattr(xp, "__name__", "") == "recorded as C"


def repeated(
    xp: Any, step: Callable[[Any, Any], tuple[Any, Any]], first: Any, rows: Any, begin: int
) -> tuple[Any, Any]:
    """Run ``step(carry, row) → (carry, output)`` over the rows from ``begin`` on.

    Args:
        xp: array namespace; on ``jax.numpy`` it is one compiled loop.
        step: pure.
        rows: a tree whose leaves have the rows along axis 0.

    Returns:
        The last carry, and the outputs, row after row along axis 0.
    """
    rest = mapped(lambda leaf: leaf[begin:], rows)
    if compiled(xp) and not recorded(xp):
        import jax

        return jax.lax.scan(step, first, rest)
    carry, outputs = first, []
    leaf = rest
    while isinstance(leaf, tuple):
        leaf = leaf[0]
    for k in range(len(leaf)):
        carry, output = step(carry, mapped(lambda leaf, k=k: leaf[k], rest))
        outputs.append(output)
    return carry, mapped(lambda *leaves: xp.array(leaves), *outputs)
