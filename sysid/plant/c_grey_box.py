"""Grey boxes and linear cores with effects as C, recorded from their own equations.

The constants of the model stand as numbers in the code; see ``c_trace``.
"""

from collections.abc import Iterable

import numpy as np

from sysid.errors import ModelError
from sysid.plant.c_trace import TRACE, Cell, Program, Traced, assigned
from sysid.plant.c_writing import CBody
from sysid.structures.augmented import Augmented
from sysid.structures.chain import Sample, step_with, with_constants
from sysid.structures.grey_box import GreyBox
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
        y = _row(structure.reading(TRACE, read.inputs("x", (n, 1)), p))
        x, v = moved.inputs("x", (n, 1)), moved.inputs("v", (structure.nu, 1))
        after = _row(structure.advance(TRACE, x, v, p, structure.h))
    except (ModelError, TypeError, AttributeError, ValueError) as error:
        raise _refused(model, str(error)) from None
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


def augmented(model: Model) -> CBody:
    """The code of a linear core with effects: one step of the chain.

    The states are the core's, those of the effects, the drives still on their way, the time and the
    angles, as in Python.

    Raises:
        ModelError: another model drives the core, or an effect cannot be written as C.
    """
    structure = model.structure
    assert isinstance(structure, Augmented)
    if structure.given is not None:
        raise _refused(model, f"a {structure.given.structure.name} model drives it")
    core, parameters = structure.unpack(model.theta)
    active, tracks, lag = structure.active, structure.ny, structure.delay - 1
    program = Program()
    at = 0

    def taken(*shape: int) -> Traced:
        nonlocal at
        at += int(np.prod(shape))
        return program.inputs("x", shape, at - int(np.prod(shape)))

    x = taken(*core.f.shape)
    held = tuple(tuple(taken(tracks) for _ in range(e.states)) for e in active)
    line = [taken(tracks) for _ in range(lag)]
    clock = taken(1)[0]
    turned, counted = taken(tracks), taken(tracks)
    line.append(program.inputs("v", (tracks,)) / np.array(structure.scales))
    sample = Sample(line[0], line[0], clock, turned, counted)
    whole = with_constants(np, active, core, parameters, structure.dt)
    speed = x[0]
    try:
        (x, held), y = step_with(TRACE, active, core, whole, (x, held), sample, structure.dt)
    except (ModelError, TypeError, AttributeError, ValueError) as error:
        raise _refused(model, str(error)) from None
    moved = [x, *(s for states in held for s in states), *line[1:], clock + structure.dt]
    moved += [turned + 0.5 * structure.dt * (speed + x[0]), counted + structure.dt * y]
    after, out = [c for part in moved for c in _row(part)], _row(y)
    if len(after) != structure.n_states(model.theta):
        raise _refused(model, "its states are not those of the chain")
    lines = [*program.lines([*after, *out])]
    lines += [*assigned("out", out, operator="+="), *assigned("x", after)]
    return CBody(
        at,
        (
            "x holds the states of the core and of the effects, drives on their way, time, angles;",
            "v the inputs.",
        ),
        tuple(f"    {line}" for line in lines),
        mathematical=True,
    )


def _refused(model: Model, why: str) -> ModelError:
    return ModelError(
        f"this {model.structure.name} model cannot be written as C: {why}; run its plant.json "
        "with sysid"
    )


def _row(value: object) -> list[Cell]:
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
