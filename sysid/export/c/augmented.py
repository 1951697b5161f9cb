"""Diagnosed models as C: a core with effects, behind the commands or behind another model."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sysid.errors import ModelError
from sysid.export.c.grey_box import refused, row
from sysid.export.c.trace import TRACE, Program, Traced, assigned
from sysid.export.c.writing import CBody, factor, minus, number
from sysid.structures.augmented.chain import Sample, step_with, with_constants
from sysid.structures.augmented.given_base import GivenBase
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model


def augmented(model: Model, write: Callable[[Model], CBody]) -> CBody:
    """The code of a linear core with effects: one step of the chain.

    The states are those of the model that drives the core, if there is one, the core's, those of
    the effects, the drives still on their way, the time and the angles, as in Python.

    Args:
        model: a diagnosed model.
        write: what writes the model that drives its core.

    Raises:
        ModelError: an effect, or the model that drives the core, cannot be written as C.
    """
    structure = model.structure
    assert isinstance(structure, Augmented)
    core, parameters = structure.unpack(model.theta)
    active, tracks, lag = structure.active, structure.ny, structure.delay - 1
    given = None if structure.given is None else _driving(model, structure.given, write)
    program = Program()
    first = at = 0 if given is None else given.n_states
    source = "v" if given is None else "drive"

    def taken(*shape: int) -> Traced:
        nonlocal at
        at += int(np.prod(shape))
        return program.inputs("x", shape, at - int(np.prod(shape)))

    x = taken(*core.f.shape)
    held = tuple(tuple(taken(tracks) for _ in range(e.states)) for e in active)
    line = [taken(tracks) for _ in range(lag)]
    clock = taken(1)[0]
    turned, counted = taken(tracks), taken(tracks)
    line.append(program.inputs(source, (tracks,)) / np.array(structure.scales))
    sample = Sample(line[0], line[0], clock, turned, counted)
    whole = with_constants(np, active, core, parameters, structure.dt)
    speed = x[0]
    try:
        (x, held), y = step_with(TRACE, active, core, whole, (x, held), sample, structure.dt)
    except (ModelError, TypeError, AttributeError, ValueError) as error:
        raise refused(model, str(error)) from None
    moved = [x, *(s for states in held for s in states), *line[1:], clock + structure.dt]
    moved += [turned + 0.5 * structure.dt * (speed + x[0]), counted + structure.dt * y]
    after, out = [c for part in moved for c in row(part)], row(y)
    if first + len(after) != structure.n_states(model.theta):
        raise refused(model, "its states are not those of the chain")
    lines = [*program.lines([*after, *out])]
    lines += [*assigned("out", out, operator="+="), *assigned("x", after, first)]
    body = [f"    {line}" for line in lines]
    words = [
        "x holds the states of the core and of the effects, drives on their way, time, angles;",
        "v the inputs.",
    ]
    if given is None:
        return CBody(at, tuple(words), tuple(body), mathematical=True)
    words += ["The drive of the core comes from a model of its own, whose states come first in x."]
    return CBody(at, tuple(words), (*given.body, *body), given.support, mathematical=True)


def _driving(model: Model, given: GivenBase, write: Callable[[Model], CBody]) -> CBody:
    """The model that drives the core, as a function, and the lines that make ``drive[]`` of it.

    d = (y⁺ + f y) / ((1 + f) K): y⁺ is known once the input is, because the model does not answer
    within the sample.
    """
    inner = write(replace(model, structure=given.structure, theta=given.theta))
    n, ny = inner.n_states, len(given.y0)
    support = [
        *inner.support,
        "/* The outputs of the model that drives the core, and its states one sample later. */",
        f"static void driving(double x[{max(n, 1)}], const double v[PLANT_INPUTS],",
        f"                    double out[{ny}])",
        "{",
        *inner.body,
        "}",
        "",
    ]
    body = [
        f"    double drive[{ny}], first[{ny}], second[{ny}], ahead[{max(n, 1)}];",
        "    const double rest[PLANT_INPUTS] = {0.0};",
        "    int i;",
        *(f"    v[{j}] = v[{j}]{minus(o)};" for j, o in enumerate(given.u0) if o),
        *(f"    first[{i}] = second[{i}] = {number(o)};" for i, o in enumerate(given.y0)),
        "    driving(x, v, first);",
        f"    for (i = 0; i < {n}; i++)",
        "        ahead[i] = x[i];",
        "    driving(ahead, rest, second);",
    ]
    for i, (f, k) in enumerate(zip(given.pole, given.gain, strict=True)):
        body.append(
            f"    drive[{i}] = (second[{i}] + {factor(f)} * first[{i}]) / {factor((1.0 + f) * k)};"
        )
    return CBody(n, (), tuple(body), tuple(support), mathematical=inner.mathematical)
