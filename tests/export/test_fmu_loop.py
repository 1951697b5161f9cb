"""Plant, controller and vehicle as units: each by itself, and together in a mission."""

import io
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_programs import needs_compiler
from plant_models import bench_model, robot_model

import sysid
from sysid.errors import ModelError
from sysid.export.fmu import archive
from sysid.export.fmu.loop_units import wiring_of
from sysid.export.package import Form, package_files, write_package
from sysid.export.verification.co_simulated import FOLDERS
from sysid.export.verification.verify import verify
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.structures.model import Model

pytestmark = [
    pytest.mark.skipif(find_spec("fmpy") is None, reason="the extra fmu is not installed"),
    needs_compiler,
]
libcosim = pytest.mark.skipif(find_spec("libcosimpy") is None, reason="libcosimpy is not installed")

MISSION = Path(sysid.__file__).parents[1] / "datasets" / "missions" / "goal_1m.yaml"
STEP = 0.1
"""Sample time of plant and controller [s]."""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first mission's units of both versions."""
    folder = tmp_path_factory.mktemp("units")
    return write_package(
        robot_model(), folder / "plant", formats=FOLDERS, form=Form(load_mission(MISSION))
    )


def robot_of(model: Model) -> RobotPlant:
    """A model wired for the first mission."""
    robot, _ = as_robot(model.plant(), load_mission(MISSION))
    return robot


def places(unit: Path) -> Mapping[str, int]:
    """Value references by name."""
    from fmpy import read_model_description

    return {v.name: v.valueReference for v in read_model_description(str(unit)).modelVariables}


@pytest.mark.slow
def test_nothing_is_wrong_with_the_units_and_every_tool_gives_what_python_gave(
    package: Path,
) -> None:
    from fmpy.validation import validate_fmu

    units = sorted(package.glob("fmu*/*.fmu"))
    assert [u.name for u in units] == ["controller.fmu", "plant.fmu", "vehicle.fmu"] * 2
    for unit in units:
        assert validate_fmu(str(unit)) == [], unit
    by_name = {r.name: r for r in verify(package).results}
    for name in ("FMPy", "libcosimpy") if find_spec("libcosimpy") else ("FMPy",):
        error = by_name[name].max_error
        assert by_name[name].failed == ""
        assert error is not None
        assert error < 1e-12, name  # the same operations in the same order


def test_a_plant_of_one_motor_is_plugged_in_twice_in_its_own_units(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import fmpy
    from lxml import etree

    monkeypatch.setattr(archive.shutil, "which", lambda name: None)  # sources alone
    form = Form(load_mission(MISSION))
    files = package_files(bench_model("oe"), formats=["fmu"], form=form)
    tree = etree.fromstring(files["fmu/SystemStructure.ssd"])
    schema = Path(fmpy.__file__).parent / "ssp" / "schema" / "SystemStructureDescription.xsd"
    etree.XMLSchema(etree.parse(schema)).assertValid(tree)
    wires = {
        f"{c.get('startElement')}.{c.get('startConnector')} "
        f"{c.get('endElement')}.{c.get('endConnector')}"
        for c in tree.iter("{*}Connection")
    }
    assert wires == {
        f"{a} {b}"
        for side in "lr"
        for a, b in (
            (f"controller.u_{side}", f"plant_{side}.u"),
            (f"plant_{side}.y", f"controller.y_{side}"),
            (f"plant_{side}.y", f"vehicle.y_{side}"),
        )
    }
    with zipfile.ZipFile(io.BytesIO(files["fmu/controller.fmu"])) as unit:
        assert not [n for n in unit.namelist() if n.startswith("binaries")]
        code = unit.read("sources/fmu_model.h").decode()
    wiring = wiring_of(robot_of(bench_model("oe")))
    assert "read.omega_l = " + wiring.speeds[0].speed("r[0]") in code


def test_a_plant_that_rests_elsewhere_at_zero_drive_starts_there() -> None:
    robot = robot_of(robot_model())
    assert wiring_of(robot).starts == ()
    elsewhere = replace(robot, rest=robot.rest + 0.5, centre=robot.centre + np.array([0.0, 7.0]))
    states = [("plant", f"start_{k}", 0.5) for k in range(len(robot.rest))]
    assert list(wiring_of(elsewhere).starts) == [("plant", "pwm_r", 7.0), *states]


@libcosim
def test_units_plugged_together_drive_the_mission_as_simulate_does(package: Path) -> None:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    execution = CosimExecution.from_ssp_file(str(package / "fmu"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    index = {i.name.decode(): i.index for i in execution.slave_infos()}
    known = {name: places(package / "fmu" / f"{name}.fmu") for name in index}
    arrived = [known["controller"]["arrived"]]
    while not observer.last_boolean_values(index["controller"], arrived)[0]:
        execution.step()
        assert execution.status().current_time < 10e9
    pose = observer.last_real_values(index["vehicle"], [known["vehicle"][n] for n in "xy"])
    mission = load_mission(MISSION)
    driven = simulate(mission, robot_of(robot_model()))
    # a connection delays by a step, which is what the robot moves on in
    assert execution.status().current_time * 1e-9 == pytest.approx(driven.time_s, abs=0.2)
    assert np.hypot(pose[0] - driven.final.x, pose[1] - driven.final.y) < 0.02


class Instance:
    """A unit of FMI 2.0 that runs, by names."""

    def __init__(self, unit: Path, folder: Path, **starts: float) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave

        about = fmpy.read_model_description(str(unit))
        self.places = places(unit)
        self.slave: Any = FMU2Slave(
            guid=about.guid,
            unzipDirectory=fmpy.extract(str(unit), unzipdir=str(folder)),
            modelIdentifier=about.coSimulation.modelIdentifier,
            instanceName=unit.stem,
        )
        self.slave.instantiate()
        self.slave.setupExperiment(startTime=0.0)
        for name, value in starts.items():
            boolean = isinstance(value, bool)
            put = self.slave.setBoolean if boolean else self.slave.setReal
            put([self.places[name.replace("__", ".")]], [value])
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def put(self, **values: float) -> None:
        self.slave.setReal([self.places[n] for n in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        collected: list[float] = self.slave.getReal([self.places[n] for n in names])
        return collected

    def step(self, k: int) -> None:
        self.slave.doStep(currentCommunicationPoint=k * STEP, communicationStepSize=STEP)


def end_of(package: Path, folder: Path, mission: Mission, **starts: float) -> list[float]:
    """Where a master that asks for outputs before it steps ends, without any delay."""
    controller = Instance(package / "fmu" / "controller.fmu", folder / "controller", **starts)
    plant = Instance(package / "fmu" / "plant.fmu", folder / "plant")
    vehicle = Instance(package / "fmu" / "vehicle.fmu", folder / "vehicle")
    given = bool(starts.get("pose_from_inputs", False))
    for k in range(int(mission.timeout / STEP)):
        wheels = dict(zip(("omega_l", "omega_r"), plant.get("omega_l", "omega_r"), strict=True))
        vehicle.put(**wheels)
        pose = ("x", "y", "psi", "speed", "yaw_rate")
        controller.put(**dict(zip(pose, vehicle.get(*pose), strict=True)) if given else wheels)
        plant.put(**dict(zip(("pwm_l", "pwm_r"), controller.get("pwm_l", "pwm_r"), strict=True)))
        if controller.slave.getBoolean([controller.places["arrived"]])[0]:
            break
        for unit in (controller, plant, vehicle):
            unit.step(k)
    return [k * STEP, *vehicle.get("x", "y", "psi")]


@pytest.mark.parametrize("given", [False, True], ids=["wheel-speeds", "pose"])
def test_without_a_delay_the_units_end_where_simulate_ends(
    package: Path, tmp_path: Path, given: bool
) -> None:
    mission = load_mission(MISSION)
    driven = simulate(mission, robot_of(robot_model()))
    expected = [driven.time_s, *driven.final]
    end = end_of(package, tmp_path, mission, pose_from_inputs=given)
    assert end == pytest.approx(expected, abs=1e-9)


def test_another_goal_needs_no_other_export(package: Path, tmp_path: Path) -> None:
    mission = load_mission(MISSION).model_copy(update={"goal": (0.6, 0.4)})
    driven = simulate(mission, robot_of(robot_model()))
    end = end_of(package, tmp_path, mission, goal_x=0.6, goal_y=0.4)
    assert end == pytest.approx([driven.time_s, *driven.final], abs=1e-9)


def test_what_stands_between_controller_and_plant_is_refused(tmp_path: Path) -> None:
    text = "goal: [1, 0]\nvehicle: {supply: {sag: 0.1}}\n"
    (tmp_path / "mission.yaml").write_text(text, encoding="utf-8")
    form = Form(load_mission(tmp_path / "mission.yaml"))
    with pytest.raises(ModelError, match=r"vehicle\.supply"):
        package_files(robot_model(), formats=["fmu"], form=form)


def test_rows_that_are_damaged_or_gone_are_refused(package: Path, tmp_path: Path) -> None:
    from sysid.export.fmu.replay import replay_from

    whole = (package / "fmu" / "controller.csv").read_text(encoding="utf-8")
    rows = replay_from(whole, "controller.csv")
    assert rows.outputs[:2] == ("pwm_l", "pwm_r")
    for text in ("", whole.replace("now:", "later:", 1), whole[: len(whole) // 2], "in:a\n1\n"):
        with pytest.raises(ModelError, match=r"controller.csv is damaged"):
            replay_from(text, "controller.csv")
