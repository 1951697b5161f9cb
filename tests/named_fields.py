"""Fields that a message of the library names, as a script that believes it gives them."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

MARKED = re.compile(r"(?<!`)`([a-z_]+(?:[=\[][^`]*)?)`(?!`)")
"""A field in backticks, with a value or without."""


def arguments(text: str) -> dict[str, Any]:
    """Fields with values: ``"say `inputs='u', ts=0.1`"`` as ``{"inputs": "u", "ts": 0.1}``."""
    found: dict[str, Any] = {}
    for marked in re.findall(r"`([a-z_]+=[^`]*)`", text):
        call: Any = ast.parse(f"f({marked})", mode="eval").body
        found |= {k.arg: ast.literal_eval(k.value) for k in call.keywords}
    return found


def messages(path: Path) -> Iterator[tuple[int, str]]:
    """Every text of a module but its docstrings, formatted ones with X for their values."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    silent: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            silent.add(id(node.value))
        if isinstance(node, ast.JoinedStr):
            silent |= {id(part) for part in ast.walk(node) if part is not node}
    for node in ast.walk(tree):
        if id(node) in silent:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
        elif isinstance(node, ast.JoinedStr):
            yield node.lineno, "".join(map(_part, node.values))


def _part(part: Any) -> str:
    """A text as it is, the call ``argument(ts=…)`` as what it writes, another value as X."""
    if isinstance(part, ast.Constant):
        return str(part.value)
    call = part.value
    if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "argument":
        return f"`{', '.join(f'{k.arg}=X' for k in call.keywords)}`"
    return "X"
