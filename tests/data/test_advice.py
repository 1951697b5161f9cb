"""Every advice that names an option is followed: it works, and leaves the other answers alone.

A row has a log that provokes a message; its fields are parsed from the text and given, each by
itself. The complaint is then gone, and so is no dead time, and no controller has appeared.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from named_fields import MARKED, arguments, messages
from scipy.signal import lfilter

from sysid.data.facts import LogFacts
from sysid.data.inspection import inspect_records
from sysid.data.preparation import Preparation, read_prepared
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import SysidError

ROOT = Path(__file__).resolve().parents[2]
N = 600
RNG = np.random.default_rng(8)
U = np.repeat(RNG.uniform(-1.0, 1.0, N // 12), 12)
Y = lfilter([0.0, 0.2], [1.0, -0.8], U) + 0.01 * RNG.standard_normal(N)
T = 0.02 * np.arange(N)
Logs = Callable[[Path], list[Path]]


def decimal_commas(values: Any) -> list[str]:
    """Three decimals behind a comma."""
    return [f"{v:.3f}".replace(".", ",") for v in values]


def log(
    head: str, *columns: Sequence[Any], name: str = "log.csv", before: str = "", sep: str = ","
) -> Logs:
    """Writes one log; numbers with six decimals, None as an empty cell."""

    def cell(value: Any) -> str:
        return "" if value is None else value if isinstance(value, str) else f"{value:.6f}"

    def write(folder: Path) -> list[Path]:
        rows = [sep.join(map(cell, row)) for row in zip(*columns, strict=True)]
        (folder / name).write_text("\n".join([*([before] * bool(before)), head, *rows]) + "\n")
        return [folder / name]

    return write


def both(*logs: Logs) -> Logs:
    return lambda folder: [path for write in logs for path in write(folder)]


def every(rows: int, values: Any) -> list[Any]:
    """Cells that are filled in every so many rows only."""
    return [v if k % rows == 0 else None for k, v in enumerate(values)]


HOLES = [None if k % 29 == 7 else v for k, v in enumerate(Y)]
LATE = np.delete(np.arange(N), range(200, 230))
TORN = np.flatnonzero(np.arange(N) % 30 < 9)
MILLIS = [f"{20 * k}" for k in range(N)]
RATES = {"inputs": "u", "outputs": ("y", "y2")}
SIDES = "t,pwm_l,pwm_r,omega_l,omega_r"
UNEVEN = np.cumsum(RNG.uniform(0.005, 0.06, N))
TURNING = np.cumsum(0.02 * (1.0 + 0.5 * Y))
WAY = np.cumsum(0.02 * np.cos(TURNING)), np.cumsum(0.02 * np.sin(TURNING))
COUNTS = np.rint(np.cumsum(20.0 + 15.0 * Y))
SLOW = 600 * 20
SLOW_U = np.repeat(RNG.uniform(-1.0, 1.0, 12), SLOW // 12)
SLOW_Y = lfilter([0.0, 0.0025], [1.0, -0.9975], SLOW_U) + 0.01 * RNG.standard_normal(SLOW)
CAUSE = np.repeat(np.random.default_rng(5).uniform(-1.0, 1.0, 100), 20)
ANSWER = lfilter([0.0, 0.2], [1.0, -0.8], CAUSE)
ANSWER += 0.01 * np.random.default_rng(6).standard_normal(2000)
CAUSE = CAUSE + 0.003 * np.random.default_rng(7).standard_normal(2000)

ADVICE: dict[str, tuple[Logs, dict[str, Any], dict[str, Any]]] = {
    "correct it, or allow": (log("t,u,y", T, U, HOLES), {"resample": "refuse"}, {}),
    "If that is wrong, give `units": (log("clock,u,y", 1e3 * T, U, Y), {}, {}),
    "if it is not the time": (log("tick,u,y", 1e3 * T, U, Y), {}, {"SECONDS": 0.02}),
    "for example `inputs": (log("t,alpha,beta", T, U, Y), {}, {}),
    "(or none": (log("t,alpha,beta,y", T, U, U + Y, Y), {}, {}),
    "Fit its speed with": (log("t,u,enc", T, U, COUNTS), {}, {"N": 2048}),
    "Give its period": (log("t,u,y", T, U, COUNTS % 1700.0), {}, {}),
    "If these jumps are real": (log("t,u,enc", T, U, COUNTS % 4096), {}, {}),
    "does not fit a pose": (
        log("t,u,omega,x [V],y,psi", T, U, Y, *WAY, TURNING), {}, {},
    ),
    "was read in degrees": (
        log("t,u,omega,x,y,psi", T, U, Y, *WAY, np.degrees(TURNING)), {}, {},
    ),
    "If it is in degrees": (
        log("t,u,omega,x,y,psi", T, U, Y, 0 * T, 0 * T, 5.0 * TURNING), {}, {},
    ),
    "To use the recorder's clock": (
        log("time,header.stamp,u,y", T + 0.001 * RNG.uniform(size=N), T, U, Y), {}, {},
    ),
    "`ts` was used": (log("t,u,y", T, U, Y), {"ts": 0.05}, {"ts": None}),
    "Give the sample time in seconds with `ts`": (log("u,y", U, Y), {}, {"ts": 0.02}),
    ", or the unit with": (log("sample,u,y", 20.0 * np.arange(N), U, Y), {}, {"ts": 0.02}),
    "reads every row as it was logged": (log("t,u,y", T, U, np.repeat(Y[::4], 4)), {}, {}),
    "the sampling is irregular": (log("t,u,y", UNEVEN**1.3, U, Y), {}, {}),
    "or count the rows, without": (log("t,u,y", np.floor(T), U, Y), {}, {"ts": 0.02}),
    "time stays at 0 ": (
        log("t,ticks,u,y", 0.0 * T, T, U, Y), {}, {"ts": 0.02},
    ),
    "the file holds several logs": (
        log("t,u,y", np.r_[T[:300], T[:300]], U, Y), {"resample": "refuse"}, {},
    ),
    "record at a fixed rate, or allow": (
        log("t,u,y", T + 0.002 * RNG.uniform(size=N), U, Y), {"resample": "refuse"}, {},
    ),
    "cuts it there": (log("t,u,y", T[LATE], U[LATE], Y[LATE]), {"resample": "refuse"}, {}),
    "interpolates instead": (log("t,u,y", T[LATE], U[LATE], Y[LATE]), {}, {}),
    "no piece between its gaps": (log("t,u,y", T[TORN], U[TORN], Y[TORN]), {}, {}),
    "would be filled": (
        log("t,u,y", np.r_[T[:300], T[300:] + 1e6], U, Y), {"resample": "fill"}, {},
    ),
    "if it separates thousands": (
        log("t [ms];u;y", MILLIS, *map(decimal_commas, (2 + U, 3 + Y)), sep=";"),
        {}, {},
    ),
    "takes it out": (log("t,u,y", T, U, Y + 0.6 * np.sin(np.pi * T / T[-1])), {}, {}),
    "Give it as an input, too": (
        log("t,u,y,room", T, U, Y + lfilter([0.0, 0.2], [1.0, -0.8], U[::-1]), U[::-1]),
        {"inputs": "u", "outputs": "y"}, {},
    ),
    "If they are, give": (
        log("t,alpha,beta", 0.02 * np.arange(2000), ANSWER, CAUSE),
        {"inputs": "alpha", "outputs": "beta"}, {},
    ),
    "Until then give": (log(SIDES, T, 2e4 * U, 2e4 * U[::-1], 8.0 * Y[::-1], 8.0 * Y), {}, {}),
    "change the sign of the": (
        log(SIDES, T, 2e4 * U, 2e4 * U[::-1], -8.0 * Y, 8.0 * Y[::-1]), {}, {},
    ),
    "the rows are finer": (
        log("t,u,y,y2", T, U, every(2, Y), every(10, Y)), RATES, {},
    ),
    "same columns with": (
        both(log("t,u,y", T, U, Y), log("t,u,y,y2", T, U, Y, Y, name="b.csv")), {},
        {"inputs": "u", "outputs": "y"},
    ),
    "give its unit with": (
        both(log("t,u,y [mm]", T, U, Y), log("t,u,y", T, U, Y, name="b.csv")), {},
        {"units": {"y": "mm"}},
    ),
    "If full drive is": (log("t,pwm,omega", T, 200.0 * U, 8.0 * Y), {}, {}),
    "If the log is not in rad/s": (log("t,pwm_l,omega_l", T, 2e4 * U, 190.0 * Y), {}, {}),
    "If it was measured, keep it with": (
        log("t,u,y", T, U, np.where(np.arange(N) % 199 == 7, -999.0, Y)), {}, {},
    ),
    "keeps every row": (log("t,u,y,torque_on", T, U, Y, 1.0 * (T < 8.0)), {}, {}),
    "Model its speed with": (log("t,u,y", T, U, np.cumsum(U)), {}, {}),
    "Leave it out with": (log("t,u1,u2,y", T, U, 0 * U, Y), {}, {}),
    "Decimate it with": (log("t,u,y", 0.02 * np.arange(SLOW), SLOW_U, SLOW_Y), {}, {}),
}  # fmt: skip
"""Part of a message → logs that provoke it, options given before, words for what it leaves open."""

TO_AN_OPTION = (
    *(
        "is not a unit of time",
        "which is not an output of",
        "`missing` takes numbers",
        "unknown `resample`",
        "unknown `stamps`",
        "unknown `encoding`",
        "is not a text in",
    ),
    *("`ts` must be", "`held` is auto", "`pwm_max` must be", "which is not a channel of"),
    *(
        "converts PWM inputs",
        "cannot be joined to a log",
        "`inputs`",
        "`outputs`",
        "`time`",
        "`enable`",
    ),
)
"""Parts of messages that refuse what an option gave, whose remedy is another value of it."""

ELSEWHERE = (
    *("If that is wrong, give the sample time in seconds", "Omit `ts` if", "; on a board of"),
    *("`strict=True` refuses such a log", "cut the log there (`trim`)"),
)
"""Parts of messages on a title that states the interval, of those that have a row, of one whose
option refuses, and of one that leaves the parts to the reader."""


def judged(paths: list[Path], options: dict[str, Any]) -> tuple[list[str], LogFacts | None]:
    """What is said of the logs, and the facts where they can be read."""
    prepared = {f.name for f in fields(Preparation)}
    steps = Preparation(**{k: v for k, v in options.items() if k in prepared})
    read = ReadOptions(**{k: v for k, v in options.items() if k not in prepared})
    try:
        records, findings = read_prepared(paths, read, steps)
    except SysidError as error:
        return [str(error)], None
    facts = LogFacts(records, findings)
    return [f.text for f in inspect_records(facts, nonlinearity=False)], facts


def advised(text: str, words: dict[str, Any], given: dict[str, Any]) -> list[dict[str, Any]]:
    """The options of each advice in a message, with what it leaves open filled in."""
    ways = []
    for marked in MARKED.findall(text):
        whole = re.sub("N(?=/rev)|SECONDS", lambda m: str(words[m[0]]), marked)
        fields_given = {marked: words[marked]} if marked in words else arguments(f"`{whole}`")
        ways.append(given | fields_given)
    if len(words) > 1:
        ways = [given | words]
    return [{k: v for k, v in way.items() if v is not None} for way in ways if way != given]


@pytest.mark.parametrize("part", ADVICE)
def test_an_advice_can_be_followed(part: str, tmp_path: Path) -> None:
    write, given, words = ADVICE[part]
    paths = write(tmp_path)
    said, before = judged(paths, given)
    complaints = [text for text in said if part in text]
    assert complaints, said
    ways = advised(complaints[0], words, given)
    assert ways, complaints[0]
    for way in ways:
        after_said, after = judged(paths, way)
        assert after is not None, (way, after_said)
        assert not [text for text in after_said if part in text], (way, after_said)
        assert not after.closed_loop or (before is not None and before.closed_loop), way
        dead_times = [[d.delay or 1 for d in f.delays or ()] if f else [] for f in (before, after)]
        assert min(dead_times[1], default=1) >= min(1, *dead_times[0], 1)


def test_every_message_that_names_an_option_is_followed() -> None:
    modules = [
        ROOT / "sysid/data/io.py",
        ROOT / "sysid/data/same_kind.py",
        ROOT / "sysid/data/units.py",
        ROOT / "sysid/data/usable_rows.py",
    ]
    for folder in ("reading", "checks"):
        modules += sorted((ROOT / "sysid/data" / folder).glob("*.py"))
    named = [(m.name, text) for m in modules for _, text in messages(m) if MARKED.findall(text)]
    assert len(named) > 30
    known = (*ADVICE, *TO_AN_OPTION, *ELSEWHERE)
    missing = [pair for pair in named if not any(part in pair[1] for part in known)]
    assert not missing, missing
