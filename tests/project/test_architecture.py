"""The shape of the code: no circles, lazy imports and registries included, and no long file."""

import ast
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PLACES = {"sysid": ROOT / "sysid", "sysid_cli": ROOT / "cli"}

MOST_LINES = 500

ALLOWED = {
    (
        "sysid.structures.registry",
        "sysid.structures.augmented.structure",
    ): "an augmented model may hold a model of any structure, which the registry reads again"
}
"""Imports that would close a circle, each with its reason."""

PLACE = re.compile(r"[a-z_][\w.]*:[A-Za-z_]\w*")
"""``module:object`` as registries write it."""


@cache
def modules() -> Mapping[str, Path]:
    """Every module by its dotted name; a package stands for its ``__init__``."""
    found = {}
    for name, folder in PLACES.items():
        for path in sorted(folder.rglob("*.py")):
            parts = (name, *path.relative_to(folder).with_suffix("").parts)
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def is_package(module: str) -> bool:
    return modules()[module].name == "__init__.py"


def package_of(module: str) -> str:
    return module if is_package(module) else module.rpartition(".")[0]


def imported(module: str) -> Iterator[str]:
    """Modules that a module imports when it runs, at any depth, and those its strings name."""
    tree = ast.parse(modules()[module].read_text(encoding="utf-8"))
    for node in running(tree):
        if isinstance(node, ast.Import):
            yield from (resolved(a.name) for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = node.module or ""
            if node.level:
                base = package_of(module).split(".")
                start = ".".join([*base[: len(base) - node.level + 1], *filter(None, [start])])
            for a in node.names:
                yield resolved(f"{start}.{a.name}")
        elif isinstance(node, ast.Constant) and PLACE.fullmatch(str(node.value)):
            place = str(node.value).partition(":")[0]
            yield resolved(place)
            # a registry may leave out the packages around it
            parts = package_of(module).split(".")
            for k in range(1, len(parts) + 1):
                yield resolved(".".join([*parts[:k], place]), whole=True)


def running(tree: ast.Module) -> Iterator[ast.AST]:
    """All nodes but those that only a type checker reads."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        yield node
        waiting.extend(ast.iter_child_nodes(node))


@cache
def resolved(name: str, whole: bool = False) -> str:
    """The longest beginning of a dotted name that is a module of ours; empty if none is."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        if ".".join(parts[:k]) in modules():
            return ".".join(parts[:k]) if k == len(parts) or not whole else ""
    return ""


def graph() -> dict[str, dict[str, str]]:
    """Module → modules that it needs when it runs, with a sentence that says so."""
    return {
        module: {
            other: f"{module} imports {other}"
            for other in imported(module)
            if other and other != module
        }
        for module in modules()
    }


def circles(edges: Mapping[str, Mapping[str, str]]) -> list[list[str]]:
    """Groups of nodes each of which reaches all others of its group (Tarjan 1972)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(v: str) -> None:
        order[v] = low[v] = len(order)
        stack.append(v)
        for w in edges.get(v, {}):
            if w not in order:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in stack:
                low[v] = min(low[v], order[w])
        if low[v] == order[v]:
            group = []
            while not group or group[-1] != v:
                group.append(stack.pop())
            if len(group) > 1:
                found.append(sorted(group))

    for v in edges:
        if v not in order:
            visit(v)
    return found


@pytest.mark.slow
def test_no_files_need_each_other_not_even_lazily() -> None:
    edges = graph()
    for a, b in ALLOWED:
        assert b in edges[a], f"{a} no longer needs {b}: take it off the list"
        del edges[a][b]
    said = [edges[a][b] for group in circles(edges) for a in group for b in group if b in edges[a]]
    assert not said, "files in a circle:\n" + "\n".join(said)


def test_the_walk_sees_lazy_imports_and_registries() -> None:
    """A test of the test: what lies inside a function or a string is found, too."""
    assert "sysid.estimation.offsets.choice" in set(imported("sysid.estimation.pem"))
    assert "sysid.structures.blocks.hammerstein_wiener" in set(
        imported("sysid.structures.registry")
    )
    assert circles({"a": {"b": ""}, "b": {"c": ""}, "c": {"a": ""}, "d": {"a": ""}}) == [
        ["a", "b", "c"]
    ]


def test_no_file_is_long() -> None:
    long = {
        str(path.relative_to(ROOT))
        for place in (
            *("sysid", "cli", "tests", "benchmarks"),
            *("studies", "thesis", "datasets", "docs", "examples"),
        )
        for path in (ROOT / place).rglob("*.py")
        if len(path.read_text(encoding="utf-8").splitlines()) > MOST_LINES
    }
    assert not long, f"over {MOST_LINES} lines: {sorted(long)}"


def test_no_two_test_files_have_the_same_name() -> None:
    """pytest imports them by their bare names."""
    names = [p.name for p in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


def test_what_a_kind_must_say_is_abstract() -> None:
    """A class that leaves it out cannot be made; it would fail only when it is run."""
    late = [
        m for m, path in modules().items() if "raise NotImplementedError" in path.read_text("utf-8")
    ]
    assert not late
