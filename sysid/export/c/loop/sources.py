"""The files of a mission's laws as C: a header and a source each, the controller, the self-test."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.errors import ModelError
from sysid.export.c.fields import members
from sysid.export.c.loop.block import Block, Law, recorded
from sysid.export.c.loop.laws_of_mission import laws
from sysid.export.c.loop.recorded_run import CLOSED, RecordedRun, not_again, record_run
from sysid.export.c.precision import Precision
from sysid.export.c.source import fill
from sysid.export.c.writing import comment, listed, number
from sysid.robot.mission.contracts import TurnsTracks
from sysid.robot.mission.loop import Loop
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.version import __version__

MOST_ROWS = 400
"""Steps of each function that the self-test knows: a mission of 40 s at the thesis's period."""


@dataclass(frozen=True, eq=False)
class LoopSources:
    """The files of a closed loop, and what they were made from.

    Attributes:
        not_again: why the mission is not driven again in C, a sentence; empty where it is.
    """

    files: dict[str, str]
    blocks: tuple[Block, ...]
    not_again: str


def loop_sources(loop: Loop, precision: Precision) -> LoopSources:
    """Headers, sources and self-test of a closed loop.

    Args:
        loop: of a mission and a robot plant, on plain numbers.
        precision: of the numbers in C.

    Raises:
        ModelError: a law cannot be written as C.
    """
    blocks, files = law_sources(loop)
    run, why = record_run(loop), not_again(loop, blocks)
    files["loop_data.h"] = _data(blocks, run, not why)
    files["loop_selftest.c"] = _selftest(loop, blocks, run, precision, not why)
    return LoopSources(files, tuple(blocks.values()), why)


def _block(loop: Loop, law: Law) -> Block | None:
    """A law as C; None for a motion that cannot be written so, which no robot needs.

    Raises:
        ModelError: another law cannot be written as C.
    """
    if law.name == "motion" and isinstance(loop.motion, TurnsTracks):
        return None
    try:
        return recorded(law)
    except ModelError:
        if law.name == "motion":
            return None
        raise


def law_sources(loop: Loop) -> tuple[dict[str, Block], dict[str, str]]:
    """The laws of a closed loop as C, and their files, with those of the controller they make.

    Raises:
        ModelError: a law cannot be written as C.
    """
    if not isinstance(loop.plant, RobotPlant):
        raise ModelError("the plant of the loop is not a robot; map it with as_robot first")
    blocks = {name: b for name, law in laws(loop).items() if (b := _block(loop, law)) is not None}
    files: dict[str, str] = {}
    for block in blocks.values():
        files |= _law_files(block)
    return blocks, files | _controller_files(loop, blocks)


def _law_files(block: Block) -> dict[str, str]:
    common = {
        "name": block.name,
        "NAME": block.name.upper(),
        "title": comment(block.title),
        "version": __version__,
        "indent": " " * (len(block.name) - 10) if len(block.name) > 10 else "",
    }
    header = fill(
        "law.h",
        **common,
        **{
            part: "\n".join(members(getattr(block, part)))
            for part in ("parameters", "states", "inputs", "outputs")
        },
    )
    source = fill(
        "law.c",
        **common,
        support="".join(f"{line}\n" for line in block.support),
        defaults=_body(
            [f"parameters->{p.name} = {number(p.values[0])};" for p in block.parameters],
            ("parameters",),
        ),
        start=_body(block.start, ("state", "parameters")),
        step=_body(block.step, ("state", "parameters", "inputs", "outputs")),
    )
    return {f"{block.name}.h": header, f"{block.name}.c": source}


def _body(lines: Sequence[str], arguments: Sequence[str]) -> str:
    """Lines of a function, with what it does not use said to be unused."""
    text = "\n".join(lines)
    idle = [f"    (void){a};" for a in arguments if not re.search(rf"\b{a}\b", text)]
    return "\n".join([*idle, *(f"    {line}" for line in lines)])


def _assigned(struct: str, block: Block, values: dict[str, str], depth: int = 4) -> str:
    """Lines that set the inputs of a function, those that it has."""
    names = [f.name for f in block.inputs if f.name in values]
    return "\n".join(f"{' ' * depth}{struct}.{n} = {values[n]};" for n in names)


def _controller_files(loop: Loop, blocks: dict[str, Block]) -> dict[str, str]:
    seen = {n: f"inputs->{n}" for n in ("t", "x", "y", "psi", "speed", "yaw_rate")}
    common = {"version": __version__, "period": number(loop.control.period)}
    return {
        "controller.h": fill("controller.h", **common),
        "controller.c": fill(
            "controller.c",
            **common,
            guidance=_assigned("seen", blocks["guidance"], seen),
            control=_assigned("asked", blocks["control"], seen),
            command=_assigned("given", blocks["command"], seen),
        ),
    }


# ------------------------------------------------------------------------------ the self-test


def _ranges(values: Array) -> Array:
    """What errors of columns are relative to: how far each reaches, 1 where it is always zero."""
    reach = np.max(np.abs(values), axis=0, initial=0.0)
    return np.where(reach > 0.0, reach, 1.0)


def _table(name: str, values: Array) -> Iterator[str]:
    yield f"static const double {name}[{values.shape[0]}][{values.shape[1]}] = {{"
    yield from (f"    {{{listed(row)}}}," for row in values)
    yield "};"


def _rows(block: Block, run: RecordedRun) -> Array:
    columns = run.rows[block.name]
    names = [f.name for f in (*block.inputs, *block.outputs)]
    return np.column_stack([columns[n] for n in names])[:MOST_ROWS]


def _data(blocks: dict[str, Block], run: RecordedRun, closed: bool) -> str:
    lines = [
        "/* Inputs and outputs of every function during sysid's run of the mission.",
        " *",
        f" * Generated by sysid {__version__}; do not edit.",
        " */",
        "#ifndef LOOP_DATA_H",
        "#define LOOP_DATA_H",
        "",
        "#include <math.h>",
        "",
        f"#define LOOP_ROWS {len(run.closed)}",
        f"#define LOOP_COLUMNS {len(CLOSED)} /* {', '.join(CLOSED)} */",
        "",
    ]
    for name in run.rows:
        block = blocks[name]
        rows = _rows(block, run)
        ranges = _ranges(rows[:, len(block.inputs) :])
        lines += [f"#define {name.upper()}_ROWS {len(rows)}"]
        lines += [*_table(f"{name}_rows", rows)]
        lines += [f"static const double {name}_ranges[{len(ranges)}] = {{{listed(ranges)}}};", ""]
    if closed:
        ranges = _ranges(run.closed)
        lines += [*_table("loop_rows", run.closed)]
        lines += [f"static const double loop_ranges[LOOP_COLUMNS] = {{{listed(ranges)}}};", ""]
    return "\n".join([*lines, "#endif", ""])


def _selftest(
    loop: Loop, blocks: dict[str, Block], run: RecordedRun, precision: Precision, closed: bool
) -> str:
    functions = "\n".join(_function_test(blocks[name]) for name in run.rows)
    calls = [
        line
        for name in run.rows
        for line in (
            f"    error = test_{name}();",
            f'    printf("{name} %.17g\\n", error);',
            f"    failed |= !(error <= {number(precision.function)});",
        )
    ]
    whole = headers = ""
    if closed:
        whole = _closed(loop, blocks, precision)
        headers = '#include "controller.h"\n#include "motion.h"\n#include "plant.h"\n'
        calls += [
            "    {",
            "        int later;",
            "        error = drive_mission(&later);",
            '        printf("closed-loop %.17g\\nlater %d\\n", error, later);',
            f"        failed |= !(error <= {number(precision.loop)}) || later < -1 || later > 1;",
            "    }",
        ]
    return fill(
        "loop_selftest.c",
        version=__version__,
        function_tolerance=number(precision.function),
        loop_tolerance=number(precision.loop),
        headers=headers,
        functions=functions,
        closed=whole,
        calls="\n".join(calls),
    )


def _function_test(block: Block) -> str:
    name, n = block.name, len(block.inputs)
    lines = [
        f"static double test_{name}(void)",
        "{",
        f"    {name}_parameters parameters;",
        f"    {name}_state state;",
        f"    {name}_inputs inputs;",
        f"    {name}_outputs outputs;",
        "    double worst = 0.0;",
        "    int k;",
        "",
        f"    {name}_defaults(&parameters);",
        f"    {name}_init(&state, &parameters);",
        f"    for (k = 0; k < {name.upper()}_ROWS; k++) {{",
        *(f"        inputs.{f.name} = {name}_rows[k][{i}];" for i, f in enumerate(block.inputs)),
        f"        {name}_step(&state, &parameters, &inputs, &outputs);",
        *(
            f"        worst = worse(worst, outputs.{f.name}, {name}_rows[k][{n + i}], "
            f"{name}_ranges[{i}]);"
            for i, f in enumerate(block.outputs)
        ),
        "    }",
        f"    {name}_terminate(&state);",
        "    return worst;",
        "}",
        "",
    ]
    return "\n".join(lines)


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
        "robot.c",
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


def _closed(loop: Loop, blocks: dict[str, Block], precision: Precision) -> str:
    return fill("closed_loop.c", slack=number(precision.slack), **robot_lines(loop, blocks))


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
