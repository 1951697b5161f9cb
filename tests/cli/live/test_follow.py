"""``sysid fit --follow``: how it ends, what it keeps, what it shows, what it refuses."""

import io
import json
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from sysid_cli.live import view
from turning_motor import TurningMotor, steps_of

Capsys = Capture
LEVELS = (-10.0, -5.0, -3.0, 0.0, 3.0, 5.0, 10.0)


def log_lines(samples: int, seed: int = 1, motor: TurningMotor | None = None) -> list[str]:
    """A log of a motor as lines with their ends."""
    u = steps_of(LEVELS, samples, 15, seed)
    y = (motor or TurningMotor(bridge=1.5)).speeds(u, 0.02)
    y = y + 0.2 * np.random.default_rng(seed).standard_normal(samples)
    rows = zip(u.tolist(), y.tolist(), strict=True)
    return [
        "t,volts,omega\n",
        *(f"{0.02 * k:.2f},{a:g},{b:.6g}\n" for k, (a, b) in enumerate(rows)),
    ]


def in_the_background(*steps: Callable[[], object]) -> threading.Thread:
    """These steps, one after the other, a moment apart, while a command runs."""

    def work() -> None:
        for step in steps:
            time.sleep(0.15)
            step()

    thread = threading.Thread(target=work)
    thread.start()
    return thread


def appended(path: Path, text: str) -> Callable[[], object]:
    """What appends a text to a file."""

    def append() -> None:
        with path.open("a") as file:
            file.write(text)

    return append


def test_a_growing_log_is_followed_and_its_model_kept(tmp_path: Path, capsys: Capsys) -> None:
    log, place = tmp_path / "run.csv", tmp_path / "w"
    text = "".join(log_lines(600))
    half = len(text) // 2 + 3  # within a line
    writer = in_the_background(appended(log, text[:half]), appended(log, text[half:]))
    found = run(
        capsys, "fit", "--follow", log, "--idle", "0.6", "--json", "--workspace", place
    ).document  # fmt: skip
    writer.join()
    live = found["live"]
    assert live["rows"] == 600
    assert live["excitation_enough"]
    (pair,) = live["pairs"]
    assert pair["gain"]["value"] == pytest.approx(TurningMotor().gain, rel=0.02)
    assert pair["dead_zone"]["value"] == pytest.approx(1.5, rel=0.03)
    assert found["structure"] == "arx"
    compared = run(capsys, "compare", "--json", "--workspace", place).document
    assert compared["ranking"][0]["model"] == found["model"]
    assert run(capsys, "export", "-o", tmp_path / "p", "--workspace", place).code == 0
    again = run(
        capsys, "fit", live["log"], "--structure", "arx", "--orders", "na=1 nb=1 nk=1",
        "--detrend", "none", "--json", "--workspace", place,
    ).document  # fmt: skip
    followed = run(
        capsys, "fit", "--follow", log, "--for", "0.2", "--orders", "na=1 nb=1 nk=1",
        "--detrend", "none", "--json", "--workspace", place,
    ).document  # fmt: skip
    for a, b in zip(again["parameters"], followed["parameters"], strict=True):
        assert b["value"] == pytest.approx(a["value"], abs=1e-8)
        assert b["std_error"] == pytest.approx(a["std_error"], rel=1e-8)


def test_ctrl_c_ends_it_and_keeps_the_model(tmp_path: Path, capsys: Capsys) -> None:
    log, place = tmp_path / "run.csv", tmp_path / "w"
    log.write_text("".join(log_lines(300)))
    interrupt = in_the_background(
        lambda: None, lambda: None, lambda: os.kill(os.getpid(), signal.SIGINT)
    )
    before = signal.getsignal(signal.SIGINT)
    done = run(capsys, "fit", log, "--follow", "--every", "0.1", "--workspace", place)
    interrupt.join()
    assert done.code == 0, done.err
    assert "Ended by hand." in done.out
    assert "dead zone 1." in done.out
    assert signal.getsignal(signal.SIGINT) is before
    assert len(list((place / "models").glob("*.json"))) == 1
    assert len(list((place / "followed").glob("run-*.csv"))) == 1


@pytest.mark.slow
def test_a_change_is_said_when_it_is_seen(tmp_path: Path, capsys: Capsys) -> None:
    log = tmp_path / "run.csv"
    u = steps_of(LEVELS, 900, 15, 2)
    y = TurningMotor().speeds(u, 0.02, np.where(np.arange(900) < 600, 1.0, 0.7))
    y = y + 0.2 * np.random.default_rng(3).standard_normal(900)
    rows = enumerate(zip(u.tolist(), y.tolist(), strict=True))
    lines = ["t,volts,omega\n", *(f"{0.02 * k:.2f},{a:g},{b:.6g}\n" for k, (a, b) in rows)]
    log.write_text("".join(lines))
    done = run(
        capsys, "fit", log, "--follow", "--for", "2", "--every", "0.1",
        "--workspace", tmp_path / "w",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert "The plant changed at 1" in done.out  # 12 s, within a block
    assert "volts → omega: gain falls by 30 % (18.5" in done.out


@pytest.mark.parametrize(
    ("arguments", "words", "code"),
    [
        (("--for", "3"), "add --follow", 2),
        (("--forgetting", "0.9"), "belong to --follow", 2),
        (("--follow", "--for", "0"), "above 0", 2),
        (("--follow", "--structure", "oe"), "only arx", 2),
        (("--follow", "--stable"), "plain least squares", 2),
        (("--follow", "--split", "0.5"), "omit", 2),
        (("--follow", "--detrend", "mean"), "auto, none, level", 2),
        (("--follow", "--low-pass", "3"), "--val", 2),
        (("--follow", "--forgetting", "1.5", "--for", "0.1"), "at most 1", 2),
        (("--follow", "--speed-of", "omega", "--for", "0.1"), "needs the whole log", 2),
        (("--follow", "--stamps", "header", "--for", "0.1"), "needs the whole log", 2),
        (("--follow", "--latency", "remove", "--for", "0.1"), "needs the whole log", 2),
        (("--follow", "--map", "u=/wheel.data", "--for", "0.1"), "is a file", 2),
        (("--stamps", "received"), "is not a bag", 2),
        (("--latency", "remove"), "is not a bag", 2),
        (("--follow", "--for", "0.1"), "too few", 1),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, capsys: Capsys, arguments: tuple[str, ...], words: str, code: int
) -> None:
    log = tmp_path / "run.csv"
    log.write_text("".join(log_lines(4)))
    done = run(capsys, "fit", log, *arguments, "--workspace", tmp_path / "w")
    assert done.code == code, done.err
    assert words in done.err
    assert done.err.count("\n") == 1


def test_a_log_that_never_comes_ends_in_time(tmp_path: Path, capsys: Capsys) -> None:
    none = tmp_path / "none.csv"
    done = run(capsys, "fit", none, "--follow", "--for", "0.2", "--workspace", tmp_path / "w")
    assert done.code == 1
    assert "no rows arrived" in done.err
    assert run(capsys, "fit", none, none, "--follow").code == 2


def test_a_topic_needs_a_mapping(capsys: Capsys) -> None:
    done = run(capsys, "fit", "--follow", "/wheel", "--for", "1")
    assert done.code == 2
    assert "/wheel is a topic" in done.err
    assert "--map" in done.err


def test_the_table_of_a_terminal() -> None:
    from rich.console import Console

    from sysid.data.record import Channel
    from sysid.estimation.online.live_fit import LiveFit

    u = steps_of(LEVELS, 300, 15, 1)
    y = TurningMotor(bridge=1.5).speeds(u, 0.02)
    live = LiveFit((Channel("volts", "V"),), (Channel("omega", "rad/s"),), 0.02)
    live.update(u[:, None], y[:, None] + 0.1 * np.random.default_rng(1).standard_normal((300, 1)))
    console = Console(width=110, record=True, file=io.StringIO())
    console.print(view.screen(live.state(), {"volts": "V"}, "run.csv"))
    shown = console.export_text()
    assert "volts → omega" in shown
    assert "(in the command)" in shown
    assert "Ctrl-C ends following" in shown
    json.dumps(live.state().to_json()["pairs"])
