"""Which reports are older than the code that makes them.

    python benchmarks/stamps.py            # say it in reports/README.md
    python benchmarks/stamps.py FILE ...   # these were made just now: stamp them, and say it

A stamp is a hash of what a report depends on: the script that makes it, every module of the project
that the script leads to (what a registry names by a string included), and the bundled logs.
Docstrings and comments do not count. A script calls ``stamped`` when it has written its report; a
test compares ``reports/README.md`` with the stamps: no report is silently older than the code.
"""

import ast
import hashlib
import json
import re
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
REPORTS = ROOT / "reports"
STAMPS = REPORTS / "stamps.json"
PAGE = REPORTS / "README.md"

MADE_BY: dict[str, tuple[str, str]] = {
    "tour.md": ("tour_report.py", "make reports"),
    "missions.md": ("mission_report.py", "make reports"),
    "motions.md": ("motion_report.py", "make reports"),
    "tuning.md": ("tuning_report.py", "make reports"),
    "thesis.md": ("thesis_report.py", "make reports"),
    "traps.md": ("trap_report.py", "make reports"),
    "structures_on_data.md": ("measured_report.py", "make reports"),
    "published_figures.md": ("published_report.py", "make reports"),
    "methods.md": ("methods_report.py", "make reports"),
    "lumped_or_black_box.md": ("lumped_report.py", "make reports"),
    "control.md": ("study_control.py", "make study"),
    "coverage.md": ("study_coverage.py", "make study"),
    "residual_tests.md": ("study_residual_tests.py", "make study"),
    "robust.md": ("study_robust.py", "make study"),
    "block_oriented.md": ("study_block_oriented.py", "make study"),
    "nonlinear_structures.md": ("study_nonlinear.py", "make study"),
    "nonlinear_tests.md": (
        "study_nonlinear_tests.py",
        "python benchmarks/study_nonlinear_tests.py",
    ),
    "nonlinearity.md": ("study_nonlinearity.py", "python benchmarks/study_nonlinearity.py"),
    "narx_wavelet.md": ("study_narx_wavelet.py", "python benchmarks/study_narx_wavelet.py"),
    "grey_boxes.md": ("study_grey_box.py", "python benchmarks/study_grey_box.py"),
    "diagnose_study.md": ("study_diagnose.py", "make study-diagnose"),
    "physics_diagnose.md": ("study_physics_diagnose.py", "make study-physics"),
    "detectable.md": ("study_detectable.py", "python benchmarks/study_detectable.py"),
    "real_diagnose.md": ("study_real_diagnose.py", "make study-real"),
    "ties.md": ("study_ties.py", "python benchmarks/study_ties.py"),
    "navigation.md": ("study_navigation.py", "make study"),
    "prediction_intervals.md": ("study_missions.py", "make study"),
    "tours.md": ("study_tour.py", "make study"),
    "dynamic_fit.md": ("study_dynamic_fit.py", "python benchmarks/study_dynamic_fit.py"),
    "vehicle_on_data.md": ("study_vehicle.py", "make study"),
    "multibody_diagnosis.md": ("study_multibody_diagnosis.py", "make study"),
    "odd_logs.md": ("study_odd_logs.py", "make study"),
    "multibody.md": ("study_multibody.py", "make study"),
    "ros.md": ("study_ros.py", "python benchmarks/study_ros.py"),
    "benchmark_linear.md": ("bench_linear.py", "make bench"),
    "benchmark_nonlinear.md": ("bench_nonlinear.py", "make bench"),
    "benchmark_diagnose.md": ("bench_diagnose.py", "make bench"),
    "benchmark_missions.md": ("bench_missions.py", "make bench"),
}
"""Report → the script that makes it and the command a person types."""

PYTHON = f"{sys.version_info[0]}.{sys.version_info[1]}"
"""Another Python writes the same code's tree in other words: stamps of two versions differ."""

PLACES = {"sysid": "sysid", "sysid_cli": "cli", "sysid_datasets": "datasets"}
"""Package → its folder; any other name may be a script or a package of scripts beside this one."""

HEAD = """# Reports

Written by the workbench itself; this table by `python benchmarks/stamps.py`. A report is up to
date when nothing it depends on has changed since it was made: code (docstrings and comments aside)
or bundled logs. One that is older still says what was true then; make it again before quoting it.

| report | state | made with |
|---|---|---|
"""

_PLACE = re.compile(r"(?P<module>\w+(\.\w+)*):\w+")


def digest(script: str) -> str:
    """Hash of everything that a script of this folder depends on, 16 hexadecimal digits."""
    total = hashlib.sha256()
    files = sorted(_reached(Path(__file__).resolve().parent / script))
    for file in files:
        total.update(str(file.relative_to(ROOT)).encode())
        total.update(_meaning(file))
    if any(f.is_relative_to(ROOT / "datasets") for f in files):
        for log in sorted((ROOT / "datasets").rglob("*.csv")):
            total.update(_content(log))
    if any(f.is_relative_to(ROOT / "datasets" / "physics") for f in files):
        for source in sorted((ROOT / "datasets" / "physics").glob("*.[ch]")):
            total.update(_content(source))
    return total.hexdigest()[:16]


def stamped(*reports: str | Path) -> None:
    """Note that reports were made just now, and say so in ``reports/README.md``.

    A report written to another place than ``reports/`` is nobody's stamp.
    """
    made = [r.name for r in map(Path, reports) if r.resolve().parent == REPORTS]
    if reports and not made:
        return
    known = stamps()
    for name in made:
        if name in MADE_BY:
            known[name] = digest(MADE_BY[name][0])
    known["python"] = PYTHON
    text = json.dumps(dict(sorted(known.items())), indent=1) + "\n"
    STAMPS.write_text(text, encoding="utf-8", newline="\n")
    PAGE.write_text(page(), encoding="utf-8", newline="\n")


def stamps() -> dict[str, str]:
    """Report → the stamp it was made with."""
    if not STAMPS.is_file():
        return {}
    found: dict[str, str] = json.loads(STAMPS.read_text(encoding="utf-8"))
    return found


def older() -> tuple[str, ...]:
    """The reports that something has changed for since they were made."""
    known = stamps()
    now = {script: digest(script) for script, _ in MADE_BY.values()}
    return tuple(n for n, (script, _) in MADE_BY.items() if known.get(n) != now[script])


def page(late: Sequence[str] | None = None) -> str:
    """The text of ``reports/README.md``; ``late`` are those that are older, if that is known."""
    late = older() if late is None else late
    rows = [
        f"| [{name}]({name}) | {'**older than the code**' if name in late else 'up to date'} "
        f"| `{command}` |"
        for name, (_, command) in MADE_BY.items()
    ]
    return HEAD + "\n".join(rows) + "\n"


def _reached(start: Path) -> set[Path]:
    """The files a script leads to by imports at any depth, itself included."""
    found: set[Path] = set()
    todo = [start]
    while todo:
        file = todo.pop()
        if file not in found:
            found.add(file)
            todo += _leads_to(file)
    return found


@cache
def _leads_to(file: Path) -> frozenset[Path]:
    """The files of the project that a file imports or names, and the packages they stand in."""
    return frozenset(f for name in _named(file) for f in _files(name))


def _named(file: Path) -> frozenset[str]:
    """Modules that a file imports or names as ``module:object`` in a string."""
    names: set[str] = set()
    package = _package(file)
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names.update(a.name for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(p for p in (package if node.level else "", node.module or "") if p)
            names.add(base)
            names.update(f"{base}.{a.name}" for a in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            place = _PLACE.fullmatch(node.value)
            if place:
                names.update((place["module"], f"{package}.{place['module']}"))
    return frozenset(names)


def _package(file: Path) -> str:
    """The dotted package of a file of the product; empty for a script."""
    for package, folder in PLACES.items():
        if file.is_relative_to(ROOT / folder):
            return ".".join([package, *file.relative_to(ROOT / folder).parent.parts])
    return ""


@cache
def _files(name: str) -> tuple[Path, ...]:
    """The file of a module and of the packages it stands in; none for a foreign one."""
    return tuple(file for file in _places(name) if file.is_file())


def _places(name: str) -> Iterator[Path]:
    """Where the file of a module and those of its packages would be."""
    first, *rest = name.split(".")
    folder = ROOT / PLACES[first] if first in PLACES else ROOT / "benchmarks" / first
    for depth in range(len(rest) + 1):
        yield folder.joinpath(*rest[:depth], "__init__.py")
    if rest or first not in PLACES:
        yield folder.joinpath(*rest).with_suffix(".py")


@cache
def _meaning(file: Path) -> bytes:
    """Hash of the code of a file without its docstrings and comments."""
    tree = ast.parse(file.read_bytes())
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [n for n in body if not _is_text(n)]  # type: ignore[attr-defined]
    return hashlib.sha256(ast.dump(tree).encode()).digest()


@cache
def _content(file: Path) -> bytes:
    """A bundled log."""
    return hashlib.sha256(file.read_bytes()).digest()


def _is_text(node: ast.AST) -> bool:
    """Whether a statement is a string that nobody uses: a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def main(names: list[str]) -> int:
    """Stamp the reports named, and write the table."""
    unknown = [n for n in names if Path(n).name not in MADE_BY]
    if unknown:
        print(f"no report {unknown[0]!r}; there are {', '.join(MADE_BY)}", file=sys.stderr)
        return 2
    stamped(*(REPORTS / Path(n).name for n in names))
    late = older()
    print(
        "Make again: " + "; ".join(f"{n} ({MADE_BY[n][1]})" for n in late) if late else "All new."
    )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
