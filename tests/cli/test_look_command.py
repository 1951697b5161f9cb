"""``sysid look``: the way from a multisine to an answer that fits a screen, and to files."""

from pathlib import Path

import numpy as np
import pytest
from cli_answers import answer, ask
from scipy.signal import lfilter

from sysid.data.frequency_response import read_frequency_response

Capture = pytest.CaptureFixture[str]


def write(path: Path, names: str, *columns: np.ndarray) -> None:
    rows = np.column_stack(columns)
    lines = [names, *(",".join(f"{v:.9g}" for v in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def driven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> Path:
    """The log of a saturating plant that an odd multisine of four periods drove."""
    monkeypatch.chdir(tmp_path)
    line = "excite multisine --odd --periods 4 --duration 25.6 --ts 0.1 --input pwm -o s.csv"
    assert ask(capsys, line.split())[0] == 0
    t, u = np.loadtxt("s.csv", delimiter=",", skiprows=1).T
    v = np.tanh(u / 15000.0)
    y = lfilter([0.0, 0.3], [1.0, -0.7], v) + 1e-3 * np.random.default_rng(0).standard_normal(
        len(u)
    )
    write(Path("log.csv"), "t,pwm,speed", t, u, y)
    return tmp_path


LOG = ("log.csv", "-u", "pwm", "-y", "speed")


def test_an_odd_multisine_says_what_is_nonlinear(driven: Path, capsys: Capture) -> None:
    code, out, err = ask(capsys, ["look", *LOG, "-o", "look.svg", "--save", "look.frd.csv"])
    assert code == 0, err
    assert len(out.splitlines()) + len(err.splitlines()) <= 24
    assert "Nonlinear: noise -" in out
    assert "even below -" in out
    assert ", odd -" in out
    assert "gain [speed/" in out
    assert Path("look.svg").read_bytes().startswith(b"<?xml")
    found = read_frequency_response("look.frd.csv")
    k = found.frequency * 25.6
    np.testing.assert_allclose(k % 2, 1.0, atol=1e-6)
    assert found.variance is not None
    assert found.inputs[0].name == "pwm"


def test_the_document_and_the_numbers(driven: Path, capsys: Capture) -> None:
    told = answer(capsys, "look", *LOG, "--save", "look.csv")
    assert told["nonlinear"] == [True]
    assert told["paths"][0]["unit"].startswith("speed/")
    assert told["frequency_response"] == "mean of 3 periods"
    assert "lines-speed" in Path("look.csv").read_text()
    code, _, err = ask(capsys, ["look", *LOG, "--kernel", "XX"])
    assert code == 2
    assert "XX" in err
    assert answer(capsys, "look", *LOG, "--save", "x.frd.csv")["data"] == "x.frd.csv"
    code, _, err = ask(capsys, ["look", "x.frd.csv"])
    assert code == 2
    assert "a frequency response already" in err


def test_an_integrator_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], 100), 8)
    y = np.cumsum(0.1 * u) + 0.05 * rng.standard_normal(800)
    write(Path("log.csv"), "t,u,y", 0.1 * np.arange(800), u, y)
    code, _, err = ask(capsys, ["look", "log.csv", "-u", "u", "-y", "y"])
    assert code == 0
    assert "y integrates its input" in err
    told = answer(capsys, "look", "log.csv", "-u", "u", "-y", "y", "--speed-of", "y")
    assert told["integrals"] == []


@pytest.mark.slow
def test_many_channels_fit_a_screen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    u = rng.standard_normal((300, 3))
    y = lfilter([0.0, 0.5], [1.0, -0.5], u @ rng.standard_normal((3, 5)), axis=0)
    y += 0.1 * rng.standard_normal(y.shape)
    names = ["u1", "u2", "u3", "y1", "y2", "y3", "y4", "y5"]
    write(Path("log.csv"), ",".join(["t", *names]), 0.1 * np.arange(300), u, y)
    line = ["look", "log.csv", "-u", "u1,u2,u3", "-y", "y1,y2,y3,y4,y5"]
    code, out, err = ask(capsys, line)
    assert code == 0, err
    assert len(out.splitlines()) + len(err.splitlines()) <= 24
    assert "Next:" in out
