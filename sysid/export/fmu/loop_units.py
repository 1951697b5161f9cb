"""The controller as a unit, the vehicle on its tracks as another one, and their connections."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from sysid.data.record import PWM_FULL_SCALE, Channel
from sysid.errors import ModelError
from sysid.export.c.fields import places
from sysid.export.c.loop.block import Block
from sysid.export.c.loop.laws import described, numbers
from sysid.export.c.loop.laws_of_mission import ESTIMATE, SIDES, flat, scene_numbers
from sysid.export.c.loop.sources import law_sources
from sysid.export.c.loop.trees import identifier
from sysid.export.c.precision import DOUBLE
from sysid.export.fmu.description import Role, Unit, Variable, named_apart
from sysid.export.fmu.replay import channel_names
from sysid.export.templates import fill
from sysid.robot.mission.contracts import TurnsTracks
from sysid.robot.mission.loop import Loop
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.runners.trace.writing import number
from sysid.structures.plant import Plant


@dataclass(frozen=True)
class Port:
    """What a track has in common with its plant: one command, or one speed.

    Attributes:
        name: as the units of the loop call it.
        plant: the instance of the plant's unit.
        at: the plant's variable of that channel.
        offset, slope: a command is offset + slope · PWM/20000, a speed slope · (value − offset).
    """

    name: str
    channel: Channel
    plant: str
    at: str
    offset: float
    slope: float

    def command(self, pwm: str) -> str:
        """C of the value for the plant from PWM [µs]."""
        if (self.offset, self.slope) == (0.0, PWM_FULL_SCALE):
            return pwm
        share = f"{number(self.slope)} * {pwm} / {number(PWM_FULL_SCALE)}"
        return f"{number(self.offset)} + {share}"

    def speed(self, value: str) -> str:
        """C of the wheel speed [rad/s] from the plant's value."""
        if (self.offset, self.slope) == (0.0, 1.0):
            return value
        return f"{number(self.slope)} * ({value} - ({number(self.offset)}))"


@dataclass(frozen=True)
class Wiring:
    """The tracks of a robot and its plant.

    Attributes:
        commands, speeds: of the left and the right track.
        plants: instances of the plant's unit.
        starts: what a plant's variables begin with where the unit itself begins otherwise, by
            instance and variable.
    """

    commands: tuple[Port, Port]
    speeds: tuple[Port, Port]
    plants: tuple[str, ...]
    starts: tuple[tuple[str, str, float], ...]


def wiring_of(robot: RobotPlant) -> Wiring:
    """How a robot's plant is plugged into the units of its loop."""
    plant = robot.plant
    assert isinstance(plant, Plant)
    inputs, outputs = channel_names([c.name for c in plant.inputs], [c.name for c in plant.outputs])
    plants = ("plant_l", "plant_r") if robot.twins else ("plant",)

    def ports(
        chosen: tuple[int, int],
        names: tuple[str, ...],
        channels: tuple[Channel, ...],
        lines: Sequence[tuple[float, float]],
    ) -> tuple[Port, Port]:
        shared = robot.twins or chosen[0] == chosen[1]
        left, right = (
            Port(
                name=f"{names[at]}_{SIDES[track]}" if shared else names[at],
                channel=channels[at],
                plant=plants[-track],
                at=names[at],
                offset=float(offset),
                slope=float(slope),
            )
            for track, (at, (offset, slope)) in enumerate(zip(chosen, lines, strict=True))
        )
        return left, right

    operating_point = [robot.centre[k] for k in robot.driven]
    commands = ports(
        robot.driven, inputs, plant.inputs, list(zip(operating_point, robot.span, strict=True))
    )
    speeds = ports(
        robot.read, outputs, plant.outputs, list(zip(robot.zero, robot.scale, strict=True))
    )
    return Wiring(commands, speeds, plants, tuple(_starts(robot, plant, plants, inputs)))


def _starts(
    robot: RobotPlant, plant: Plant, plants: tuple[str, ...], inputs: tuple[str, ...]
) -> Iterator[tuple[str, str, float]]:
    """At zero drive, which need not be where the plant's unit rests."""
    rests = robot.rest if robot.twins else robot.rest[None]
    for instance, rest in zip(plants, rests, strict=True):
        for name, centre, usual in zip(inputs, robot.centre, plant.u_offset, strict=True):
            if centre != usual:
                yield instance, name, float(centre)
        for k, (x, usual) in enumerate(zip(rest, plant.initial_state(), strict=True)):
            if x != usual:
                yield instance, f"start_{k}", float(x - usual)


THOUGHTS = ("reference_speed", "reference_psi", "v_cmd", "psi_cmd")
"""Outputs of the controller beside its commands and its estimate."""


@dataclass
class _Variables:
    """Variables of a unit as they are put together, and the lines of C that use them."""

    found: list[Variable] = field(default_factory=list)

    def add(self, variable: Variable) -> int:
        """The value reference of another variable."""
        self.found.append(variable)
        return len(self.found) - 1


@dataclass(frozen=True, eq=False)
class LoopUnits:
    """The units of a loop beside its plant, and how they are plugged together."""

    controller: Unit
    vehicle: Unit
    wiring: Wiring


def loop_units(loop: Loop, name: str) -> LoopUnits:
    """Controller and vehicle of a closed loop as units.

    Args:
        loop: of a mission and a robot plant, on plain numbers.
    """
    if isinstance(loop.motion, TurnsTracks):
        raise ModelError(
            "the motion of this mission turns the tracks itself, which the plant's unit cannot "
            "do; export it with motion of kind kinematic or slip"
        )
    if loop.feed is not None:
        raise ModelError(
            "the mission has a vehicle.supply, which belongs to neither unit; remove it"
        )
    blocks, files = law_sources(loop)
    if "motion" not in blocks:
        raise ModelError(
            "the motion of this mission cannot be written as C, nor as an FMU; choose motion of "
            "kind kinematic or slip"
        )
    assert isinstance(loop.plant, RobotPlant)
    wiring = wiring_of(loop.plant)
    return LoopUnits(
        _controller(loop, blocks, files, wiring, name),
        _vehicle(loop, blocks["motion"], files, wiring, name),
        wiring,
    )


def _controller(
    loop: Loop, blocks: Mapping[str, Block], files: Mapping[str, str], wiring: Wiring, name: str
) -> Unit:
    made = _Variables()
    measurements = list(_measurements(made, blocks["navigation"], wiring, "read"))
    outputs = [
        f"    r[{made.add(Variable(p.name, Role.OUTPUT, p.channel.unit, f'{track} command'))}] = "
        f"{p.command(f'state->decided.pwm_{side}')};"
        for p, side, track in zip(wiring.commands, SIDES, ("left", "right"), strict=True)
    ]
    pose = {n: made.add(_of(n, Role.INPUT, "where pose_from_inputs is set")) for n in ESTIMATE}
    for n in ("arrived", "gives_up"):
        at = made.add(Variable(n, Role.OUTPUT, "", described(n)[1], boolean=True))
        outputs.append(f"    r[{at}] = state->decided.{n} > 0.5 ? 1.0 : 0.0;")
    outputs += [f"    r[{made.add(_of(n, Role.OUTPUT))}] = state->decided.{n};" for n in THOUGHTS]
    for n in ESTIMATE:
        unit, words = described(n)
        at = made.add(Variable(f"estimate_{n}", Role.OUTPUT, unit, f"estimated: {words}"))
        outputs.append(f"    r[{at}] = state->estimate.{n};")
    words = "take the pose from the inputs x, y, psi, speed, yaw_rate instead of navigation"
    given = made.add(Variable("pose_from_inputs", Role.FIXED, "", words, boolean=True))
    laws = ("guidance", "control", "command", "navigation")
    parameters = _parameters(made, loop, [blocks[n] for n in laws], _IN_CONTROLLER)
    made.add(Variable("time", Role.TIME, "s", "of the simulation"))
    needed = (*laws, "controller")
    return Unit(
        "controller",
        loop.plant.dt,
        named_apart(made.found),
        {f"{n}{e}": files[f"{n}{e}"] for n in needed for e in (".h", ".c")},
        fill(
            "fmu/controller_unit.c",
            parameters=parameters,
            start={n: float(v) for n, v in flat(loop.start().estimate).items()},
            slack=DOUBLE.slack,
            full=PWM_FULL_SCALE,
            measurements=measurements,
            given=given,
            pose=pose,
            outputs=outputs,
        ),
        f"what drives {name}, by sysid",
    )


_IN_CONTROLLER = {"navigation": "p->navigation."} | {
    n: f"p->laws.{n}." for n in ("guidance", "control", "command")
}


def _vehicle(
    loop: Loop, motion: Block, files: Mapping[str, str], wiring: Wiring, name: str
) -> Unit:
    made = _Variables()
    measurements = list(_measurements(made, motion, wiring, "rolled"))
    outputs = [f"    r[{made.add(_of(n, Role.OUTPUT))}] = body.{n};" for n in ESTIMATE]
    parameters = _parameters(made, loop, [motion], {"motion": "p->"})
    made.add(Variable("time", Role.TIME, "s", "of the simulation"))
    return Unit(
        "vehicle",
        loop.plant.dt,
        named_apart(made.found),
        {n: files[n] for n in ("motion.h", "motion.c")},
        fill(
            "fmu/vehicle_unit.c",
            parameters=parameters,
            measurements=measurements,
            outputs=outputs,
        ),
        f"where {name} drives to, by sysid",
    )


def _of(name: str, role: Role, when: str = "") -> Variable:
    """A signal of the loop as a variable."""
    unit, words = described(name)
    return Variable(name, role, unit, f"{words}, {when}" if when else words)


OF_THE_UNIT = ("t", "dt", "drive_l", "drive_r")
"""Inputs of laws that a unit knows itself."""


def _measurements(made: _Variables, block: Block, wiring: Wiring, struct: str) -> Iterator[str]:
    """Inputs for what a law reads, and the lines that hand them over."""
    wheels = dict(zip(("omega_l", "omega_r"), wiring.speeds, strict=True))
    for f in block.inputs:
        if f.name in OF_THE_UNIT:
            continue
        port = wheels.get(f.name)
        if port is None:
            words = f"{f.words}, NaN where nothing is read".lstrip(", ")
            at = made.add(
                Variable(f.name, Role.INPUT, f.unit, words, float("nan"), may_be_nan=True)
            )
            yield f"    {struct}.{f.name} = r[{at}];"
            continue
        at = made.add(Variable(port.name, Role.INPUT, port.channel.unit, f.words, port.offset))
        yield f"    {struct}.{f.name} = {port.speed(f'r[{at}]')};"


def _parameters(
    made: _Variables, loop: Loop, blocks: Sequence[Block], structs: Mapping[str, str]
) -> list[str]:
    """Parameters of laws as variables, those of the scene once, and the lines that set them."""
    scene = {identifier(p) for p in scene_numbers(loop.scene)}
    lines: list[str] = []
    known: dict[str, int] = {}
    for block in blocks:
        names = {identifier(p) for p, _ in numbers(getattr(loop, block.name, None))}
        in_steps = "\n".join(block.step)
        for f in block.parameters:
            for place, value in places((f,)):
                shared = f.name in scene and f.name not in names
                name = place if shared else f"{block.name}.{place}"
                read = re.search(rf"\bparameters->{f.name}\b", in_steps)
                variable = Variable(
                    name, Role.TUNABLE if read else Role.FIXED, f.unit, f.words, value
                )
                if name not in known:
                    known[name] = made.add(variable)
                elif read:
                    made.found[known[name]] = variable
                lines.append(f"    {structs[block.name]}{place} = r[{known[name]}];")
    return lines
