"""No text and no option breaks a command: random logs and options."""

from pathlib import Path

import numpy as np
import pytest
from bad_input_cases import assert_one_sentence
from command_line import Capture, run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

CELL = st.one_of(
    st.integers(-9, 9).map(str),
    st.floats(-1e3, 1e3).map(lambda v: f"{v:.3g}"),
    st.sampled_from(
        ["", "nan", "inf", "-", "x", "1,5", '"', "1e400", "0x1", "é", "2024-01-01", " "]
    ),
)

NAME = st.sampled_from(["t", "time", "u", "y", "pwm_l", "omega_l", "x", "", "u [V]", "y_ref", "k"])

OPTION = st.sampled_from(
    [
        ("--ts", "0.1"),
        ("--ts", "-"),
        ("--resample", "fill"),
        ("--resample", "split"),
        ("--decimal", ","),
        ("--delimiter", ";"),
        ("--delimiter", "space"),
        ("--input", "u"),
        ("--output", "y,x"),
        ("--time", "k"),
        ("--unit", "y=rpm"),
        ("--pwm-max", "255"),
        ("--pwm-max", "1e-400"),
    ]
)

FIT_OPTION = st.sampled_from(
    [
        ("--split", "0.7"),
        ("--split", "0.001"),
        ("--skip", "3"),
        ("--skip", "99999"),
        ("--horizon", "2"),
        ("--detrend", "linear"),
        ("--stable",),
        ("--robust",),
        ("--fix", "a1=0"),
        ("--bound", "b1=-1:1"),
        ("--initial-state", "zero"),
        ("--orders", "na=1:2 nb=0:1"),
        ("--orders", "na=1 nb=1 nk=0"),
    ]
)


@st.composite
def csv_texts(draw: st.DrawFn) -> str:
    """Small tables that are almost logs: mostly numbers, some surprises."""
    sep = draw(st.sampled_from([",", ",", ";", "\t", " "]))
    names = draw(st.lists(NAME, min_size=1, max_size=4))
    seed, count = draw(st.integers(0, 9)), draw(st.integers(0, 40))
    body = np.random.default_rng(seed).integers(-9, 9, size=(count, len(names))).astype(str)
    if count and names[0] in ("t", "time", "k"):
        body[:, 0] = np.arange(count)
    rows = [list(row) for row in body]
    for _ in range(draw(st.integers(0, 2)) if rows else 0):
        row = rows[draw(st.integers(0, count - 1))]
        row[draw(st.integers(0, len(row) - 1))] = draw(CELL)
    return "\n".join(sep.join(r) for r in [names, *rows]) + draw(st.sampled_from(["", "\n"]))


def _survives(capsys: Capture, *words: object) -> None:
    result = run(capsys, *words)
    assert result.code in (0, 1, 2)
    assert "Traceback" not in result.err
    assert "unexpected" not in result.err, (words, result.err)
    if result.code and words[0] == "fit":
        assert_one_sentence(result.err, str(words))
        assert result.out == ""


FUZZ = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.mark.slow
@FUZZ
@given(text=csv_texts(), options=st.lists(OPTION, max_size=2))
def test_no_text_breaks_inspect(
    text: str, options: list[tuple[str, ...]], tmp_path: Path, capsys: Capture
) -> None:
    log = tmp_path / "any.csv"
    log.write_text(text, encoding="utf-8")
    _survives(capsys, "inspect", log, *(w for o in options for w in o))


@pytest.mark.slow
@FUZZ
@given(text=csv_texts(), options=st.lists(st.one_of(OPTION, FIT_OPTION), max_size=3))
def test_no_text_and_no_option_breaks_fit(
    text: str, options: list[tuple[str, ...]], tmp_path: Path, capsys: Capture
) -> None:
    log = tmp_path / "any.csv"
    log.write_text(text, encoding="utf-8")
    words = [w for o in options for w in o]
    given_orders = () if "--orders" in words else ("--orders", "na=1 nb=1")
    _survives(
        capsys, "fit", log, "--structure", "arx", *given_orders, *words,
        "--workspace", tmp_path / "w", "--jobs", 1,
    )  # fmt: skip
