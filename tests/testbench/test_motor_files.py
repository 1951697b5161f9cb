"""What a file of the bench holds is told by its columns; what cannot be is one sentence."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run

from sysid.errors import DataError
from sysid.testbench.motor.characterise import MotorBench, MotorOptions, characterise_motor
from sysid.testbench.motor.equations import MotorConstants, steady_state
from sysid.testbench.motor.events import from_counter, from_times
from sysid.testbench.motor.joint import correlations
from sysid.testbench.motor.tables import columns_of, read_bench_table

TRUE = MotorConstants(R=2.4, Kem=0.004, Kc=0.0036, f=2e-7, C0=8e-5, J=1.5e-7, gear=60.0)
VOLTS = np.array([3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
LOADS = (0.02, 0.04, 0.06)
RPM = 30.0 / np.pi


def table(path: Path, head: str, *columns: Sequence[float] | np.ndarray) -> Path:
    rows = [",".join(f"{v:.6g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def experiments(folder: Path, seed: int) -> list[Path]:
    """All four experiments on a motor that is no one's, measurements with 0.5 % of noise."""
    rng = np.random.default_rng(seed)

    def noisy(values: np.ndarray) -> np.ndarray:
        return values * (1.0 + 0.005 * rng.standard_normal(np.shape(values)))

    speed, current = steady_state(TRUE, VOLTS)
    stalled = TRUE.gear * (TRUE.Kc * VOLTS / TRUE.R - TRUE.C0)
    at, load = np.repeat(VOLTS, 3), np.tile(LOADS, len(VOLTS))
    loaded, drawn = steady_state(TRUE, at, load)
    return [
        table(folder / "a.csv", "voltage_V,current_mA", VOLTS, 1e3 * noisy(VOLTS / TRUE.R)),
        table(
            folder / "b.csv", "V,current [A],speed_rpm", VOLTS, noisy(current), RPM * noisy(speed)
        ),
        table(folder / "c.csv", "voltage_V,torque_Nm", VOLTS, noisy(stalled)),
        table(
            folder / "d.csv", "voltage_V,load_Nm,speed_rad_s,i_mA", at, load, noisy(loaded),
            1e3 * noisy(drawn),
        ),
    ]  # fmt: skip


def errors(errors: MotorBench) -> list[float]:
    rows = [p for p in errors.parameters if p.value is not None]
    assert [p.name for p in rows] == ["R", "Kem", "Kc", "f", "C0"]
    return [abs(p.value - getattr(TRUE, p.name)) / p.std_error for p in rows]


@pytest.mark.parametrize("method", ["separate", "joint"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_experiments_tell_the_motor_within_their_errors(
    tmp_path: Path, method: str, seed: int
) -> None:
    bench = characterise_motor(experiments(tmp_path, seed), MotorOptions(gear=60.0, method=method))
    # noise levels come from a dozen measurements: Student's tails, 4.5 of 10 degrees of freedom is
    # 1e-3
    assert max(errors(bench)) < 4.5
    assert [t.kind.value for t in bench.tests] == [
        "blocked rotor", "no load", "stall", "external load",
    ]  # fmt: skip
    matrix = correlations(bench.covariance)
    assert np.all(np.abs(matrix) <= 1.0 + 1e-12)
    assert np.allclose(matrix, matrix.T)
    f, dry = (list(bench.names).index(n) for n in ("f", "C0"))
    assert matrix[f, dry] < 0.0  # one line: its slope against its intercept


def test_units_of_a_table_do_not_matter(tmp_path: Path) -> None:
    """rpm, mA and mNm or rad/s, A and Nm; nothing but rounding differs."""
    speed, current = steady_state(TRUE, VOLTS)
    one = table(tmp_path / "n.csv", "voltage_V,current_A,speed_rad_s", VOLTS, current, speed)
    other = table(tmp_path / "m.csv", "u_mV,i_mA,rpm", 1e3 * VOLTS, 1e3 * current, RPM * speed)
    options = MotorOptions(known={"R": (2.4, 0.01)}, gear=60.0)
    a, b = (characterise_motor([p], options).parameters for p in (one, other))
    for p, q in zip(a, b, strict=True):
        if p.name not in ("L", "J"):
            assert p.value == pytest.approx(q.value, rel=1e-4)


@pytest.mark.parametrize(
    ("head", "rows", "said"),
    [
        ("voltage_V,current_mA\n", "3,170\n5,210\n", "17.6 to 23.8 Ω; the motor turned"),
        ("voltage_V,current\n", "3,0.17\n", "current has no unit"),
        ("voltage_V,current_A\n", "3,0.97\n", "missing for Kem (no load"),
        ("voltage_V,current_A,speed_rpm\n", "3,0.17,85\n5,.21,149\n", "missing for R (a blocked"),
        ("current_A,speed_rpm\n", "1,85\n", "has no column of voltage"),
        ("voltage_V,current_A\n", "3,-0.97\n", "the current has the other sign"),
        ("R_ohm,gear\n", "-3.1,120\n", "R must be a positive number"),
        ("voltage_V,torque_Nm,motor_torque_Nm\n", "3,1,1\n", "two columns of torque"),
    ],
)
def test_a_file_that_cannot_serve_is_one_sentence(
    tmp_path: Path, capsys: Capture, head: str, rows: str, said: str
) -> None:
    path = tmp_path / "x.csv"
    path.write_text(head + rows)
    done = run(capsys, "bench", "motor", path, "--workspace", tmp_path / "w")
    assert done.code == 1
    assert said in " ".join(done.err.split())
    assert "`" not in done.err
    assert not (tmp_path / "w").exists()


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("b.csv", "speed_rpm", "speed_rad_s", "check the units of speed (rpm or rad/s)"),
        ("a.csv", "current_mA", "current_A", "check the units of speed"),
        ("b.csv", "current [A]", "current [mA]", "of that of the blocked rotor"),
        ("c.csv", "torque_Nm", "motor_torque_Nm", "more power than it takes"),
    ],
)
def test_a_wrong_unit_is_noticed(tmp_path: Path, name: str, old: str, new: str, said: str) -> None:
    files = experiments(tmp_path, 4)
    wrong = tmp_path / name
    wrong.write_text(wrong.read_text().replace(old, new))
    try:
        noticed = " ".join(characterise_motor(files, MotorOptions(gear=60.0)).notes)
    except DataError as error:
        noticed = str(error)
    assert said in noticed


def test_a_marker_gives_the_speed_of_evenly_spaced_events(tmp_path: Path) -> None:
    """A clock of 2 ms: the speed from all events is far better than from one interval."""
    speed = 9.3
    t = np.floor(np.arange(1, 40) * 2.0 * np.pi / speed / 2e-3) * 2e-3
    result, error = from_times(t, 1.0, "x").steady_speed()
    assert abs(result - speed) < 4.0 * error
    _, _, single, one_error = from_times(t, 1.0, "x").intervals()
    assert np.max(np.abs(single - speed) / one_error) < 2.5  # uniform: at most √6
    assert error < 0.05 * float(np.mean(one_error))


def test_event_times_stand_for_a_table_of_speeds(tmp_path: Path) -> None:
    speed, current = steady_state(TRUE, VOLTS)
    rows = [
        (v, i, round(k * 2.0 * np.pi / w / 8.0 / 2e-3) * 2e-3)
        for v, w, i in zip(VOLTS, speed, current, strict=True)
        for k in range(1, 200)
    ]
    path = table(tmp_path / "e.csv", "voltage_V,current_A,t_event_s", *zip(*rows, strict=True))
    options = MotorOptions(known={"R": (2.4, 0.001)}, gear=60.0, pulses_per_turn=8.0)
    bench = characterise_motor([path], options)
    assert bench.tests[0].of("speed") == pytest.approx(speed, rel=1e-3)


def test_a_motor_that_still_runs_up_is_refused(tmp_path: Path) -> None:
    t = np.cumsum(1.0 / np.linspace(5.0, 10.0, 40))
    path = table(tmp_path / "e.csv", "voltage_V,t_event_s", np.full(40, 3.0), t)
    with pytest.raises(DataError, match="leave out the events before it is steady"):
        characterise_motor([path])


@pytest.mark.parametrize("speed", [41.3, 3.0, -7.0])
def test_edges_of_a_counter_stand_where_the_shaft_was(speed: float) -> None:
    """Many ticks a row or few, forward or backward: within the standard error of their instant."""
    tick, t = 0.05, 1e-2 * np.arange(400)
    events = from_counter(t, tick * np.floor((speed * t + 0.3) / tick), tick)
    off = (events.angle - (speed * events.t + 0.3)) / (abs(speed) * events.error)
    assert np.max(np.abs(off)) < np.sqrt(3.0) + 1e-6  # the ends of a uniform distribution
    assert abs(float(np.mean(off))) < 0.5


@pytest.mark.parametrize(
    ("name", "role", "scale"),
    [
        ("Drehzahl_1/min", "speed", 1.0 / RPM),
        ("speed_rad/s", "speed", 1.0),
        ("amps", "current", 1.0),
        ("currentMilliamps", "current", 1e-3),
        ("pulse_time_us", "event", 1e-6),
        ("Ereigniszeit_ms", "event", 1e-3),
        ("hallTime_ms", "event", 1e-3),
        ("Zeit [s]", "time", 1.0),
    ],
)
def test_columns_as_strangers_write_them(
    tmp_path: Path, name: str, role: str, scale: float
) -> None:
    path = table(tmp_path / "a.csv", f"{name},remark", [1.0, 2.0], [0.0, 0.0])
    column = columns_of(read_bench_table(path), {})[0]
    assert (column.role, column.scale) == (role, pytest.approx(scale, rel=1e-12))


def test_one_speed_tells_no_friction_and_is_refused(tmp_path: Path, capsys: Capture) -> None:
    blocked = table(tmp_path / "blocked.csv", "voltage_V,current_A", [1.0, 2.0], [0.5, 1.0])
    free = table(tmp_path / "free.csv", "voltage_V,current_A,speed_rpm", [6.0], [0.1], [90.0])
    done = run(capsys, "bench", "motor", free, blocked, "--gear", "30")
    assert done.code == 1
    assert done.err.startswith("experiments are missing for f and C0 (no load at two voltages")
    assert done.err.count("\n") == 1


def test_a_motor_that_was_driven_backward_is_the_same_motor(tmp_path: Path) -> None:
    forward = experiments(tmp_path, 1)
    (tmp_path / "back").mkdir()
    back = []
    for path in forward:
        head, *rows = path.read_text().splitlines()
        numbers = [[f"{-float(v):.6g}" for v in row.split(",")] for row in rows]
        back.append(tmp_path / "back" / path.name)
        back[-1].write_text("\n".join([head, *(",".join(r) for r in numbers)]) + "\n")
    options = MotorOptions(gear=TRUE.gear)
    a, b = (characterise_motor(f, options).parameters for f in (forward, back))
    for one, other in zip(a, b, strict=True):
        assert other.value == (None if one.value is None else pytest.approx(one.value, rel=1e-4))


def test_a_good_bench_does_not_contradict_itself(tmp_path: Path) -> None:
    """Stall torque over the whole current, and less that without load, bracket Kc."""
    assert not [n for n in bench_of(tmp_path).notes if "contradicts" in n]


def bench_of(folder: Path) -> MotorBench:
    return characterise_motor(experiments(folder, 2), MotorOptions(gear=TRUE.gear))


@pytest.mark.slow
def test_readings_that_err_by_a_share_widen_the_joint_errors(tmp_path: Path) -> None:
    """Errors proportional to the measurement turn a line by more than one noise level suggests."""
    away = []
    for seed in range(8):
        (tmp_path / str(seed)).mkdir()
        bench = characterise_motor(
            experiments(tmp_path / str(seed), seed), MotorOptions(gear=TRUE.gear, method="joint")
        )
        away += errors(bench)
    assert max(away) < 4.0  # of 40 from Student's t with 4 degrees of freedom or more
