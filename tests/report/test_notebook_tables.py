"""What a notebook shows of a result: its figures, and nothing of a name that would act."""

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from mission_cases import Robot
from quick_diagnosis import dead_zone_log, diagnose
from test_mission_page import MISSION, drive

import sysid
from sysid.data.io import read_log
from sysid.outside_text import html_table
from sysid.robot.mission.monte_carlo.runs import simulate_runs


class Words(HTMLParser):
    """The text alone."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.feed(text)

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def words_of(shown: object) -> list[str]:
    return Words(shown._repr_html_()).words  # type: ignore[attr-defined]


def test_a_comparison(tmp_path: Path) -> None:
    log = read_log(dead_zone_log(tmp_path / "log.csv"))
    models = {n: sysid.fit(log, n, o) for n, o in (("arx", "na=1 nb=1"), ("oe", "nb=1 nf=1"))}
    ranking = sysid.compare(log, models)
    words = words_of(ranking)
    assert f"* {ranking.best.contender.id}" in words
    for line in ranking.lines:
        for fit in line.figures["fit_percent"].values():
            assert f"{fit:.2f}" in words


def test_a_record_and_models_in_a_row(tmp_path: Path) -> None:
    log = read_log(dead_zone_log(tmp_path / "log.csv"))
    assert repr(log).startswith("<Record log.csv: ")
    assert "\n" not in repr(log)
    assert {*log.input_names, *log.output_names} <= set(words_of(log))
    model = sysid.fit(log, "arx", "na=1 nb=1")
    ranking = sysid.compare(log, [model])
    assert repr(ranking) == "<Ranking by fit on the log: 1 arx>"
    with pytest.raises(sysid.UsageError, match="is no log"):
        sysid.compare([model], log)  # type: ignore[arg-type]


def test_a_diagnosis(tmp_path: Path) -> None:
    found = diagnose([read_log(dead_zone_log(tmp_path / "log.csv"))], None)
    words = words_of(found)
    assert {e.id for e in found.effects} <= set(words)
    assert repr(found).startswith(f"<Diagnosis {found.verdict}: ")
    assert any(f"{found.gap.closed_percent:.0f} %" in w for w in words)


def test_a_drive_and_many() -> None:
    result = drive()
    assert f"{result.time_s:.4g} s" in words_of(result)
    assert result.sentence in words_of(result)
    batch = simulate_runs(MISSION, [Robot()], 5)
    assert str(batch.outcomes["arrived"].count) in words_of(batch)
    assert batch.sentence in words_of(batch)


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", 'a"b', "x & y"])
def test_names_do_not_act(name: str) -> None:
    text = html_table([(name,)], (name,))
    assert "<script" not in text
    assert Words(text).words == [name, name]
    assert re.fullmatch(r"<table><tr><th scope=\"col\">.*</table>", text)
