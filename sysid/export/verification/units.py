"""A unit of FMI through the inputs of a self-test, in a process of its own.

Run as ``python -m sysid.export.verification.units TOOL UNIT INPUTS OUTPUTS``: both are CSV files
without a header, the second is written. What runs is native code of a package,
which must not take this process with it.
"""

import csv
import shutil
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np

from sysid.data.record import Array

Run = Callable[[Path, Array], Array]


def by_fmpy(unit: Path, u: Array) -> Array:
    """Outputs (N, ny) at the instants of the inputs (N, nu), by FMPy."""
    fmpy = import_module("fmpy")
    fmi2 = import_module("fmpy.fmi2")
    about = fmpy.read_model_description(str(unit))
    folder = fmpy.extract(str(unit))
    try:
        slave = fmi2.FMU2Slave(
            guid=about.guid,
            unzipDirectory=folder,
            modelIdentifier=about.coSimulation.modelIdentifier,
            instanceName="verified",
        )
        inputs, outputs = (
            [v.valueReference for v in about.modelVariables if v.causality == kind]
            for kind in ("input", "output")
        )
        dt = float(about.defaultExperiment.stepSize)
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        y = np.zeros((len(u), len(outputs)))
        for k, row in enumerate(u):
            slave.setReal(inputs, row.tolist())
            y[k] = slave.getReal(outputs)
            slave.doStep(currentCommunicationPoint=k * dt, communicationStepSize=dt)
        slave.terminate()
        slave.freeInstance()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return y


def by_libcosim(unit: Path, u: Array) -> Array:
    """Outputs (N, ny) one sample after each input, which is still held, by libcosim."""
    execution_class = import_module("libcosimpy.CosimExecution").CosimExecution
    slave_class = import_module("libcosimpy.CosimSlave").CosimLocalSlave
    manipulator = import_module("libcosimpy.CosimManipulator").CosimManipulator.create_override()
    observer = import_module("libcosimpy.CosimObserver").CosimObserver.create_last_value()
    about = import_module("fmpy").read_model_description(str(unit))
    inputs, outputs = (
        [v.valueReference for v in about.modelVariables if v.causality == kind]
        for kind in ("input", "output")
    )
    step = round(1e9 * float(about.defaultExperiment.stepSize))
    execution = execution_class.from_step_size(step_size=step)
    index = execution.add_local_slave(slave_class(fmu_path=str(unit), instance_name="verified"))
    execution.add_manipulator(manipulator=manipulator)
    execution.add_observer(observer=observer)
    y = np.zeros((len(u), len(outputs)))
    for k, row in enumerate(u):
        manipulator.slave_real_values(
            slave_index=index, variable_references=inputs, values=row.tolist()
        )
        execution.step()
        y[k] = observer.last_real_values(slave_index=index, variable_references=outputs)
    return y


TOOLS: dict[str, Run] = {"FMPy": by_fmpy, "libcosimpy": by_libcosim}


def main(tool: str, unit: str, inputs: str, outputs: str) -> None:
    """Write the outputs."""
    with open(inputs, newline="", encoding="utf-8") as rows:
        u = np.array([[float(v) for v in row] for row in csv.reader(rows)])
    with tempfile.TemporaryDirectory(prefix="sysid-unit-") as folder:
        copy = Path(folder) / "plant.fmu"
        shutil.copyfile(unit, copy)
        y = TOOLS[tool](copy, u)
    with open(outputs, "w", newline="", encoding="utf-8") as rows:
        csv.writer(rows).writerows([[repr(float(v)) for v in row] for row in y])


if __name__ == "__main__":
    main(*sys.argv[1:])
