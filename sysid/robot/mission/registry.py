"""The laws a mission can name by ``kind:``: the built-in ones and those of other packages."""

from collections.abc import Mapping
from functools import partial
from importlib import import_module
from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError, ValidationError

from sysid.data.yaml_files import problems
from sysid.data.yaml_files.problems import sentence_at
from sysid.data.yaml_files.source import Place, YamlSource, shown
from sysid.errors import UsageError
from sysid.extensions import loaded, points, unusable
from sysid.robot.mission.axis import AxisLaw
from sysid.robot.mission.contracts import Controller, Guidance, Motion, Navigation, Sensor
from sysid.robot.mission.loop import COLUMNS

GROUP = "sysid.mission"
"""Other packages name their laws in this entry-point group, as ``guidance.my-kind``."""

ROLES: Mapping[str, type] = {
    "guidance": Guidance,
    "control": Controller,
    "control.speed": AxisLaw,
    "control.yaw": AxisLaw,
    "navigation": Navigation,
    "motion": Motion,
    "sensors": Sensor,
}
"""Sections of a mission file that choose a law, and what a law must be able to do there."""

BUILT_IN = {
    "guidance.field": "guidance.field:PotentialField",
    "guidance.pure-pursuit": "guidance.pure_pursuit:PurePursuit",
    "guidance.harmonic": "guidance.harmonic:Harmonic",
    "guidance.steps": "guidance.steps:Steps",
    "control.pi-p": "control.pi_p:SpeedPIYawP",
    "control.speed.pi": "control.linear:PI",
    "control.speed.p": "control.linear:P",
    "control.speed.pd": "control.linear:PD",
    "control.speed.pid": "control.linear:PID",
    "control.speed.sliding-mode": "control.model_based:SlidingMode",
    "control.speed.computed-torque": "control.model_based:ComputedTorque",
    "control.speed.adaptive": "control.adaptive:Adaptive",
    "control.speed.fuzzy": "control.fuzzy:Fuzzy",
    "control.speed.neural": "control.neural:Neural",
    "control.yaw.p": "control.linear:YawP",
    "control.yaw.pi": "control.linear:YawPI",
    "control.yaw.pd": "control.linear:YawPD",
    "control.yaw.pid": "control.linear:YawPID",
    "control.yaw.sliding-mode": "control.model_based:YawSlidingMode",
    "control.yaw.computed-torque": "control.model_based:YawComputedTorque",
    "control.yaw.adaptive": "control.adaptive:YawAdaptive",
    "control.yaw.fuzzy": "control.fuzzy:YawFuzzy",
    "control.yaw.neural": "control.neural:YawNeural",
    "navigation.odometry": "navigation.dead_reckoning:Odometry",
    "navigation.inertial": "navigation.dead_reckoning:Inertial",
    "navigation.compass": "navigation.dead_reckoning:Compass",
    "navigation.kf": "navigation.ekf:Kalman",
    "navigation.ekf": "navigation.ekf:ExtendedKalman",
    "navigation.ukf": "navigation.ukf:UnscentedKalman",
    "navigation.finite-model": "navigation.finite_model:FiniteModel",
    "motion.kinematic": "motion.kinematic:Kinematic",
    "motion.slip": "motion.slip:Slip",
    "motion.dynamic": "motion.dynamic:Dynamic",
    "sensors.encoders": "sensors.encoders:Encoders",
    "sensors.gyroscope": "sensors.inertial:Gyroscope",
    "sensors.accelerometer": "sensors.inertial:Accelerometer",
    "sensors.magnetometer": "sensors.magnetometer:Magnetometer",
    "sensors.visual_odometry": "sensors.visual_odometry:VisualOdometry",
    "sensors.position_fixes": "sensors.position_fixes:PositionFixes",
}
"""Module and class of every law that comes with the package; the first of a role is its default."""

WHEELS = {"omega_l", "omega_r"}
"""What a sensor may read in the place of the exact wheel speeds."""

COMPOSED = {"control": "control.axes:AxisController"}
"""The law that puts a role together from laws of its axes."""


def kinds(role: str) -> tuple[str, ...]:
    """The kinds of a role, the default first."""
    names = [*BUILT_IN, *points(GROUP)]
    parts = tuple(f"{part}." for part in ROLES if part.startswith(f"{role}."))
    of_role = [n for n in names if n.startswith(f"{role}.") and not n.startswith(parts)]
    return tuple(dict.fromkeys(n.removeprefix(f"{role}.") for n in of_role))


def axes(role: str) -> tuple[str, ...]:
    """The axes that laws of a role can be put together from: speed and yaw of ``control``."""
    return tuple(r.removeprefix(f"{role}.") for r in ROLES if r.startswith(f"{role}."))


def law_class(role: str, kind: str) -> type[BaseModel]:
    """The class of a law."""
    place = BUILT_IN.get(f"{role}.{kind}")
    if place is not None:
        return _built_in(place)
    point = points(GROUP).get(f"{role}.{kind}")
    if point is None or kind not in kinds(role):
        raise UsageError(f"unknown kind {kind!r} of {role}: the kinds are {_listed(role)}")
    law = loaded(point, "law")
    if not (isinstance(law, type) and issubclass(law, BaseModel)):
        raise unusable(point, "law", "is no pydantic model")
    has = {*dir(law), *law.model_fields}
    missing = [n for n in dir(ROLES[role]) if not n.startswith("_") and n not in has]
    if missing:
        raise unusable(point, "law", f"has no {', '.join(missing)}")
    return law


def _built_in(place: str) -> type[BaseModel]:
    module, name = place.split(":")
    law: type[BaseModel] = getattr(import_module(f"sysid.robot.mission.{module}"), name)
    return law


def _listed(role: str) -> str:
    """The kinds of a role, and those of the axes that it can be put together from."""
    whole = ", ".join(kinds(role))
    by_axis = [f"{axis}: {{kind: {'|'.join(kinds(f'{role}.{axis}'))}}}" for axis in axes(role)]
    return f"{whole}; or {', '.join(by_axis)}" if by_axis else whole


def section_class(role: str, section: Mapping[str, Any]) -> tuple[type[BaseModel], dict[str, Any]]:
    """The class that a section of a mission file describes, and its keys without ``kind``.

    A section that names axes is put together from their laws; a kind that is none of the role but
    one of its axes' serves every axis.

    Raises:
        ValidationError: of the key ``kind``, where no law is called so.
    """
    keys = {k: v for k, v in section.items() if k != "kind"}
    parts = axes(role)
    if "kind" not in section and any(axis in section for axis in parts):
        return _built_in(COMPOSED[role]), keys
    kind = section.get("kind", kinds(role)[0])
    if not isinstance(kind, str):
        raise sentence_at(
            ("kind",), f"the kind of {role} is {shown(kind)}: the kinds are {_listed(role)}"
        )
    if kind not in kinds(role) and any(kind in kinds(f"{role}.{axis}") for axis in parts):
        return _built_in(COMPOSED[role]), {**{axis: {"kind": kind} for axis in parts}, **keys}
    try:
        return law_class(role, kind), keys
    except UsageError as error:
        raise sentence_at(("kind",), str(error)) from None


def kind_of(role: str, law: Any) -> str:
    """The kind under which a law is known; the name of its class where it is known under none."""
    name = f"{type(law).__module__}:{type(law).__qualname__}"
    places = {f"sysid.robot.mission.{place}": known for known, place in BUILT_IN.items()}
    places |= {point.value: known for known, point in points(GROUP).items()}
    known = places.get(name, "")
    of_role = known.startswith(f"{role}.")
    return known.removeprefix(f"{role}.") if of_role else type(law).__name__


def law(role: str, section: Any) -> Any:
    """The law that a section of a mission file describes.

    Args:
        section: a law, which is returned as it is; a mapping of its keys with its ``kind``, the
            default where it names none; None for the default with its default keys.

    Raises:
        ValueError: it describes none (pydantic's ``ValidationError`` where one key is to blame).
    """
    if isinstance(section, ROLES[role]):
        return section
    if section is None:
        section = {}
    if isinstance(section, str):
        raise ValueError(f"{role} is {shown(section)}: write {role}: {{kind: {section}}}")
    if not isinstance(section, Mapping):
        raise PydanticCustomError("model_type", "a section of keys is needed")
    cls, keys = section_class(role, section)
    return cls.model_validate(keys, context={"law": law})


def motion_chosen(mission: Any) -> Any:
    """The values of a mission file, the kind of motion that its vehicle names in ``motion``.

    Raises:
        ValidationError: there is no such kind, or the section ``motion`` has another one.
    """
    if not isinstance(mission, Mapping):
        return mission
    vehicle, place = mission.get("vehicle"), ("vehicle", "motion")
    kind = vehicle.get("motion") if isinstance(vehicle, Mapping) else None
    kind = getattr(vehicle, "motion", kind)
    if kind is None:
        return mission
    if not isinstance(kind, str) or kind not in kinds("motion"):
        raise sentence_at(
            place, f"vehicle.motion is {shown(kind)}: the kinds are {_listed('motion')}"
        )
    section = mission.get("motion")
    section = {} if section is None else section
    if isinstance(section, Mapping):
        law = section.get("kind", kind)
        section = {**section, "kind": law}
    else:
        law = kind_of("motion", section)
    if law != kind:
        raise sentence_at(
            place, f"the vehicle's motion is {kind}, but motion.kind is {law}: keep one"
        )
    return {**mission, "motion": section}


def sensor_set(section: Any) -> Mapping[str, Sensor]:
    """The sensors that a section of a mission file lists by kind, each with its keys or none.

    Raises:
        ValueError: one is unknown, or a key of it is to blame.
    """
    if section is None:
        return {}
    if not isinstance(section, Mapping):
        raise ValueError(f"sensors is {shown(section)}: write sensors: {{{kinds('sensors')[0]}: }}")
    sensors: dict[str, Sensor] = {}
    problems: list[InitErrorDetails] = []
    for kind, keys in section.items():
        try:
            cls = law_class("sensors", kind)
            sensor: Any = keys
            if not isinstance(keys, ROLES["sensors"]):
                sensor = cls.model_validate({} if keys is None else keys)
            _check_names(sensor.names, sensors)
            sensors[kind] = sensor
        except UsageError as error:
            problem = PydanticCustomError("sentence", "{sentence}", {"sentence": str(error)})
            problems.append({"type": problem, "loc": (str(kind),), "input": keys})
        except ValidationError as error:
            problems += [_below(kind, e) for e in error.errors()]
    if problems:
        raise ValidationError.from_exception_data("sensors", problems)
    return sensors


def _check_names(names: tuple[str, ...], others: Mapping[str, Sensor]) -> None:
    """Refuse a sensor whose measurements have the name of something else in the log."""
    for kind, other in others.items():
        for name in {*names} & {*other.names}:
            raise UsageError(f"{name} is read by sensors.{kind} already: remove one of them")
    for name in {*names} & {*COLUMNS} - WHEELS:
        raise UsageError(f"a sensor reads {name}, which is a column of every mission: rename it")


def _below(kind: str, error: ErrorDetails) -> InitErrorDetails:
    """An error of one sensor as an error of the section."""
    context = {**error.get("ctx", {}), "sentence": error["msg"]}
    custom = PydanticCustomError(error["type"], "{sentence}", context)
    return {"type": custom, "loc": (kind, *error["loc"]), "input": error["input"]}


def first_problem(error: ValidationError, source: YamlSource, model: type[BaseModel]) -> str:
    """Word the problem that comes first in the file, and name the lines of the others.

    Args:
        model: the model of the whole file, for the keys there are.

    Returns:
        ``file:line: what is wrong: what to do``.
    """
    known = partial(_known_keys, model=model, values=source.values)
    return problems.first_problem(error, source, known, "the mission", {"goal": "goal: [1, 0]"})


def _known_keys(place: Place, model: type[BaseModel], values: Mapping[str, Any]) -> list[str]:
    section = str(place[0]) if place else ""
    if section == "obstacles":
        return ["at", "radius", "velocity"]
    if section == "sensors":
        chosen = place[1:2]
        return (
            list(law_class(section, str(chosen[0])).model_fields) if chosen else [*kinds(section)]
        )
    if section in ROLES:
        keys = values[section]
        for axis in axes(section):  # of a law put together from the laws of its axes
            if place[1:2] == (axis,):
                section, keys = f"{section}.{axis}", keys[axis]
        return ["kind", *section_class(section, keys)[0].model_fields]
    return problems.keys_of(model, place)
