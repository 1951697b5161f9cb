"""The runner of the studies: runs are kept and not made again, options choose among them."""

from pathlib import Path

import pytest

from studies.runner import Study, by_case, finished

STUDY = Study("example", "example.md", runs=3, first=10)
MADE: list[tuple[str, int]] = []


def one(case: str, seed: int) -> tuple[str, int]:
    MADE.append((case, seed))
    return case, 2 * seed


@pytest.fixture(autouse=True)
def none_made() -> None:
    MADE.clear()


def test_finished_runs_are_kept_and_read_back_alike(tmp_path: Path) -> None:
    words = ["--jobs", "1", "--results", str(tmp_path / "kept" / "runs.jsonl")]
    first = by_case(one, ["a", "b"], STUDY.asked("", [*words, "--limit", "2"]))
    assert first == {"a": [["a", 20], ["a", 22]]}
    whole = by_case(one, ["a", "b"], STUDY.asked("", words))
    assert whole == {c: [[c, 2 * s] for s in (10, 11, 12)] for c in "ab"}
    assert len(MADE) == len(set(MADE)) == 6
    assert by_case(one, ["a", "b"], STUDY.asked("", words)) == whole
    assert len(MADE) == 6


def test_only_takes_runs_whose_key_holds_a_text() -> None:
    asked = STUDY.asked("", ["--jobs", "1", "--only", "x", "z 1"])
    wanted = {key: (key, 1) for key in ("x 1", "y 1", "z 1", "z 2")}
    assert list(finished(one, wanted, asked)) == ["x 1", "z 1"]


def test_a_report_ends_with_version_date_command_and_seeds(tmp_path: Path) -> None:
    asked = STUDY.asked("", ["--runs", "2", "--jobs", "9", "-o", str(tmp_path / "page.md")])
    STUDY.write(asked, "# Page\n")
    *_, last = (tmp_path / "page.md").read_text(encoding="utf-8").splitlines()
    assert last.startswith("sysid 0.")
    assert last.endswith(": `python -m studies.example --runs 2`; seeds: 10 to 11.")
