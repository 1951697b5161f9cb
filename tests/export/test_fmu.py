"""The plant as a unit of FMI, by tools that are not ours."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_programs import needs_compiler
from plant_models import bench_model, robot_model

from sysid.data.record import Channel, Record
from sysid.errors import ModelError
from sysid.estimation.pem import fit
from sysid.export.fmu import archive
from sysid.export.package import package_files, write_package
from sysid.export.verification.co_simulated import UNIT, CoSimulated, replays_of
from sysid.plant.package import files_of, load_plant
from sysid.plant.selftest import NAME, read_csv
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

fmpy = pytest.mark.skipif(find_spec("fmpy") is None, reason="the extra fmu is not installed")
libcosim = pytest.mark.skipif(find_spec("libcosimpy") is None, reason="libcosimpy is not installed")


def exported(folder: Path, model: Model) -> Path:
    return write_package(model, folder / "plant", formats=["fmu"])


def slave_of(unit: Path, folder: Path, said: list[str] | None = None) -> Any:
    """An initialised unit, and what it logs."""
    import fmpy as tool
    from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

    heard = [] if said is None else said
    about = tool.read_model_description(str(unit))
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(
        lambda environment, name, status, category, message: heard.append(message.decode())
    )
    callbacks.allocateMemory = defaultCallbacks.allocateMemory
    callbacks.freeMemory = defaultCallbacks.freeMemory
    slave = FMU2Slave(
        guid=about.guid,
        unzipDirectory=tool.extract(str(unit), unzipdir=str(folder / "unit")),
        modelIdentifier=about.coSimulation.modelIdentifier,
        instanceName="tested",
    )
    slave.instantiate(callbacks=callbacks)
    slave.setupExperiment(startTime=0.0)
    return slave


@fmpy
@needs_compiler
def test_fmpy_has_nothing_to_say_about_the_unit(tmp_path: Path) -> None:
    from fmpy import read_model_description
    from fmpy.validation import validate_fmu

    unit = exported(tmp_path, robot_model()) / UNIT
    assert validate_fmu(str(unit)) == []
    by_name = {v.name: v for v in read_model_description(str(unit)).modelVariables}
    assert by_name["pwm_l"].causality == "input"
    assert (by_name["omega_r"].causality, by_name["omega_r"].unit) == ("output", "rad/s")


@fmpy
@libcosim
@needs_compiler
@pytest.mark.parametrize("late", [False, True], ids=["FMPy", "libcosim"])
def test_a_plant_whose_output_jumps_with_its_input_gives_what_python_gives(
    tmp_path: Path, late: bool
) -> None:
    package = exported(tmp_path, bench_model("arx", nk=0))
    files, plant = files_of(package), load_plant(package)
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    replays = replays_of(files, plant, read_csv(files[NAME], plant, "plant"))
    replay_result = CoSimulated("libcosimpy" if late else "FMPy", replays, late).replay(
        tmp_path, files
    )
    assert replay_result.failed == ""
    assert replay_result.max_error is not None
    assert replay_result.max_error < 1e-9


@fmpy
@needs_compiler
def test_a_step_between_two_samples_is_refused_and_a_longer_one_is_several(tmp_path: Path) -> None:
    from fmpy.fmi1 import FMICallException

    model, said = robot_model(), list[str]()
    unit = exported(tmp_path, model) / UNIT
    slave = slave_of(unit, tmp_path, said)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.setReal([0, 1], [8000.0, -4000.0])
    with pytest.raises(FMICallException):
        slave.doStep(currentCommunicationPoint=0.0, communicationStepSize=1.5 * model.dt)
    assert "no multiple of the sample time 0.1 s" in said[-1]
    slave.doStep(currentCommunicationPoint=0.0, communicationStepSize=3 * model.dt)
    plant = model.plant()
    state, u = plant.initial_state(), np.array([8000.0, -4000.0])
    for _ in range(3):
        state, _ = plant.step(state, u)
    assert slave.getReal([2, 3]) == pytest.approx(plant.readout(state, u).tolist(), rel=1e-12)
    with pytest.raises(FMICallException):
        slave.setReal([0], [float("nan")])
    assert "not finite" in said[-1]
    slave.freeInstance()


@fmpy
@needs_compiler
def test_states_begin_where_the_parameters_say(tmp_path: Path) -> None:
    model = robot_model()
    slave = slave_of(exported(tmp_path, model) / UNIT, tmp_path)
    plant = model.plant()
    state = plant.initial_state() + np.arange(1.0, len(plant.initial_state()) + 1)
    places = [4 + k for k in range(len(state))]
    slave.setReal(places, (state - plant.initial_state()).tolist())
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    expected = plant.readout(state, np.zeros(2)).tolist()
    assert slave.getReal([2, 3]) == pytest.approx(expected, rel=1e-12)
    slave.freeInstance()


def strange_model() -> Model:
    """Three inputs, two outputs, names that no program takes, twice the same, an irrational Ts."""
    rng = np.random.default_rng(1)
    u = rng.normal(size=(300, 3)).repeat(2, axis=0)
    y = np.zeros((600, 2))
    for t in range(1, 600):
        y[t] = 0.5 * y[t - 1] + u[t - 1] @ np.array([[1.0, 2.0], [0.0, 1.0], [0.3, 0.1]])
    y += 0.01 * rng.normal(size=y.shape)
    inputs = (Channel('drive "left" <%>\n&', "V"), Channel("12 ärger*/"), Channel("drive"))
    record = Record(u, y, np.sqrt(2.0) / 30.0, inputs, (Channel("drive"), Channel("temp", "°C")))
    return fit(structure_class("arx").from_orders({"na": 1, "nb": 1, "nk": 1}, 3, 2), [record])


@fmpy
@needs_compiler
@pytest.mark.parametrize("format_name", ["fmu", "fmu3"])
def test_channels_may_be_called_as_people_call_them(tmp_path: Path, format_name: str) -> None:
    from fmpy import read_model_description, simulate_fmu
    from fmpy.validation import validate_fmu

    model = strange_model()
    write_package(model, tmp_path / "plant", formats=[format_name])
    unit = str(tmp_path / "plant" / format_name / "plant.fmu")
    assert validate_fmu(unit) == []
    names = [v.name for v in read_model_description(unit).modelVariables[:5]]
    assert names == ['drive "left" <%> &', "12 ärger*/", "drive", "drive_2", "temp"]
    rows = simulate_fmu(
        unit,
        stop_time=20 * model.dt,
        step_size=model.dt,
        output_interval=model.dt,
        start_values={"drive": 2.0},
    )
    state, u = model.plant().initial_state(), np.array([0.0, 0.0, 2.0])
    for row in rows:
        state, y = model.plant().step(state, u)
        assert [row["drive_2"], row["temp"]] == pytest.approx(y.tolist(), rel=1e-12)


@fmpy
@needs_compiler
def test_a_plant_that_never_settles_says_so(tmp_path: Path) -> None:
    from fmpy.fmi1 import FMICallException

    said: list[str] = []
    model = integrator()
    slave = slave_of(exported(tmp_path, model) / UNIT, tmp_path, said)
    slave.setReal([0], [1.0])
    slave.setBoolean([3], [True])
    slave.enterInitializationMode()
    with pytest.raises(FMICallException):
        slave.exitInitializationMode()
    assert "does not settle" in said[-1]
    slave.freeInstance()


def integrator() -> Model:
    """An angle, driven by its speed."""
    u = np.random.default_rng(2).normal(size=(100, 1)).repeat(3, axis=0)
    y = np.vstack([[[0.0]], 0.1 * np.cumsum(u, axis=0)[:-1]])
    record = Record(u, y + 0.001 * u[::-1], 0.05, (Channel("u", "V"),), (Channel("angle", "rad"),))
    model = fit(structure_class("oe").from_orders({"nb": 1, "nf": 1, "nk": 1}, 1, 1), [record])
    return replace(model, theta=np.array([0.1, -1.0]))  # exactly one, which no fit gives


@fmpy
@needs_compiler
def test_the_same_plant_gives_the_same_unit() -> None:
    one, other = (package_files(robot_model(), formats=["fmu"])[UNIT] for _ in range(2))
    assert one == other


def test_without_fmpy_one_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "find_spec", lambda name: None)
    with pytest.raises(ModelError, match=r"pip install 'sysid-workbench\[fmu\]'"):
        package_files(robot_model(), formats=["fmu"])
