"""Progress where nobody sees a bar: a line now and then on stderr, and nothing on stdout."""

import io
import re
import sys
import time
from itertools import pairwise

import pytest
from sysid_cli import render


def test_piped_progress_is_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(render, "SPOKEN_EVERY", 0.05)
    with render.progress("Fitting", total=4) as tick:
        tick(1)
        time.sleep(0.3)
    with render.stages("Diagnosing") as stage:
        stage("the proof", 0.5)
        time.sleep(0.3)
    shown = capsys.readouterr()
    assert shown.out == ""
    for line in ("Fitting: 0 s, 25 % done", "the proof: 0 s, 50 % done"):
        said = re.findall(rf"^{line}, about 0 s left$", shown.err, re.MULTILINE)
        assert len(said) == 1, "a share is said once"
    assert shown.err.count("Fitting: 0 s\n") >= 1, "that it goes on is said all the same"


def test_a_short_command_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with render.progress("Fitting", total=4) as tick:
        tick(4)
    assert capsys.readouterr().err == ""


class Terminal(io.StringIO):
    """What is written to a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("total", "words"), [(4, "25%"), (None, "0:00:0")])
def test_a_terminal_shows_a_bar_after_a_second(
    monkeypatch: pytest.MonkeyPatch, total: int | None, words: str
) -> None:
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(render, "DRAWN_AFTER", 0.05)
    with render.progress("Fitting", total) as tick:
        tick(1)
        time.sleep(0.3)
    assert words in shown.getvalue()
    assert "Fitting" in shown.getvalue()
    monkeypatch.setattr(render, "DRAWN_AFTER", 5.0)
    before = shown.getvalue()
    with render.progress("Comparing", total) as tick:
        tick(1)
    assert "Comparing" not in shown.getvalue().removeprefix(before)


@pytest.mark.parametrize("width", [40, 80, 200])
def test_prose_breaks_between_words_at_the_width_that_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int
) -> None:
    sentence = "! The residuals of omega_l are correlated with the inputs: dynamics are missing."
    path = "/a/folder-of-a-long-name/" + 60 * "x" + ".csv"
    monkeypatch.setenv("COLUMNS", str(width))
    render.warn(sentence)
    render.say(f"Log: {path}")
    render.command(f"sysid fit {path}")
    shown = capsys.readouterr()
    assert shown.err.split() == sentence.split()
    assert max(map(len, shown.err.splitlines())) <= width
    assert path in shown.out
    assert f"sysid fit {path}\n" in shown.out
    monkeypatch.delenv("COLUMNS")
    render.warn(sentence)
    assert capsys.readouterr().err == f"{sentence}\n", "a pipe gets whole sentences"


def test_a_bar_never_goes_back(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(render, "SPOKEN_EVERY", 0.05)
    with render.stages("Diagnosing") as stage:
        for what, share in (("first", 0.6), ("again", 0.2)):
            stage(what, share)
            time.sleep(0.2)
    assert re.findall(r"(\w+): 0 s, (\d+) %", capsys.readouterr().err) == [
        ("first", "60"),
        ("again", "60"),
    ]


def test_the_share_of_a_fit_grows_with_its_work() -> None:
    from sysid_datasets import path

    from sysid.data.io import read_logs
    from sysid.estimation.identify import Request, identify

    shares: list[float] = []
    named = ("arx", "armax", "oe")
    request = Request(structures=named, orders="na=1:2 nb=1:2 nc=1 nf=1 nk=1", jobs=1)
    identify(read_logs([path("rotation")]), [], request, lambda share, what: shares.append(share))
    assert shares == sorted(shares)
    assert (shares[-1], len(shares) > 6) == (1.0, True)
    assert max(b - a for a, b in pairwise(shares)) < 0.3
