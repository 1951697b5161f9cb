"""The plant as C99: one step function with a state struct, and a program that checks it."""

import re
from collections.abc import Callable, Iterator
from importlib.resources import files
from string import Template

import numpy as np

from sysid.data.record import Channel
from sysid.errors import ModelError
from sysid.export.c.augmented import augmented
from sysid.export.c.blocks import blocks
from sysid.export.c.grey_box import grey_box
from sysid.export.c.linear import linear
from sysid.export.c.narx import narx
from sysid.export.c.polynomial import polynomial
from sysid.export.c.writing import CBody, comment, listed, minus, number
from sysid.plant.selftest import TOLERANCE, SelfTest
from sysid.structures.augmented.structure import Augmented
from sysid.structures.base import Structure
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.model import Model
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.narx.structure import NarxWavelet
from sysid.version import __version__


def _diagnosed(model: Model) -> CBody:
    return augmented(model, _body)


WRITERS: tuple[tuple[type[Structure], Callable[[Model], CBody]], ...] = (
    (PolynomialStructure, linear),
    (NARMAX, polynomial),
    (NarxWavelet, narx),
    (BlockStructure, blocks),
    (GreyBox, grey_box),
    (Augmented, _diagnosed),
)
"""What writes each family of structures."""


def why_no_c_code(model: Model) -> str:
    """Why a model cannot be written as C, as a sentence; empty where it can."""
    try:
        _body(model)
    except ModelError as error:
        return str(error)
    return ""


def c_sources(model: Model, test: SelfTest, name: str = "") -> dict[str, str]:
    """``plant.h``, ``plant.c`` and ``selftest.c`` of a model.

    The code computes what the structure's ``step`` computes, in double precision, so that it
    agrees with Python to rounding.

    Args:
        model: a fitted model.
        test: the rows ``selftest.c`` checks.
        name: what to call the plant; the structure's title unless given.

    Raises:
        ModelError: the structure cannot be written as C.
    """
    written = _body(model)
    title = comment(f"{name}: {model.structure.title}" if name else model.structure.title)
    common = {"title": title, "version": __version__}
    n = written.n_states
    storage = str(max(n, 1))  # C has no empty arrays
    headers = ["#include <math.h>", ""] if written.mathematical else []
    return {
        "plant.h": _fill(
            "plant.h",
            **common,
            dt=number(model.dt),
            nu=str(len(model.inputs)),
            ny=str(len(model.outputs)),
            n=str(n),
            n_storage=storage,
            channels="\n".join(_channel_lines(model.inputs, model.outputs)),
        ),
        "plant.c": _fill(
            "plant.c",
            **common,
            words="\n".join(f" * {line}".rstrip() for line in map(comment, written.words)),
            includes="\n".join([*headers, '#include "plant.h"']),
            support="".join(f"{line}\n" for line in written.support),
            n_storage=storage,
            body="\n".join(_step_lines(model, written)),
        ),
        "selftest.c": _fill(
            "selftest.c",
            **common,
            rows=str(len(test.t)),
            tolerance=number(TOLERANCE),
            data="\n".join(f"    {{{listed(row)}}}," for row in np.column_stack([test.u, test.y])),
            scale=listed(test.scale()),
        ),
    }


def _body(model: Model) -> CBody:
    for family, write in WRITERS:
        if isinstance(model.structure, family):
            return write(model)
    raise ModelError(
        f"a {model.structure.name} model cannot be written as C; run its plant.json with sysid"
    )


def _step_lines(model: Model, written: CBody) -> Iterator[str]:
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


def _fill(template: str, **values: str) -> str:
    source = files("sysid.export.c").joinpath("templates", template).read_text(encoding="utf-8")
    return Template(source).substitute(values)
