"""Terms that were replaced by the field's words do not return: in text for users, and in names."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from source_statements import tree_of

ROOT = Path(__file__).parents[2]
SOURCES = ("sysid", "cli")

PHRASES = {
    r"\bfore(told|tells?)\b": "predict",
    r"\bwhere it stands\b|\bstands? although\b": "at standstill; stalled under command",
    r"\bof the error went\b": "held-out RMSE fell by",
    r"\bExplains\b.*\bof the gap\b": "without it the held-out error is … times as large",
    r"\bof its usual size\b": "of the typical output",
    r"\bstill follow the inputs\b": "correlated with the inputs",
    r"\banswers? nonlinearly\b": "nonlinear response",
    r"\bto speak of\b": "effect below 2 % of the strongest path's",
    r"\bdata can(not)? serve\b": "data usable",
    r"\bunasked\b": "automatic warnings",
    r"\bname is dropped\b|\bdoes not stand\b": "effect rejected",
    r"\bmodel (that is doubted|to doubt)\b": "model to diagnose",
    r"\bmodel before\b|\bmodel after\b": "original model, augmented model",
    r"\bcannot tell\b": "inconclusive; cannot distinguish",
    r"\(judges\)": "(validation)",
    r"\bthat tell it\b": "estimates agree across logs",
    r"\bplain(er|est)\b": "baseline; simplest",
    r"\btold apart\b|\btells? (\w+ ){1,4}apart\b": "distinguished",
    r"\bfits only in part\b": "partly explained",
    r"\berrors are loud\b": "residuals far above the noise",
    r"\bnobody knows\b": "(cut)",
    r"\bruntime that is here\b": "every installed runtime",
    r"\bAs of the command\b|\bWhere to\b": "workspace folder; output path",
    r"\bacts? together\b": "interactions",
    r"\bturns about one point\b": "centre of rotation",
    r"\bwould prove nothing\b": "the validation log must differ from the estimation log",
    r"\bleave \S+ away\b": "omit",
    r"\bwith a meaning\b": "physical parameters",
    r"\bfor the purpose to say\b": "depends on the application",
    r"\bis no file\b|\btells? nothing\b": "file not found",
}
"""Former phrase → what stands in its place."""

NAMES = (
    *("NamingSearch", "Naming", "Named", "Warm", "warm", "valued", "head_window"),
    *("Contest", "run_contest", "contest", "Standings", "standings", "Course", "Drawing", "Draws"),
    *("put_right", "tied_readings", "again", "finished", "_Last", "mends", "case_of", "Little"),
    *("surprises", "foretold", "uneven_delay", "slots", "lanes", "supermodel", "walkers"),
    *("discrepancy", "proof", "recursive", "estimated_level", "loud", "audible", "FEWEST.*"),
)
"""Former names of classes, functions, modules and constants, as regular expressions."""


def test_text_for_users_has_none_of_the_former_phrases() -> None:
    former = re.compile("|".join(PHRASES))
    found = {
        f"{where}: {match[0]}"
        for where, text in (*_sources()[0], *_pages())
        for match in former.finditer(" ".join(text.split()))
    }
    assert not found, "\n".join(sorted(found))


def test_no_class_function_module_or_constant_has_a_former_name() -> None:
    former = re.compile("|".join(NAMES))
    found = [f"{where}: {name}" for where, name in _sources()[1] if former.fullmatch(name)]
    assert not found, "\n".join(found)


@cache
def _sources() -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """(place, text) of string constants; (place, name) of all that has a name at its definition."""
    texts, names = [], []
    for path in (p for folder in SOURCES for p in (ROOT / folder).rglob("*.py")):
        where = str(path.relative_to(ROOT))
        names.append((where, path.parent.name if path.stem == "__init__" else path.stem))
        tree = tree_of(path)
        for statement in tree.body:
            targets = statement.targets if isinstance(statement, ast.Assign) else ()
            names += [(where, t.id) for t in targets if isinstance(t, ast.Name)]
        docstrings = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Expr):
                docstrings.add(node.value)
            elif isinstance(node, ast.ClassDef | ast.FunctionDef):
                names.append((f"{where}:{node.lineno}", node.name))
            elif isinstance(value := getattr(node, "value", None), str) and node not in docstrings:
                texts.append((f"{where}:{node.lineno}", value))
    return texts, names


def _pages() -> Iterator[tuple[str, str]]:
    """(file, text) of templates and pages."""
    templates = (p for p in (ROOT / "sysid").rglob("*") if p.suffix in (".j2", ".md"))
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs/structures").glob("*.md")]
    for path in (*templates, *pages, ROOT / "README.md"):
        yield str(path.relative_to(ROOT)), path.read_text("utf-8")
