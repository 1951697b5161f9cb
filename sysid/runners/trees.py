"""Functions of every number in tuples, named tuples and dicts of one structure."""

from collections.abc import Callable
from typing import Any


def mapped(f: Callable[..., Any], *trees: Any) -> Any:
    """``f`` of every number or array of trees of one structure, as such a tree."""
    first = trees[0]
    if isinstance(first, dict):
        return {key: mapped(f, *(tree[key] for tree in trees)) for key in first}
    if not isinstance(first, tuple):
        return f(*trees)
    parts = [mapped(f, *branches) for branches in zip(*trees, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)


def chosen(condition: Any, one: Any, other: Any, xp: Any) -> Any:
    """``one`` where the condition holds, else ``other``: two states of the same shape."""
    return mapped(lambda a, b: xp.where(condition, a, b), one, other)
