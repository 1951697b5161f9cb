"""The plant as C99: one step function with a state struct, and a program that checks it."""

from collections.abc import Iterable, Iterator
from importlib.resources import files
from string import Template

import numpy as np

from sysid import __version__
from sysid.data.record import Array, Channel
from sysid.errors import ModelError
from sysid.plant.selftest import TOLERANCE, SelfTest
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.polynomial import PolynomialStructure
from sysid.structures.transfer import Group, TransferMatrix


def has_c_code(structure: Structure) -> bool:
    """Whether a structure can be written as C: those with a transfer matrix can."""
    return isinstance(structure, PolynomialStructure)


def c_sources(model: Model, test: SelfTest, name: str = "") -> dict[str, str]:
    """``plant.h``, ``plant.c`` and ``selftest.c`` of a linear model.

    The code runs the very difference equations of the transfer matrix, so that it agrees with
    Python to rounding: with the state x of each group, drive v = u − u₀ and output w,

        w = num₀·v + x₁,  xₖ ← xₖ₊₁ + numₖ·v − denₖ w.

    Args:
        model: a fitted model.
        test: the rows ``selftest.c`` checks.
        name: what to call the plant; the structure's title unless given.

    Raises:
        ModelError: the structure has no transfer matrix.
    """
    structure = model.structure
    if not isinstance(structure, PolynomialStructure):
        raise ModelError(
            f"a {structure.name} model cannot be written as C; run its plant.json with sysid"
        )
    transfer = structure.transfer(model.theta)
    title = _comment(f"{name}: {structure.title}" if name else structure.title)
    common = {"title": title, "version": __version__}
    n = transfer.n_states
    return {
        "plant.h": _fill(
            "plant.h",
            **common,
            dt=_number(model.dt),
            nu=str(transfer.nu),
            ny=str(transfer.ny),
            n=str(n),
            n_storage=str(max(n, 1)),  # C has no empty arrays
            channels="\n".join(_channel_lines(model.inputs, model.outputs)),
        ),
        "plant.c": _fill(
            "plant.c",
            **common,
            n_storage=str(max(n, 1)),
            body="\n".join(_step_lines(transfer, model.detrend.u_offset, model.detrend.y_offset)),
        ),
        "selftest.c": _fill(
            "selftest.c",
            **common,
            rows=str(len(test.t)),
            tolerance=_number(TOLERANCE),
            data="\n".join(f"    {{{_list(row)}}}," for row in np.column_stack([test.u, test.y])),
            scale=_list(test.scale()),
        ),
    }


def _step_lines(transfer: TransferMatrix, u_offset: Array, y_offset: Array) -> Iterator[str]:
    """The body of ``plant_step``."""
    for j, offset in enumerate(u_offset):
        yield f"    v[{j}] = u[{j}]{_minus(offset)};"
    for i, offset in enumerate(y_offset):
        yield f"    out[{i}] = {_number(offset)};"
    at = 0
    for group in transfer.groups:
        yield ""
        yield from _group_lines(group, at)
        at += group.order
    if not transfer.groups:
        yield "    (void)x;"
        yield "    (void)v;"
        yield "    (void)w;"
    yield ""
    for i in range(transfer.ny):
        yield f"    y[{i}] = out[{i}];"


def _group_lines(group: Group, at: int) -> Iterator[str]:
    """One transfer function; its first state is x[at]."""
    first = [f"x[{at}]"] if group.order else []
    yield f"    w = {_sum([*first, *_products(group, 0)])};"
    yield f"    out[{group.output}] += w;"
    for k in range(1, group.order + 1):
        following = [f"x[{at + k}]"] if k < group.order else []
        feedback = [f"{_number(-group.den[k])} * w"] if group.den[k] else []
        yield f"    x[{at + k - 1}] = {_sum([*following, *_products(group, k), *feedback])};"


def _products(group: Group, k: int) -> list[str]:
    """num_k·v, without the terms that are zero."""
    pairs = zip(group.inputs, group.num[:, k], strict=True)
    return [f"{_number(b)} * v[{j}]" for j, b in pairs if b]


def _sum(terms: list[str]) -> str:
    return " + ".join(terms) if terms else "0.0"


def _minus(offset: float) -> str:
    return f" - ({_number(offset)})" if offset else ""


def _number(value: float) -> str:
    """A double literal that reads back as the same double."""
    return repr(float(value))


def _list(values: Iterable[float]) -> str:
    return ", ".join(_number(v) for v in values)


def _channel_lines(inputs: tuple[Channel, ...], outputs: tuple[Channel, ...]) -> Iterator[str]:
    for letter, channels in (("u", inputs), ("y", outputs)):
        for k, channel in enumerate(channels):
            unit = f" [{_comment(channel.unit)}]" if channel.unit else ""
            yield f" * {letter}[{k}]  {_comment(channel.name)}{unit}"


def _comment(text: str) -> str:
    """Text that cannot end a comment or continue a line."""
    plain = "".join(c if c.isprintable() and c not in "\\?" else "_" for c in text)
    return plain.replace("*/", "*_").replace("/*", "_*")


def _fill(template: str, **values: str) -> str:
    source = files("sysid.plant").joinpath("templates", template).read_text(encoding="utf-8")
    return Template(source).substitute(values)
