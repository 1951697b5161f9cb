"""Every function and class has a user: the library, a command, a page, a template or an example."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from source_statements import statements_of

ROOT = Path(__file__).resolve().parents[2]
USERS = ("sysid", "cli", "datasets", "benchmarks", "studies", "thesis", "examples", "docs")

KEPT = {
    "wheel_speeds": "kinematics that vehicle physics is built on: thesis 2.13, inverted",
    "angular_velocity": "the same: after 2.1",
    "to_inertial": "the same: 2.3",
    "to_body": "the same: 2.3",
    "point_velocity": "the same: 2.7",
    "point_acceleration": "the same: 2.9",
    "_repr_html_": "called by notebooks",
    "format_help": "called by typer for --help",
}
"""Known and without a user, with the reason why they stay. Tests alone are no user."""


def definitions(path: Path) -> Iterator[str]:
    """Functions, methods and classes that nothing is wrapped around: a decorator is a user."""
    for node in statements_of(path):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            kinds = {ast.unparse(d).partition("(")[0] for d in node.decorator_list}
            own = kinds <= {"property", "staticmethod", "classmethod", "dataclass", "cache"}
            if own and not node.name.startswith("__"):
                yield node.name


def words() -> Counter[str]:
    """How often each word stands in what could use something, definitions included."""
    found: Counter[str] = Counter()
    suffixes = {".py", ".md", ".j2", ".toml", ".yaml", ".h"}
    files = [p for user in USERS for p in (ROOT / user).rglob("*") if p.suffix in suffixes]
    for path in (*files, *ROOT.glob("*.md"), ROOT / "pyproject.toml"):
        found.update(re.findall(r"\w+", path.read_text(encoding="utf-8")))
    return found


def test_nothing_is_there_for_tests_alone() -> None:
    counted = words()
    sources = [p for package in ("sysid", "cli") for p in sorted((ROOT / package).rglob("*.py"))]
    defined = Counter(name for path in sources for name in definitions(path))
    unused = {name for name, times in defined.items() if counted[name] <= times}
    assert len(defined) > 1000
    assert unused - KEPT.keys() == set(), "delete them, or say here why they stay"
    assert KEPT.keys() <= defined.keys(), "no longer there: take them off the list"
