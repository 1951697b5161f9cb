"""The numbers of a plant as members of a struct of C: their names, units and words."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from sysid.data.record import Array, Channel
from sysid.export.c.fields import Field
from sysid.export.c.names import distinct
from sysid.fitting.problem import Parameter
from sysid.runners.trace.program import Program, constant
from sysid.runners.trace.traced import WRITTEN_OUT, Traced
from sysid.structures import special_runs
from sysid.structures.augmented.given_base import GivenBase
from sysid.structures.augmented.structure import Augmented
from sysid.structures.base import Structure
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.model import Model
from sysid.structures.plant import Step

STRUCT = "parameters->"
_COUNT = re.compile(r"\d+")


@dataclass(frozen=True, eq=False)
class PlantNumbers:
    """θ and the operating point as values of a program, and as members of a struct.

    Attributes:
        theta: θ, behind it that of a model inside, (n,).
        u_offset, y_offset: the operating point, (nu,) and (ny,).
    """

    theta: Traced
    u_offset: Traced
    y_offset: Traced
    fields: tuple[Field, ...]

    def read_in(self, text: str) -> tuple[Field, ...]:
        """Members that lines of C read."""
        read = set(re.findall(rf"{STRUCT}(\w+)", text))
        return tuple(f for f in self.fields if f.name in read)


def theta_numbers(model: Model) -> list[Field]:
    """θ of a model, behind it that of the model that its effects are added to."""
    return list(
        _theta_numbers(model.structure, model.parameters, model.theta, model.inputs, model.outputs)
    )


def _theta_numbers(
    structure: Structure,
    parameters: Sequence[Parameter],
    theta: Array,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
) -> Iterator[Field]:
    constants = structure.physics.constants if isinstance(structure, GreyBox) else ()
    known = {c.name: c.words for c in constants}
    for p, value in zip(parameters, theta, strict=True):
        words = known.get(p.name.partition("[")[0], "")
        said = f"{p.name}: {words}" if words else p.name
        yield Field(p.name, p.unit, said, values=(float(value),))
    base = structure.given if isinstance(structure, Augmented) else None
    if base is not None:
        own_parameters = base.structure.parameters(inputs, outputs)
        for n in _theta_numbers(base.structure, own_parameters, base.theta, inputs, outputs):
            yield replace(n, name=f"base.{n.name}", words=f"base, {n.words}")


def plant_numbers(program: Program, model: Model, fixed: Iterable[int] | None) -> PlantNumbers:
    """The numbers of a model, those that C may change as values of a program.

    An operating point of zero is none. A long row of numbers that are called alike but for what
    counts them (the weights of a network) is one array.

    Args:
        fixed: entries of θ that stay numbers; None for all.
    """
    theta = theta_numbers(model)
    kept = set(range(len(theta)) if fixed is None else fixed)
    point = [
        Field(
            f"{letter}0[{c.name}]", c.unit, f"operating point of {c.name}", values=(float(value),)
        )
        for letter, channels, offsets in (
            ("u", model.inputs, model.detrend.u_offset),
            ("y", model.outputs, model.detrend.y_offset),
        )
        for c, value in zip(channels, offsets, strict=True)
    ]
    every = [*theta, *point]
    free = [k for k in range(len(theta)) if k not in kept]
    free += [k for k in range(len(theta), len(every)) if every[k].value != 0.0]
    cells = np.empty(len(every), dtype=object)
    cells[:] = [constant(n.value) for n in every]
    groups = list(_groups(free, every))
    # neighbours are called without what counts them
    names = distinct(
        every[g[0]].name if len(g) == 1 else _COUNT.sub("", every[g[0]].name) for g in groups
    )
    fields = []
    for name, group in zip(names, groups, strict=True):
        first, last = every[group[0]], every[group[-1]]
        values = tuple(every[k].value for k in group)
        if len(group) == 1:
            fields.append(Field(name, first.unit, first.words, 0, values))
            cells[group[0]] = program.parameter(f"{STRUCT}{name}", first.value)
            continue
        words = f"{first.name} ... {last.name}"
        fields.append(Field(name, first.unit, words, len(group), values))
        for at, k in enumerate(group):
            array = f"{STRUCT}{name}"
            cells[k] = program.parameter(f"{array}[{at}]", every[k].value, (array, at))
    n, nu = len(theta), len(model.inputs)
    return PlantNumbers(
        Traced(cells[:n]), Traced(cells[n : n + nu]), Traced(cells[n + nu :]), tuple(fields)
    )


def _groups(free: Sequence[int], every: Sequence[Field]) -> Iterator[list[int]]:
    """Neighbours that are called alike, where they are many; else each by itself."""

    def alike(k: int) -> tuple[str, str]:
        return _COUNT.sub("#", every[k].name), every[k].unit

    for _, alike_entries in groupby(free, alike):
        group = list(alike_entries)
        if len(group) > WRITTEN_OUT:
            yield group
        else:
            yield from ([k] for k in group)


# ------------------------------------------------------------------------------ a step of cells


def traced_step(structure: Structure, theta: Any, like: Array) -> Step:
    """The step of a structure whose θ is recorded, (x, u) → (x⁺, y).

    Args:
        theta: of it, and of the model inside.
        like: θ as numbers.
    """
    n = len(like)
    if isinstance(structure, Augmented) and structure.given is not None:
        base = _TracedBase(**vars(structure.given), traced=theta[n:])
        structure = replace(structure, given=base)
    classes = type(structure).__mro__
    traced = next(c for c in classes if c in special_runs.traced_step.registry)
    own_step = next(c for c in classes if "step" in vars(c))
    if issubclass(traced, own_step):
        return special_runs.traced_step(structure, theta[:n], like)
    return structure.step(theta[:n])  # whose author knows of no other way


@dataclass(frozen=True, eq=False)
class _TracedBase(GivenBase):
    """A model inside, whose θ is recorded, too."""

    traced: Any

    def step(self) -> Step:
        return self.around(traced_step(self.structure, self.traced, self.theta))
