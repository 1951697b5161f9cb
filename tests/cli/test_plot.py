"""Every word of ``sysid plot``: a picture, and numbers that are those of the library."""

import csv
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, robot_log, run
from sysid_cli.app import main

from sysid.estimation.assessment.responses import step_curves
from sysid.report.model_panels import WHAT
from sysid.workspace.store import Workspace

MODELS = ("--structure", "arx,oe", "--orders", "arx: na=1 nb=1; oe: nb=1 nf=1")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, another one, and two models in a workspace."""
    folder = tmp_path_factory.mktemp("plots")
    log, val = robot_log(folder / "log.csv"), robot_log(folder / "val.csv", seed=2)
    ws = str(folder / ".sysid")
    line = ["fit", str(log), "--val", str(val), *MODELS, "--workspace", ws, "--json"]
    assert main(line) == 0
    return folder


@pytest.fixture
def here(fitted: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(fitted)
    return fitted


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.parametrize(
    "what", [pytest.param(w, marks=[pytest.mark.slow] * (w == "look")) for w in WHAT]
)
def test_every_word_gives_a_picture_and_numbers(what: str, here: Path, capsys: Capture) -> None:
    models = ["arx"] if what == "surface" else ["oe", "arx"]
    told = run(capsys, "plot", what, *models, "-o", f"{what}.svg", "--save", f"{what}.csv")
    assert told.code == 0, told.err
    assert (here / f"{what}.svg").read_bytes().startswith(b"<?xml")
    numbers = rows(here / f"{what}.csv")
    assert len(numbers) > 3
    assert all(np.isfinite(float(r["x"])) for r in numbers)


def test_numbers_are_those_of_the_library_with_their_bands(here: Path, capsys: Capture) -> None:
    assert run(capsys, "plot", "step", "oe", "--save", "one.csv", "-o", "one.png").code == 0
    model = Workspace(Path(".sysid")).load("oe").model
    (first, *_) = step_curves(model)
    shown = [r for r in rows(here / "one.csv") if r["panel"] == "step-pwm_l-omega_l"]
    y = np.array([float(r["y"]) for r in shown])
    np.testing.assert_allclose(y, first.y, rtol=1e-8, atol=1e-12)  # nine digits are written
    half = np.array([float(r["high"]) - float(r["low"]) for r in shown]) / 2.0
    np.testing.assert_allclose(half, 1.96 * first.error, rtol=1e-4, atol=1e-10)
    assert (here / "one.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_models_lie_over_what_was_measured(here: Path, capsys: Capture) -> None:
    line = ("plot", "bode", "oe", "arx", "val.csv", "-o", "b.pdf", "--save", "b.csv", "--json")
    answered = run(capsys, *line).document
    assert Path(answered["picture"]).read_bytes().startswith(b"%PDF")
    gain = [r for r in rows(here / "b.csv") if r["panel"] == "gain-pwm_l-omega_l"]
    curves = {r["curve"] for r in gain}
    assert "measured" in curves
    assert len(curves) == 3
    # a gain of 1e-3 (rad/s)/µs at rest, which the log shows at its lowest frequency, too
    first = {c: next(float(r["y"]) for r in gain if r["curve"] == c) for c in curves}
    for value in first.values():
        assert value == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("plot sky", 2, "'sky' cannot be plotted; choose one of log"),
        ("plot step nowhere.csv", 2, "nowhere.csv: file not found"),
        ("plot step bj", 2, "no model 'bj'"),
        ("plot step -o step.gif", 2, "ends in .svg, .png or .pdf"),
        ("plot step -o no/where/step.svg", 2, "does not exist"),
        ("plot surface oe", 1, "has no surface"),
    ],
)
def test_refusals(line: str, code: int, words: str, here: Path, capsys: Capture) -> None:
    told = run(capsys, *line.split())
    assert (told.code, told.out) == (code, "")
    assert words in told.err
    assert len(told.err.splitlines()) == 1
