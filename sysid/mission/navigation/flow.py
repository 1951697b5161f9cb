"""Choices and repetitions in laws: short on plain numbers, traced on ``jax.numpy``."""

from collections.abc import Callable
from typing import Any


def compiled(xp: Any) -> bool:
    """Whether a namespace is traced by JAX, so that both sides of a choice have to be written."""
    return getattr(xp, "__name__", "") == "jax.numpy"


def either(xp: Any, condition: Any, one: Callable[[], Any], other: Callable[[], Any]) -> Any:
    """``one()`` where the condition holds, else ``other()``; one run computes only the chosen.

    Both must give numbers of the same structure and shapes.
    """
    if not compiled(xp):
        return one() if condition else other()
    import jax

    def as_arrays(choice: Callable[[], Any]) -> Callable[[], Any]:
        return lambda: jax.tree.map(lambda leaf: xp.asarray(leaf, float), choice())

    return jax.lax.cond(condition, as_arrays(one), as_arrays(other))


def mapped(f: Callable[..., Any], *trees: Any) -> Any:
    """``f`` of every number or array in tuples and named tuples of one structure."""
    first = trees[0]
    if not isinstance(first, tuple):
        return f(*trees)
    parts = [mapped(f, *branches) for branches in zip(*trees, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)


def repeated(
    xp: Any, step: Callable[[Any, Any], tuple[Any, Any]], first: Any, rows: Any, begin: int
) -> tuple[Any, Any]:
    """Run ``step(carry, row) → (carry, output)`` over the rows from ``begin`` on.

    Args:
        xp: array namespace; on ``jax.numpy`` it is one compiled loop.
        step: pure.
        first: the carry before the first row.
        rows: a tree whose leaves have the rows along axis 0.
        begin: row to begin with.

    Returns:
        The last carry, and the outputs, row after row along axis 0.
    """
    rest = mapped(lambda leaf: leaf[begin:], rows)
    if compiled(xp):
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
