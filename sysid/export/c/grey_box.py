"""Grey boxes as C, recorded from their own equations.

The constants of the model stand as numbers in the code; see ``c_trace``.
"""

from collections.abc import Iterable

import numpy as np

from sysid.errors import ModelError
from sysid.export.c.trace import TRACE, Cell, Program, Traced, assigned
from sysid.export.c.writing import CBody
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.model import Model


def grey_box(model: Model) -> CBody:
    """The code of a grey box: its reading, then its steps within a sample.

    Raises:
        ModelError: its equations use what cannot be written as C.
    """
    structure = model.structure
    assert isinstance(structure, GreyBox)
    n, steps = len(structure.state_names), max(structure.substeps, 1)
    p = structure.prepared(np, structure.unpack(np, model.theta), structure.h)
    read, moved = Program(), Program()
    try:
        y = row(structure.reading(TRACE, read.inputs("x", (n, 1)), p))
        x, v = moved.inputs("x", (n, 1)), moved.inputs("v", (structure.nu, 1))
        after = row(structure.advance(TRACE, x, v, p, structure.h))
    except (ModelError, TypeError, AttributeError, ValueError) as error:
        raise refused(model, str(error)) from None
    support = [
        "/* The states one step later, inputs held. */",
        f"static void advance(double x[{n}], const double v[PLANT_INPUTS])",
        "{",
        *_unused(moved, after, ("x", "v")),
        *(f"    {line}" for line in [*moved.lines(after), *assigned("x", after)]),
        "}",
        "",
    ]
    body = [
        *(f"    {line}" for line in [*read.lines(y), *assigned("out", y, operator="+=")]),
        *_loop(steps),
    ]
    per = "a sample" if steps == 1 else f"each of {steps} steps in a sample"
    return CBody(
        n,
        (
            f"x holds {', '.join(structure.state_names)}; v the inputs. The outputs are read, then",
            f"{per} is computed from the equations of the model.",
        ),
        tuple(body),
        tuple(support),
        mathematical=True,
    )


def refused(model: Model, why: str) -> ModelError:
    """The error that says why `model` has no C code, and what to run instead."""
    return ModelError(
        f"this {model.structure.name} model cannot be written as C: {why}; run its plant.json "
        "with sysid"
    )


def row(value: object) -> list[Cell]:
    """The cells of a traced value of any shape, or of a plain number, in C order."""
    return (value if isinstance(value, Traced) else TRACE.stack([Traced([]), value])).ravel()


def _unused(program: Program, results: Iterable[Cell], names: tuple[str, ...]) -> list[str]:
    """Lines that tell the compiler which arguments are not looked at."""
    text = "\n".join(program.lines(list(results)))
    return [f"    (void){name};" for name in names if f"= {name}[" not in text]


def _loop(steps: int) -> list[str]:
    if steps == 1:
        return ["    advance(x, v);"]
    return [
        "    {",
        "        int k;",
        f"        for (k = 0; k < {steps}; k++)",
        "            advance(x, v);",
        "    }",
    ]
