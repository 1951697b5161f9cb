"""Controllers of a law for the speed and one for the yaw: chosen, limited, tracking."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Capture, robot_log, run
from control_cases import driven, inputs, pwm
from mission_cases import SCENE, Robot, goal
from sysid_cli.missions.control_option import chosen_controller

from sysid.errors import DataError, ModelError, UsageError
from sysid.robot.mission.control.axes import AXES, AxisController
from sysid.robot.mission.control.linear import PD, PI, YawP, YawPD, YawPID
from sysid.robot.mission.control.pi_p import SpeedPIYawP
from sysid.robot.mission.registry import kinds, law_class
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.settling import nominal_of
from sysid.runners import floats
from sysid.vehicle.kinematics import Geometry

# Chosen -------------------------------------------------------------------------------------------


def written(folder: Path, text: str) -> Path:
    path = folder / "m.yaml"
    path.write_text("goal: [1, 0]\n" + text)
    return path


def test_flat_keys_and_axes_are_the_same_controller(tmp_path: Path) -> None:
    flat = load_mission(written(tmp_path, "control: {kp_yaw: 0.3, v_cmd_max: 0.6}\n"))
    axes = load_mission(
        written(
            tmp_path,
            "control:\n  speed: {kind: pi, kp: 2, ki: 1.85}\n  yaw: {kind: p, kp: 0.3}\n"
            "  v_cmd_max: 0.6\n",
        )
    )
    assert isinstance(flat.control, SpeedPIYawP)
    assert isinstance(axes.control, AxisController)
    one, other = simulate(flat, Robot()), simulate(axes, Robot())
    for name, column in one.log.items():
        np.testing.assert_array_equal(column, other.log[name], name)


def test_one_kind_serves_both_axes_and_an_axis_alone_leaves_the_other(tmp_path: Path) -> None:
    both = load_mission(written(tmp_path, "control: {kind: pd, period: 0.05}\n")).control
    assert both == AxisController(speed=PD(), yaw=YawPD(), period=0.05)
    one = load_mission(written(tmp_path, "control:\n  yaw: {kind: pid, kd: 0.1}\n")).control
    assert one == AxisController(speed=PI(), yaw=YawPID(kd=0.1))


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (
            "control:\n  speed:\n    kind: pix\n",
            4,
            "unknown kind 'pix' of control.speed: the kinds are pi, p, pd, pid, sl",
        ),
        ("control: {kind: pix}\n", 2, "the kinds are pi-p; or speed: {kind: pi|p|pd|pid"),
        ("control: {yaw: pd}\n", 2, "control.yaw is the text 'pd': write control.yaw: {kind: pd}"),
        ("control:\n  yaw:\n    kind: pd\n    kdd: 1\n", 5, "'kdd' in control.yaw: did you mean"),
        ("control: {kind: pd, kp: 1}\n", 2, "unknown key 'kp' in control: the keys are kind, "),
        ("control:\n  speed: {kind: pi, kp: -1}\n", 3, "control.speed.kp is -1"),
        ("control: {speed: {anti_windup: some}}\n", 2, "conditional"),
        ("control: {speed: 3}\n", 2, "control.speed is 3: write a section"),
    ],
)
def test_a_mistake_in_an_axis_is_named_with_its_line(
    tmp_path: Path, text: str, line: int, words: str
) -> None:
    with pytest.raises(DataError) as caught:
        load_mission(written(tmp_path, text))
    assert str(caught.value).startswith(f"m.yaml:{line}: ")
    assert words in str(caught.value)


def test_a_choice_replaces_the_law_and_keeps_the_limits() -> None:
    flat = SpeedPIYawP(kp_yaw=0.3, psi_cmd_max=0.2, period=0.05)
    chosen = chosen_controller("yaw=pd", flat)
    assert chosen == AxisController(speed=PI(), yaw=YawPD(), psi_cmd_max=0.2, period=0.05)
    again = chosen_controller("speed=pd,yaw=p", AxisController(yaw=YawP(kp=0.7)))
    assert again == AxisController(speed=PD(), yaw=YawP(kp=0.7))
    assert chosen_controller("pi-p", flat) is flat
    assert chosen_controller("pd", flat).period == 0.05


def test_a_law_of_one_axis_comes_from_another_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = tmp_path / "site" / "own_axis-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: own-axis\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[sysid.mission]\ncontrol.yaw.relay = own_axis:Relay\ncontrol.yaw.none = own_axis:Nothing\n"
    )
    (tmp_path / "site" / "own_axis.py").write_text(
        "from sysid.robot.mission.settings import AxisSettings\n"
        "class Nothing(AxisSettings):\n    pass\n"
        "class Relay(AxisSettings):\n"
        "    size: float = 0.1\n"
        "    def start(self, scene, xp):\n        return ()\n"
        "    def step(self, state, inputs, dt, xp):\n"
        "        return state, xp.where(inputs.error > 0.0, self.size, -self.size)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    assert kinds("control.yaw")[-2:] == ("relay", "none")
    assert "yaw.relay" not in kinds("control")
    mission = load_mission(written(tmp_path, "control: {yaw: {kind: relay, size: 0.05}}\n"))
    log = simulate(mission, Robot()).log
    assert set(np.abs(log["psi_cmd"][:-1])) == {0.05}
    with pytest.raises(DataError, match=r"m.yaml:2: the law 'control.yaw.none' .* has no st"):
        load_mission(written(tmp_path, "control: {yaw: {kind: none}}\n"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pix", "unknown kind 'pix' of control: the kinds are pi-p"),
        ("speed=pix", "unknown kind 'pix' of control.speed: the kinds are pi"),
        ("sped=pi", "one for each axis, as speed=pid,yaw=pd"),
        ("speed=pi,speed=p", "one for each axis"),
        ("yaw=", "one for each axis"),
    ],
)
def test_a_choice_that_is_none_is_one_sentence(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        chosen_controller(text, SpeedPIYawP())


# Tracking -----------------------------------------------------------------------------------------

AXIS_LAWS = [(axis, kind) for axis in AXES for kind in kinds(f"control.{axis}")]


@pytest.mark.parametrize(("axis", "kind"), AXIS_LAWS)
def test_gains_are_keys_of_the_law_and_can_be_changed(axis: str, kind: str) -> None:
    law = law_class(f"control.{axis}", kind)()
    assert law.gains
    for name, (low, high) in law.gains.items():
        assert low <= getattr(law, name) <= high
        assert getattr(law.with_gains({name: high}), name) == high
    whole = AxisController(**{axis: law})
    assert {f"{axis}.{n}": b for n, b in law.gains.items()}.items() <= whole.gains.items()
    first = next(iter(law.gains))
    assert getattr(getattr(whole.with_gains({f"{axis}.{first}": 0.5}), axis), first) == 0.5


def test_the_page_on_control_drives(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mission and the command that docs/control.md shows, on a plant from a log."""
    page = (Path(__file__).parents[3] / "docs" / "control.md").read_text(encoding="utf-8")
    shown = re.findall(r"```(yaml|console)\n(.*?)```", page, flags=re.DOTALL)
    mission = next(text for kind, text in shown if kind == "yaml")
    command = next(text for kind, text in shown if kind == "console" and " --control " in text)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mission.yaml").write_text(mission)
    robot_log(tmp_path / "log.csv", noise=0.01)
    of_first_order = ("--structure", "arx", "--orders", "na=1 nb=1 nk=1")
    assert run(capsys, "fit", "log.csv", *of_first_order).code == 0
    assert run(capsys, "export", "--format", "json").code == 0
    plain = run(capsys, "simulate", "mission.yaml", "--json").document
    assert plain["outcome"] == "arrived"
    other = run(capsys, *command.split()[1:], "--json").document
    assert other["outcome"] == "arrived"
    assert other["time_s"] != plain["time_s"] or other["final"] != plain["final"]
    nothing = mission + "  compensate: identified\n"
    (tmp_path / "mission.yaml").write_text(nothing)
    said = run(capsys, "simulate", "mission.yaml", "--json").document["warnings"]
    assert any("Nothing is compensated" in sentence for sentence in said)


# Parts of a PID -----------------------------------------------------------------------------------


@pytest.mark.parametrize("windup", ["conditional", "back-calculation"])
def test_anti_windup_keeps_the_overshoot_small(windup: Any) -> None:
    """A step to a speed that the limit hardly reaches, then down to a fifth of it."""
    references = [(0.42, 0.0)] * 100 + [(0.1, 0.0)] * 60

    def above(law: PI) -> float:
        """Mean speed above the lower reference in the six seconds after the step down."""
        run = driven(AxisController(speed=law, v_cmd_max=0.8), references, Robot(difference=0.0))
        return float(np.mean(run[100:, 0] - 0.1))

    free = above(PI(anti_windup="none"))
    # What is left is the loop's own slow mode; winding up leaves more than twice as much.
    assert above(PI(anti_windup=windup)) < 0.5 * free


def test_the_derivative_filter_takes_noise_off_the_command() -> None:
    rates = np.random.default_rng(3).standard_normal(2000)

    def spread(filter_time: float) -> float:
        law, commands = PD(kp=0.0, kd=0.1, filter_time=filter_time), []
        state = law.start(SCENE, floats)
        for rate in rates.tolist():
            state, command = law.step(state, inputs(rate=rate), 0.1, floats)
            commands.append(command)
        return float(np.std(commands))

    # A first-order filter of white noise leaves √(a/(2 − a)) of it, a = T/(T_f + T) = 1/4; two
    # thousand numbers give a standard deviation within some per cent.
    assert spread(0.0) == pytest.approx(0.1, rel=0.1)
    assert spread(0.3) == pytest.approx(0.1 * math.sqrt(0.25 / 1.75), rel=0.1)


def test_feed_forward_alone_holds_the_speed_of_the_identified_plant() -> None:
    """Open loop: V_ref over the measured gain is the drive that reaches V_ref."""
    robot = Robot(top_speed=0.7, difference=0.0)
    scene = SCENE._replace(nominal=nominal_of(robot, Geometry(), pwm))
    law = AxisController(speed=PI(kp=0.0, ki=0.0, feed_forward=1.0))
    run = driven(law, [(0.3, 0.0)] * 60, robot, scene)
    assert run[-1, 0] == pytest.approx(0.3, rel=1e-3)  # 5.9 s are thirty time constants


def test_gain_and_lag_are_measured_along_both_axes() -> None:
    nominal = nominal_of(Robot(lag=0.5, difference=0.0), Geometry(), pwm)
    assert nominal.speed.gain == pytest.approx(0.43, rel=1e-3)  # settled to a thousandth
    assert nominal.yaw.gain == pytest.approx(2 * 0.43 / Geometry().B, rel=1e-3)
    # The trapezoid over samples of a fifth of the lag.
    assert nominal.speed.lag == pytest.approx(0.5, rel=0.02)
    assert nominal.yaw.lag == pytest.approx(0.5, rel=0.02)


def test_a_plant_that_answers_backwards_has_no_model_for_a_controller() -> None:
    mission = Mission(goal=(1.0, 0.0), control=AxisController(speed=PI(feed_forward=1.0)))
    with pytest.raises(ModelError, match="forward speed never rises"):
        simulate(mission, Robot(top_speed=-0.43))
    simulate(goal(1, 0), Robot(top_speed=-0.43))  # a law without a model asks for none
