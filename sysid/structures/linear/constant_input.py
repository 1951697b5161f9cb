"""An offset as an ordinary parameter: the constant 1 as one more input of a linear structure.

    A y = Σ (B_j/F_j) u_j + c·1 + (C/D) e

With it ARX stays linear, and starts, gradients, covariance and searches of orders need to know
nothing of offsets. The output's offset where the inputs are zero is y₀ = A(1)⁻¹ c.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from sysid.data.record import Array, Channel, Index, Record
from sysid.fitting.problem import Parameter
from sysid.structures.linear.polynomial import PolynomialStructure

Linear = TypeVar("Linear", bound=PolynomialStructure)

ONES = Channel("1")
"""The further input."""


def with_constant(structure: Linear, outputs: Sequence[bool]) -> Linear:
    """The structure with the constant as its last input, in the equations of these outputs."""
    o = structure.orders
    rows = [int(wanted) for wanted in outputs]
    orders = replace(
        o,
        nb=tuple((*row, n) for row, n in zip(o.nb, rows, strict=True)),
        nf=tuple((*row, 0) for row in o.nf),
        nk=tuple((*row, 0) for row in o.nk),
        constant=True,
    )
    return replace(structure, orders=orders)


def without_constant(structure: Linear) -> Linear:
    """Undo ``with_constant``."""
    o = structure.orders
    if not o.constant:
        return structure
    orders = replace(
        o,
        nb=tuple(row[:-1] for row in o.nb),
        nf=tuple(row[:-1] for row in o.nf),
        nk=tuple(row[:-1] for row in o.nk),
        constant=False,
    )
    return replace(structure, orders=orders)


def constant_places(wide: PolynomialStructure) -> tuple[Index, Index]:
    """Entries of θ that are the constant's coefficients, and the outputs they belong to."""
    places, outputs = [], []
    for i in range(wide.ny):
        _, b, *_ = wide.layout(i).slices()
        if b[-1].stop > b[-1].start:
            places.append(int(wide.row_index(i)[b[-1].start]))
            outputs.append(i)
    return np.array(places, dtype=np.intp), np.array(outputs, dtype=np.intp)


def widened(
    wide: PolynomialStructure, parameters: Sequence[Parameter], outputs: Sequence[Channel]
) -> tuple[Parameter, ...]:
    """The parameters of the plain structure with the constants' at their places."""
    parameters_with_constant = list(parameters)
    for place, i in zip(*constant_places(wide), strict=True):
        parameters_with_constant.insert(
            int(place), Parameter(f"offset[{outputs[i].name}]", outputs[i].unit)
        )
    return tuple(parameters_with_constant)


def widened_theta(wide: PolynomialStructure, theta: Array) -> Array:
    """θ of the plain structure with a zero at the constants' places."""
    theta_with_constant = theta.tolist()
    for place in constant_places(wide)[0]:
        theta_with_constant.insert(int(place), 0.0)
    return np.array(theta_with_constant, dtype=np.float64)


def with_ones(record: Record) -> Record:
    """The record with the constant 1 as its last input."""
    return replace(
        record,
        u=np.column_stack([record.u, np.ones(len(record))]),
        inputs=(*record.inputs, ONES),
    )
