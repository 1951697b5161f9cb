"""Inertia from a pendulum: the thesis's numbers, simulated swings with friction, and odd logs."""

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from sysid.data.reading.read_options import ReadOptions
from sysid.errors import SysidError
from sysid.testbench.pendulum.inertia import Hanging, small_swing_period
from sysid.testbench.pendulum.study import inertia_of_logs, inertia_of_period

BODY = Hanging()
TRUE = 0.03
"""Inertia of the simulated body [kg m²]."""
SMALL = BODY.period(TRUE)


@cache
def swing(
    amplitude: float = 10.0, viscous: float = 0.003, dry: float = 0.008, seconds: float = 35.0
) -> Callable[[np.ndarray], np.ndarray]:
    """θ(t) [rad] of a rigid pendulum with friction in its hinge, from a turning point.

    Integrated over each half swing by itself, so that dry friction [Nm] is a constant there.
    """
    total = BODY.steiner + TRUE
    pieces, t, theta, sign = [], 0.0, math.radians(amplitude), 1.0
    while t < seconds:

        def slope(_: float, x: np.ndarray, sign: float = sign) -> list[float]:
            torque = -BODY.moment * math.sin(x[0]) - viscous * x[1] + sign * dry
            return [x[1], torque / total]

        def stands(_: float, x: np.ndarray, sign: float = sign) -> float:
            return sign * float(x[1])

        stands.terminal, stands.direction = True, 1.0  # type: ignore[attr-defined]
        result = solve_ivp(
            slope, (0.0, SMALL), [theta, 0.0], events=stands, rtol=1e-9, atol=1e-11,
            dense_output=True,
        )  # fmt: skip
        pieces.append((t, result.sol))
        t, theta, sign = t + float(result.t[-1]), float(result.y[0, -1]), -sign

    def angle(at: np.ndarray) -> np.ndarray:
        out = np.empty(len(at))
        starts = [start for start, _ in pieces]
        which = np.searchsorted(starts, at, side="right") - 1
        for k in np.unique(which):
            inside = which == k
            out[inside] = pieces[k][1](at[inside] - starts[k])[0]
        return out

    return angle


def noisy(rate: float, seed: int, seconds: float = 35.0) -> tuple[np.ndarray, np.ndarray]:
    """Instants with a fifth of a sample of jitter [s], and the angle with 0.1° of noise [rad]."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate)
    t[1:] += 0.2 / rate * rng.uniform(-1.0, 1.0, len(t) - 1)
    return t, swing()(t) + math.radians(0.1) * rng.standard_normal(len(t))


def log(path: Path, t: np.ndarray, **columns: np.ndarray) -> Path:
    return write_log(path, ["t", *columns], [t, *columns.values()], step=None)


def test_the_thesis_period_gives_the_thesis_inertia(capsys: Capture) -> None:
    result = run(capsys, "bench", "pendulum", "--period", 1.735, "--json").document
    assert result["inertia_kg_m2"] == pytest.approx(0.0652, abs=5e-5)  # as printed
    assert result["corrected_kg_m2"] == pytest.approx(0.0618, abs=5e-5)
    low, high = result["interval_kg_m2"]  # ± 5 ms
    assert high - low == pytest.approx(0.0102, abs=5e-5)
    assert result["sensitivities"]["period"] * 0.010 == pytest.approx(0.0102, abs=5e-5)
    assert result["driver"] == "period"
    assert result["std_error"] > 0.5 * (high - low)  # lengths and masses have errors, too
    assert result["box_inertia_kg_m2"] == pytest.approx(1.592 / 12 * (0.19**2 + 0.134**2))
    assert "8.6 times the value from mass and size" in " ".join(result["sentences"])


def test_sensitivities_are_derivatives() -> None:
    period, step = 1.735, 1e-6
    slopes = BODY.sensitivities(period)
    assert slopes.pop("period") == pytest.approx(
        (BODY.inertia(period + step) - BODY.inertia(period - step)) / (2 * step), rel=1e-6
    )
    letters = {name: getattr(BODY, name) for name in slopes}
    for name, slope in slopes.items():
        high, low = (Hanging(**(letters | {name: letters[name] + s * step})) for s in (1, -1))
        apart = (high.inertia(period) - low.inertia(period)) / (2 * step)
        assert slope == pytest.approx(apart, rel=1e-6), name


@pytest.mark.parametrize("degrees", [0.0, 10.0, 60.0, 120.0])
def test_the_amplitude_is_taken_out_exactly(degrees: float) -> None:
    amplitude = math.radians(degrees)
    exact = 2.0 / math.pi * float(ellipk(math.sin(amplitude / 2.0) ** 2))
    assert small_swing_period(exact, amplitude) == pytest.approx(1.0, rel=1e-12)
    series = 1.0 + amplitude**2 / 16.0
    assert exact - series == pytest.approx(11.0 * amplitude**4 / 3072.0, abs=0.012 * amplitude**6)


@pytest.mark.parametrize(("rate", "most"), [(20.0, 1e-4), (200.0, 3e-5)])
def test_the_interval_of_a_log_holds_the_truth(tmp_path: Path, rate: float, most: float) -> None:
    # 0.1° of noise on 20 swings of 10° allow σ(T) ≈ √24 σ / (2π A n √N) · T = 3e-5 s at 20 Hz
    t, angle = noisy(rate, seed=4)
    study = inertia_of_logs([log(tmp_path / "a.csv", t, angle_deg=np.degrees(angle))])
    assert abs(study.small_period - SMALL) < 3.0 * study.small_std_error < 3.0 * most
    assert abs(study.corrected - TRUE) < 1e-4  # the period's part: 1.0 kg m²/s · 1e-4 s
    assert study.logs[0].oscillation.friction == pytest.approx(0.008 / BODY.moment, rel=0.1)
    assert study.period > study.small_period
    assert not study.findings


@pytest.mark.slow
def test_an_angle_may_come_in_any_form(tmp_path: Path) -> None:
    t, angle = noisy(20.0, seed=5)
    half, still = angle / 2.0, np.zeros(len(t))
    turn = np.array([0.8, 0.0, 0.0, 0.6])  # the tracker's own attitude
    w, x = np.cos(half), np.sin(half)
    forms = {
        "degrees": {"angle": np.degrees(angle)},
        "radians": {"theta_rad": angle, "speed_rad_s": np.gradient(angle, t)},
        "of several": {"roll_deg": still + 0.01 * angle, "pitch_deg": np.degrees(angle)},
        "quaternion": {
            "qw": turn[0] * w, "qx": turn[0] * x, "qy": turn[3] * x, "qz": turn[3] * w,
        },
        "position": {"x": 0.7 * np.sin(angle), "y": 1.0 - 0.7 * np.cos(angle), "z": still},
    }  # fmt: skip
    for form, columns in forms.items():
        study = inertia_of_logs([log(tmp_path / f"{form}.csv", t, **columns)])
        assert abs(study.small_period - SMALL) < 4.0 * study.small_std_error < 4e-4, form
        assert math.degrees(study.logs[0].oscillation.amplitudes[0]) == pytest.approx(10, abs=0.5)


def test_what_is_no_free_swing_is_left_out(tmp_path: Path) -> None:
    t, angle = noisy(20.0, seed=6)
    rng = np.random.default_rng(6)
    held = np.arange(0.0, 3.0, 0.05)
    t = np.concatenate([held, 3.0 + t])
    angle = np.concatenate([np.full(len(held), angle[0]), angle])
    wild = rng.choice(len(t), 15, replace=False)
    angle[wild] += rng.choice([-1.0, 1.0], 15)
    kept = (t < 14.0) | (t > 16.5)
    study = inertia_of_logs([log(tmp_path / "a.csv", t[kept], angle_rad=angle[kept])])
    assert abs(study.small_period - SMALL) < 4.0 * study.small_std_error < 4e-4
    assert study.logs[0].oscillation.left_out >= 12  # some may lie in the part that is held
    assert study.logs[0].oscillation.t[0] > 3.0


@pytest.mark.slow
def test_logs_are_weighed_and_compared(tmp_path: Path, capsys: Capture) -> None:
    paths = []
    for seed, stretched in ((1, 1.0), (2, 1.0), (3, 1.001)):
        t, angle = noisy(20.0, seed)
        paths.append(log(tmp_path / f"{seed}.csv", t * stretched, angle_deg=np.degrees(angle)))
    both = inertia_of_logs(paths[:2])
    assert both.small_std_error < min(r.oscillation.small_std_error for r in both.logs)
    picture = tmp_path / "swing.svg"
    result = run(capsys, "bench", "pendulum", *paths, "--plot", picture, "--json").document
    assert picture.read_text().startswith("<?xml")
    assert [f["code"] for f in result["findings"]] == ["logs-differ"]
    assert result["small_swing_period_std_error"] > 5.0 * both.small_std_error
    shown = run(capsys, "bench", "pendulum", paths[0])
    assert shown.code == 0
    assert "dominated by" in shown.out


def test_a_plain_damped_sine_is_said_to_be_no_pendulum(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 35.0, 0.02)
    angle = 20.0 * np.exp(-0.03 * t) * np.cos(2 * np.pi * t / 1.735)
    path = log(tmp_path / "a.csv", t, angle_deg=angle + 0.1 * rng.standard_normal(len(t)))
    study = inertia_of_logs([path])
    assert abs(study.period - 1.735) < 4.0 * study.period_std_error < 2e-4
    assert [f.code for f in study.findings] == ["not-a-pendulum"]


T = np.arange(0.0, 30.0, 0.05)
SINE = np.sin(2 * np.pi * T / 1.735)
REFUSED = {
    "no oscillation": ({"angle": np.random.default_rng(0).standard_normal(len(T))}, "oscillation"),
    "at rest": ({"pitch_deg": np.random.default_rng(2).standard_normal(len(T))}, "is noise"),
    "a ramp": ({"angle_deg": 2.0 * T}, "drifts evenly"),
    "no measurement": ({"angle_deg": np.nan * T}, "has 0 measurements"),
    "a random walk": (
        {"angle": np.cumsum(np.random.default_rng(0).standard_normal(len(T)))},
        "no oscillation",
    ),
    "overdamped": ({"angle_deg": 10.0 * np.exp(-T)}, "no oscillation"),
    "two periods": ({"angle_deg": 10.0 * SINE * (T < 3.5)}, "needed; let it swing"),
    "constant": ({"angle_deg": 0.0 * T + 3.0}, "stays at"),
    "other columns": ({"current_A": SINE}, "no angle, quaternion or position"),
    "two that swing": ({"roll": SINE, "pitch": SINE}, "several angles that swing"),
    "no angle's unit": ({"angle [V]": SINE}, "no angle"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_logs_that_cannot_serve_are_refused(case: str, tmp_path: Path, capsys: Capture) -> None:
    columns, words = REFUSED[case]
    result = run(capsys, "bench", "pendulum", log(tmp_path / "a.csv", T, **columns))
    assert result.code == 1
    assert words in result.err
    assert result.err.count("\n") == 1


def test_slow_sampling_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SysidError, match="too slow for a period"):
        inertia_of_logs([log(tmp_path / "a.csv", T[::12], angle_deg=10.0 * SINE[::12])])


def test_a_log_that_does_not_tell_its_time_needs_it(tmp_path: Path) -> None:
    t = np.arange(0.0, 35.0, 0.05)
    columns = {"angle_deg": np.degrees(swing()(t)), "height": 0.0 * t}
    path = write_log(tmp_path / "a.csv", list(columns), list(columns.values()), step=None)
    with pytest.raises(SysidError, match="has no sample time"):
        inertia_of_logs([path])
    study = inertia_of_logs([path], options=ReadOptions(ts=0.05))
    assert study.small_period == pytest.approx(SMALL, abs=2e-5)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--period", "1.735", "--m", "-1"], 2, "the mass m is -1"),
        (["--period", "1.735", "--I1", "-1"], 2, "inertia I1 is -1"),
        (["--period", "0"], 2, "--period is 0"),
        (["--period", "1.5"], 1, "shorter than the 1.6698 s of a body without inertia"),
        (["--period", "1.735", "--swing", "190"], 2, "--swing is 190°"),
        (["--period", "1.735", "--std-error", "x=1"], 2, "'x' has no standard error"),
        (["--period", "1.735", "--std-error", "l"], 2, "write NAME=VALUE"),
        (["--period", "1.735", "--size", "0x1"], 2, "give two lengths above 0"),
        (["--period", "1.735", "--plot", "a.png"], 2, "omit it with --period"),
        ([], 2, "give either a log of the swing or its period"),
        (["a.csv", "--swing", "5"], 2, "belongs to --period"),
    ],
)
def test_wrong_use_is_one_sentence(
    arguments: list[str], code: int, words: str, capsys: Capture
) -> None:
    result = run(capsys, "bench", "pendulum", *arguments)
    assert (result.code, result.out) == (code, "")
    assert words in result.err
    assert result.err.count("\n") == 1


def test_errors_that_are_given_count() -> None:
    exact = dict.fromkeys(("m", "m1", "l", "l1", "I1", "g"), 0.0)
    study = inertia_of_period(1.735, Hanging(errors=exact), std_error=0.001)
    assert study.std_error == pytest.approx(0.001 * BODY.sensitivities(1.735)["period"])
    longer = inertia_of_period(1.735, Hanging(errors=exact | {"l": 0.01}), std_error=0.001)
    assert next(iter(longer.contributions)) == "l"
    assert inertia_of_period(1.8, Hanging(m=2.0)).box is None  # another robot of unknown size
