"""Every law of the closed loop: pure, over any array namespace, chosen by kind, blamed by name."""

import itertools
import math
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mission_cases import Robot, check_law, goal

from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.errors import DataError, ModelError, UsageError
from sysid.robot.mission.contracts import (
    ROBOT_INPUTS,
    ROBOT_OUTPUTS,
    Command,
    ControlInputs,
    Pose,
    Scene,
)
from sysid.robot.mission.control.pi_p import SpeedPIYawP
from sysid.robot.mission.guidance.field import PotentialField
from sysid.robot.mission.loop import Loop, Tick, ticks
from sysid.robot.mission.navigation.dead_reckoning import Odometry
from sysid.robot.mission.registry import ROLES, kinds, law_class
from sysid.robot.mission.settings import ControlSettings
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tracks.settling import Ending, settle
from sysid.runners import floats

LAWS = [(role, kind) for role in ROLES for kind in kinds(role) if kind != "multibody"]
"""MuJoCo knows no other namespace: its runs go one by one."""


@pytest.mark.parametrize(("role", "kind"), LAWS)
def test_a_law_is_pure_and_the_same_on_every_namespace(role: str, kind: str) -> None:
    check_law(role, law_class(role, kind)())


def test_the_loop_runs_compiled_and_many_at_once() -> None:
    """Sixteen runs from other starts, vectorised, agree with one after the other."""
    jax.config.update("jax_enable_x64", True)
    robot, mission, samples = Robot(), goal(2, 1, obstacles=[(1.0, 0.9)]), 100
    scene, dt = mission.scene(), robot.dt
    clock = list(islice(ticks(dt, mission.control.period), samples))
    assert all(tick.now == (pytest.approx(tick.t),) and not tick.before for tick in clock)

    def loop(y: Any, xp: Any) -> Loop:
        start = scene._replace(start=Pose(0.0, y, 0.0))
        laws = (mission.guidance, mission.control, mission.navigation, mission.motion)
        return Loop(*laws, plant=robot, scene=start, timeout=mission.timeout, xp=xp)

    @jax.jit
    @jax.vmap
    def batch(y: Any) -> Any:
        def sample(state: Any, instant: Any) -> Any:
            t, dt = instant
            after, row = loop(y, jnp).sample(state, Tick(t, dt, (), (t,)))
            return jax.tree.map(lambda a, b: jnp.asarray(a, b.dtype), after, state), row

        start = jax.tree.map(jnp.asarray, loop(y, jnp).start())
        instants = np.array([tick.t for tick in clock]), np.array([tick.dt for tick in clock])
        return jax.lax.scan(sample, start, instants)

    starts = np.linspace(-0.5, 0.5, 16)
    last, columns = batch(starts)
    together = np.array(columns)
    for k, y in enumerate(starts.tolist()):
        alone, state = loop(y, floats), loop(y, floats).start()
        for j, tick in enumerate(clock):
            state, row = alone.sample(state, tick)
            # A hundred steps of a stable loop, rounded differently.
            np.testing.assert_allclose(together[:, k, j], row, rtol=0, atol=1e-9)
        assert int(last.verdict[k]) == state.verdict


@pytest.mark.parametrize(
    ("name", "arity"),
    [
        ("sin", 1),
        ("cos", 1),
        ("hypot", 2),
        ("arctan2", 2),
        ("minimum", 2),
        ("maximum", 2),
        ("abs", 1),
        ("sign", 1),
    ],
)
def test_plain_floats_have_numpys_functions(name: str, arity: int) -> None:
    values = [0.0, -0.0, 1.5, -2.5, 1e-300, math.inf, math.nan]
    plain, general = getattr(floats, name), getattr(np, name)
    for arguments in itertools.product(values, repeat=arity):
        if name in ("sin", "cos") and math.isinf(arguments[0]):
            continue  # a domain error of plain floats; the simulator words it
        with np.errstate(invalid="ignore"):
            wanted = general(*arguments)
        assert plain(*arguments) == pytest.approx(wanted, rel=1e-15, nan_ok=True)
    many = np.array(values[:5])
    np.testing.assert_array_equal(plain(*[many] * arity), general(*[many] * arity))


def test_plain_floats_choose_and_cut() -> None:
    assert floats.where(np.bool_(True), 1.0, 2.0) == 1.0
    np.testing.assert_array_equal(floats.where(np.array([True, False]), 1.0, 2.0), (1.0, 2.0))
    assert [floats.clip(x, -1.0, 1.0) for x in (-3.0, 0.5, 3.0)] == [-1.0, 0.5, 1.0]
    assert [floats.clip(k, 0, 2) for k in (-1, 1, 5)] == [0, 1, 2]
    assert floats.clip(0.0, 1.0, -1.0) == np.clip(0.0, 1.0, -1.0)
    assert math.isnan(floats.clip(math.nan, -1.0, 1.0))
    rising = [-1.0, 0.0, 0.0, 2.0]
    for x in (-2.0, 0.0, 0.5, 2.0, 3.0, math.nan):
        for side in ("left", "right"):
            assert floats.searchsorted(rising, x, side) == np.searchsorted(rising, x, side)
    with pytest.raises(TypeError, match="logical_not"):
        floats.where(-2, 1.0, 2.0)  # what ~True is
    assert floats.sqrt(4.0) == 2.0


# Laws by kind -------------------------------------------------------------------------------------


def test_a_law_is_chosen_by_kind_and_todays_keys_stay_valid(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(
        "goal: [1, 0]\n"
        "guidance: {kind: field, theta: 1}\n"
        "control: {kp_yaw: 0.3}\n"
        "navigation: {kind: odometry, r: 0.03}\n"
        "motion:\n"
    )
    mission = load_mission(path)
    assert mission.guidance == PotentialField(theta=1.0)
    assert mission.control == SpeedPIYawP(kp_yaw=0.3)
    assert mission.navigation == Odometry(r=0.03)
    assert mission == Mission(
        goal=(1.0, 0.0),
        guidance=PotentialField(theta=1.0),
        control=SpeedPIYawP(kp_yaw=0.3),
        navigation=Odometry(r=0.03),
    )


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("guidance:\n  K: 1\n  kind: x\n", 4, "unknown kind 'x' of guidance: the kinds are field"),
        ("control: {kind: 3}\n", 2, "the kind of control is 3: the kinds are pi-p"),
        ("navigation: {kind: }\n", 2, "the kind of navigation is empty: the kinds are odometry"),
        ("control: pid\n", 2, "control is the text 'pid': write control: {kind: pid}"),
        ("motion: {mass: 3}\n", 2, "unknown key 'mass' in motion: the keys are kind"),
        ("motion: 3\n", 2, "motion is 3: write a section"),
        ("navigation: {R: 0.03}\n", 2, "unknown key 'R' in navigation: did you mean 'r'"),
        ("navigation: {r: wide}\n", 2, "navigation.r is the text 'wide': give a number"),
    ],
)  # fmt: skip
def test_a_law_that_is_not_there_lists_those_that_are(
    text: str, line: int, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("goal: [1, 0]\n" + text)
    with pytest.raises(DataError) as caught:
        load_mission(path)
    assert str(caught.value).startswith(f"m.yaml:{line}: ")
    assert words in str(caught.value)


@pytest.fixture
def broken_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An installed package whose laws are none."""
    about = tmp_path / "site" / "broken_laws-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: broken-laws\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[sysid.mission]\n"
        "control.gone = broken_laws:Nowhere\n"
        "control.number = broken_laws:NUMBER\n"
        "control.bare = broken_laws:Bare\n"
        "control.pi-p = broken_laws:NUMBER\n"
        "sensors.mute = mute_sensor:Mute\n"
    )
    (tmp_path / "site" / "broken_laws.py").write_text(
        "from sysid.robot.mission.settings import ControlSettings\n"
        "NUMBER = 3\n"
        "class Bare(ControlSettings):\n    def start(self, scene, xp):\n        return 0.0\n"
    )
    (tmp_path / "site" / "mute_sensor.py").write_text(
        "from sysid.robot.mission.sensors.imperfect import ImperfectSensor\n"
        "class Mute(ImperfectSensor):\n    rate: float = 1.0\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path / "site"))


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("gone", "the law 'control.gone' of the package broken-laws cannot be imported"),
        ("number", "the law 'control.number' of the package broken-laws is no pydantic model"),
        ("bare", "the law 'control.bare' of the package broken-laws has no step"),
    ],
)
@pytest.mark.usefixtures("broken_package")
def test_a_package_with_a_broken_law_is_named(kind: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(f"goal: [1, 0]\ncontrol: {{kind: {kind}}}\n")
    with pytest.raises(DataError) as caught:
        load_mission(path)
    assert str(caught.value).startswith(f"m.yaml:2: {words}")
    assert kinds("control") == ("pi-p", "gone", "number", "bare")
    assert law_class("control", "pi-p") is SpeedPIYawP  # ours stays ours


@pytest.mark.usefixtures("broken_package")
def test_a_sensor_of_a_package_that_reads_nothing_is_named(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("goal: [1, 0]\nsensors:\n  gyroscope:\n  mute:\n")
    words = (
        r"m.yaml:4: the law 'sensors.mute' .*the sensor Mute needs `.measured` and `.measure\(\)`"
    )
    with pytest.raises(DataError, match=words):
        load_mission(path)


class Wild(ControlSettings):
    """A controller that fails in one of three ways after half a second."""

    how: str

    def start(self, scene: Scene, xp: Any) -> float:
        return 0.0

    def step(
        self, state: float, inputs: ControlInputs, dt: float, xp: Any
    ) -> tuple[float, Command]:
        if inputs.t < 0.5:
            return state, Command(0.1, 0.0)
        given = {"nan": math.nan, "huge": 1e300}.get(self.how) or 1.0 / state
        return state, Command(given, 0.0)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("nan", "the law of control gives nan, 0 at t = 0.5 s"),
        ("zero", "a law of the mission fails at t = 0.5 s .float division by zero"),
    ],
)
def test_a_law_without_numbers_is_named_and_not_the_plant(how: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        simulate(goal(1, 0, control=Wild(how=how)), Robot())


def test_a_command_beyond_full_drive_is_cut_by_the_drive() -> None:
    log = simulate(goal(1, 0, timeout=2, control=Wild(how="huge")), Robot()).log
    assert log["pwm_l"].max() == log["pwm_r"].max() == 20000.0


def test_advice_of_another_law_names_no_gain_that_it_has_not() -> None:
    class Still(ControlSettings):
        def start(self, scene: Scene, xp: Any) -> tuple[()]:
            return ()

        def step(
            self, state: tuple[()], inputs: ControlInputs, dt: float, xp: Any
        ) -> tuple[tuple[()], Command]:
            return (), Command(0.0, 0.0)

    said = simulate(goal(1, 0, control=Still()), Robot()).sentence
    assert "stands still" in said
    assert "kp_" not in said


# Plants asked by contract -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Tracks:
    """A robot's own plant; ``leak`` 1 makes its speeds integrate, a word in an error does not."""

    leak: float = 1.0
    error: str = ""
    dt: float = 0.1
    inputs: tuple[Channel, ...] = ROBOT_INPUTS
    outputs: tuple[Channel, ...] = ROBOT_OUTPUTS
    input_range: tuple[tuple[float, float], ...] = ()
    u_offset: Array = field(default_factory=lambda: np.zeros(2))
    ground: Ground = field(default_factory=Ground)

    def initial_state(self) -> Array:
        return np.zeros(2)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        if self.error:
            raise ModelError(self.error)
        return self.leak * state + 1e-5 * u, state


@pytest.mark.slow
def test_a_robots_plant_that_never_rests_is_driven_with_a_warning() -> None:
    plant = Tracks()
    assert settle(plant, np.zeros(2), np.full(2, 1.0)).ending is Ending.KEEPS_MOVING
    _, warnings = as_robot(plant, Mission(goal=(1.0, 0.0)))
    assert "too slow to settle" in warnings[0]


def test_the_words_of_an_error_decide_nothing() -> None:
    """What a plant raises is its own affair, whatever words are in it."""
    plant = Tracks(error="the belt keeps moving although the drive is off")
    with pytest.raises(ModelError, match="the belt keeps moving"):
        as_robot(plant, Mission(goal=(1.0, 0.0)))


# Sensors ------------------------------------------------------------------------------------------


def test_navigation_is_told_the_drive_it_moved_under_and_the_plants_sample_time() -> None:
    seen: list[Any] = []

    class Listening(Odometry):
        def step(self, state: Any, inputs: Any, dt: Any, xp: Any) -> Any:
            seen.append(inputs)
            return super().step(state, inputs, dt, xp)

    log = simulate(goal(1, 0, navigation=Listening()), Robot(dt=0.05)).log
    shown = np.array([i.drive for i in seen]) * 20000.0
    # The command logged at a sample is what holds from there on.
    np.testing.assert_allclose(shown[1:, 0], log["pwm_l"][:-1], rtol=1e-12)
    assert {i.scene.dt for i in seen} == {0.05}


def test_what_sensors_read_is_in_the_log_and_follows_the_seed(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("goal: [1, 0]\nsensors:\n  gyroscope: {noise: 0.01}\n")
    mission = load_mission(path)
    one, again, other = (simulate(mission, Robot(), seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.log["gyro_z"], again.log["gyro_z"])
    assert not np.array_equal(one.log["gyro_z"], other.log["gyro_z"])
    np.testing.assert_array_equal(one.log["yaw_rate"], other.log["yaw_rate"])  # odometry ignores it
    error = (one.log["gyro_z"] - one.log["yaw_rate"])[1:]
    # σ = 0.01·√10; some fifty samples give it within a factor of two.
    assert 0.5 < np.std(error) / (0.01 * math.sqrt(10)) < 2


@pytest.mark.parametrize(
    ("keys", "line", "words"),
    [
        ("gyroscope: {noise: -1}", 3, "sensors.gyroscope.noise is -1"),
        (
            "gyroscope: {nois: 1}",
            3,
            "unknown key 'nois' in sensors.gyroscope: did you mean 'noise'",
        ),
        ("gyroscope: 3", 3, "sensors.gyroscope is 3: write a section"),
        ("gyroscope: {kind: field}", 3, "unknown key 'kind' in sensors.gyroscope"),
        ("gyroscope: {rate: 0}", 3, "sensors.gyroscope.rate is 0: give a number above 0"),
        ("gyroscope: {dropout: 1}", 3, "sensors.gyroscope.dropout is 1: give a number below 1"),
        ("gyroscope: {latency: 20}", 3, "sensors.gyroscope.latency is 20: .* at most 5"),
        ("gyroscope: {saturation: 0}", 3, "sensors.gyroscope.saturation is 0: .* above 0"),
        ("gyroscope: {noise: }", 3, "sensors.gyroscope.noise is empty: give a number"),
        ("gyroscope: {noise: [1, 2]}", 3, "noise has 2 numbers: give one, .* each of gyro_z"),
        (
            "magnetometer: {bias: [1, x]}",
            3,
            r"sensors.magnetometer.bias\[2\] is the text 'x': give a number",
        ),
        ("magnetometer: {iron: [[1, 2]]}", 3, r"iron must be .*: write iron: \[\[x, y, strength"),
        ("gyro: ", 3, "unknown kind 'gyro' of sensors: the kinds are encoders, gyroscope, "),
    ],
)
def test_a_mistake_in_a_sensor_is_named_with_its_line(
    tmp_path: Path, keys: str, line: int, words: str
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(f"goal: [1, 0]\nsensors:\n  {keys}\n")
    with pytest.raises(DataError, match=f"m.yaml:{line}: {words}"):
        load_mission(path)


def test_a_law_chosen_on_the_command_line_replaces_the_mission_s(tmp_path: Path) -> None:
    from sysid_cli.missions.law_options import LawChoice

    path = tmp_path / "m.yaml"
    path.write_text("goal: [1, 0]\nguidance: {theta: 1}\nnavigation: {r: 0.03}\n")
    mission = load_mission(path)
    other = LawChoice(guidance="steps", navigation="odometry", motion="kinematic").applied(mission)
    assert type(other.guidance).__name__ == "Steps"
    assert other.navigation == Odometry(r=0.03)  # the same kind keeps its keys
    assert LawChoice(guidance="field").applied(mission) == mission
    with pytest.raises(UsageError, match="unknown kind 'x' of navigation: the kinds are odometry"):
        LawChoice(navigation="x").applied(mission)
