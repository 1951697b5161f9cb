"""Navigation laws in missions: what they fuse, reject, wait for, and say."""

import math
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mission_cases import Robot, goal

from sysid.data.record import Array
from sysid.errors import DataError, ModelError
from sysid.robot.mission.contracts import Navigation, NavigationInputs
from sysid.robot.mission.navigation.finite_model import FiniteModel, Hypothesis
from sysid.robot.mission.navigation.fusion import RUN
from sysid.robot.mission.registry import law_class
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.runners import floats

FILTERS = ("kf", "ekf", "ukf", "finite-model")


def sensors(**kinds: dict[str, Any]) -> dict[str, Any]:
    return {kind: law_class("sensors", kind)(**keys) for kind, keys in kinds.items()}


def law(kind: str, **keys: Any) -> Any:
    return law_class("navigation", kind)(**keys)


class Slippery:
    """A floor on which both tracks lose a part of their speed."""

    slides = False

    def __init__(self, slip: float) -> None:
        self.slip = slip

    def __bool__(self) -> bool:
        return True

    def __call__(self, left: float, right: float) -> tuple[float, float]:
        return (1.0 - self.slip) * left, (1.0 - self.slip) * right

    def start(self) -> tuple[()]:
        return ()

    def step(self, state: Any, omega: tuple[float, float], dt: float) -> tuple[Any, Any]:
        return self(*omega), state


def driven(
    navigation: Any, slip: float = 0.0, seed: int = 1, robot: Any = None, **kinds: Any
) -> MissionResult:
    """A short mission around a corner."""
    mission = goal(2, 1, navigation=navigation, sensors=sensors(**kinds), timeout=30)
    plant: Any = robot or Robot(ground=Slippery(slip))  # type: ignore[arg-type]
    return simulate(mission, plant, seed)


def errors(run: MissionResult) -> Array:
    """How far the estimate is from the truth, sample by sample [m]."""
    log = run.log
    return np.hypot(log["x_est"] - log["x"], log["y_est"] - log["y"])


# Dead reckoning, inertial, compass ----------------------------------------------------------------


def test_perfect_inertial_sensors_show_the_way() -> None:
    """Measurements of 1 kHz without errors at 50 samples a second: integration loses nothing."""
    exact = {"noise": 0.0, "bias_std": 0.0, "bias_walk": 0.0, "resolution": 0.0}
    run = driven(law("inertial"), robot=Robot(dt=0.02), gyroscope=exact, accelerometer=exact)
    assert run.outcome.value == "arrived"
    # Trapezoids over acceleration that is a mean of each sample already: half a sample of speed
    # change at the start, 0.3 m/s · 0.02 s.
    final = math.hypot(run.final.x - 2, run.final.y - 1)
    assert final < 0.1 + 0.3 * 0.02


def test_an_accelerometers_bias_grows_with_the_square_of_time() -> None:
    exact = {"noise": 0.0, "bias_std": 0.0, "bias_walk": 0.0, "resolution": 0.0}
    biased = exact | {"bias": [0.02, 0.0]}
    run = driven(law("inertial"), gyroscope=exact, accelerometer=biased)
    # It believes to be ½·0.02·t² ahead and stops that much short of the goal.
    short = math.hypot(run.final.x - 2, run.final.y - 1)
    assert short > 0.3 * 0.5 * 0.02 * run.time_s**2


def test_a_compass_corrects_the_heading_that_unlike_wheels_lose() -> None:
    """The left sprocket is 5 % larger than odometry believes."""

    class Unlike(Slippery):
        def __call__(self, left: float, right: float) -> tuple[float, float]:
            return 1.05 * left, right

    robot = Robot(ground=Unlike(0.0))  # type: ignore[arg-type]
    blind = driven(law("odometry"), robot=robot)
    led = driven(law("compass"), robot=robot, magnetometer={"bias_std": 0.0, "north": 0.7})
    missed = [math.hypot(r.final.x - 2, r.final.y - 1) for r in (blind, led)]
    assert missed[0] > 0.25
    # What is left is the way itself, half of 5 % too long, and the tolerance.
    assert missed[1] < 0.1 + 0.025 * math.hypot(2, 1)


# Filters ------------------------------------------------------------------------------------------

ALL: dict[str, Any] = {
    "encoders": {}, "gyroscope": {"latency": 0.1}, "accelerometer": {}, "magnetometer": {},
    "visual_odometry": {"rate": 5.0, "latency": 0.3, "dropout": 0.2},
    "position_fixes": {"rate": 2.0},
}  # fmt: skip


@pytest.mark.parametrize("kind", FILTERS)
def test_a_filter_knows_how_well_it_knows(kind: str) -> None:
    """Errors within what the covariance says, which stays symmetric and positive definite."""
    run = driven(law(kind), **ALL)
    log = run.log
    assert run.outcome.value == "arrived"
    assert np.isfinite([log[n] for n in ("x_est", "y_est", "psi_est", "v_est", "P_xx")]).all()
    determinant = log["P_xx"] * log["P_yy"] - log["P_xy"] ** 2
    assert determinant.min() > 0
    assert log["P_psi"].min() > 0
    if kind != "kf":  # which takes its heading for known
        distance = errors(run) / np.sqrt(log["P_xx"] + log["P_yy"])
        assert distance.max() < 4  # 4σ: of seventy samples none lies beyond in sixteen of 17 runs


LATE_FIXES: dict[str, Any] = {"position_fixes": {"rate": 4.0, "latency": 0.2, "dropout": 0.2}}


@pytest.mark.parametrize(
    ("kind", "kinds"),
    [
        ("ekf", LATE_FIXES),
        pytest.param("finite-model", {"gyroscope": {}}, marks=pytest.mark.slow),
    ],
)
def test_many_at_once_compiled_are_as_one_after_the_other(kind: str, kinds: dict[str, Any]) -> None:
    """Late measurements, losses and all; eight runs side by side on jax.numpy."""
    jax.config.update("jax_enable_x64", True)
    run = driven(law(kind), **kinds)
    mission = goal(2, 1, navigation=law(kind), sensors=sensors(**kinds))
    scene, filt = mission.scene(), mission.navigation
    names = ["omega_l", "omega_r", *(n for s in scene.sensors.values() for n in s.names)]
    rows = np.array([run.log[n] for n in names]).T[:40]
    shifts = np.linspace(-0.3, 0.3, 8)

    def estimates(x: Any, xp: Any) -> Any:
        start = scene._replace(start=scene.start._replace(x=x))

        def step(state: Any, row: Any) -> Any:
            k, row = row
            measurements = dict(zip(names, row, strict=True))
            given = NavigationInputs(0.1 * k, measurements, start)
            state, _ = filt.step(state, given, xp.where(k > 0, 0.1, 0.0), xp)
            return state, xp.array(filt.report(state, xp))  # type: ignore[attr-defined]

        state = filt.start(start, xp)
        if xp is jnp:
            state = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), state)
            return jax.lax.scan(step, state, (jnp.arange(40.0), jnp.asarray(rows)))[1]
        out = []
        for k, row in enumerate(rows.tolist()):
            state, shown = step(state, (float(k), row))
            out.append(shown)
        return np.array(out)

    together = np.asarray(jax.jit(jax.vmap(lambda x: estimates(x, jnp)))(jnp.asarray(shifts)))
    for k in (0, 7):
        # Forty steps of a stable filter, rounded differently; wheel speeds weigh 1/r² ≈ 2000.
        alone = estimates(float(shifts[k]), floats)
        np.testing.assert_allclose(together[k], alone, rtol=1e-9, atol=1e-9)


def test_readings_that_come_late_are_used_where_they_belong() -> None:
    """Late fixes: as good as in time but for what is still on its way, far better than none."""
    kinds: dict[str, Any] = {"encoders": {}, "gyroscope": {}}
    fixes = {"rate": 10.0, "noise": 0.003}
    in_time = driven(law("ekf"), slip=0.3, **kinds, position_fixes=fixes)
    late = driven(law("ekf"), slip=0.3, **kinds, position_fixes=fixes | {"latency": 0.5})
    ignored = driven(
        law("ekf", buffer=0), slip=0.3, **kinds, position_fixes=fixes | {"latency": 0.5}
    )
    assert errors(late).mean() < 3 * errors(in_time).mean()
    assert errors(late).mean() < 0.2 * errors(ignored).mean()


def test_a_reading_that_comes_late_changes_the_present_as_if_it_had_been_in_time() -> None:
    """The same numbers, some of them three samples late: the same belief once all have come."""
    filt = law("ekf")
    rng = np.random.default_rng(2)
    fixes = rng.normal(size=(30, 2)) * 0.01
    ends = []
    for latency in (0.0, 0.3):
        scene = goal(
            2, 1, navigation=filt,
            sensors=sensors(position_fixes={"latency": latency}, gyroscope={}),
        ).scene()  # fmt: skip
        d = round(latency / 0.1)
        state = filt.start(scene, floats)
        for k in range(30):
            fix = fixes[k - d] if 0 <= k - d < 25 else (math.nan, math.nan)
            measurements = {
                "omega_l": 1.0,
                "omega_r": 2.0,
                "gyro_z": 0.1,
                "fix_x": fix[0],
                "fix_y": fix[1],
            }
            given = NavigationInputs(0.1 * k, measurements, scene)
            state, _ = filt.step(state, given, 0.1 if k else 0.0, floats)
        ends.append(state.belief.of)
    np.testing.assert_array_equal(ends[0].x, ends[1].x)
    np.testing.assert_array_equal(ends[0].P, ends[1].P)


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_slip_that_encoders_cannot_see_is_seen_by_a_camera(kind: str) -> None:
    wheels: dict[str, Any] = {"encoders": {}, "gyroscope": {}}
    blind = driven(law(kind), slip=0.3, **wheels)
    seeing = driven(law(kind), slip=0.3, **wheels, visual_odometry={})
    assert errors(blind)[-1] > 0.4
    assert errors(seeing)[-1] < 0.05
    assert seeing.log["slip_l_est"][-1] == pytest.approx(0.3, abs=0.05)


def test_a_magnetometer_near_iron_is_rejected() -> None:
    """Iron beside the way that turns the field by more than a radian where the robot passes."""
    kinds: dict[str, Any] = {
        "encoders": {}, "gyroscope": {}, "magnetometer": {"iron": [[1.0, 0.7, 4.0]]}
    }  # fmt: skip
    open_gate, gated = (driven(law("ekf", gate=g), **kinds) for g in (1.0, 0.999))
    turned = [np.abs(r.log["psi_est"] - r.log["psi"]).max() for r in (open_gate, gated)]
    assert open_gate.log["rejected"].sum() == 0
    assert gated.log["rejected"].sum() > 5
    assert turned[0] > 0.3
    assert turned[1] < 0.05


def pushed(kind: str, fixes: Array) -> tuple[Array, float]:
    """Distances of the estimate of a robot that stands still to fixes that it reads, (N, 2), and
    how many were rejected."""
    filt = law(kind, q={"slip": 0.0})
    scene = goal(2, 1, navigation=filt, sensors=sensors(position_fixes={"noise": 0.01})).scene()
    state, off, rejected = filt.start(scene, floats), [], 0.0
    for k, (x, y) in enumerate(fixes.tolist()):
        read = {"omega_l": 0.0, "omega_r": 0.0, "fix_x": x, "fix_y": y}
        state, body = filt.step(state, NavigationInputs(0.1 * k, read, scene), 0.1, floats)
        rejected += dict(zip(filt.columns, filt.report(state, floats), strict=True))["rejected"]
        off.append(math.hypot(body.pose.x - x, body.pose.y - y))
    return np.array(off), rejected


@pytest.mark.parametrize("kind", FILTERS)
def test_fixes_that_agree_open_the_gate_again_and_outliers_do_not(kind: str) -> None:
    """A robot that is pushed half a metre aside while its wheels stand; and wild measurements."""
    noise = np.random.default_rng(5).normal(0.0, 0.01, (30, 2))
    aside = noise + [[0.0, 0.5 * (k >= 10)] for k in range(30)]
    off, rejected = pushed(kind, aside)
    assert off[10:14].min() > 0.4
    assert off[15:].max() < 0.05  # 5σ
    assert rejected == RUN - 1
    turns = np.array([[math.cos(2.0 * k), math.sin(2.0 * k)] for k in range(30)])
    off, rejected = pushed(kind, noise + turns * (np.arange(30) >= 10)[:, None])
    assert off[10:].min() > 0.9
    assert rejected == 20


# Hypotheses ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("slip", "holds"), [(0.0, "p_grip"), (0.3, "p_slip")])
def test_a_bank_tells_whether_the_tracks_slip(slip: float, holds: str) -> None:
    run = driven(law("finite-model"), slip=slip, encoders={}, gyroscope={}, visual_odometry={})
    log = run.log
    np.testing.assert_allclose(log["p_grip"] + log["p_slip"], 1.0, atol=1e-12)
    moving = log["v"] > 0.05  # who stands does not slip
    # Slow or turning robots show little slip, and doubt comes back with the dwell time.
    assert log[holds][moving].min() > 0.5
    assert np.mean(log[holds][moving] > 0.9) > 0.8
    assert errors(run)[-1] < 0.05


@pytest.mark.parametrize(("lag", "holds"), [(0.2, "p_empty"), (0.8, "p_payload")])
def test_a_bank_tells_a_payload_by_how_the_robot_answers(lag: float, holds: str) -> None:
    models = {
        "empty": Hypothesis(lag=0.2, top_speed=0.43, speed=1e-3),
        "payload": Hypothesis(lag=0.8, top_speed=0.43, speed=1e-3),
    }
    bank = FiniteModel(hypotheses=models, dwell=1000.0)  # a payload does not come and go
    run = driven(bank, robot=Robot(lag=lag, difference=0.0), encoders={})
    assert run.log[holds][-1] > 0.99


# What is said -------------------------------------------------------------------------------------


def test_a_filter_without_sensors_takes_the_plainest_and_says_so() -> None:
    mission = goal(1, 0, navigation=law("ekf"))
    assert set(mission.scene().sensors) == {"encoders", "gyroscope"}
    _, notes = as_robot(Robot(), mission)
    assert "no sensors are listed: navigation reads encoders and gyroscope" in notes[-1]
    assert as_robot(Robot(), goal(1, 0))[1] == ()  # dead reckoning needs none


def test_what_comes_too_late_for_the_buffer_is_said() -> None:
    mission = goal(
        1, 0, navigation=law("ekf", buffer=2, r={"fix_x": 1.0}),
        sensors=sensors(gyroscope={"latency": 0.5}),
    )  # fmt: skip
    _, notes = as_robot(Robot(), mission)
    assert "gyroscope reads comes later than navigation.buffer = 2" in notes[0]
    assert "a variance of fix_x, which no sensor reads" in notes[1]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("sensors: {encoders: }\nnavigation:\n  kind: inertial\n", 3,
         "navigation reads gyroscope and accelerometer and sensors has no gyroscope and no"),
        ("navigation:\n  kind: ekf\n  r: {gyro_z: -1}\n", 4, "navigation.r.gyro_z is -1"),
        ("navigation:\n  kind: kf\n  q: {speed: -1}\n", 4, "navigation.q.speed is -1"),
        ("navigation:\n  kind: ukf\n  q: {sped: 1}\n", 4, "there is a density q of 'sped'"),
        ("navigation:\n  kind: ekf\n  gate: 0.2\n", 4, "navigation.gate is 0.2"),
        ("navigation:\n  kind: finite-model\n  hypotheses: {one: {}}\n", 4, "hypotheses are 1"),
        ("navigation:\n  kind: finite-model\n  hypotheses: {a: {}, b: {lag: 1}}\n", 4,
         "lag and top_speed together"),
    ],
)  # fmt: skip
def test_mistakes_are_named_with_their_line(
    tmp_path: Path, text: str, line: int, words: str
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("goal: [1, 0]\n" + text)
    with pytest.raises(DataError) as caught:
        load_mission(path)
    assert str(caught.value).startswith(f"m.yaml:{line}: ")
    assert words in str(caught.value)


def test_a_mission_that_was_put_together_otherwise_is_refused_when_driven() -> None:
    mission = goal(1, 0, sensors=sensors(encoders={}))
    blind: Navigation = law("compass")
    with pytest.raises(ModelError, match="sensors has no magnetometer"):
        simulate(mission.model_copy(update={"navigation": blind}), Robot())
