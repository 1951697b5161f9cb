"""No function is too long to be read at once."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from source_statements import statements_of

ROOT = Path(__file__).resolve().parents[2]
ROOMS = (
    *("sysid", "cli", "benchmarks", "studies", "thesis"),
    *("datasets", "docs", "examples", "tests"),
)

LONGEST = 60
"""Lines of a function without its docstring: what one screen shows."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def lines_of(function: Function) -> int:
    """Lines of a function without its docstring.

    A signature that declares options of a command line is a table of them, help texts included,
    and is not counted either.
    """
    lines = (function.end_lineno or 0) - function.lineno + 1
    first = function.body[0]
    if ast.get_docstring(function) is not None:
        lines -= (first.end_lineno or 0) - first.lineno + 1
    if any("option(" in ast.unparse(d) for d in defaults(function)):
        lines -= first.lineno - function.lineno
    return lines


def defaults(function: Function) -> list[ast.expr]:
    given = function.args
    return [*given.defaults, *(d for d in given.kw_defaults if d is not None)]


def may_be_long(text: str) -> bool:
    """Whether a ``def`` is so far from the next one at its depth or above, or from the end."""
    heads = [
        (k, len(line) - len(line.lstrip()))
        for k, line in enumerate([*text.splitlines(), "def end"])
        if re.match(r"\s*(async )?(def|class) ", line)
    ]
    return any(
        next(k for k, depth in heads[n + 1 :] if depth <= own) - start > LONGEST
        for n, (start, own) in enumerate(heads[:-1])
    )


def functions() -> Iterator[tuple[str, Function]]:
    """Those of the files in which one may be too long."""
    for path in sorted(p for room in ROOMS for p in (ROOT / room).rglob("*.py")):
        if not may_be_long(path.read_text(encoding="utf-8")):
            continue
        for node in statements_of(path):
            if isinstance(node, Function):
                yield f"{path.relative_to(ROOT).as_posix()}: {node.name}", node


def test_no_function_is_longer_than_a_screen() -> None:
    longer = ((name, f) for name, f in functions() if (f.end_lineno or 0) - f.lineno >= LONGEST)
    assert {name: n for name, f in longer if (n := lines_of(f)) > LONGEST} == {}


def test_docstrings_and_tables_of_options_are_not_counted() -> None:
    text = '"""' + "\n" * 80 + '"""'
    plain = ast.parse(f"def f(x):\n    {text}\n    a = 1\n    return a").body[0]
    command = "def f(\n" + "    x: int = option(1),\n" + "):\n    return x"
    assert isinstance(plain, ast.FunctionDef)
    assert lines_of(plain) == 3
    declared = ast.parse(command).body[0]
    assert isinstance(declared, ast.FunctionDef)
    assert lines_of(declared) == 1
