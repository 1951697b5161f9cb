"""The report for an integrator: functions, interfaces, sizes, operations."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from sysid.export.c.fields import Field, numbers
from sysid.export.c.loop.block import Block
from sysid.export.c.loop.sources import LoopSources
from sysid.export.c.precision import Precision
from sysid.export.c.step import PlantStep
from sysid.export.templates import fill
from sysid.structures.model import Model

_HEAD = re.compile(r"for \(int \w+ = 0; \w+ < (\d+);")
_INDEX = re.compile(r"\[[^\[\]]*\]")
_CALL = re.compile(r"\b([a-z][a-z0-9_]*)\(")
_OPERATOR = re.compile(r"(?<=[\w)\]]) ([-+*/]|[<>!=]=?|&&|\|\||\?) ")
_CHEAP = frozenset(["fabs", "floor", "ceil", "isnan", "isfinite"])
"""Functions of math.h that are an instruction or a few, not a series."""


OPERATIONS = ("added", "multiplied", "divided", "roots", "compared", "calls")
"""Kinds that are counted. ``compared``: comparisons, choices between two values, absolute values,
roundings to a whole; ``calls``: of other functions of math.h: exponentials, sines, powers …"""


def counted(lines: Sequence[str]) -> Counter[str]:
    """What lines of a recorded step make at most, loops counted as often as they go round.

    Both sides of a choice are computed always, so that this is what every step takes. Places in
    arrays are not counted.
    """
    total, times = Counter[str](), [1]
    for line in lines:
        text = line.strip()
        head = _HEAD.match(text)
        if head:
            times.append(times[-1] * int(head[1]))
        elif text == "}":
            times.pop()
        else:
            total.update({kind: n * times[-1] for kind, n in _of_line(text).items()})
    return total


def _of_line(text: str) -> dict[str, int]:
    """What one statement makes."""
    _, equals, value = text.partition(" = ")
    if not equals:
        value = text.partition(" += ")[2]
    plain = value
    while _INDEX.search(plain):
        plain = _INDEX.sub("", plain)
    signs = _OPERATOR.findall(plain)
    functions = [f for f in _CALL.findall(plain) if f not in ("double", "float", "int")]
    cheap = sum(f in _CHEAP for f in functions)
    roots = functions.count("sqrt")
    added = signs.count("+") + signs.count("-")
    multiplied, divided = signs.count("*"), signs.count("/")
    compared = len(signs) - added - multiplied - divided + cheap
    calls = len(functions) - cheap - roots
    every = (added + (" += " in text), multiplied, divided, roots, compared, calls)
    return dict(zip(OPERATIONS, every, strict=True))


def operations(lines: Sequence[str]) -> tuple[int, int]:
    """(arithmetic and comparisons, calls of functions) that lines make at most."""
    n = counted(lines)
    calls = n["calls"] + n["roots"]
    return n.total() - calls, calls


CONTROLLER = ("guidance", "control", "command")
"""The laws that ``controller_step`` calls."""


def report(
    model: Model, plant: PlantStep, precision: Precision, loop: LoopSources | None = None
) -> str:
    """``report.md``.

    Args:
        loop: what drives it, None for the plant alone.
    """
    size = 8 if precision.double else 4
    blocks = () if loop is None else loop.blocks
    notes = [precision.reason] if precision.reason else []
    programs = ["./selftest"]
    when = f"The plant is stepped every {model.dt:g} s."
    if loop is not None:
        programs.append("./loop_selftest")
        when = (
            f"The controller is called every {loop.period:g} s, navigation and plant every "
            f"{model.dt:g} s."
        )
    if loop is not None and loop.not_again:
        notes.append(loop.not_again)
    return fill(
        "c/report.md",
        title="The plant in C" if loop is None else "The loop in C",
        when=when,
        programs=" && ".join(programs),
        functions="\n".join([*_plant_rows(plant, size), *_rows(blocks, size)]),
        size=str(size),
        interfaces="\n".join([*_plant(model, plant), *(x for b in blocks for x in _interface(b))]),
        notes="".join(f"\n{note}\n" for note in notes),
    )


def _row(name: str, does: str, sizes: tuple[int, int], n: Counter[str]) -> str:
    state, parameters = sizes
    cells = (f"`{name}`", does, f"{state} B", f"{parameters} B", *(n[kind] for kind in OPERATIONS))
    return f"| {' | '.join(map(str, cells))} |"


def _plant_rows(plant: PlantStep, size: int) -> Iterator[str]:
    state = max(plant.n_states, 1) + len(plant.derived) + len(plant.sources)
    sizes = (size * state, size * numbers(plant.parameters))
    compared = Counter(compared=len(plant.sources))
    step = counted([*plant.entering, *plant.starting, *plant.body]) + compared
    yield _row("plant_step", "The identified plant, at every sample", sizes, step)
    if plant.derived:
        again = step + counted(plant.following)
        yield _row("plant_step", "the same where a parameter has changed", sizes, again)


def _rows(blocks: Sequence[Block], size: int) -> Iterator[str]:
    counts, states, parameters = {}, {}, {}
    for b in blocks:
        counts[b.name] = counted(b.step)
        states[b.name], parameters[b.name] = numbers(b.states), numbers(b.parameters)
        sizes = (size * states[b.name], size * parameters[b.name])
        yield _row(f"{b.name}_step", b.title, sizes, counts[b.name])
    if blocks:
        kept = sum(states[n] for n in CONTROLLER) + 2  # what of the last command reached the tracks
        sizes = (size * kept, size * sum(parameters[n] for n in CONTROLLER))
        does = "Guidance, control and command module in one: X, Y, ψ, Vx in, PWM out"
        total = sum((counts[n] for n in CONTROLLER), Counter(compared=3))
        yield _row("controller_step", does, sizes, total)


def _plant(model: Model, plant: PlantStep) -> Iterator[str]:
    yield from ("", "## plant", "")
    for part, letter, channels in (("inputs", "u", model.inputs), ("outputs", "y", model.outputs)):
        yield from _table(
            part, [Field(f"{letter}[{k}]", c.unit, c.name) for k, c in enumerate(channels)]
        )
    yield from _table("parameters", plant.parameters)


def _interface(b: Block) -> Iterator[str]:
    yield from ("", f"## {b.name}", "")
    parts: Mapping[str, Sequence[Field]] = {
        "inputs": b.inputs,
        "outputs": b.outputs,
        "parameters": b.parameters,
        "state": b.states,
    }
    for part, fields in parts.items():
        yield from _table(part, fields)
    if b.fixed:
        names = ", ".join(f"`{n}`" for n in b.fixed)
        yield f"Parameters that decide branches are constants in C: {names}."
        yield ""


def _table(part: str, fields: Sequence[Field]) -> Iterator[str]:
    if not fields:
        return
    valued = part == "parameters"
    yield f"| {part} | unit | | value |" if valued else f"| {part} | unit | |"
    yield "|---|---|---|---|" if valued else "|---|---|---|"
    for f in fields:
        size = f"[{f.size}]" if f.size else ""
        cells = [f"`{f.name}{size}`", _cell(f.unit), _cell(f.words)]
        if valued:
            first, last = f.values[0], f.values[-1]
            cells.append(f"{first:g} … {last:g}" if f.size else f"{first:g}")
        yield f"| {' | '.join(cells)} |"
    yield ""


def _cell(text: str) -> str:
    """Text that ends no cell of a table."""
    return text.replace("|", "\\|").replace("\n", " ")
