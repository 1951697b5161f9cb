"""The files of a mission's laws as C: a header and a source each, the controller, the self-test."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.errors import ModelError
from sysid.export.c.loop.block import Block, Law, recorded
from sysid.export.c.loop.laws_of_mission import laws
from sysid.export.c.loop.recorded_run import CLOSED, RecordedRun, not_again, record_run
from sysid.export.c.precision import Precision
from sysid.export.templates import fill
from sysid.plant.selftest import reach
from sysid.robot.mission.contracts import TurnsTracks
from sysid.robot.mission.loop import Loop
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.runners.trace.writing import number

MOST_ROWS = 400
"""Steps of each function that the self-test knows: a mission of 40 s at the thesis's period."""


@dataclass(frozen=True, eq=False)
class LoopSources:
    """The files of a closed loop, and what they were made from.

    Attributes:
        period: between two steps of the controller [s].
        not_again: why the mission is not driven again in C, a sentence; empty where it is.
    """

    files: dict[str, str]
    blocks: tuple[Block, ...]
    period: float
    not_again: str


def loop_sources(loop: Loop, precision: Precision) -> LoopSources:
    """Headers, sources and self-test of a closed loop.

    Args:
        loop: of a mission and a robot plant, on plain numbers.
    """
    blocks, files = law_sources(loop)
    run, why = record_run(loop), not_again(loop, blocks)
    files["loop_data.h"] = _data(blocks, run, not why)
    files["loop_selftest.c"] = _selftest(loop, blocks, run, precision, not why)
    return LoopSources(files, tuple(blocks.values()), loop.control.period, why)


def _block(loop: Loop, law: Law) -> Block | None:
    """A law as C; None for a motion that cannot be written so, which no robot needs."""
    if law.name == "motion" and isinstance(loop.motion, TurnsTracks):
        return None
    try:
        return recorded(law)
    except ModelError:
        if law.name == "motion":
            return None
        raise


def law_sources(loop: Loop) -> tuple[dict[str, Block], dict[str, str]]:
    """The laws of a closed loop as C, and their files, with those of the controller they make."""
    if not isinstance(loop.plant, RobotPlant):
        raise ModelError("the plant of the loop is not a robot; map it with as_robot first")
    blocks = {name: b for name, law in laws(loop).items() if (b := _block(loop, law)) is not None}
    files: dict[str, str] = {}
    for block in blocks.values():
        indent = " " * (len(block.name) - 10)
        for end in ("h", "c"):
            written = fill(f"c/law.{end}", block=block, indent=indent, used=_used)
            files[f"{block.name}.{end}"] = written
    return blocks, files | _controller_files(loop, blocks)


def _used(lines: Sequence[str], word: str) -> bool:
    """Whether an argument is used by the lines of a function."""
    return any(re.search(rf"\b{word}\b", line) for line in lines)


def _assigned(struct: str, block: Block, values: dict[str, str], depth: int = 4) -> str:
    """Lines that set the inputs of a function, those that it has."""
    names = [f.name for f in block.inputs if f.name in values]
    return "\n".join(f"{' ' * depth}{struct}.{n} = {values[n]};" for n in names)


def _controller_files(loop: Loop, blocks: dict[str, Block]) -> dict[str, str]:
    seen = {n: f"inputs->{n}" for n in ("t", "x", "y", "psi", "speed", "yaw_rate")}
    return {
        "controller.h": fill("c/controller.h", period=loop.control.period),
        "controller.c": fill(
            "c/controller.c",
            guidance=_assigned("seen", blocks["guidance"], seen),
            control=_assigned("asked", blocks["control"], seen),
            command=_assigned("given", blocks["command"], seen),
        ),
    }


# ------------------------------------------------------------------------------ the self-test


def _rows(block: Block, run: RecordedRun) -> Array:
    columns = run.rows[block.name]
    names = [f.name for f in (*block.inputs, *block.outputs)]
    return np.column_stack([columns[n] for n in names])[:MOST_ROWS]


def _data(blocks: dict[str, Block], run: RecordedRun, closed: bool) -> str:
    tables = [(name, _rows(blocks[name], run)) for name in run.rows]
    reached = [(n, rows, reach(rows[:, len(blocks[n].inputs) :])) for n, rows in tables]
    if closed:
        reached.append(("loop", run.closed, reach(run.closed)))
    return fill("c/loop_data.h", closed_rows=len(run.closed), columns=CLOSED, tables=reached)


def _selftest(
    loop: Loop, blocks: dict[str, Block], run: RecordedRun, precision: Precision, closed: bool
) -> str:
    whole = ""
    if closed:
        whole = fill("c/closed_loop.c", slack=precision.slack, **robot_lines(loop, blocks))
    return fill(
        "c/loop_selftest.c",
        precision=precision,
        blocks=[blocks[name] for name in run.rows],
        closed=whole,
    )


def robot_lines(loop: Loop, blocks: dict[str, Block]) -> dict[str, str]:
    """What a loop in C is made of around its laws, by its place in a template.

    Returns:
        ``robot``: its struct and functions; ``navigation``, ``motion``: lines that give both their
        inputs, of t, dt, omega[2] and held[2]; ``start_x`` …: where it begins.
    """
    robot = loop.plant
    assert isinstance(robot, RobotPlant)
    read = {
        "t": "t",
        "dt": "dt",
        "omega_l": "omega[0]",
        "omega_r": "omega[1]",
        "drive_l": f"held[0] / {number(PWM_FULL_SCALE)}",
        "drive_r": f"held[1] / {number(PWM_FULL_SCALE)}",
    }
    of_robot = fill(
        "c/robot.c",
        twins_words=" of each track" if robot.twins else "",
        copies="2" if robot.twins else "1",
        rest="\n".join(_rest(robot)),
        drive="\n".join(_drive(robot)),
    )
    return {
        "robot": of_robot,
        "navigation": _assigned("read", blocks["navigation"], read, 16),
        "motion": _assigned("rolled", blocks["motion"], read, 8),
        **{f"start_{k}": number(v) for k, v in loop.scene.start._asdict().items()},
    }


def _rest(robot: RobotPlant) -> Iterator[str]:
    rest = robot.rest if robot.twins else robot.rest[None]
    for k, state in enumerate(rest):
        yield f"    plant_init(&robot->plant[{k}], &robot->parameters);"
        yield from (
            f"    robot->plant[{k}].x[{i}] = {number(v)};" for i, v in enumerate(state) if v != 0.0
        )


def _drive(robot: RobotPlant) -> Iterator[str]:
    """Lines that step the plant, or both copies of it, by PWM of both tracks."""
    for copy in range(2 if robot.twins else 1):
        for i, centre in enumerate(robot.centre):
            terms = [number(centre)]
            for track in (copy,) if robot.twins else (0, 1):
                if robot.driven[track] == i:
                    share = number(robot.span[track])
                    terms.append(f"{share} * pwm[{track}] / {number(PWM_FULL_SCALE)}")
            yield f"    u[{i}] = {' + '.join(terms)};"
        yield f"    plant_step(&robot->plant[{copy}], &robot->parameters, u, y);"
        for track in (copy,) if robot.twins else (0, 1):
            zero, scale = number(robot.zero[track]), number(robot.scale[track])
            yield f"    omega[{track}] = {scale} * (y[{robot.read[track]}] - ({zero}));"
