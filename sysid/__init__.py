"""sysid: from a robot's log to a plant you can trust.

Everything a script needs is here, imported when it is first used (PEP 562):

    import sysid

    model = sysid.fit("log.csv", "oe", orders="nb=2 nf=2 nk=1")
    print(model.summary())
    model.plot.bode("val.csv")
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from sysid.version import __version__

_NAMES = {
    "sysid.data.io": ("read_log", "read_logs"),
    "sysid.data.reading.read_options": ("ReadOptions",),
    "sysid.data.record": ("Channel", "Record"),
    "sysid.errors": ("DataError", "ModelError", "SysidError", "UsageError"),
    "sysid.estimation.online.live_fit": ("LiveFit",),
    "sysid.estimation.response_fit": ("fit_response",),
    "sysid.export.package": ("write_package",),
    "sysid.fitting.options": ("FitOptions",),
    "sysid.fitting.problem": ("Focus",),
    "sysid.interface": (
        *("compare", "diagnose", "fit", "fit_vehicle", "forecast"),
        *("frequency_response", "from_dataframe", "identify", "inspect", "load_model", "localize"),
        *("look", "plan"),
        *("simulate", "simulate_runs", "step_response", "structure", "tune"),
    ),
    "sysid.plant.package": ("load_plant",),
    "sysid.robot.mission.spec": ("Mission", "load_mission"),
    "sysid.structures.model": ("Model",),
    "sysid.structures.plant": ("Plant",),
    "sysid.testbench.motor.characterise": ("MotorOptions", "characterise_motor"),
    "sysid.testbench.pendulum.inertia": ("Hanging",),
    "sysid.testbench.pendulum.study": ("inertia_of_logs", "inertia_of_period"),
    "sysid.testbench.power.study": ("bench_power",),
    "sysid.vehicle.wheels.description": ("load_vehicle",),
    "sysid.vehicle.wheels.vehicle": ("Vehicle",),
    "sysid.vehicle.wheels.wheel": ("Wheel",),
}
_PLACES = {name: module for module, names in _NAMES.items() for name in names}
"""Name → the module that holds it."""

if TYPE_CHECKING:
    from sysid.data.io import read_log as read_log
    from sysid.data.io import read_logs as read_logs
    from sysid.data.reading.read_options import ReadOptions as ReadOptions
    from sysid.data.record import Channel as Channel
    from sysid.data.record import Record as Record
    from sysid.errors import DataError as DataError
    from sysid.errors import ModelError as ModelError
    from sysid.errors import SysidError as SysidError
    from sysid.errors import UsageError as UsageError
    from sysid.estimation.online.live_fit import LiveFit as LiveFit
    from sysid.estimation.response_fit import fit_response as fit_response
    from sysid.export.package import write_package as write_package
    from sysid.fitting.options import FitOptions as FitOptions
    from sysid.fitting.problem import Focus as Focus
    from sysid.interface import compare as compare
    from sysid.interface import diagnose as diagnose
    from sysid.interface import fit as fit
    from sysid.interface import fit_vehicle as fit_vehicle
    from sysid.interface import forecast as forecast
    from sysid.interface import frequency_response as frequency_response
    from sysid.interface import from_dataframe as from_dataframe
    from sysid.interface import identify as identify
    from sysid.interface import inspect as inspect
    from sysid.interface import load_model as load_model
    from sysid.interface import localize as localize
    from sysid.interface import look as look
    from sysid.interface import plan as plan
    from sysid.interface import simulate as simulate
    from sysid.interface import simulate_runs as simulate_runs
    from sysid.interface import step_response as step_response
    from sysid.interface import structure as structure
    from sysid.interface import tune as tune
    from sysid.plant.package import load_plant as load_plant
    from sysid.robot.mission.spec import Mission as Mission
    from sysid.robot.mission.spec import load_mission as load_mission
    from sysid.structures.model import Model as Model
    from sysid.structures.plant import Plant as Plant
    from sysid.testbench.motor.characterise import MotorOptions as MotorOptions
    from sysid.testbench.motor.characterise import characterise_motor as characterise_motor
    from sysid.testbench.pendulum.inertia import Hanging as Hanging
    from sysid.testbench.pendulum.study import inertia_of_logs as inertia_of_logs
    from sysid.testbench.pendulum.study import inertia_of_period as inertia_of_period
    from sysid.testbench.power.study import bench_power as bench_power
    from sysid.vehicle.wheels.description import load_vehicle as load_vehicle
    from sysid.vehicle.wheels.vehicle import Vehicle as Vehicle
    from sysid.vehicle.wheels.wheel import Wheel as Wheel

__all__ = ["__version__", *sorted(_PLACES)]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'sysid' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return __all__
