"""Connections between the units of a robot: the plant's channels as those of two tracks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sysid.data.record import PWM_FULL_SCALE, Channel
from sysid.export.c.loop.laws_of_mission import SIDES
from sysid.export.fmu.replay import channel_names
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
