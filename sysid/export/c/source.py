"""The plant as C99: one step function with a state struct, and a self-test."""

import re
from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files
from string import Template

import numpy as np

from sysid.data.record import Channel
from sysid.export.c.fields import Field, members, places
from sysid.export.c.step import PlantStep, c_step
from sysid.export.c.writing import comment, listed, number, wrapped
from sysid.plant.selftest import TOLERANCE, SelfTest
from sysid.structures.model import Model
from sysid.version import __version__

_MATHEMATICAL = re.compile(r"\b(HUGE_VAL|NAN|[a-z]\w*\()")
"""What needs math.h: infinity, and calls of functions."""


def c_sources(
    model: Model, test: SelfTest, name: str = "", tolerance: float = TOLERANCE
) -> dict[str, str]:
    """:func:`plant_sources` of a model's step."""
    return plant_sources(model, c_step(model), test, name, tolerance)


def plant_sources(
    model: Model, written: PlantStep, test: SelfTest, name: str, tolerance: float
) -> dict[str, str]:
    """``plant.h``, ``plant.c`` and ``selftest.c`` of a model.

    The code computes what the structure's ``step`` computes, in double precision, so that it
    agrees with Python to rounding.

    Args:
        test: the rows ``selftest.c`` checks.
        name: what to call the plant; the structure's title where that is empty.
        tolerance: error that ``selftest.c`` allows, in parts of the range of each output.

    Raises:
        ModelError: the structure cannot be written as C.
    """
    title = comment(f"{name}: {model.structure.title}" if name else model.structure.title)
    common = {"title": title, "version": __version__}
    n = written.n_states
    code = "\n".join((*written.support, *written.body, *written.following))
    values = [v for _, v in places(written.parameters)]
    needs_math = _MATHEMATICAL.search(code) or not np.all(np.isfinite(values))
    return {
        "plant.h": fill(
            "plant.h",
            **common,
            dt=number(model.dt),
            nu=str(len(model.inputs)),
            ny=str(len(model.outputs)),
            n=str(n),
            feedthrough=str(int(written.feedthrough)),
            parameters="\n".join(members(written.parameters)),
            states="\n".join(_state_lines(written)),
            channels="\n".join(_channel_lines(model.inputs, model.outputs)),
        ),
        "plant.c": fill(
            "plant.c",
            **common,
            words="\n".join(f" * {line}".rstrip() for line in map(comment, written.words)),
            includes="\n".join(
                [*(["#include <math.h>"] if needs_math else []), "#include <string.h>"]
            ),
            support="".join(f"{line}\n" for line in (*written.support, *_following(written))),
            defaults=_body(_defaults(written.parameters), ("parameters",)),
            start=_body(_start(written), ("parameters",)),
            body=_body(_step_lines(written), ("parameters",)),
        ),
        "selftest.c": fill(
            "selftest.c",
            **common,
            rows=str(len(test.t)),
            tolerance=number(tolerance),
            data="\n".join(f"    {{{listed(row)}}}," for row in np.column_stack([test.u, test.y])),
            scale=listed(test.scale()),
        ),
    }


def _state_lines(written: PlantStep) -> Iterator[str]:
    """Members of the state."""
    yield f"    double x[{max(written.n_states, 1)}];"  # C has no empty arrays
    if written.derived:
        derived, sources = len(written.derived), len(written.sources)
        yield f"    double derived[{derived}]; /* what follows from parameters alone */"
        yield f"    double made_of[{sources}]; /* the parameters that it was computed from */"


def _body(lines: Iterable[str], arguments: Sequence[str]) -> str:
    """Lines of a function, with what it does not use said to be unused."""
    text = "\n".join(f"    {line}".rstrip() for line in lines)
    idle = [f"    (void){a};" for a in arguments if not re.search(rf"\b{a}\b", text)]
    return "\n".join([*idle, *([text] if text else [])])


def _defaults(parameters: Sequence[Field]) -> Iterator[str]:
    """Lines that put the identified values into the struct."""
    for f in parameters:
        if f.size:
            yield f"static const double {f.name}[{f.size}] = {{"
            yield from wrapped([number(v) for v in f.values])
            yield "};"
    for f in parameters:
        if f.size:
            yield f"memcpy(parameters->{f.name}, {f.name}, sizeof {f.name});"
        else:
            yield f"parameters->{f.name} = {number(f.values[0])};"


def _following(written: PlantStep) -> Iterator[str]:
    """The function that computes again what follows from parameters alone."""
    if not written.derived:
        return
    yield "/* What follows from parameters alone, computed again where one of them has changed. */"
    yield "static void follow(plant_state *state, const plant_parameters *parameters)"
    yield "{"
    yield from (f"    {line}" for line in written.following)
    for k, d in enumerate(written.derived):
        yield f"    state->derived[{k}] = {d.name};"
    for k, (place, _) in enumerate(written.sources):
        yield f"    state->made_of[{k}] = parameters->{place};"
    yield "}"
    yield ""
    yield "static int changed(const plant_state *state, const plant_parameters *parameters)"
    yield "{"
    yield "    const double *const of = state->made_of;"
    yield ""
    tests = [f"of[{k}] != parameters->{place}" for k, (place, _) in enumerate(written.sources)]
    yield "    return " + "\n        || ".join(tests) + ";"
    yield "}"
    yield ""


_FOLLOW = ("if (changed(state, parameters))", "    follow(state, parameters);")


def _start(written: PlantStep) -> Iterator[str]:
    """The body of ``plant_init``: rest, and what follows from the parameters as exported."""
    yield "memset(state, 0, sizeof *state);"
    for k, d in enumerate(written.derived):
        yield f"state->derived[{k}] = {number(d.usual)};"
    for k, (_, value) in enumerate(written.sources):
        yield f"state->made_of[{k}] = {number(value)};"
    if written.derived:
        yield from _FOLLOW


def _step_lines(written: PlantStep) -> Iterator[str]:
    """The body of ``plant_step``."""
    yield "double *const x = state->x;"
    yield "double v[PLANT_INPUTS];"
    yield "double out[PLANT_OUTPUTS]; /* y may be the same array as u */"
    for name in ("x", "v"):
        if not any(re.search(rf"\b{name}\b", line) for line in written.body):
            yield f"(void){name};"
    yield ""
    if written.derived:
        yield from _FOLLOW
    yield from written.entering
    yield from written.starting
    yield from written.body
    yield ""
    yield from (f"y[{i}] = out[{i}];" for i in range(len(written.starting)))


def _channel_lines(inputs: tuple[Channel, ...], outputs: tuple[Channel, ...]) -> Iterator[str]:
    for letter, channels in (("u", inputs), ("y", outputs)):
        for k, channel in enumerate(channels):
            unit = f" [{comment(channel.unit)}]" if channel.unit else ""
            yield f" * {letter}[{k}]  {comment(channel.name)}{unit}"


def fill(template: str, **values: str) -> str:
    """A template with its values put in."""
    source = files("sysid.export.c").joinpath("templates", template).read_text(encoding="utf-8")
    return Template(source).substitute(values)
