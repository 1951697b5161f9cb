"""Battery and H-bridge: simulated rests, loads and staircases, and what a mission makes of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from mission_cases import Robot, goal
from plant_models import bench_record, robot_model
from scipy.signal import lfilter

from sysid.data.record import Channel
from sysid.effects.catalogue import chain_effects
from sysid.effects.measured import Measured, read_measured, within
from sysid.errors import SysidError
from sysid.estimation.pem import fit
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.registry import structure_class
from sysid.testbench.power.study import bench_power

BATTERY = {"E": 7.9, "R0": 0.08, "R1": 0.05, "tau": 12.0, "slope": 0.5}
"""Open-circuit voltage [V], resistances [Ω], recovery [s], fall per charge [V/Ah]."""


def loads(seconds: float, seed: int = 0, step: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Battery's voltage [V] and current [A]: rests and loads of 20 s in turns, 5 mV of noise."""
    rng = np.random.default_rng(seed)
    block = int(20.0 / step)
    levels = [0.05 if k % 2 == 0 else rng.uniform(1.0, 4.0) for k in range(int(seconds / 20.0))]
    current = np.repeat(levels, block)
    a = np.exp(-step / BATTERY["tau"])
    held = lfilter([0.0, 1.0 - a], [1.0, -a], BATTERY["R1"] * current)
    charge = (np.cumsum(current) - current) * step / 3600.0
    voltage = BATTERY["E"] - BATTERY["slope"] * charge - BATTERY["R0"] * current - held
    return voltage + 0.005 * rng.standard_normal(len(current)), current


def battery_log(path: Path, seconds: float = 300.0, sign: float = 1.0, seed: int = 0) -> Path:
    voltage, current = loads(seconds, seed)
    return write_log(path, ["battery_voltage_V", "battery_current_A"], [voltage, sign * current])


LEVELS = np.concatenate([np.arange(0, 21), np.arange(19, -21, -1), np.arange(-19, 1)]) * 0.05
BANDS = (0.063, 0.081)


def cut(drive: np.ndarray, gain: float = 7.2) -> np.ndarray:
    """A dead band that is cut out of the command."""
    beyond = np.maximum(np.abs(drive) - np.where(drive > 0, *BANDS), 0.0)
    return gain * np.sign(drive) * beyond


def staircase(
    path: Path, answer: str, law: object = cut, scale: float = 20000.0, **more: float
) -> Path:
    """A staircase up and down in both directions, 2 s a step, with a lag of 0.1 s and noise."""
    rng = np.random.default_rng(1)
    drive = np.repeat(LEVELS, 40)
    lagged = lfilter([0.0, 0.4], [1.0, -0.6], law(drive))  # type: ignore[operator]
    noisy = lagged + 0.02 * rng.standard_normal(len(drive))
    columns = {"pwm": scale * drive, answer: noisy}
    columns |= {name: np.full(len(drive), value) for name, value in more.items()}
    return write_log(path, list(columns), list(columns.values()), step=0.05)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_slow_recovery_is_no_resistance_that_acts_at_once(tmp_path: Path, sign: float) -> None:
    (b,) = bench_power([battery_log(tmp_path / "a.csv", sign=sign)]).batteries
    assert b.turned == (sign < 0)
    assert abs(b.resistance - 0.08) < 3.0 * b.std_error < 1e-3
    assert abs(b.settled - 0.13) < 3.0 * b.settled_std_error < 8e-3
    assert abs(b.open_voltage - 7.9) < 3.0 * b.open_std_error < 5e-3
    (branch,) = b.branches
    assert abs(branch.tau - 12.0) < 3.0 * branch.tau_std_error < 1.0
    assert b.slope is not None
    assert abs(b.slope - 0.5) < 3.0 * (b.slope_std_error or 0.0) < 0.2


def test_a_table_gives_the_resistance_of_lasting_loads(tmp_path: Path) -> None:
    current = np.array([0.0, 0.5, 1.0, 2.0, 3.0])
    noise = 1e-3 * np.array([1.0, -1.0, 1.0, -1.0, 0.5])
    path = write_log(
        tmp_path / "a.csv", ["voltage_V", "current_A"], [7.9 - 0.13 * current + noise, current],
        step=None,
    )  # fmt: skip
    study = bench_power([path])
    (b,) = study.batteries
    assert abs(b.resistance - 0.13) < 3.0 * b.std_error < 5e-3
    assert b.charge is None
    assert "steady-table" in [f.code for f in study.findings]


@pytest.mark.parametrize("answer", ["motor_voltage_V", "omega"])
def test_both_dead_bands_of_a_bridge(tmp_path: Path, answer: str) -> None:
    study = bench_power([staircase(tmp_path / "a.csv", answer)])
    supply = study.supply()
    for key, band in zip(("dead_band_forward", "dead_band_backward"), BANDS, strict=True):
        assert abs(supply[key].value - band) < 4.0 * supply[key].std_error < 4e-3
    assert "dead_band_jump" not in supply
    assert ("voltage" in supply) == (answer != "omega")
    friction = [f.code for f in study.findings]
    assert ("not-the-bridge-alone" in friction) == (answer == "omega")


def test_a_small_answer_on_the_line_is_no_dead_band(tmp_path: Path) -> None:
    """Just beyond the band the first answer is below any share of the largest one."""

    def close(drive: np.ndarray) -> np.ndarray:
        return 7.2 * np.sign(drive) * np.maximum(np.abs(drive) - 0.09, 0.0)

    supply = bench_power([staircase(tmp_path / "a.csv", "motor_voltage_V", close)]).supply()
    for key in ("dead_band_forward", "dead_band_backward"):
        assert abs(supply[key].value - 0.09) < 4.0 * supply[key].std_error < 4e-3
    assert "dead_band_jump" not in supply


def test_gain_and_drop_of_a_bridge(tmp_path: Path) -> None:
    study = bench_power([staircase(tmp_path / "a.csv", "motor_voltage_V", supply_V=7.4)])
    (bridge,) = study.bridges
    d = bridge.forward
    assert d is not None
    assert abs(d.gain - 7.2) < 4.0 * d.gain_std_error < 0.05
    drop = bridge.drop(d)
    assert drop is not None
    assert abs(drop[0] - (7.4 - 7.2 * (1.0 - BANDS[0]))) < 4.0 * drop[1] < 0.05


def test_a_jump_is_told_from_a_band_that_is_cut_out(tmp_path: Path) -> None:
    def jumps(drive: np.ndarray) -> np.ndarray:
        return np.where(np.abs(drive) > 0.12, 7.2 * drive, 0.0)

    path = staircase(tmp_path / "a.csv", "motor_voltage_V", jumps, scale=255.0)
    supply = bench_power([path], pwm_max=255.0).supply()
    for key in ("dead_band_forward", "dead_band_backward", "dead_band_jump"):
        # known to a step of the staircase
        assert supply[key].value == pytest.approx(0.12, abs=0.03)
        assert abs(supply[key].value - 0.12) < 3.0 * supply[key].std_error


def test_what_is_measured_fills_a_mission_and_bounds_a_diagnosis(
    tmp_path: Path, capsys: Capture
) -> None:
    mission, bench, picture = (tmp_path / n for n in ("m.yaml", "bench.json", "p.svg"))
    mission.write_text("# mine\ngoal: [1, 0]\nvehicle:\n  r: 0.03\n  supply: {loss: 0.001}\n")
    files = [battery_log(tmp_path / "b.csv"), staircase(tmp_path / "s.csv", "motor_voltage_V")]
    line = ["bench", "power", *files, "--full-current", 3, "-o", mission, "-o", bench]
    result = run(capsys, *line, "--plot", picture, "--json").document
    supply = result["vehicle"]["supply"]
    assert supply["sag"] == pytest.approx(3.0 * 0.13 / 7.9, rel=0.02)
    text = mission.read_text()
    assert text.startswith("# mine\ngoal: [1, 0]\n")
    assert "r: 0.03" in text
    assert f"dead_band_forward: {supply['dead_band_forward']:.4g}" in text
    assert picture.read_text().startswith("<?xml")
    effects = within(chain_effects(), read_measured(bench))
    band = next(p for e in effects for p in e.parameters if p.measured_as == "dead_band_forward")
    assert band.lower < BANDS[0] < band.upper < 0.1
    assert band.starts == (pytest.approx(supply["dead_band_forward"]),) * len(band.starts)
    shown = run(capsys, *line[:4])
    assert "mΩ more after 1" in shown.out


def test_bounds_keep_within_what_an_effect_may_be() -> None:
    effects = within(chain_effects(), {"sag": Measured(0.95, 0.5), "nothing": Measured(1.0, 1.0)})
    sag = next(p for e in effects for p in e.parameters if p.measured_as == "sag")
    assert (sag.lower, sag.upper) == (0.0, 0.9)
    others = [e for e in effects if sag not in e.parameters]
    assert all(e in chain_effects() for e in others)


def test_supply_acts_between_command_and_plant() -> None:
    plain, fed = goal(1.0, 0.0), goal(1.0, 0.0, vehicle={"supply": {"sag": 0.3}})
    robot, notes = as_robot(Robot(), fed)
    assert any("counts twice" in n for n in notes)
    before, after = (simulate(m, robot).log for m in (plain, fed))
    assert after["pwm_l"][0] == before["pwm_l"][0] > 0.0  # the command is that of control
    load = 0.5 * (before["pwm_l"][0] + before["pwm_r"][0]) / 20000.0
    assert after["omega_l"][1] / before["omega_l"][1] == pytest.approx(1.0 - 0.3 * load)
    idle = goal(1.0, 0.0, vehicle={"supply": {}})
    assert np.array_equal(simulate(idle, robot).log["x"], before["x"])


def test_commands_within_the_dead_band_move_nothing() -> None:
    fed = goal(1.0, 0.0, vehicle={"supply": {"dead_band_forward": 0.7, "dead_band_backward": 0.7}})
    robot, _ = as_robot(Robot(), fed)
    log = simulate(fed, robot).log
    first = int(np.argmax(log["pwm_l"] > 0.7 * 20000.0))
    assert first > 3  # the integral takes its time
    assert np.all(log["omega_l"][: first + 1] == 0.0)
    assert np.all(log["omega_l"][first + 1 : first + 3] > 0.0)


def test_the_supply_is_full_drive_of_a_motor_driven_by_voltage() -> None:
    record = bench_record()
    record = replace(
        record, u=record.u - 5.0, y=record.y - 40.0,
        inputs=(Channel("voltage", "V"),), outputs=(Channel("omega", "rad/s"),),
    )  # fmt: skip
    structure = structure_class("arx").from_orders({"na": 2, "nb": 2, "nk": 1}, 1, 1)
    plant = fit(structure, [record]).plant()
    fed = goal(1.0, 0.0, vehicle={"supply": {"voltage": 6.0}})
    robot, notes = as_robot(plant, fed)
    assert robot.span == pytest.approx((6.0, 6.0))
    assert robot.scale == pytest.approx((1.0, 1.0))
    assert not any("counts twice" in n for n in notes)
    assert any("not voltages" in n for n in as_robot(robot_model().plant(), fed)[1])


REFUSED = {
    "no load": ({"voltage_V": 7.9, "current_A": 0.0}, "0 A throughout"),
    "one load": ({"voltage_V": 7.5, "current_A": 2.0}, "2 A throughout"),
    "no current": ({"voltage_V": 7.5, "height_m": 2.0}, "has neither the columns of a battery"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_logs_that_cannot_serve_are_refused(case: str, tmp_path: Path, capsys: Capture) -> None:
    columns, words = REFUSED[case]
    path = write_log(tmp_path / "a.csv", list(columns), [[v] * 50 for v in columns.values()])
    result = run(capsys, "bench", "power", path)
    assert (result.code, result.out) == (1, "")
    assert words in result.err
    assert result.err.count("\n") == 1


def test_staircases_that_cannot_serve_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SysidError, match="full drive is unknown"):
        bench_power([staircase(tmp_path / "a.csv", "motor_voltage_V", scale=255.0)])
    with pytest.raises(SysidError, match="fewer than 3 PWM steps change"):
        bench_power([staircase(tmp_path / "b.csv", "motor_voltage_V", lambda d: 0.0 * d)])
    with pytest.raises(SysidError, match="give a current above 0"):
        bench_power([battery_log(tmp_path / "c.csv")], full_current=-1.0)
    with pytest.raises(SysidError, match=r"d\.csv is not a file of `sysid bench power`"):
        read_measured(battery_log(tmp_path / "d.csv"))
