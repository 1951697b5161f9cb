"""Motions that slip and that have mass, in the loop of a mission."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mission_cases import Robot, goal

from benchmarks.agreement import TOLERANCE, agreement
from sysid.data.preprocess import Detrend
from sysid.data.record import Channel
from sysid.errors import DataError, ModelError
from sysid.robot.mission.batch.sampler import Numbers, run_seeds
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.contracts import Body, MotionInputs, Pose, SensorInputs
from sysid.robot.mission.monte_carlo.runs import chunks, runner_of
from sysid.robot.mission.motion.slip import Slip
from sysid.robot.mission.sensors.inertial import Accelerometer
from sysid.robot.mission.simulator import scene_of, simulate
from sysid.robot.mission.spec import load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tracks.torque import motors_of, on_ground
from sysid.runners import floats
from sysid.structures.grey_box.dc_motor.structure import DCMotor, MotorPhysics
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.plant import Plant
from sysid.vehicle.dynamics import VehicleState, step
from sysid.vehicle.floor import Circle, Floor, HalfPlane, Polygon
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import TrackedVehicle

SPEED = Channel("omega", "rad/s")


def motor(ny: int = 1, options: dict[str, str] | None = None, **values: float) -> Plant:
    """A dc-motor of the bench's constants, 7.5 V at full drive."""
    given = {"input": "voltage", "friction": "coulomb", "parameters": "bench"} | (options or {})
    m = DCMotor(MotorPhysics.from_options(given, ny, ny), Sampling(0.1, 20))
    volts, tags = "voltage", [""] if ny == 1 else ["_l", "_r"]
    return Plant.of_structure(
        m,
        m.physics.pack(
            {"motor_friction": 2.9658e-5, "friction_torque": 0.0, "load_inertia": 0.0} | values
        ),
        0.1,
        tuple(Channel(volts + t, "V") for t in tags),
        tuple(Channel("omega" + t, "rad/s") for t in tags),
        Detrend.none(ny, ny),
        np.array([[-7.5, 7.5]] * ny + [[-25.0, 25.0]] * ny),
    )


LUMPED = {"parameters": "lumped", "torque_constant": "0.0335"}


@cache
def driven(motion: str, soil: str = "concrete", target: tuple[float, float] = (0.5, 0.0)):
    mission = goal(*target, vehicle={"motion": motion, "soil": soil, "speed_scale": 1.0})
    return simulate(mission, as_robot(motor(), mission)[0])


@pytest.mark.parametrize("soil", ["concrete", "dry-sand"])
@pytest.mark.parametrize("motion", ["kinematic", "slip", "dynamic"])
def test_every_motion_drives_a_mission(motion: str, soil: str) -> None:
    outputs = driven(motion, soil)
    assert outputs.outcome == "arrived"
    assert outputs.final.x == pytest.approx(0.42, abs=0.03)
    lost = 1.0 - outputs.final.x / (0.0215 * np.trapezoid(outputs.log["omega_l"], dx=0.1))
    if motion == "kinematic":
        assert abs(lost) < 1e-9
    elif soil == "dry-sand":
        assert lost > 0.005


def test_a_robot_that_slips_past_its_goal_is_not_said_to_stand_there() -> None:
    """Odometry does not see slip: it holds for reached what the robot is a third short of."""
    mission = goal(0.9, 0.0, motion={"kind": "slip", "slip": 0.3}, vehicle={"speed_scale": 1.0})
    result = simulate(mission, as_robot(motor(), mission)[0])
    assert result.outcome == "missed"
    away = 0.9 - result.final.x
    assert away > 0.2
    assert (
        f"estimated pose reached the goal, but the robot is {away:.2g} m from it" in result.sentence
    )
    assert driven("kinematic").sentence == "The robot reached the goal within the tolerance."


def test_the_dynamic_motion_turns_the_tracks_itself() -> None:
    """The log's wheel speeds are those of motors that the ground resists, not of free ones."""
    log = driven("dynamic").log
    mission = goal(0.5, 0.0, vehicle={"motion": "dynamic", "speed_scale": 1.0})
    robot, _ = as_robot(motor(), mission)
    state, scene = VehicleState(), mission.scene()
    for k in range(10):
        drive = log["pwm_l"][k] / 20_000, log["pwm_r"][k] / 20_000
        state = step(state, drive, 0.1, scene.car, motors_of(robot), scene.floor, floats)
        assert state.omega == pytest.approx((log["omega_l"][k + 1], log["omega_r"][k + 1]))
        assert state.x == pytest.approx(log["x"][k + 1])
    assert {"v_y", "thrust_l", "thrust_r"} <= log.keys()


def test_motors_that_nothing_holds_turn_as_the_model_says() -> None:
    """On ground without friction the same drive gives the free run of the dc-motor."""
    plant = motor(options={"integrator": "exact"})
    robot, _ = as_robot(plant, goal(1, 0, vehicle={"speed_scale": 1.0}))
    ice = Floor(Soil(0.0, 0.0, 0.01, rolling=0.0, lateral=0.0))
    state, free = VehicleState(), robot.initial_state()
    for _ in range(8):
        free, _ = robot.step(free, np.array([14_000.0, -9_000.0]))
        state = step(state, (0.7, -0.45), 0.1, TrackedVehicle(), motors_of(robot), ice, floats)
    assert state.omega == pytest.approx(tuple(free.ravel()), rel=3e-3)


@pytest.mark.parametrize(
    ("plant", "lifted", "words"),
    [
        (Robot(), None, "the plant has speeds only"),
        (motor(options={"parameters": "lumped"}), None, "the plant has speeds only"),
        (motor(2), None, "a log driven on the ground, which already contains"),
        (motor(2, LUMPED, coupling=-0.4), None, "a log driven on the ground"),
        (motor(), False, "a log driven on the ground"),
    ],
)
def test_motors_that_nobody_knows_alone_are_refused(plant, lifted, words: str) -> None:
    mission = goal(1, 0, vehicle={"motion": "dynamic", "lifted": lifted, "speed_scale": 1.0})
    with pytest.raises(ModelError, match=words):
        as_robot(plant, mission)


def test_lifted_tracks_are_taken_with_a_sentence_or_by_word() -> None:
    silent, shown = (
        goal(1, 0, vehicle={"motion": "dynamic", "speed_scale": 1.0, "lifted": word})
        for word in (None, True)
    )
    for plant in (motor(), motor(2, mass=0.0, yaw_inertia=0.0), motor(2, LUMPED)):
        assert any("tracks lifted" in s for s in as_robot(plant, silent)[1])
    said = as_robot(motor(2, LUMPED, coupling=-0.4), shown)[1]
    assert not any("tracks lifted" in s for s in said)
    assert any("the mass 1.592 kg" in s and "the floor is concrete" in s for s in said)


def test_constants_of_the_bench_and_lumped_ones_are_one_motor() -> None:
    mission = goal(1, 0, vehicle={"speed_scale": 1.0})
    one = motors_of(as_robot(motor(), mission)[0])[0]
    gain = one.torque / one.damping / 7.5
    lumped = motor(
        options={"parameters": "lumped", "torque_constant": str(one.torque / 7.5)},
        gain=gain,
        time_constant=one.inertia / one.damping,
        coulomb=one.friction / one.torque * 7.5,
    )
    other = motors_of(as_robot(lumped, mission)[0])[0]
    assert other[:4] == pytest.approx(one[:4], rel=1e-12)
    weaker = motor(options={"friction": "full"}, limit=3.0)
    limited = motors_of(as_robot(weaker, mission)[0])[0]
    assert limited.limit == pytest.approx(0.4)  # 3 V of 7.5 V


FILE = "goal: [1, 0]\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "vehicle:\n  motion: flying\n",
            "m.yaml:3: vehicle.motion is the text 'flying': the kinds",
        ),
        (
            "motion: {kind: slip}\nvehicle:\n  motion: dynamic\n",
            "m.yaml:4: the vehicle's motion is dynamic, but motion.kind is slip: keep one",
        ),
        (
            "motion: {kind: dynamic, mass: 2}\nvehicle:\n  r: 0.02\n  mass: 3\n",
            "m.yaml:5: mass of the vehicle is not that of motion: keep one",
        ),
        ("vehicle:\n  soil: dry-sant\n", "m.yaml:3: "),
        ("vehicle:\n  mass: -1\n", "m.yaml:3: vehicle.mass is -1: give a number above 0"),
        ("vehicle:\n  centre: 0.2\n", "m.yaml:2: the centre of mass lies 0.2 m"),
        (
            "vehicle:\n  patches: [{soil: snow}]\n",
            "m.yaml:3: a patch has soil: write soil, and one",
        ),
        ("vehicle:\n  slope: [10, 0]\n", "m.yaml:3: vehicle.slope"),
        ("motion:\n  kind: slip\n  slip: 20\n", "m.yaml:4: motion.slip is 20: write a share"),
        (
            "motion: {kind: slip, slip: 0.1, soil: snow}\n",
            "m.yaml:2: motion of kind slip has both slip shares",
        ),
        ("motion: {kind: dynamic, weight: 2}\n", "m.yaml:2: unknown key 'weight' in motion"),
    ],
)
def test_what_makes_no_vehicle_is_refused_with_its_line(
    tmp_path: Path, text: str, sentence: str
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(FILE + text)
    with pytest.raises(DataError) as refused:
        load_mission(path)
    assert sentence in str(refused.value)


def test_a_mission_file_says_vehicle_and_floor_in_either_section(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(
        FILE
        + "vehicle:\n  motion: dynamic\n  mass: 2\n  L: 0.2\n  soil: {preset: snow, rolling: 0.1}\n"
        "motion: {yaw_inertia: 0.05, slope: [0.1, 0], patches: [{soil: clay, circle: [1, 2, 0.5]},"
        " {soil: carpet, polygon: [[0, 0], [1, 0], [0, 1]]}, {soil: loam, half_plane: [[0, 0], "
        "[1, 1]]}]}\n"
    )
    scene = load_mission(path).scene()
    assert scene.car == TrackedVehicle(mass=2.0, contact_length=0.2, yaw_inertia=0.05)
    assert scene.floor.soil.rolling == 0.1
    assert scene.floor.slope == (0.1, 0.0)
    assert [type(p.area) for p in scene.floor.patches] == [Circle, Polygon, HalfPlane]


def test_slip_by_shares_loses_what_they_say() -> None:
    inputs = MotionInputs(0.1, 10.0, 20.0, goal(1, 0).scene())
    body = Slip(slip=(0.1, 0.2)).step(Body(Pose(0.0, 0.0, 0.0), 0.0, 0.0), inputs, 0.1, floats)[1]
    assert body.speed == pytest.approx(0.0215 / 2.0 * (9.0 + 16.0))
    spot = MotionInputs(0.1, -10.0, 10.0, inputs.scene)
    turned = Slip(turning=0.3).step(Body(Pose(0.0, 0.0, 0.0), 0.0, 0.0), spot, 0.1, floats)[1]
    assert turned.yaw_rate == pytest.approx(0.7 * 0.0215 / 0.186 * 20.0)


def test_an_accelerometer_feels_what_slides_sideways() -> None:
    """(2.9): a_x = V̇_x − V_yψ̇, a_y = V̇_y + V_xψ̇."""
    sensor = Accelerometer(noise=(0.0,), bias_std=(0.0,), bias_walk=(0.0,), saturation=None)
    sensor = sensor.model_copy(update={"resolution": (0.0,)})
    scene = goal(1, 0).scene()
    state = sensor.start(scene, floats)
    for t, body in (
        (0.0, Body(Pose(0.0, 0.0, 0.0), 0.2, 1.0, 0.1)),
        (0.1, Body(Pose(0.0, 0.0, 0.0), 0.3, 2.0, 0.15)),
    ):
        seen = SensorInputs(t, body, 0.0, 0.0, (0.0,) * sensor.draws, scene)
        state, read = sensor.step(state, seen, 0.1 if t else 0.0, floats)
    assert read == pytest.approx((1.0 - 0.3, 0.5 + 0.6))


def test_controllers_know_the_motors_on_their_ground() -> None:
    """Gain and limits are measured with the ground's resistance."""
    mission = goal(0.5, 0, limits="plant", vehicle={"motion": "dynamic", "speed_scale": 1.0})
    robot, _ = as_robot(motor(), mission)
    scene = scene_of(mission, robot)
    resisted = 0.0215 * scene.floor.soil.rolling * scene.car.weight / 2.0
    free = motors_of(robot)[0]
    top = 0.0215 * (free.torque - free.friction - resisted) / free.damping
    assert scene.limits.speed == pytest.approx(top, rel=1e-3)
    assert on_ground(robot, scene).outputs == robot.outputs


def test_runs_side_by_side_are_the_runs_one_after_the_other() -> None:
    """Mass and soils of each run included; the slip of the motion stands for friction.slip."""
    patches = [{"soil": "carpet", "circle": [0.2, 0.0, 0.1]}]
    mission = goal(
        0.35,
        0.1,
        vehicle={"motion": "dynamic", "soil": "dry-sand", "patches": patches, "lifted": True},
        timeout=4.0,
    )
    setup = Setup.of(mission, [motor()])
    seeds = run_seeds(5, 3)
    figures = runner_of((setup, True))(chunks(setup, seeds, 4)[0]).figures
    agreed = agreement(setup, seeds, figures)
    assert agreed.apart == ()
    assert agreed.largest <= TOLERANCE
    assert len(set(figures.x.tolist())) == 3
    names = {name for name, _ in setup.plant_variants[0].sampler.varying}
    assert {"mass", "soil.rolling", "soil.friction_angle", "soil[2].lateral"} <= names
    assert "friction.slip" not in names


@pytest.mark.parametrize(
    ("vary", "there"),
    [
        ({"soil": False}, {"mass"}),
        ({"mass": False, "soil": 2.0}, {"soil"}),
        ({"mass": 0.1}, {"mass", "soil"}),
    ],
)
def test_mass_and_soil_vary_as_the_mission_says(vary, there: set[str]) -> None:
    mission = goal(1, 0, vehicle={"motion": "slip", "mass": 2.0}, vary=vary)
    setup = Setup.of(mission, [motor()])
    assert {"mass", "soil"} & set(setup.varied) == there
    seeds = run_seeds(1, 400)
    sampler = setup.plant_variants[0].sampler
    samples = sampler.draw(seeds)
    runs = (Numbers(*(v[k].tolist() for v in samples.numbers)) for k in range(len(seeds)))
    scenes = [sampler.varied(run).scene() for run in runs]
    spread = float(np.std([s.car.mass for s in scenes]))  # 400 draws tell it to ± 4 %
    assert spread == pytest.approx(2.0 * (vary.get("mass", 0.02) or 0.0), rel=0.15)
    soil = mission.scene().floor.soil
    expected = dict(soil.std)["lateral"] * (vary.get("soil", 1.0) or 0.0)
    result = float(np.std([s.floor.soil.lateral for s in scenes]))
    assert result == pytest.approx(expected, rel=0.15)
    varied = setup.alone(seeds[0])[0].scene()
    assert (varied.car, varied.floor) == (scenes[0].car, scenes[0].floor)


def test_speeds_of_the_motors_are_not_scaled() -> None:
    twice = goal(1, 0, vehicle={"motion": "dynamic", "speed_scale": 2.0})
    with pytest.raises(ModelError, match=r"vehicle\.speed_scale is 2"):
        as_robot(motor(), twice)
    notes = as_robot(motor(), goal(1, 0, vehicle={"motion": "dynamic"}))[1]
    assert not any("which is taken as" in n and "m/s" in n for n in notes)
