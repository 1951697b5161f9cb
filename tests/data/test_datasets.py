"""The bundled data: the truth twin is the robot it claims to be, and the files are its answers."""

import ast
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sysid_datasets
import yaml
from numpy.typing import NDArray
from sysid_datasets import generate
from sysid_datasets.schedules import prbs
from sysid_datasets.twin import (
    AT_REST,
    DEVASTATOR,
    PWM_FULL,
    SAMPLE_TIME,
    State,
    advance,
    simulate_truth,
)

Array = NDArray[np.float64]
RADIUS, DISTANCE = 0.0215, 0.186
WITH_POSE = {"rotation", "multilevel", "prbs"}
FRICTIONLESS = replace(DEVASTATOR, motor_coulomb=0.0, track_load=(0.0, 0.0))


def held(left: float, right: float, seconds: float = 5.0) -> Array:
    return np.tile([left, right], (round(seconds / SAMPLE_TIME), 1))


def columns(name: str) -> dict[str, Array]:
    file = sysid_datasets.path(name)
    header = file.read_text().split("\n", 1)[0].split(",")
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    return dict(zip(header, table.T, strict=True))


# --- the twin's physics ---------------------------------------------------------------------------


def test_top_speed_is_that_of_the_robot() -> None:
    speed = simulate_truth(held(PWM_FULL, PWM_FULL)).omega[-1].mean() * RADIUS
    assert speed == pytest.approx(0.43, abs=0.01)


def test_tracks_differ_by_15_to_20_percent_in_gain() -> None:
    # Gain is the slope of speed over PWM, which friction does not change; 19 % at full PWM.
    low, high = (simulate_truth(held(p, p)).omega[-1] for p in (10000.0, 15000.0))
    slope = high - low
    assert 1.15 <= slope[1] / slope[0] <= 1.20
    top = simulate_truth(held(PWM_FULL, PWM_FULL)).omega[-1]
    assert 1.15 <= top[1] / top[0] <= 1.20


@pytest.mark.parametrize("pwm", [6000.0, 12000.0, 20000.0])
def test_equal_commands_turn_left(pwm: float) -> None:
    pose = simulate_truth(held(pwm, pwm, 1.5)).pose[-1]
    assert pose[1] > 0.0
    assert pose[2] > 0.0


@pytest.mark.parametrize("sign", [(1, 1), (-1, -1), (1, -1), (-1, 1)])
def test_small_commands_move_nothing_at_all(sign: tuple[int, int]) -> None:
    truth = simulate_truth(held(sign[0] * 2500.0, sign[1] * 2500.0))
    assert not truth.omega.any()
    assert not truth.pose.any()


@pytest.mark.parametrize("track", [0, 1])
def test_dead_zone_ends_between_2500_and_3500(track: int) -> None:
    moved = [abs(simulate_truth(held(p, p, 1.0)).omega[-1, track]) > 0.0 for p in (2500.0, 3500.0)]
    assert moved == [False, True]


def test_saturation_begins_at_the_duty_limit() -> None:
    edge = DEVASTATOR.duty_limit * PWM_FULL
    speeds = [simulate_truth(held(p, p)).omega[-1] for p in (edge - 1000.0, edge, PWM_FULL)]
    assert np.all(speeds[1] > speeds[0] + 0.5)
    np.testing.assert_array_equal(speeds[2], speeds[1])


def test_coasting_stops_for_good() -> None:
    pwm = np.vstack([held(15000.0, -15000.0, 2.0), held(0.0, 0.0, 3.0)])
    truth = simulate_truth(pwm)
    assert not truth.omega[-10:].any()
    assert np.ptp(truth.pose[-10:], axis=0).max() == 0.0
    # Friction stops the tracks, it never turns them back.
    assert truth.omega[:, 0].min() >= 0.0
    assert truth.omega[:, 1].max() <= 0.0


def test_pushing_one_track_changes_the_other_one_slightly_and_only_for_a_while() -> None:
    steady = held(10000.0, 10000.0)
    pushed = steady.copy()
    pushed[20:, 1] = 16000.0
    change = simulate_truth(pushed).omega - simulate_truth(steady).omega
    own, other = change[-1, 1], change[20:, 0]
    # The modes (0.17 s forward, 0.29 s turning) give a peak of 0.10 of the pushed track's change.
    assert 0.05 < np.abs(other).max() / own < 0.15
    assert abs(other[-1]) < 0.05 * np.abs(other).max()


@pytest.mark.parametrize(("sign", "tau"), [(1.0, 0.1656), (-1.0, 0.2950)])
def test_without_friction_the_speed_follows_the_closed_form(sign: float, tau: float) -> None:
    # Equal gains leave one mode: w = G V / D (1 - exp(-t / tau)), tau = (M11 ± M12) / D by hand:
    # J = 1.44e-3, a = 1.7334e-4, b = 8.7115e-4 kg m², D = 0.010789 Nm/(rad/s).
    twin = replace(FRICTIONLESS, voltage_gain=(1.0, 1.0))
    truth = simulate_truth(held(sign * 8000.0, 8000.0, 1.0), twin)
    torque = 120.0 * 8.6626e-4 / 3.1 * 7.5 * 0.4
    damping = 120.0**2 * (8.6626e-4 * 0.0023 / 3.1 + 1.0651e-7)
    expected = torque / damping * (1.0 - np.exp(-truth.t / tau))
    # 2e-3 of the final speed: tau above has four digits.
    np.testing.assert_allclose(truth.omega[:, 1], expected, atol=2e-3 * expected[-1])
    np.testing.assert_allclose(truth.omega[:, 0], sign * truth.omega[:, 1], atol=1e-12)


def test_pose_follows_the_tracks() -> None:
    # Steady speeds trace a circle of radius B/2 (wr + wl)/(wr - wl).
    twin = FRICTIONLESS
    running = simulate_truth(held(6000.0, 12000.0, 6.0), twin)
    left, right = running.omega[-1]
    start: State = (left, right, 0.3, -0.2, 0.5)
    _, _, x, y, psi = advance(start, (6000.0, 12000.0), 1.0, twin, steps=500)
    turned = RADIUS / DISTANCE * (right - left)
    circle = DISTANCE / 2.0 * (right + left) / (right - left)
    # 1e-6: what is left of the transient (e^-20), and the chord of a 2 ms step.
    assert psi == pytest.approx(0.5 + turned, abs=1e-6)
    assert x == pytest.approx(0.3 + circle * (math.sin(psi) - math.sin(0.5)), abs=1e-6)
    assert y == pytest.approx(-0.2 - circle * (math.cos(psi) - math.cos(0.5)), abs=1e-6)


@pytest.mark.parametrize("name", ["multilevel_val", "prbs", "rotation"])
def test_finer_integration_changes_nothing_visible(name: str) -> None:
    truth = generate.truth_of(name)
    finer = simulate_truth(truth.pwm[:400], steps=150)
    # A tenth of the encoder's noise; the instants at which a track sticks limit the agreement.
    np.testing.assert_allclose(truth.omega[:400], finer.omega, atol=0.1 * generate.OMEGA_SIGMA)


def test_a_command_is_answered_one_sample_later() -> None:
    omega = simulate_truth(held(12000.0, 12000.0, 0.5)).omega
    assert not omega[0].any()
    assert omega[1].min() > 10.0 * generate.OMEGA_SIGMA


def test_the_thesis_loop_drives_the_twin_one_metre() -> None:
    """Mission 1 of the thesis: 4.9 s, ends at (0.91, 0.028), at most 0.04 m off the line.

    5.2 ± 0.6 s and a drift of 0.02-0.06 m are the tolerances of the published outcome.
    """
    arrival, (_, _, x, y, _) = _drive_to((1.0, 0.0))
    assert arrival == pytest.approx(5.2, abs=0.6)
    assert math.hypot(x - 1.0, y) <= 0.10
    assert 0.02 <= y <= 0.06


def _drive_to(goal: tuple[float, float]) -> tuple[float, State]:
    """Attractive field, PI on speed and P on yaw with the thesis's gains, every 0.1 s."""
    state, integral = AT_REST, 0.0
    for k in range(300):
        left, right, x, y, psi = state
        away_x, away_y = goal[0] - x, goal[1] - y
        distance = math.hypot(away_x, away_y)
        if distance <= 0.10:
            return k * SAMPLE_TIME, state
        error = 0.3 * 2.0 / (2.0 + 0.4 / distance) - RADIUS / 2.0 * (left + right)
        speed = 2.0 * error + 1.85 * (integral + error * SAMPLE_TIME)
        if 0.0 <= speed <= 1.0:
            integral += error * SAMPLE_TIME
        turn = math.remainder(math.atan2(away_y, away_x) - psi, 2.0 * math.pi)
        speed, turn = min(max(speed, 0.0), 1.0), min(max(0.4 * turn, -0.3), 0.3)
        drive = [min(max(v, -1.0), 1.0) * PWM_FULL for v in (speed - turn, speed + turn)]
        state = advance(state, drive)
    raise AssertionError(f"never arrived: {state}")


# --- the logs -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_files_are_what_the_generator_writes(tmp_path: Path) -> None:
    assert generate.main(["--out", str(tmp_path)]) == 0
    bundled = sysid_datasets.folder("devastator")
    assert {p.name for p in (tmp_path / "devastator").iterdir()} == {
        p.name for p in bundled.glob("*")
    }
    for file in (tmp_path / "devastator").iterdir():
        assert file.read_bytes() == (bundled / file.name).read_bytes(), file.name


def test_the_generator_runs_as_a_file_without_an_installation(tmp_path: Path) -> None:
    script = Path(generate.__file__)
    # -S -s leave out site-packages, hence the workbench; NumPy alone is put back.
    environment = {**os.environ, "PYTHONPATH": str(_only_numpy(tmp_path / "lib"))}
    done = subprocess.run(
        [sys.executable, "-S", "-s", str(script), "--out", str(script)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    # The folder is a file: one sentence, exit 1. That it got there means its imports resolved.
    assert done.returncode == 1
    assert done.stderr.startswith("cannot write the logs to ")
    assert done.stderr.count("\n") == 1


def _only_numpy(folder: Path) -> Path:
    folder.mkdir()
    installed = Path(np.__file__).parent
    for package in (installed, installed.with_name("numpy.libs")):
        if package.exists():
            (folder / package.name).symlink_to(package)
    return folder


def test_a_perfect_model_fits_99_percent_on_multilevel() -> None:
    truth, log = generate.truth_of("multilevel"), columns("multilevel")
    for track, name in enumerate(("omega_l", "omega_r")):
        error = np.linalg.norm(log[name] - truth.omega[:, track])
        fit = 100.0 * (1.0 - error / np.linalg.norm(log[name] - log[name].mean()))
        # One noise for both tracks, whose spreads differ by 20 %.
        assert fit == pytest.approx(99.0, abs=0.3)


@pytest.mark.slow
def test_the_noise_is_the_stated_one_in_every_log() -> None:
    for name in generate.LOGS:
        truth, log = generate.truth_of(name), columns(name)
        noise = np.column_stack([log["omega_l"], log["omega_r"]]) - truth.omega
        # 4 standard errors of a standard deviation, 1/sqrt(2 N), and of a mean.
        allowed = 4.0 / math.sqrt(2.0 * noise.size)
        assert noise.std() == pytest.approx(generate.OMEGA_SIGMA, rel=allowed), name
        assert abs(noise.mean()) < 4.0 * generate.OMEGA_SIGMA / math.sqrt(noise.size), name
        if "x" in log:
            off = np.column_stack([log["x"], log["y"], log["psi"]]) - truth.pose
            sigma = [generate.POSITION_SIGMA, generate.POSITION_SIGMA, generate.HEADING_SIGMA]
            # 1 % more: the log's last digit, 1e-4, is a tenth of the noise.
            allowed = 4.0 / math.sqrt(2.0 * len(off)) + 0.01
            np.testing.assert_allclose(off.std(axis=0), sigma, rtol=allowed, err_msg=name)


@pytest.mark.parametrize("name", sorted(generate.LOGS))
def test_columns_times_and_range(name: str) -> None:
    log = columns(name)
    pose = ["x", "y", "psi"] if name.removesuffix("_val") in WITH_POSE else []
    assert list(log) == ["t", "pwm_l", "pwm_r", "omega_l", "omega_r", *pose]
    np.testing.assert_allclose(log["t"], SAMPLE_TIME * np.arange(len(log["t"])), atol=1e-9)
    assert 30.0 <= log["t"][-1] <= 120.0
    pwm = np.column_stack([log["pwm_l"], log["pwm_r"]])
    assert np.abs(pwm).max() <= PWM_FULL
    assert not pwm[:10].any()


@pytest.mark.parametrize(
    ("name", "correlation", "allowed"),
    [
        ("forward_back", 1.0, 0.0),
        ("rotation", -1.0, 0.0),
        ("multilevel", 0.0, 0.1),
        ("prbs", 0.0, 0.1),
        ("multisine", 0.0, 0.1),
    ],
)
@pytest.mark.parametrize("suffix", ["", "_val"])
def test_tracks_are_excited_alike_or_independently(
    name: str, suffix: str, correlation: float, allowed: float
) -> None:
    log = columns(name + suffix)
    # Without the first second, at rest on both tracks.
    found = np.corrcoef(log["pwm_l"][10:], log["pwm_r"][10:])[0, 1]
    assert found == pytest.approx(correlation, abs=allowed + 1e-12)


def test_multilevel_visits_the_dead_zone_and_the_saturation() -> None:
    log = columns("multilevel")
    for name in ("pwm_l", "pwm_r"):
        size = np.abs(log[name])
        assert np.mean((size > 0) & (size < 3000)) > 0.05
        assert np.mean(size > DEVASTATOR.duty_limit * PWM_FULL) > 0.02


@pytest.mark.parametrize("tap", [6, 4])
def test_prbs_is_a_maximum_length_sequence(tap: int) -> None:
    signs = np.sign(prbs(np.random.default_rng(1), 1000, 0.1, tap)[10:, 0])
    assert len(signs) == 127
    # Its defining property: the cyclic auto-correlation is -1 at every lag but zero.
    assert {int(signs @ np.roll(signs, lag)) for lag in range(1, 127)} == {-1}


def lagged(pwm: Array, omega: Array, order: int) -> Array:
    """Regressors of an ARX model without noise model: own past speeds, both tracks' commands."""
    rows = [omega[order - lag : len(omega) - lag] for lag in range(1, order + 1)]
    for track in (0, 1):
        rows += [pwm[order - lag : len(pwm) - lag, track] for lag in range(1, order + 1)]
    return np.column_stack(rows)


@pytest.mark.parametrize(("name", "least"), [("prbs", 95.0), ("multisine", 88.0)])
@pytest.mark.parametrize("track", [0, 1])
def test_a_linear_model_of_order_two_fits_the_well_behaved_logs(
    name: str, least: float, track: int
) -> None:
    """ARX(2, 2, 1) on both commands, free run on the other record; friction costs the rest."""
    order = 2
    logs = [columns(n) for n in (name, name + "_val")]
    pwm, other = (np.column_stack([log["pwm_l"], log["pwm_r"]]) / PWM_FULL for log in logs)
    omega, measured = (log[("omega_l", "omega_r")[track]] for log in logs)
    theta = np.linalg.lstsq(lagged(pwm, omega, order), omega[order:], rcond=None)[0]
    run = np.zeros(len(measured))
    for k in range(order, len(run)):
        past = [run[k - 1], run[k - 2], *other[[k - 1, k - 2], 0], *other[[k - 1, k - 2], 1]]
        run[k] = theta @ past
    spread = np.linalg.norm(measured - measured.mean())
    assert 100.0 * (1.0 - np.linalg.norm(measured - run) / spread) > least


# --- the package ----------------------------------------------------------------------------------


def test_names_and_paths() -> None:
    assert set(sysid_datasets.names("devastator")) == set(generate.LOGS)
    for kind in ("devastator", "missions"):
        for name in sysid_datasets.names(kind):
            file = sysid_datasets.path(name)
            assert file.is_file()
            assert sysid_datasets.path(file.name) == file
            assert file.parent == sysid_datasets.folder(kind)


@pytest.mark.parametrize(
    ("call", "argument", "named"),
    [
        (sysid_datasets.path, "prsb", "prbs"),
        (sysid_datasets.path, "../README.md", "goal_1m"),
        (sysid_datasets.folder, "benches", "missions"),
        (sysid_datasets.names, "", "devastator"),
    ],
)
def test_unknown_names_are_refused_with_the_known_ones(
    call: Callable[[str], object], argument: str, named: str
) -> None:
    with pytest.raises(FileNotFoundError, match=named):
        call(argument)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("goal_1m", {"goal": [1, 0]}),
        ("obstacles_6_3", {"goal": [6, 3], "obstacles": [[2, 3.5], [3, 1], [4, 2.5], [5, 3]]}),
        ("straight_5m_theta1", {"goal": [5, 0], "guidance": {"Kg": 0.3, "theta": 1}}),
        ("straight_5m_theta2", {"goal": [5, 0], "guidance": {"Kg": 0.3}}),
    ],
)
def test_missions_say_what_differs_from_the_defaults(name: str, expected: object) -> None:
    assert yaml.safe_load(sysid_datasets.path(name).read_text(encoding="utf-8")) == expected


def test_every_file_is_described() -> None:
    page = (sysid_datasets.folder() / "README.md").read_text(encoding="utf-8")
    for kind in ("devastator", "missions"):
        for name in sysid_datasets.names(kind):
            assert f"`{name}`" in page, name


@pytest.mark.parametrize(
    "module", sorted({p.stem for p in Path(generate.__file__).parent.glob("*.py")} - {"multibody"})
)
def test_the_twin_shares_no_code_with_the_workbench(module: str) -> None:
    """Of ``multibody`` the physics is MuJoCo's; it has the scene in common with the missions."""
    source = Path(generate.__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    imported = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [])
        + ([alias.name for alias in node.names] if isinstance(node, ast.Import) else [])
    }
    assert not imported & {"sysid", "sysid_cli", "scipy"}
