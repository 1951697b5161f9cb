"""The plant as C99: one step function with a state struct, and a program that checks it."""

import re
from collections.abc import Iterator
from importlib.resources import files
from string import Template

import numpy as np

from sysid.data.record import Channel
from sysid.export.c.step import c_step
from sysid.export.c.writing import comment, listed, minus, number
from sysid.plant.selftest import TOLERANCE, SelfTest
from sysid.structures.c_step import CStep
from sysid.structures.model import Model
from sysid.version import __version__

_MATHEMATICAL = re.compile(r"\b(HUGE_VAL|NAN|[a-z]\w*\()")
"""What needs math.h: infinity, and calls of functions."""


def c_sources(
    model: Model, test: SelfTest, name: str = "", tolerance: float = TOLERANCE
) -> dict[str, str]:
    """``plant.h``, ``plant.c`` and ``selftest.c`` of a model.

    The code computes what the structure's ``step`` computes, in double precision, so that it
    agrees with Python to rounding.

    Args:
        model: a fitted model.
        test: the rows ``selftest.c`` checks.
        name: what to call the plant; the structure's title unless given.
        tolerance: error that ``selftest.c`` allows, in parts of the range of each output.

    Raises:
        ModelError: the structure cannot be written as C.
    """
    written = c_step(model)
    title = comment(f"{name}: {model.structure.title}" if name else model.structure.title)
    common = {"title": title, "version": __version__}
    n = written.n_states
    storage = str(max(n, 1))  # C has no empty arrays
    code = "\n".join((*written.support, *written.body))
    headers = ["#include <math.h>", ""] if _MATHEMATICAL.search(code) else []
    return {
        "plant.h": fill(
            "plant.h",
            **common,
            dt=number(model.dt),
            nu=str(len(model.inputs)),
            ny=str(len(model.outputs)),
            n=str(n),
            n_storage=storage,
            channels="\n".join(_channel_lines(model.inputs, model.outputs)),
        ),
        "plant.c": fill(
            "plant.c",
            **common,
            words="\n".join(f" * {line}".rstrip() for line in map(comment, written.words)),
            includes="\n".join([*headers, '#include "plant.h"']),
            support="".join(f"{line}\n" for line in written.support),
            n_storage=storage,
            body="\n".join(_step_lines(model, written)),
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


def _step_lines(model: Model, written: CStep) -> Iterator[str]:
    """The body of ``plant_step``."""
    for name in ("x", "v"):
        if not any(re.search(rf"\b{name}\b", line) for line in written.body):
            yield f"    (void){name};"
    yield ""
    for j, offset in enumerate(model.detrend.u_offset):
        yield f"    v[{j}] = u[{j}]{minus(offset)};"
    for i, offset in enumerate(model.detrend.y_offset):
        yield f"    out[{i}] = {number(offset)};"
    yield from written.body
    yield ""
    for i in range(len(model.outputs)):
        yield f"    y[{i}] = out[{i}];"


def _channel_lines(inputs: tuple[Channel, ...], outputs: tuple[Channel, ...]) -> Iterator[str]:
    for letter, channels in (("u", inputs), ("y", outputs)):
        for k, channel in enumerate(channels):
            unit = f" [{comment(channel.unit)}]" if channel.unit else ""
            yield f" * {letter}[{k}]  {comment(channel.name)}{unit}"


def fill(template: str, **values: str) -> str:
    """A template with its values put in."""
    source = files("sysid.export.c").joinpath("templates", template).read_text(encoding="utf-8")
    return Template(source).substitute(values)
