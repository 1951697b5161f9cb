"""Squares both ways tell unequal wheels from a wrong width; squares one way do not."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from skid_steer_logs import FINE, Skid, columns, written

from sysid.data.record import Array
from sysid.robot.calibration.square_runs import (
    ideal_return,
    read_returns,
    returned,
    scales,
    square_result,
)
from sysid.vehicle.kinematics import Geometry

NOMINAL = Geometry(0.1, 0.4)
SIDE = 4.0


@pytest.mark.parametrize(("wheels", "width"), [(1.002, 1.0), (1.0, 0.995), (0.999, 1.003)])
def test_returns_are_those_of_borenstein_and_feng(wheels: float, width: float) -> None:
    """Their first-order formulas, from the centres of both clusters (1996, eqs. 5.8 to 5.12)."""
    cw, ccw = (ideal_return(wheels, width, SIDE, NOMINAL.B, way) for way in (True, False))
    alpha = (cw[0] + ccw[0]) / (-4.0 * SIDE)
    beta = (cw[0] - ccw[0]) / (-4.0 * SIDE)
    bend = 0.5 * SIDE / np.sin(0.5 * beta) if beta else np.inf
    ratio = (bend + 0.5 * NOMINAL.B) / (bend - 0.5 * NOMINAL.B) if beta else 1.0
    # of first order: sides that bend by up to 0.02 leave the square of that, 4e-4
    assert ratio == pytest.approx(wheels, abs=1e-4)
    assert 0.5 * np.pi / (0.5 * np.pi - alpha) == pytest.approx(width, abs=5e-4)


def test_both_numbers_come_back_with_errors_that_hold() -> None:
    rng = np.random.default_rng(3)
    ways = [True] * 5 + [False] * 5
    true = {way: ideal_return(1.01, 1.03, SIDE, NOMINAL.B, way) for way in (True, False)}
    away = []
    for _ in range(60):
        missed = [true[way] + 0.01 * rng.normal(size=2) for way in ways]
        squares = square_result(returned(ways, missed, SIDE, NOMINAL))
        for truth, number in ((1.01, squares.wheel_ratio), (1.03, squares.width_ratio)):
            assert number is not None
            assert number[1] is not None
            away.append((number[0] - truth) / number[1])
    assert squares.worst[1] is not None
    assert squares.worst[1] < 0.1 * squares.worst[0]
    # Student's t with 8 degrees of freedom has a standard deviation of 1.15; ± 0.1 is 2 σ of 120
    assert 0.9 < np.std(away) < 1.4


def test_squares_one_way_tell_neither() -> None:
    missed = [ideal_return(1.01, 1.03, SIDE, NOMINAL.B, True)] * 3
    squares = square_result(returned([True] * 3, missed, SIDE, NOMINAL))
    assert squares.wheel_ratio is None
    assert squares.width_ratio is None
    assert "drive some counter-clockwise" in squares.sentence


def _square(clockwise: bool) -> Array:
    """Wheel speeds of a square of 1.5 m by an odometry of ``NOMINAL``, every millisecond."""
    sign = -1.0 if clockwise else 1.0
    corner = 0.25 * np.pi * NOMINAL.B / NOMINAL.r / 2.0
    parts = [(0.0, 0.0, 1.5)]
    for _ in range(4):
        parts += [(6.0, 6.0, 1.5 / 0.6), (0.0, 0.0, 0.3), (-2.0 * sign, 2.0 * sign, corner)]
        parts += [(0.0, 0.0, 0.3)]
    steps = [np.tile([left, right], (round(t / FINE), 1)) for left, right, t in parts]
    smooth = np.ones(100) / 100.0
    both = np.concatenate(steps)
    return np.column_stack([np.convolve(both[:, k], smooth, "same") for k in (0, 1)])


@pytest.mark.slow
def test_squares_are_found_in_logs(capsys: Capture, tmp_path: Path) -> None:
    left, right = scales(1.01)
    skid = Skid((0.1 * left, 0.1 * right), 0.4 * 1.04, lag=0.1, heading_lag=0.1, noise=(1e-3, 1e-3))
    logs = [
        written(tmp_path / f"{way}.csv", columns(skid, _square(way), seed=way + 1))
        for way in (True, False)
    ]
    result = run(capsys, "fit-vehicle", *logs, "--geometry", "r=0.1,B=0.4", "--json").document
    squares = result["squares"]
    assert squares["runs"] == {"cw": 1, "ccw": 1}
    # a start of 1 mm and 1 mrad over sides of 1.5 m
    assert squares["E_d"]["value"] == pytest.approx(1.01, abs=1e-3)
    assert squares["E_b"]["value"] == pytest.approx(1.04, abs=3e-3)
    assert squares["E_b"]["std_error"] is None
    assert "at least two" in squares["sentence"]


def test_a_table_of_returns_is_enough(capsys: Capture, tmp_path: Path) -> None:
    table = tmp_path / "returns.csv"
    rows = [
        (name, *ideal_return(1.01, 1.0, SIDE, NOMINAL.B, name == "cw"))
        for name in ("cw", "ccw", "cw", "ccw")
    ]
    table.write_text("direction,x,y\n" + "".join(f"{n},{x},{y}\n" for n, x, y in rows))
    options = ("--returns", table, "--side", SIDE, "--geometry", "r=0.1,B=0.4")
    result = run(capsys, "fit-vehicle", *options, "--json").document
    assert result["squares"]["E_d"]["value"] == pytest.approx(1.01, abs=1e-6)
    assert len(read_returns(table, SIDE, NOMINAL)) == 4
    assert "E_d" in run(capsys, "fit-vehicle", *options).out


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("direction,x\ncw,1\n", ("--side", "4"), "no column y"),
        ("direction,x,y\nleft,1,2\n", ("--side", "4"), "line 2"),
        ("direction,x,y\ncw,1,2\n", ("--side", "0"), "a length above 0"),
        ("direction,x,y\ncw,1,2\n", (), "need --side"),
        ("direction,x,y\ncw,1,2\n", ("--side", "4", "log.csv"), "replaces a LOG"),
    ],
)
def test_bad_returns_are_refused(
    capsys: Capture, tmp_path: Path, text: str, options: tuple[str, ...], words: str
) -> None:
    table = tmp_path / "returns.csv"
    table.write_text(text)
    result = run(capsys, "fit-vehicle", "--returns", table, *options)
    assert result.code in (1, 2)
    assert words in result.err
