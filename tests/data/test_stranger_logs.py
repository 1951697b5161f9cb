"""Logs of people who know their robot, not this tool: time, units, names, layout of a file."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from hypothesis import given, settings
from hypothesis import strategies as st
from written_logs import LOGGERS, RPM, STEP, lines, motor, point, robot_drive, whole

from sysid.data.checks.quality import inspect_records
from sysid.data.finding import Severity
from sysid.data.io import ReadOptions, read_file
from sysid.data.reading.clock import unrolled
from sysid.data.reading.columns import choose_columns
from sysid.data.reading.dates import seconds_of
from sysid.data.record import Channel, Record
from sysid.data.units import conversion, from_name
from sysid.errors import DataError, SysidError, UsageError


def put(folder: Path, text: str, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# ------------------------------------------------------------------------------ whole files


@pytest.mark.parametrize("logger", LOGGERS)
def test_every_logger_is_read_alike(tmp_path: Path, logger: str) -> None:
    written = LOGGERS[logger]()
    log = read_file(put(tmp_path, written.text), ReadOptions(**written.options))
    record = log.records[0]
    # Stamps of an epoch in seconds and of spreadsheet days resolve 0.2 and 1 µs of 20 ms.
    assert record.dt == pytest.approx(written.dt, rel=1e-4)
    assert len(record) == len(written.u)
    np.testing.assert_allclose(record.u[:, 0], written.u, atol=1e-9)
    np.testing.assert_allclose(record.y[:, 0], written.y, atol=1e-9)
    for part in written.said:
        assert part in " ".join(log.notes)
    assert not [f for f in log.findings if f.code == "sample-time"]


@pytest.mark.parametrize("logger", LOGGERS)
def test_missing_lines_are_counted_behind_every_clock(tmp_path: Path, logger: str) -> None:
    """Two lines away: two samples are interpolated, whatever the clock, and none denies it."""
    written = LOGGERS[logger]()
    text = written.text.splitlines()
    body = len(text) - 60  # behind the header, and not where another line is doubled
    log = read_file(
        put(tmp_path, "\n".join([*text[:body], *text[body + 2 :]]) + "\n"),
        ReadOptions(**written.options),
    )
    assert len(log.records[0]) == len(written.u)
    findings = inspect_records(log.records, reading=log.findings)
    said = " ".join(f.text for f in findings)
    assert "2 missing samples were interpolated" in said
    assert "No sample is missing" not in said


# ------------------------------------------------------------------------------------- time


@pytest.mark.parametrize(
    ("name", "step", "dt"),
    [
        ("millis", 20, 0.02),
        ("micros", 20, 2e-5),
        ("millis()", 20, 0.02),
        ("t_ms", 5, 0.005),
        ("timeMs", 5, 0.005),
        ("TimeUS", 2500, 0.0025),
        ("time [ms]", 2, 0.002),
        ("time (us)", 500, 0.0005),
        ("Time_s", 2, 2.0),
        ("t [min]", 1, 60.0),
        ("elapsed seconds", 0.5, 0.5),
        ("Zeit in ms", 10, 0.01),
        ("Zeit", 0.01, 0.01),
        ("time", 1, 1.0),
        ("time", 4, 4.0),
        ("time", 60, 60.0),
        ("time", 50, 0.05),
        ("time", 4000, 0.004),
        ("time", 10_000_000, 0.01),
        ("timestamp", 12.5, 0.0125),
    ],
)
def test_unit_of_the_time(tmp_path: Path, name: str, step: float, dt: float) -> None:
    k, u, y = motor(60)
    log = read_file(
        put(tmp_path, f"{name},u,y\n" + lines([point(step * k, 4), whole(u), point(y)]))
    )
    assert log.records[0].dt == pytest.approx(dt, rel=1e-6)
    guessed = [f for f in log.findings if f.code == "time-unit" and "by its steps" in f.text]
    unsure = name in ("time", "timestamp") and step >= 10
    assert bool(guessed) == unsure
    for finding in guessed:  # the option in the sentence works, and is believed
        assert finding.severity is Severity.WARNING
        said = finding.advice.split("'")[1]
        assert said.startswith(f"{name}=")
        other = ReadOptions(units=dict([said.split("=")]))
        assert not [
            f
            for f in read_file(tmp_path / "log.csv", other).findings
            if f.code == "time-unit" and "by its steps" in f.text
        ]


@pytest.mark.parametrize("first", [1_714_564_800, 1_714_564_800_000, 1_714_564_800_000_000])
@pytest.mark.parametrize("seconds", [0.02, 1.0, 60.0])
def test_epochs_are_told_by_their_size(tmp_path: Path, first: int, seconds: float) -> None:
    if first == 1_714_564_800 and seconds < 1.0:
        pytest.skip("whole seconds cannot hold such steps")
    k, u, y = motor(60)
    unit = 1_714_564_800 / first
    text = "timestamp,u,y\n" + lines([whole(first + k * (seconds / unit)), whole(u), point(y)])
    log = read_file(put(tmp_path, text))
    assert log.records[0].dt == pytest.approx(seconds, rel=1e-9)
    assert log.records[0].t0 == 0.0
    assert log.origin == pytest.approx(1_714_564_800)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.sampled_from([2.0**16, 2.0**24, 2.0**31, 2.0**32]),
    st.sampled_from([1.0, 1e-3, 1e-6]),
    st.floats(0.0, 1.0),
    st.integers(1, 60),
    st.integers(0, 10**6),
)
def test_rollovers_are_undone(
    modulus: float, scale: float, start: float, step: int, seed: int
) -> None:
    """Counts modulo M come back as they were, with jitter and a few missing rows."""
    rng = np.random.default_rng(seed)
    usual = step * 40  # 40 … 2400 counts: far below half of the smallest modulus
    true = np.cumsum(usual + rng.integers(-usual // 5, usual // 5 + 1, 300)).astype(float)
    true = np.delete(true, [60, 61, 62]) + np.floor(start * modulus)
    read = (true % modulus) * scale
    found, said = unrolled(read, "clock", "log", lambda i: f"log, line {i + 2}")
    wraps = int(np.count_nonzero(np.diff(read) < 0))
    # Twelve digits of the largest number are what a float leaves after the products.
    np.testing.assert_allclose(found - found[0], (true - true[0]) * scale, atol=1e-9 * true[-1])
    assert len(said) == (wraps > 0)


def test_a_restart_is_no_rollover(tmp_path: Path) -> None:
    k, u, y = motor(100)
    body = lines([whole(20 * k), whole(u), point(y)])
    path = put(tmp_path, "millis,u,y\n" + body + body)
    with pytest.raises(DataError, match="several logs: --resample split"):
        read_file(path)
    assert len(read_file(path, ReadOptions(resample="split")).records) == 2


def test_without_a_time_it_is_said_loudly(tmp_path: Path) -> None:
    _, u, y = motor(60)
    for head in ("u,y", "sample,u,y", "nr,u,y"):
        columns = [whole(u), point(y)]
        columns = columns if head == "u,y" else [whole(np.arange(60)), *columns]
        log = read_file(put(tmp_path, head + "\n" + lines(columns)))
        (found,) = (f for f in log.findings if f.code == "sample-time")
        assert found.severity is Severity.WARNING
        assert "--ts" in found.text
        timed = read_file(tmp_path / "log.csv", ReadOptions(ts=0.02))
        assert timed.records[0].dt == 0.02
        assert not timed.findings


@pytest.mark.parametrize(
    ("cells", "step"),
    [
        (["2024-05-01T12:00:00.100Z", "2024-05-01T12:00:00.350Z"], 0.25),
        (["2024-05-01 12:00:00+02:00", "2024-05-01 11:00:00+01:00"], 0.0),
        (["01.05.2024 12:00:00,100", "01.05.2024 12:00:00,350"], 0.25),
        (["31.12.24 23:59:59", "01.01.25 00:00:00"], 1.0),
        (["5/1/2024 11:59:59 AM", "5/1/2024 12:00:00 PM"], 1.0),
        (["13/01/2024 12:00", "14/01/2024 12:00"], 86400.0),
        (["12:00:00:120", "12:00:00:140"], 0.02),
        (["59:59.5", "60:00.0"], 0.5),
        (["20240501_120000.123", "20240501_120000.223"], 0.1),
        (["2024-05-01", "2024-05-02"], 86400.0),
    ],
)
def test_dates(cells: list[str], step: float) -> None:
    found = seconds_of(cells)
    assert isinstance(found, tuple)
    assert found[0][1] == pytest.approx(step, abs=1e-9)


def test_numbers_are_no_dates() -> None:
    assert seconds_of(["1.05", "2"]) is None
    assert seconds_of(["-3.5e-3", "2"]) is None
    assert seconds_of(["2024-05-01", "soon"]) == 1


TIMES = ("t", "time", "millis", "Zeit", "TimeUS", "sample", "k", "foo")


@pytest.mark.parametrize("name", TIMES)
@pytest.mark.parametrize("side", ["inputs", "outputs"])
def test_the_time_is_no_signal(tmp_path: Path, name: str, side: str) -> None:
    k, u, y = motor(60)
    stamps = whole(k) if name in ("sample", "k") else point(0.02 * k)
    path = put(tmp_path, f"{name},u,y\n" + lines([stamps, whole(u), point(y)]))
    instead = "--input u" if side == "inputs" else "--output y"
    with pytest.raises(UsageError, match=f"column {name} of log.csv .* such as {instead}"):
        read_file(path, ReadOptions(**{side: (name,)}))  # type: ignore[arg-type]


def test_the_time_is_refused_as_a_person_types_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    k, u, y = motor(60)
    path = put(tmp_path, "t,u,y\n" + lines([point(0.02 * k), whole(u), point(y)]))
    found = run(capsys, "fit", path, "--output", "t", "--workspace", tmp_path / "w")
    assert found.code == 2
    assert "column t of log.csv is the time and cannot be the output" in found.err


def test_a_current_named_like_a_counter_is_no_counter(tmp_path: Path) -> None:
    _, u, y = motor(60)
    log = read_file(
        put(tmp_path, "U,I\n" + lines([whole(u), point(y)])), ReadOptions(outputs=("I",))
    )
    np.testing.assert_array_equal(log.records[0].y[:, 0], y)


def test_a_clock_too_coarse_is_left_where_the_sample_time_is_given(tmp_path: Path) -> None:
    k, u, y = motor(200)
    path = put(tmp_path, "Zeit,u,y\n" + lines([whole(k // 50), whole(u), point(y)]))
    with pytest.raises(DataError, match=r"time stands still.*--ts"):
        read_file(path)
    assert read_file(path, ReadOptions(ts=0.02)).records[0].dt == 0.02


def test_rows_that_begin_with_empty_cells_are_no_titles(tmp_path: Path) -> None:
    k, u, y = motor(60)
    body = lines([point(0.02 * k), whole(u), point(y)])
    path = put(tmp_path, "t,u,y\n-0.04,,\n-0.02,,\n" + body)
    with pytest.raises(DataError, match="line 2, column u: the cell is empty"):
        read_file(path)
    assert len(read_file(path, ReadOptions(resample="fill")).records[0]) == 60


def test_a_ramp_is_a_signal_where_the_sample_time_is_given(tmp_path: Path) -> None:
    k, u, y = motor(60)
    path = put(tmp_path, "ramp,u,y\n" + lines([point(0.02 * k), whole(u), point(y)]))
    record = read_file(path, ReadOptions(inputs=("ramp",), outputs=("y",), ts=0.5)).records[0]
    assert record.dt == 0.5
    np.testing.assert_allclose(record.u[:, 0], 0.02 * k, atol=1e-12)


def test_a_signal_with_the_name_of_a_time_is_a_signal(tmp_path: Path) -> None:
    k, u, y = motor(60)
    path = put(tmp_path, "millis,n,T\n" + lines([whole(20 * k), point(y), whole(u)]))
    record = read_file(path, ReadOptions(inputs=("T",), outputs=("n",))).records[0]
    np.testing.assert_array_equal(record.y[:, 0], y)
    assert record.dt == 0.02


# --------------------------------------------------------------------------------- names


@pytest.mark.parametrize(
    ("names", "inputs", "outputs", "pose"),
    [
        ("t pwmL pwmR rpmL rpmR", "pwmL pwmR", "rpmL rpmR", ""),
        ("t rpm_right rpm_left right_pwm left_pwm", "left_pwm right_pwm", "rpm_left rpm_right", ""),
        ("t pwm_left pwm_right left_rpm right_rpm", "pwm_left pwm_right", "left_rpm right_rpm", ""),
        ("t cmdLeft cmdRight wL wR", "cmdLeft cmdRight", "wL wR", ""),
        ("t pwml pwmr omegal omegar", "pwml pwmr", "omegal omegar", ""),
        (
            "t PWM_Left PWM_Right SpeedLeft SpeedRight",
            "PWM_Left PWM_Right",
            "SpeedLeft SpeedRight",
            "",
        ),
        ("t motorL motorR v_left v_right", "motorL motorR", "v_left v_right", ""),
        ("t duty_l duty_r vel_l vel_r vbat", "duty_l duty_r", "vel_l vel_r", ""),
        (
            "t cmd_left cmd_right speed_ref_left speed_ref_right speed_left speed_right",
            "cmd_left cmd_right",
            "speed_left speed_right",
            "",
        ),
        (
            "t pwm_l pwm_r omega_l omega_r pos_x pos_y yaw_deg",
            "pwm_l pwm_r",
            "omega_l omega_r",
            "pos_x pos_y yaw_deg",
        ),
        (
            "t pwmL pwmR rpmL rpmR x_mm y_mm theta",
            "pwmL pwmR",
            "rpmL rpmR",
            "x_mm y_mm theta",
        ),
        (
            "t cmd_l cmd_r w_l w_r odom_x odom_y odom_yaw x y heading",
            "cmd_l cmd_r",
            "w_l w_r",
            "x y heading",
        ),
        ("t duty rpm", "duty", "rpm", ""),
        ("t throttle speed current", "throttle", "speed", ""),
        ("t voltage rpm temp", "voltage", "rpm", ""),
        ("t Spannung Drehzahl Strom", "Spannung", "Drehzahl", ""),
        ("t Heizung Temperatur", "Heizung", "Temperatur", ""),
        ("t Gaspedal Geschwindigkeit Ladezustand", "Gaspedal", "Geschwindigkeit", ""),
        ("t Kommando_deg Winkel_deg", "Kommando_deg", "Winkel_deg", ""),
        ("t RudderDeg YawRate Heading", "RudderDeg", "YawRate", ""),
        ("t Lenkwinkel Gierrate", "Lenkwinkel", "Gierrate", ""),
        ("t vanne débit niveau_2", "vanne", "niveau_2", ""),
        ("t Chauffage1 Chauffage2 Température1", "Chauffage1 Chauffage2", "Température1", ""),
        ("t Pump_A Pump_B Level_A Level_B", "Pump_A Pump_B", "Level_A Level_B", ""),
        ("t heater heater_temp", "heater", "heater_temp", ""),
        ("t pompe courant pression", "pompe", "pression", ""),
        ("t valve level battery_voltage", "valve", "level", ""),
        ("t speed_cmd speed", "speed_cmd", "speed", ""),
        ("t duty wobble", "duty", "wobble", ""),
        ("t u y_motor_power", "u", "y_motor_power", ""),
        ("t pwm1 pwm2 rpm1 rpm2", "pwm1 pwm2", "rpm1 rpm2", ""),
        ("t M1_PWM M2_PWM M1_RPM M2_RPM", "M1_PWM M2_PWM", "M1_RPM M2_RPM", ""),
        ("t left_cmd right_cmd left_enc right_enc", "left_cmd right_cmd", "left_enc right_enc", ""),
        (
            "Zeit Motorspannung Motordrehzahl Batteriespannung Solldrehzahl",
            "Motorspannung",
            "Motordrehzahl",
            "",
        ),
    ],
)
def test_names(names: str, inputs: str, outputs: str, pose: str) -> None:
    choice = choose_columns(names.split())
    assert choice.inputs == tuple(inputs.split())
    assert choice.outputs == tuple(outputs.split())
    assert choice.pose == tuple(pose.split())


@pytest.mark.parametrize(
    ("names", "example"),
    [
        ("t duty left_thing right_thing", "--input duty --output left_thing"),
        ("t pwm gain rate", "--input pwm --output gain"),
        ("t alpha beta", "--input alpha --output beta"),
        ("t duty throttle rpm drehzahl", "--output rpm"),
        ("t motor 1", ""),
        ("t ML MR rpmL rpmR", "--input ML,MR --output rpmL,rpmR"),
        ("t p1 p2 rpm", "--input p1,p2 --output rpm"),
        ("t zone_a zone_b temp1 temp2", "--input zone_a,zone_b --output temp1,temp2"),
        ("t FU_Sollwert Geber_Istwert", "--input FU_Sollwert --output Geber_Istwert"),
    ],
)
def test_ambiguous_names_are_refused_with_an_example_that_works(
    tmp_path: Path, names: str, example: str
) -> None:
    columns = names.split()
    rng = np.random.default_rng(1)
    cells = [point(0.02 * np.arange(60)), *(point(rng.normal(size=60)) for _ in columns[1:])]
    path = put(tmp_path, ",".join(columns) + "\n" + lines(cells))
    try:
        read_file(path)
    except SysidError as error:
        text = str(error)
        assert "\n" not in text
        assert example in text
        if "for example" in text:
            words = text.split("for example ")[1].rstrip(")").split()
            sides = [tuple(words[i].split(",")) for i in (1, 3)]
            read_file(path, ReadOptions(inputs=sides[0], outputs=sides[1]))
    else:
        assert not example


@pytest.mark.parametrize(
    ("inputs", "outputs", "robot"),
    [
        (["pwm_l", "pwm_r"], ["omega_l", "omega_r"], True),
        (["pwm"], ["omega"], True),
        (["pwmL", "pwmR"], ["rpmL", "rpmR"], True),
        (["left_pwm", "right_pwm"], ["v_left", "v_right"], True),
        (["cmd_left", "cmd_right"], ["wL", "wR"], True),
        (["duty"], ["rpm"], True),
        (["u"], ["y"], False),
        (["voltage"], ["speed"], False),
        (["heater"], ["temp"], False),
        (["pwm_l", "pwm_r"], ["y1", "y2"], False),
    ],
)
def test_a_robot_is_seen_whatever_its_names(
    inputs: list[str], outputs: list[str], robot: bool
) -> None:
    rng = np.random.default_rng(0)
    record = Record(
        rng.normal(size=(30, len(inputs))),
        rng.normal(size=(30, len(outputs))),
        0.1,
        tuple(from_name(n).channel(n, 0.1) for n in inputs),
        tuple(from_name(n).channel(n, 0.1) for n in outputs),
    )
    assert record.is_robot_log is robot


def test_a_followed_speed_is_no_drive() -> None:
    """A robot whose command is a speed has its own controller: no PWM, and no robot log here."""
    inputs = (Channel("u_l_rad_s", "rad/s"), Channel("u_r_rad_s", "rad/s"))
    outputs = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))
    assert not Record(np.eye(20, 2), np.eye(20, 2), 0.1, inputs, outputs).is_robot_log


def test_small_pwm_is_not_called_microseconds(tmp_path: Path) -> None:
    k, u, y = motor(60)
    path = put(tmp_path, "t,pwm,rpm\n" + lines([point(0.02 * k), whole(u), point(y)]))
    assert [c.unit for c in read_file(path).records[0].inputs] == [""]
    scaled = read_file(path, ReadOptions(pwm_max=255)).records[0]
    assert [c.unit for c in scaled.inputs] == ["µs"]
    told = read_file(path, ReadOptions(units={"pwm": "us"})).records[0]
    assert [c.unit for c in told.inputs] == ["µs"]


# --------------------------------------------------------------------------------- units


@pytest.mark.parametrize(
    ("unit", "to", "factor"),
    [
        *((u, "rad/s", RPM) for u in ("rpm", "RPM", "U/min", "1/min", "min^-1", "min⁻¹", "tr/min")),
        *((u, "rad/s", np.pi / 180) for u in ("deg/s", "°/s", "Grad/s", "dps")),
        *((u, "rad", np.pi / 180) for u in ("deg", "°", "Grad", "degrees")),
        *((u, "rad/s", 1.0) for u in ("rad/s", "rad s^-1", "rad·s⁻¹")),
        *((u, "m/s", 1 / 3.6) for u in ("km/h", "kmh", "km/H")),
        *((u, "degC", 1.0) for u in ("°C", "degC", "Celsius")),
        ("U/s", "rad/s", 2 * np.pi),
        ("Volt", "V", 1.0),
        ("mV", "V", 1e-3),
        ("mm", "m", 1e-3),
    ],
)
def test_units_however_they_are_written(tmp_path: Path, unit: str, to: str, factor: float) -> None:
    assert conversion(unit).unit == to
    assert conversion(unit).scale == pytest.approx(factor, rel=1e-12)
    k, u, y = motor(60)
    for column in (f"y [{unit}]", f"y ({unit})"):
        path = put(tmp_path, f"t,u,{column}\n" + lines([point(0.02 * k), whole(u), point(y)]))
        record = read_file(path).records[0]
        np.testing.assert_allclose(record.y[:, 0], y * factor, atol=1e-12)
        assert record.outputs[0].unit == to


@pytest.mark.parametrize(
    ("name", "to", "factor"),
    [
        ("rpm_left", "rad/s", RPM),
        ("rpmL", "rad/s", RPM),
        ("speedRpm", "rad/s", RPM),
        ("speed_RPM", "rad/s", RPM),
        ("n_U_min", "rad/s", RPM),
        ("yaw_deg", "rad", np.pi / 180),
        ("yawDeg", "rad", np.pi / 180),
        ("v_km_h", "m/s", 1 / 3.6),
        ("omega_m", "rad/s", 1.0),
        ("u_mV", "V", 1e-3),
        ("speed", "", 1.0),
    ],
)
def test_units_in_names(name: str, to: str, factor: float) -> None:
    found = from_name(name)
    assert (found.unit, found.scale) == (to, pytest.approx(factor, rel=1e-12))


def test_an_error_is_shown_in_the_file_unit_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    k, u, y = motor(400)
    path = put(tmp_path, "millis,pwm,rpm\n" + lines([whole(20 * k), whole(u), point(y)]))
    arguments = ("fit", path, "--structure", "arx", "--orders", "na=1 nb=1 nk=1")
    found = run(capsys, *arguments, "--workspace", tmp_path / "w")
    assert found.code == 0
    assert " rpm)" in found.out
    document = run(capsys, *arguments, "--workspace", tmp_path / "w", "--json").document
    error = document["estimation"]["one_step"]["rmse"]["rpm"] / RPM
    # the readings carry 0.3 rpm of noise, which an ARX model of them sees 1.35-fold
    assert error == pytest.approx(0.3 * np.sqrt(1 + 0.9**2), rel=0.15)


# ---------------------------------------------------------------------------------- pose

DRIVE = robot_drive()


def pose_log(folder: Path, names: tuple[str, str, str], values: tuple[np.ndarray, ...]) -> Path:
    rows = np.arange(len(DRIVE["x"]))
    columns = [
        point(STEP * rows),
        *(whole(c) for c in DRIVE["pwm"].T),
        *(point(c, 4) for c in DRIVE["omega"].T),
        *(point(v, 9) for v in values),
    ]
    return put(folder, "t,pwm_l,pwm_r,omega_l,omega_r," + ",".join(names) + "\n" + lines(columns))


X, Y, PSI = DRIVE["x"], DRIVE["y"], DRIVE["psi"]
FOLDED = (PSI + np.pi) % (2 * np.pi) - np.pi
POSES: dict[str, tuple[tuple[str, str, str], tuple[np.ndarray, ...], dict[str, str], str]] = {
    "plain": (("x", "y", "psi"), (X, Y, PSI), {}, ""),
    "folded": (("x", "y", "psi"), (X, Y, FOLDED), {}, ""),
    "[deg]": (("x", "y", "psi [deg]"), (X, Y, np.degrees(PSI)), {}, "psi from deg"),
    "(deg)": (("x", "y", "psi (deg)"), (X, Y, np.degrees(FOLDED)), {}, "psi from deg"),
    "[°]": (("x [m]", "y [m]", "yaw [°]"), (X, Y, np.degrees(PSI) % 360), {}, "yaw from °"),
    "_deg": (("x", "y", "psi_deg"), (X, Y, np.degrees(PSI) % 360), {}, "psi_deg from deg"),
    "mm": (("x [mm]", "y [mm]", "theta"), (X * 1e3, Y * 1e3, FOLDED), {}, "x from mm"),
    "_mm": (("x_mm", "y_mm", "yaw_deg"), (X * 1e3, Y * 1e3, np.degrees(PSI)), {}, "x_mm from mm"),
    "pos": (("pos_x", "pos_y", "yawDeg"), (X, Y, np.degrees(PSI)), {}, "pos_x, pos_y, yawDeg"),
    "by option": (("x", "y", "psi"), (X, Y, np.degrees(PSI)), {"psi": "deg"}, "psi from deg"),
    "length by option": (
        ("x", "y", "psi"),
        (X * 100, Y * 100, PSI),
        {"x": "cm", "y": "cm"},
        "x from cm",
    ),
    "untold, folded": (("x", "y", "psi"), (X, Y, np.degrees(PSI) % 360), {}, "read in degrees"),
    "untold, unfolded": (("x", "y", "heading"), (X, Y, np.degrees(PSI)), {}, "read in degrees"),
    "compass": (
        ("x", "y", "heading [deg]"),
        (X, Y, (90.0 - np.degrees(PSI)) % 360),
        {},
        "as a compass does",
    ),
}


@pytest.mark.parametrize("case", POSES)
def test_the_pose_however_it_is_written(tmp_path: Path, case: str) -> None:
    names, values, units, said = POSES[case]
    log = read_file(pose_log(tmp_path, names, values), ReadOptions(units=units))
    pose = log.records[0].pose
    assert pose is not None
    # Nine decimals of the file, the angle up to whole turns of its start.
    np.testing.assert_allclose(pose[:, :2], np.column_stack([X, Y]), atol=1e-8)
    turns = (pose[:, 2] - PSI) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.rint(turns[0]), atol=1e-8)
    assert said in " ".join(log.notes)
    assert not [n for n in log.notes if "not used" in n]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("x", "y", "speedup"), "x, y look like a pose but were not used: there is no angle"),
        (("x_px", "y_px", "psi"), ""),
        (("x [px]", "y [px]", "psi"), "the unit of x is px"),
    ],
)
def test_what_looks_like_a_pose_and_is_none_is_said(
    tmp_path: Path, names: tuple[str, str, str], said: str
) -> None:
    log = read_file(pose_log(tmp_path, names, (X, Y, PSI)))
    assert log.records[0].pose is None
    text = " ".join(f.text for f in log.findings)
    assert said in text
    assert "not used" in text
    assert all(name.split(" ")[0] in text for name in names)


def test_a_wrong_unit_of_the_pose_is_refused(tmp_path: Path) -> None:
    path = pose_log(tmp_path, ("x", "y", "psi"), (X, Y, PSI))
    with pytest.raises(UsageError, match=r"unit of psi is V.*--unit psi=rad"):
        read_file(path, ReadOptions(units={"psi": "V"}))
    with pytest.raises(UsageError, match=r"t=rpm is no unit of time.*s, ms, us"):
        read_file(path, ReadOptions(units={"t": "rpm"}))


# --------------------------------------------------------------------- what commands say


def test_inspect_and_fit_never_deny_what_reading_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    k, u, y = motor(900)
    keep = np.setdiff1d(k, np.arange(40, 880, 20))
    text = "time,u,y\n" + lines([point(STEP * keep), whole(u[keep]), point(y[keep])])
    path = put(tmp_path, text)
    out = run(capsys, "inspect", path).out
    assert "42 missing samples were interpolated" in out
    assert "No sample is missing" not in out
    found = json.loads(run(capsys, "inspect", path, "--json").out)["findings"]
    assert not [f for f in found if f["code"] == "missing" and f["severity"] == "ok"]
