"""Guidance, control, command module, navigation and motion of a mission, to be recorded as C."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from sysid.effects.catalogue import effect
from sysid.export.c.loop.block import Law
from sysid.export.c.loop.laws import described, documented, numbers, with_numbers
from sysid.export.c.loop.trees import Path, identifier, leaves, mapped
from sysid.robot.mission.contracts import (
    Body,
    Command,
    ControlInputs,
    GuidanceInputs,
    NavigationInputs,
    Point,
    Pose,
    References,
    Scene,
)
from sysid.robot.mission.loop import Loop, on_ground
from sysid.robot.mission.tracks.compensation import Compensation
from sysid.runners.trace.traced import TRACE
from sysid.vehicle.kinematics import Geometry

Numbers = Mapping[Path, Any]


ESTIMATE = {"x": 0.0, "y": 0.0, "psi": 0.0, "speed": 0.0, "yaw_rate": 0.0}
"""What a body is, as inputs and outputs have it."""


def body_of(given: Mapping[str, Any]) -> Body:
    """The body that inputs say."""
    return Body(Pose(given["x"], given["y"], given["psi"]), given["speed"], given["yaw_rate"])


def flat(body: Body) -> dict[str, Any]:
    """A body as inputs and outputs have it."""
    return dict(zip(ESTIMATE, (*body.pose, body.speed, body.yaw_rate), strict=True))


def _tree(scene: Scene) -> dict[str, Any]:
    """What of a scene may change from mission to mission, as nested numbers."""

    def places(points: Sequence[Point]) -> dict[str, dict[str, Any]]:
        return {str(k): dict(zip("xy", p, strict=True)) for k, p in enumerate(points, 1)}

    obstacles = (
        {k: v for k, v in o._asdict().items() if k not in ("vx", "vy") or o.vx != 0 or o.vy != 0}
        for o in scene.obstacles
    )
    return {
        "start": scene.start._asdict(),
        "goal": dict(zip("xy", scene.goal, strict=True)),
        "tolerance": scene.tolerance,
        "vehicle": {"r": scene.geometry.r, "B": scene.geometry.B},
        "obstacle": {str(k): numbers for k, numbers in enumerate(obstacles, 1)},
        "waypoint": places(scene.way),
        "path": places(scene.path),
    }


def scene_numbers(scene: Scene) -> dict[Path, float]:
    """Numbers of a scene that may change from mission to mission, by place."""
    return {p: float(v) for p, v in leaves(_tree(scene))}


def with_scene_numbers(scene: Scene, given: Numbers) -> Scene:
    """The scene with other numbers at these places."""
    there = mapped(_tree(scene), lambda p, v: given.get(p, v))
    obstacles = zip(scene.obstacles, there["obstacle"].values(), strict=True)
    way, path = (
        tuple(tuple(point.values()) for point in there[name].values())
        for name in ("waypoint", "path")
    )
    return scene._replace(
        start=Pose(**there["start"]),
        goal=tuple(there["goal"].values()),
        tolerance=there["tolerance"],
        geometry=Geometry(**there["vehicle"]),
        obstacles=tuple(o._replace(**numbers) for o, numbers in obstacles),
        way=way,
        path=path,
    )


def laws(loop: Loop) -> dict[str, Law]:
    """The laws of a closed loop by the names of their C functions."""
    return {
        "guidance": _guidance(loop),
        "control": _control(loop),
        "command": _command(loop),
        "navigation": _navigation(loop),
        "motion": _motion(loop),
    }


def _law(
    name: str,
    title: str,
    loop: Loop,
    inputs: Mapping[str, Any],
    step: Callable[[Any, Scene, Any, Mapping[str, Any]], tuple[Any, Any]],
) -> Law:
    """A law of the loop with its own numbers and those of the scene as parameters."""
    law = getattr(loop, name)

    def start(given: Numbers) -> Any:
        return with_numbers(law, given).start(with_scene_numbers(loop.scene, given), TRACE)

    def advance(given: Numbers, state: Any, read: Any) -> tuple[Any, Any]:
        scene = with_scene_numbers(loop.scene, given)
        return step(with_numbers(law, given), scene, state, read)

    own_numbers = dict(numbers(law))

    def words(place: Path) -> tuple[str, str]:
        return documented(law, place) if place in own_numbers else described(identifier(place))

    parameters = {**scene_numbers(loop.scene), **own_numbers}
    return Law(name, title, parameters, dict(inputs), start, advance, words)


def _guidance(loop: Loop) -> Law:
    def step(law: Any, scene: Scene, state: Any, read: Mapping[str, Any]) -> tuple[Any, Any]:
        asked = GuidanceInputs(read["t"], body_of(read), scene)
        state, references = law.step(state, asked, loop.control.period, TRACE)
        return state, guidance_outputs(references)

    title = "From the estimated pose to references of speed and yaw, once a control period"
    return _law("guidance", title, loop, {"t": 0.0, **ESTIMATE}, step)


def guidance_outputs(references: References) -> dict[str, Any]:
    """References as outputs."""
    return {
        "reference_speed": references.speed,
        "reference_psi": references.psi,
        "arrived": references.arrived,
        "gives_up": references.gives_up,
    }


CONTROL_INPUTS = ("t", "reference_speed", "reference_psi", *ESTIMATE)
APPLIED = ("applied_v_cmd", "applied_psi_cmd")


def _control(loop: Loop) -> Law:
    def step(law: Any, scene: Scene, state: Any, read: Mapping[str, Any]) -> tuple[Any, Any]:
        wanted = References(read["reference_speed"], read["reference_psi"], False)
        applied = Command(*(read[n] for n in APPLIED))
        asked = ControlInputs(read["t"], wanted, body_of(read), scene, applied)
        state, command = law.step(state, asked, loop.control.period, TRACE)
        return state, command._asdict()

    title = "From references and estimate to the speed and the yaw command, once a control period"
    return _law("control", title, loop, dict.fromkeys((*CONTROL_INPUTS, *APPLIED), 0.0), step)


SIDES = ("l", "r")


def compensated_numbers(shaper: Any) -> dict[Path, float]:
    """Numbers of the effects that a command module makes up for, by place."""
    if not isinstance(shaper, Compensation):
        return {}
    return {
        (id, name, side): float(value)
        for id in shaper.ids
        for name, values in shaper.identified.parameters[id].items()
        for side, value in zip(SIDES, values, strict=True)
    }


def with_compensated_numbers(shaper: Any, given: Numbers) -> Any:
    """The same command module with other numbers at these places."""
    if not isinstance(shaper, Compensation) or not given:
        return shaper
    numbers = {id: dict(named) for id, named in shaper.identified.parameters.items()}
    for id in shaper.ids:
        for name, values in numbers[id].items():
            sides = zip(SIDES, values, strict=True)
            numbers[id][name] = TRACE.stack([given.get((id, name, s), v) for s, v in sides])
    return replace(shaper, identified=replace(shaper.identified, parameters=numbers))


def _command(loop: Loop) -> Law:
    parameters = compensated_numbers(loop.shaper)

    def step(given: Numbers, state: Any, read: Mapping[str, Any]) -> tuple[Any, Any]:
        wanted = Command(read["v_cmd"], read["psi_cmd"])
        shaper = with_compensated_numbers(loop.shaper, given)
        pwm, applied = shaper(wanted, body_of(read), read["t"], TRACE)
        return (), command_outputs(pwm, applied)

    inputs = dict.fromkeys(("t", "v_cmd", "psi_cmd", *ESTIMATE), 0.0)
    title = "From the speed and the yaw command to the pulse widths of both tracks"

    def words(place: Path) -> tuple[str, str]:
        if place not in parameters:
            return described(identifier(place))
        id, name, side = place
        unit = next(p.unit for p in effect(id).parameters if p.name == name)
        words = f"{id}.{name} of the {'left' if side == 'l' else 'right'} track, to be made up for"
        return unit.replace("speed", loop.plant.outputs[0].unit), words

    return Law("command", title, parameters, inputs, lambda given: (), step, words)


def command_outputs(pwm: tuple[Any, Any], applied: Command) -> dict[str, Any]:
    """What the command module gives, as outputs."""
    given = (*pwm, applied.v_cmd, applied.psi_cmd)
    return dict(zip(("pwm_l", "pwm_r", *APPLIED), given, strict=True))


def _navigation(loop: Loop) -> Law:
    names = ("omega_l", "omega_r", *(n for s in loop.scene.sensors.values() for n in s.names))

    def step(law: Any, scene: Scene, state: Any, read: Mapping[str, Any]) -> tuple[Any, Any]:
        measurements = {n: read[n] for n in names}
        drive = (read["drive_l"], read["drive_r"])
        seen = NavigationInputs(read["t"], measurements, scene, drive)
        state, body = law.step(state, seen, read["dt"], TRACE)
        return state, flat(body)

    inputs = dict.fromkeys(dict.fromkeys(("t", "dt", *names, "drive_l", "drive_r")), 0.0)
    title = "From the sensor measurements to the robot's pose, at every sample"
    return _law("navigation", title, loop, inputs, step)


class OnGround(NamedTuple):
    """What ground and motion remember."""

    ground: Any
    motion: Any


def _motion(loop: Loop) -> Law:
    ground = loop.plant.ground

    def step(law: Any, scene: Scene, state: Any, read: Mapping[str, Any]) -> tuple[Any, Any]:
        under, last = state if ground.remembers else (ground.start(), state)
        omega, at = (read["omega_l"], read["omega_r"]), (read["t"], read["dt"])
        under, rolled = on_ground(ground, under, omega, at, scene)
        last, body = law.step(last, rolled, read["dt"], TRACE)
        return OnGround(under, last) if ground.remembers else last, flat(body)

    inputs = dict.fromkeys(("t", "dt", "omega_l", "omega_r"), 0.0)
    title = "From the track speeds on the ground to the vehicle's pose, at every sample"
    law = _law("motion", title, loop, inputs, step)
    if not ground.remembers:
        return law
    return replace(law, start=lambda given: OnGround(ground.start(), law.start(given)))
