"""Reports that are older than the code say so, and the stamp sees what matters and no more."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import studies

stamps = studies.load("benchmarks/stamps.py")


def test_every_report_has_a_maker_and_every_maker_exists() -> None:
    reports = {p.name for p in stamps.REPORTS.glob("*.md")} - {"README.md"}
    assert reports == set(stamps.MADE_BY)
    for script, _ in stamps.MADE_BY.values():
        assert (studies.ROOT / "benchmarks" / script).is_file()


@pytest.mark.slow
def test_no_report_is_silently_older_than_the_code() -> None:
    if stamps.stamps().get("python") != stamps.PYTHON:
        pytest.skip(
            "the stamps were made by another version of Python, which hashes code differently"
        )
    late = stamps.older()
    said = ", ".join(f"{n}: {stamps.MADE_BY[n][1]}" for n in late)
    assert stamps.PAGE.read_text(encoding="utf-8") == stamps.page(late), (
        f"reports/README.md does not say which reports are older than the code ({said}); make them "
        "again, or say so with: python benchmarks/stamps.py"
    )


def test_every_script_that_writes_a_report_stamps_it() -> None:
    for script, _ in stamps.MADE_BY.values():
        text = (studies.ROOT / "benchmarks" / script).read_text(encoding="utf-8")
        # make_reports.py stamps what its writers return; one table is printed and copied in
        stamped_elsewhere = script.endswith("_report.py") or script == "study_narx_wavelet.py"
        assert stamped_elsewhere or "stamped(" in text, script


def forget() -> None:
    """What the script remembers of files: one process makes many stamps of one state."""
    for cached in (stamps._leads_to, stamps._files, stamps._meaning):
        cached.cache_clear()


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A project of a script and two modules, one of them reached through a string only."""
    for folder in ("benchmarks", "sysid", "datasets"):
        (tmp_path / folder).mkdir()
    write(tmp_path / "benchmarks" / "stamps.py", "")
    write(tmp_path / "benchmarks" / "study.py", "def f():\n    from sysid import table\n")
    write(tmp_path / "sysid" / "__init__.py", "")
    write(tmp_path / "sysid" / "table.py", "KINDS = {'a': 'hidden:Class'}\n")
    write(tmp_path / "sysid" / "hidden.py", "LIMIT = 3\n")
    write(tmp_path / "sysid" / "apart.py", "LIMIT = 5\n")
    forget()
    monkeypatch.setattr(stamps, "ROOT", tmp_path)
    monkeypatch.setattr(stamps, "__file__", str(tmp_path / "benchmarks" / "stamps.py"))
    yield tmp_path
    forget()


def write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "text", "changes"),
    [
        ("sysid/hidden.py", "LIMIT = 4\n", True),
        ("sysid/table.py", "KINDS = {'a': 'hidden:Other'}\n", True),
        ("benchmarks/study.py", "def f():\n    from sysid import table\n    return 1\n", True),
        ("sysid/hidden.py", '"""Said."""\n\nLIMIT = 3  # because\n', False),
        ("sysid/apart.py", "LIMIT = 6\n", False),
    ],
)
def test_a_stamp_changes_with_what_the_report_depends_on(
    project: Path, file: str, text: str, changes: bool
) -> None:
    before = stamps.digest("study.py")
    write(project / file, text)
    forget()
    assert (stamps.digest("study.py") != before) is changes
