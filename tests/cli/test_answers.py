"""Answers fit a screen: at most 24 lines of 80 columns, whatever is wrong."""

import re
from pathlib import Path

import pytest
import sysid_datasets
from command_line import Capture, run
from sysid_cli.answer import LINES, Answer
from sysid_cli.render import column_widths

LOGS = Path(sysid_datasets.__file__).parent / "devastator"
NAMES = ("forward_back", "multisine", "rotation")
"""README.md has the answers on the other bundled logs, and its test looks at their size."""


def assert_fits_a_screen(out: str, err: str) -> None:
    """Both streams together; lines on progress are no part of the answer."""
    lines = [*out.splitlines(), *(s for s in err.splitlines() if not re.search(r": \d+ s(,|$)", s))]
    assert len(lines) <= LINES, "\n".join(lines)
    assert max(map(len, lines)) <= 80, max(lines, key=len)


@pytest.fixture(autouse=True)
def eighty_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_fit_of_given_orders(name: str, tmp_path: Path, capsys: Capture) -> None:
    judged = ("--val", LOGS / f"{name}_val.csv", "--workspace", tmp_path)
    asked = ("--structure", "arx,oe,hammerstein-wiener", "--orders", "na=1 nb=1 nf=1 nk=1")
    answered = run(capsys, "fit", LOGS / f"{name}.csv", *judged, *asked, "--max-iterations", 8)
    assert answered.code == 0
    assert_fits_a_screen(answered.out, answered.err)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_fit_with_a_search(name: str, tmp_path: Path, capsys: Capture) -> None:
    judged = ("--val", LOGS / f"{name}_val.csv", "--workspace", tmp_path)
    answered = run(capsys, "fit", LOGS / f"{name}.csv", *judged)
    assert_fits_a_screen(answered.out, answered.err)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_diagnosis_and_what_follows(name: str, tmp_path: Path, capsys: Capture) -> None:
    place = ("--workspace", tmp_path)
    told = run(capsys, "diagnose", LOGS / f"{name}.csv", "--val", LOGS / f"{name}_val.csv", *place)
    assert told.code == 0
    assert_fits_a_screen(told.out, told.err)
    ranked = run(capsys, "compare", *place)
    assert_fits_a_screen(ranked.out, ranked.err)
    assert f"validated on {name}_val.csv" in ranked.out


def test_warnings_share_the_lines_that_are_left(capsys: Capture) -> None:
    """Whole where there is room, else their first sentences, else their number."""
    answer = Answer(ending=1)
    for k in range(18):
        answer.say(f"line {k}")
    long = [f"Warning {k} begins. {'It goes on and on. ' * 12}" for k in range(9)]
    answer.cautions(long, "sysid show")
    answer.say("the end")
    answer.print()
    out, err = capsys.readouterr()
    assert_fits_a_screen(out, err)
    assert out.endswith("the end\n")
    assert err.splitlines() == [
        *(f"! Warning {k} begins." for k in range(4)),
        "! 5 more warnings: sysid show",
    ]


def test_prose_breaks_between_words_and_numbers_keep_their_intervals(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    answer = Answer()
    answer.say("word-with-hyphens " * 6, most=9)
    answer.table(["a path", "values"], [["u → y", "1.25 ± 0.15, 3.75 ± 0.25, 5.55 ± 0.75"]])
    answer.print()
    lines = capsys.readouterr().out.splitlines()
    assert all(word == "word-with-hyphens" for line in lines[:3] for word in line.split())
    assert "1.25 ± 0.15, 3.75 ± 0.25," in lines[4]
    assert "5.55 ± 0.75" in lines[5]


def test_a_long_name_leaves_the_figures_whole(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    path = "DB12.Sollwert_Hz → DB12.Drehzahl_Istwert"
    answer = Answer()
    answer.table(
        ["oe", "gain [DB12.Drehzahl_Istwert/Hz]", "dynamics", "2 % settling"],
        [[path, "29.18 ± 0.43", "1.598 ± 0.081 rad/s, damping 0.821 ± 0.055", "2.71 s"]],
    )
    answer.print()
    out = capsys.readouterr().out
    assert "…" not in out
    assert all(f in out for f in ("29.18 ± 0.43", "1.598 ± 0.081", "0.821 ± 0.055"))


@pytest.mark.parametrize("room", [33, 30, 26, 22])
def test_a_table_wraps_words_and_breaks_no_number(room: int) -> None:
    rows = [["constant", "value", "meaning"], ["Kem", "8.6479e-05", "inductance of the winding"]]
    name, value, words = column_widths(rows, room)
    assert name + value + words == room
    assert value == len("8.6479e-05")
    assert room < 28 or (name, words) >= (len("constant"), len("inductance"))


def test_a_long_sentence_ends_behind_a_part_of_it(capsys: Capture) -> None:
    answer = Answer()
    answer.say(f"{'one two three ' * 8}four; {'five six ' * 9}seven", most=2)
    answer.print()
    assert capsys.readouterr().out.endswith("three four; …\n")
