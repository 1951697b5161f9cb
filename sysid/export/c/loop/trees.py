"""Nested tuples, named tuples and dicts as flat rows with names, and back."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from sysid.export.c import names
from sysid.runners.trace.traced import cells_of

Path = tuple[str, ...]
"""Names from the whole to a value."""


def leaves(tree: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Every number or array of a tree, with its place."""
    if isinstance(tree, Mapping):
        parts = [(str(k), v) for k, v in tree.items()]
    elif isinstance(tree, tuple):
        parts = list(zip(getattr(tree, "_fields", map(str, range(len(tree)))), tree, strict=True))
    else:
        yield path, tree
        return
    for name, part in parts:
        yield from leaves(part, (*path, name))


def mapped(tree: Any, change: Callable[[Path, Any], Any], path: Path = ()) -> Any:
    """The same tree with every leaf changed."""
    if isinstance(tree, Mapping):
        return {k: mapped(v, change, (*path, str(k))) for k, v in tree.items()}
    if isinstance(tree, tuple):
        names = getattr(tree, "_fields", None)
        keys = names or tuple(map(str, range(len(tree))))
        parts = [mapped(v, change, (*path, k)) for k, v in zip(keys, tree, strict=True)]
        return type(tree)(*parts) if names else tuple(parts)
    return change(path, tree)


def identifier(path: Path) -> str:
    """A place as a name of C: ``estimate_pose_x``."""
    return names.identifier("_".join(path))


def size(value: Any) -> int:
    """Entries of a leaf; 0 for a single number."""
    cells = cells_of(value)
    return int(cells.size) if cells.ndim else 0
