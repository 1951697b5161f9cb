"""Logs of people who know their robot, not this tool: names, units and pose of their columns."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from named_fields import arguments
from written_logs import RPM, STEP, lines, motor, point, put, robot_drive, whole

from sysid.data.io import read_file
from sysid.data.reading.columns import choose_columns
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.roles import roles
from sysid.data.record import Channel, Record
from sysid.data.units import conversion, from_name
from sysid.errors import SysidError, UnclearColumnsError, UsageError

# ------------------------------------------------------------------------------------------ names


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        ("t pwmL pwmR rpmL rpmR", "pwmL pwmR > rpmL rpmR"),
        ("t rpm_right rpm_left right_pwm left_pwm", "left_pwm right_pwm > rpm_left rpm_right"),
        ("t pwm_left pwm_right left_rpm right_rpm", "pwm_left pwm_right > left_rpm right_rpm"),
        ("t cmdLeft cmdRight wL wR", "cmdLeft cmdRight > wL wR"),
        ("t pwml pwmr omegal omegar", "pwml pwmr > omegal omegar"),
        ("t PWM_Left PWM_Right SpeedLeft SpeedRight", "PWM_Left PWM_Right > SpeedLeft SpeedRight"),
        ("t motorL motorR v_left v_right", "motorL motorR > v_left v_right"),
        ("t duty_l duty_r vel_l vel_r vbat", "duty_l duty_r > vel_l vel_r"),
        ("t motor_volt speed soc", "motor_volt > speed"),
        (
            "t cmd_left cmd_right speed_ref_left speed_ref_right speed_left speed_right",
            "cmd_left cmd_right > speed_left speed_right",
        ),
        (
            "t pwm_l pwm_r omega_l omega_r pos_x pos_y yaw_deg",
            "pwm_l pwm_r > omega_l omega_r > pos_x pos_y yaw_deg",
        ),
        ("t pwmL pwmR rpmL rpmR x_mm y_mm theta", "pwmL pwmR > rpmL rpmR > x_mm y_mm theta"),
        (
            "t cmd_l cmd_r w_l w_r odom_x odom_y odom_yaw x y heading",
            "cmd_l cmd_r > w_l w_r > x y heading",
        ),
        ("t u_l_rad_s u_r_rad_s omega_l omega_r", "u_l_rad_s u_r_rad_s > omega_l omega_r"),
        ("t duty rpm", "duty > rpm"),
        ("t throttle speed current", "throttle > speed"),
        ("t Spannung Drehzahl Strom", "Spannung > Drehzahl"),
        ("t Heizung Temperatur", "Heizung > Temperatur"),
        ("t Gaspedal Geschwindigkeit Ladezustand", "Gaspedal > Geschwindigkeit"),
        ("t Kommando_deg Winkel_deg", "Kommando_deg > Winkel_deg"),
        ("t RudderDeg YawRate Heading", "RudderDeg > YawRate"),
        ("t Lenkwinkel Gierrate", "Lenkwinkel > Gierrate"),
        ("t Chauffage1 Chauffage2 Température1", "Chauffage1 Chauffage2 > Température1"),
        ("t Pump_A Pump_B Level_A Level_B", "Pump_A Pump_B > Level_A Level_B"),
        ("t heater heater_temp", "heater > heater_temp"),
        ("t pompe courant pression", "pompe > pression"),
        ("t valve level battery_voltage", "valve > level"),
        ("t speed_cmd speed", "speed_cmd > speed"),
        ("t duty wobble", "duty > wobble"),
        ("t heater_1 heater_2 zone_1 zone_2", "heater_1 heater_2 > zone_1 zone_2"),
        ("t u y_motor_power", "u > y_motor_power"),
        ("t pwm1 pwm2 rpm1 rpm2", "pwm1 pwm2 > rpm1 rpm2"),
        ("t M1_PWM M2_PWM M1_RPM M2_RPM", "M1_PWM M2_PWM > M1_RPM M2_RPM"),
        ("t left_cmd right_cmd left_enc right_enc", "left_cmd right_cmd > left_enc right_enc"),
        (
            "Zeit Motorspannung Motordrehzahl Batteriespannung Solldrehzahl",
            "Motorspannung > Motordrehzahl",
        ),
        ("t pwm_l pwm_r omega_l omega_r", "pwm_l pwm_r > omega_l omega_r"),
        ("omega_r t x pwm_r y psi omega_l pwm_l v_ref", "pwm_l pwm_r > omega_l omega_r > x y psi"),
        ("t pwm_l omega_l x y psi", "pwm_l > omega_l > x y psi"),
        ("t_s u_V y_speed_V", "u_V > y_speed_V"),
        ("sample u1 u2 y1 y2", "u1 u2 > y1 y2"),
        ("t_s u1 u2 u3 u4 u5 y1_tension y2_tension", "u1 u2 u3 u4 u5 > y1_tension y2_tension"),
        ("t_s u_vir_V y_qm_m ref_qg_m", "u_vir_V > y_qm_m"),
        ("time cmd_l cmd_r speed_l speed_r speed_ref", "cmd_l cmd_r > speed_l speed_r"),
        ("Time Input Output", "Input > Output"),
        ("t in1 out1 omega_ref", "in1 > out1"),
        ("t duty left_thing right_thing", "duty > left_thing right_thing"),
        ("t ML MR rpmL rpmR", "ML MR > rpmL rpmR"),
        ("t p1 p2 rpm", "p1 p2 > rpm"),
        ("t zone_a zone_b temp1 temp2", "zone_a zone_b > temp1 temp2"),
        ("t FU_Sollwert Geber_Istwert", "FU_Sollwert > Geber_Istwert"),
        ("ms target_deg actual_deg", "target_deg > actual_deg"),
        ("t setpoint PID_output speed", "PID_output > speed"),
        ("t Sollfrequenz Istfrequenz", "Sollfrequenz > Istfrequenz"),
        ("t voltage rpm current", "voltage > rpm"),
        (
            "t pwm_l pwm_r v_cmd true_omega_l true_omega_r omega_l omega_r gyro_z",
            "pwm_l pwm_r > omega_l omega_r",
        ),
        ("t pwm_l pwm_r omega_l omega_r gyro_z accel_x", "pwm_l pwm_r > omega_l omega_r"),
        ("t ESC_signal Thrust Voltage Current", "ESC_signal > Thrust"),
        ("t ESC_signal AccX AccY AccZ Thrust Voltage", "ESC_signal > Thrust"),
        ("t valve supply_temp", "valve > supply_temp"),
        ("TimeUS RCOut.roll GyrX_dps Bat_V", "RCOut.roll > GyrX_dps"),
    ],
)
def test_names(names: str, chosen: str) -> None:
    """``chosen``: inputs > outputs, and > columns of the pose where there are any."""
    choice = choose_columns(names.split())
    inputs, outputs, pose = (*chosen.split(" > "), "")[:3]
    assert choice.inputs == tuple(inputs.split())
    assert choice.outputs == tuple(outputs.split())
    assert choice.pose == tuple(pose.split())


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        ("Frequenz/Hz Bandwaage/t/h", "Frequenz > Bandwaage"),
        ("U_Motor/V n_Motor/1/min", "U_Motor > n_Motor"),
        ("Motor_voltage/V Sway/deg Trolley_speed/m/s", "Motor_voltage > Trolley_speed"),
        ("Fan_speed/rpm Duty/%", "Duty > Fan_speed"),
        ("Fan_speed Duty", "Duty > Fan_speed"),
        ("knob lift/mm", "knob > lift"),
        ("speed/rpm armature/V", "armature > speed"),
        ("NaOH_dosing/% pH", "NaOH_dosing > pH"),
        ("lift/mm temperature/°C", "lift > temperature"),
        ("Bohrung/mm u", "u > Bohrung"),
        ("supply/V shaft/rpm", "supply > shaft"),
        ("Blower/% DO/mg/l", "Blower > DO"),
    ],
)
def test_units_behind_names(names: str, chosen: str) -> None:
    """What a name does not say its unit does; a unit moves no column whose name says what it is."""
    units = dict(n.partition("/")[::2] for n in names.split())
    choice = choose_columns({"t": "", **units})
    assert chosen == f"{' '.join(choice.inputs)} > {' '.join(choice.outputs)}"


@pytest.mark.parametrize("names", ["Blower/% DO/mg/l Temp/°C", "FU_Sollwert/Hz Hoehe/cm Wind/m/s"])
def test_beside_a_command_a_unit_says_as_much_as_a_word(names: str) -> None:
    """Of what two sensors read the one with a known name is not taken silently."""
    units = dict(n.partition("/")[::2] for n in names.split())
    with pytest.raises(UnclearColumnsError, match="the output can be"):
        choose_columns({"t": "", **units})


@pytest.mark.parametrize(
    ("names", "example"),
    [
        ("t pwm gain rate", "inputs='pwm', outputs='gain'"),
        ("t voltage rpm temp", "inputs='voltage', outputs='rpm'"),
        ("t vanne débit niveau_2", "inputs='vanne', outputs='débit'"),
        ("index inertia voltage w_rad_s", "inputs='voltage', outputs='w_rad_s'"),
        ("t steering throttle gyro speed", "inputs='steering', outputs='gyro'"),
        ("t setpoint knob speed", "inputs='setpoint', outputs='speed'"),
        ("t valve outdoor_temp supply_temp", "inputs='valve', outputs='supply_temp'"),
        ("t AccelPedal BrakePressure speed", "inputs='AccelPedal', outputs='speed'"),
        ("t Drehzahl Druck", "inputs='Drehzahl', outputs='Druck'"),
        ("t alpha beta", "inputs='alpha', outputs='beta'"),
        ("t duty throttle rpm drehzahl", "outputs='rpm'"),
        ("t motor 1", ""),
        ("t battery speed", "the input can be battery or speed (or none"),
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
            read_file(path, ReadOptions(**arguments(text.split("for example ")[1])))
    else:
        assert not example


@pytest.mark.parametrize("names", [("alpha", "beta"), ("belt_kmh", "heart_rate")])
def test_what_is_held_is_the_input_of_the_example(names: tuple[str, str], tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    held, moving = np.repeat(rng.normal(size=6), 10), rng.normal(size=60)
    for head, cells in ((names, (held, moving)), (names[::-1], (moving, held))):
        rows = lines([point(0.02 * np.arange(60)), *map(point, cells)])
        with pytest.raises(SysidError, match=f"inputs='{names[0]}', outputs='{names[1]}'"):
            read_file(put(tmp_path, f"t,{','.join(head)}\n{rows}"))


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


# ------------------------------------------------------------------------------------------ units


@pytest.mark.parametrize(
    ("unit", "to", "factor"),
    [
        *((u, "rad/s", RPM) for u in ("rpm", "RPM", "U/min", "1/min", "min^-1", "min⁻¹", "tr/min")),
        *((u, "rad/s", np.pi / 180) for u in ("deg/s", "°/s", "Grad/s", "dps")),
        *((u, "rad", np.pi / 180) for u in ("deg", "°", "Grad", "degrees")),
        *((u, "rad/s", 1.0) for u in ("rad/s", "rad s^-1", "rad·s⁻¹")),
        *((u, "m/s", 1 / 3.6) for u in ("km/h", "kmh", "km/H")),
        *((u, "m/s", 1852 / 3600) for u in ("kn", "kts", "Knots")),  # of ships
        ("kN", "N", 1e3),
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


def test_an_error_is_shown_in_the_file_unit_first(tmp_path: Path, capsys: Capture) -> None:
    k, u, y = motor(400)
    path = put(tmp_path, "millis,pwm,rpm\n" + lines([whole(20 * k), whole(u), point(y)]))
    arguments = ("fit", path, "--structure", "arx", "--orders", "na=1 nb=1 nk=1")
    found = run(capsys, *arguments, "--workspace", tmp_path / "w", "--full")
    assert found.code == 0
    assert " rpm (" in found.out
    document = run(capsys, *arguments, "--workspace", tmp_path / "w", "--json").document
    error = document["estimation"]["one_step"]["rmse"]["rpm"] / RPM
    # the readings carry 0.3 rpm of noise, which an ARX model of them sees 1.35-fold
    assert error == pytest.approx(0.3 * np.sqrt(1 + 0.9**2), rel=0.15)


# ------------------------------------------------------------------------------------------- pose

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
        "like a compass",
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
        (("x", "y", "speedup"), "x, y look like a pose but were not used: the angle"),
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
    with pytest.raises(UsageError, match=r"unit of psi is V.*`units={'psi': 'rad'}`"):
        read_file(path, ReadOptions(units={"psi": "V"}))
    with pytest.raises(UsageError, match=r"units={'t': 'rpm'}` is not a unit of time.*s, ms, us"):
        read_file(path, ReadOptions(units={"t": "rpm"}))


def test_a_minus_before_a_unit_changes_the_sign(tmp_path: Path, capsys: Capture) -> None:
    k, u, y = motor(400)
    path = put(tmp_path, "millis,pwm,rpm\n" + lines([whole(20 * k), whole(u), point(-y)]))
    fit = ("fit", path, "--structure", "arx", "--orders", "na=1 nb=1 nk=1")
    place = ("--workspace", tmp_path / "w")
    plain, turned = (
        run(capsys, *fit, *more, "--json", *place).document for more in ((), ("--unit", "rpm=-rpm"))
    )
    gains = [
        step["gain"]["value"] * step["file_factor"]
        for d in (plain, turned)
        for step in d["models"][0]["step_response"]
    ]
    assert gains[0] < 0.0
    assert gains[1] == pytest.approx(-gains[0])


@pytest.mark.parametrize(
    ("names", "units", "inputs", "outputs"),
    [
        (("amp_out_V", "laser_mm"), ("V", "mm"), {("amp_out_V",)}, {("laser_mm",)}),
        (("FIC.SP", "FIC.OP", "FIC.PV"), ("", "", ""), {("FIC.OP",)}, {("FIC.PV",)}),
        (("Stirrer", "pO2"), ("rpm", "%"), {("Stirrer",)}, {("pO2",)}),
        (("Compressor", "T_room"), ("", "degC"), {("Compressor",)}, {("T_room",)}),
        (("Power", "Flow", "T"), ("kW", "l/min", "degC"), {("Power",)}, {("Flow",), ("T",)}),
    ],
)
def test_what_a_unit_says_counts_as_a_word_does(
    names: tuple[str, ...],
    units: tuple[str, ...],
    inputs: set[tuple[str, ...]],
    outputs: set[tuple[str, ...]],
) -> None:
    """A temperature by its unit is measured; a source's voltage or a stirrer's speed drives."""
    found = roles(dict(zip(names, units, strict=True)), (), (), (), None)
    assert ({*found.inputs}, {*found.outputs}) == (inputs, outputs)
