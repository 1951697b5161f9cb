"""What a person who integrates the code wants to know: functions, interfaces, sizes, operations."""

import re
from collections.abc import Iterator, Sequence

from sysid.export.c.fields import Field, numbers
from sysid.export.c.loop.block import Block
from sysid.export.c.loop.drive import Drive
from sysid.export.c.precision import Precision
from sysid.export.c.source import fill
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


def report(loop: Loop, blocks: Sequence[Block], drive: Drive, precision: Precision) -> str:
    """``report.md``."""
    size = 8 if precision.double else 4
    notes = [precision.reason] if precision.reason else []
    if drive.sensors:
        notes.append(
            "The mission has sensors with noise, so the self-test of the loop steps each function "
            "through the readings of one drive and does not drive the mission itself."
        )
    return fill(
        "report.md",
        period=f"{loop.control.period:g}",
        dt=f"{loop.plant.dt:g}",
        functions="\n".join(_row(b, size) for b in blocks),
        size=str(size),
        interfaces="\n".join(line for b in blocks for line in _interface(b)),
        notes="".join(f"\n{note}\n" for note in notes),
    )


def _row(b: Block, size: int) -> str:
    plain, calls = operations(b.step)
    state, parameters = (size * numbers(f) for f in (b.states, b.parameters))
    return f"| `{b.name}_step` | {b.title} | {state} B | {parameters} B | {plain} | {calls} |"


def _interface(b: Block) -> Iterator[str]:
    yield from ("", f"## {b.name}", "")
    parts = {"inputs": b.inputs, "outputs": b.outputs, "parameters": b.parameters}
    for part, fields in (parts | {"state": b.states}).items():
        yield from _table(part, fields)
    if b.held:
        names = ", ".join(f"`{n}`" for n in b.held)
        yield f"Numbers by which the law decides while it is written are constants: {names}."
        yield ""


def _table(part: str, fields: Sequence[Field]) -> Iterator[str]:
    if not fields:
        return
    yield f"| {part} | unit | | value |" if part == "parameters" else f"| {part} | unit | |"
    yield "|---|---|---|---|" if part == "parameters" else "|---|---|---|"
    for f in fields:
        size = f"[{f.size}]" if f.size else ""
        value = f" {f.values[0]:g} |" if part == "parameters" else ""
        yield f"| `{f.name}{size}` | {f.unit} | {f.words} |{value}"
    yield ""
