"""What a person who integrates the code wants to know: functions, interfaces, sizes, operations."""

import re
from collections.abc import Iterator, Sequence

from sysid.export.c.loop.block import Block, Field
from sysid.export.c.loop.drive import Drive
from sysid.export.c.precision import Precision
from sysid.mission.loop import Loop

_HEAD = re.compile(r"for \(int \w+ = 0; \w+ < (\d+);")
_CALL = re.compile(r"\b([a-z][a-z0-9_]*)\(")
_OPERATOR = re.compile(r"(?<=[\w)\]]) (?:[-+*/]|[<>!=]=?|==|&&|\|\||\?) ")


def operations(lines: Sequence[str]) -> tuple[int, int]:
    """(arithmetic and comparisons, calls of functions) that lines make at most, loops counted."""
    plain = calls = 0
    times = [1]
    for line in lines:
        text = line.strip()
        head = _HEAD.match(text)
        if head:
            times.append(times[-1] * int(head[1]))
        elif text == "}":
            times.pop()
        else:
            plain += times[-1] * len(_OPERATOR.findall(text.partition(" = ")[2]))
            calls += times[-1] * len(_CALL.findall(text))
    return plain, calls


def numbers(fields: Sequence[Field]) -> int:
    """How many numbers a struct holds."""
    return sum(max(f.size, 1) for f in fields)


def report(loop: Loop, blocks: Sequence[Block], drive: Drive, precision: Precision) -> str:
    """``report.md``."""
    return "\n".join(_lines(loop, blocks, drive, precision)) + "\n"


def _lines(
    loop: Loop, blocks: Sequence[Block], drive: Drive, precision: Precision
) -> Iterator[str]:
    size = 8 if precision.double else 4
    yield "# The loop in C"
    yield ""
    yield (
        f"The controller is called every {loop.control.period:g} s, navigation and plant every "
        f"{loop.plant.dt:g} s. Everything is C99 without heap and globals: a function works on the "
        "structs it is given."
    )
    yield ""
    yield "```"
    yield "make && ./selftest && ./loop_selftest     # or: cmake -B build && cmake --build build"
    yield "```"
    yield ""
    yield "## Entry points"
    yield ""
    yield "| function | does | state | parameters | operations a step | calls of math.h |"
    yield "|---|---|---|---|---|---|"
    for b in blocks:
        plain, calls = operations(b.step)
        yield (
            f"| `{b.name}_step` | {b.title} | {size * numbers(b.states)} B | "
            f"{size * numbers(b.parameters)} B | {plain} | {calls} |"
        )
    yield (
        "| `controller_step` | guidance, control and command module in one: X, Y, ψ, Vx in, PWM "
        "out | | | | |"
    )
    yield ""
    yield (
        "Each has `_defaults` (parameters of the mission), `_init`, `_step` and `_terminate`. "
        "Operations are the most that a step can take; both sides of a choice are computed always, "
        "so it takes the same time at every step. Sizes are of numbers of "
        f"{size} bytes; `make size` "
        "tells that of the code for your compiler."
    )
    for b in blocks:
        yield ""
        yield f"## {b.name}"
        yield ""
        for part, fields in (
            ("inputs", b.inputs),
            ("outputs", b.outputs),
            ("parameters", b.parameters),
            ("state", b.states),
        ):
            yield from _table(part, fields)
        if b.held:
            yield (
                f"Numbers that the law decides by while it is written, and which are constants: "
                f"{', '.join(f'`{n}`' for n in b.held)}."
            )
            yield ""
    if precision.reason:
        yield ""
        yield precision.reason
    if drive.sensors:
        yield ""
        yield (
            "The mission has sensors with noise, so `loop_selftest` steps each function through "
            "the readings of one drive and does not drive the mission itself."
        )


def _table(part: str, fields: Sequence[Field]) -> Iterator[str]:
    if not fields:
        return
    yield f"| {part} | unit | | value |" if part == "parameters" else f"| {part} | unit | |"
    yield "|---|---|---|---|" if part == "parameters" else "|---|---|---|"
    for f in fields:
        size = f"[{f.size}]" if f.size else ""
        value = f" {f.value:g} |" if part == "parameters" else ""
        yield f"| `{f.name}{size}` | {f.unit} | {f.words} |{value}"
    yield ""
