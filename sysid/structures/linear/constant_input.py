"""An offset as an ordinary parameter: the constant 1 as one more input of a linear structure.

    A y = Σ (B_j/F_j) u_j + c·1 + (C/D) e

With it ARX stays linear, and starts, gradients, covariance and searches of orders need to know
nothing of offsets. The output's offset where the inputs are zero is y₀ = A(1)⁻¹ c.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Channel, Record
from sysid.fitting.problem import Parameter
from sysid.structures.linear.base import LinearStructure

ONES = Channel("1")
"""The further input."""


def widened(
    wide: LinearStructure, parameters: Sequence[Parameter], outputs: Sequence[Channel]
) -> tuple[Parameter, ...]:
    """The parameters of the plain structure with the constants' at their places."""
    parameters_with_constant = list(parameters)
    for place, i in zip(*wide.constant_places(), strict=True):
        parameters_with_constant.insert(
            int(place), Parameter(f"offset[{outputs[i].name}]", outputs[i].unit)
        )
    return tuple(parameters_with_constant)


def widened_theta(wide: LinearStructure, theta: Array) -> Array:
    """θ of the plain structure with a zero at the constants' places."""
    theta_with_constant = theta.tolist()
    for place in wide.constant_places()[0]:
        theta_with_constant.insert(int(place), 0.0)
    return np.array(theta_with_constant, dtype=np.float64)


def with_ones(record: Record) -> Record:
    """The record with the constant 1 as its last input."""
    return replace(
        record,
        u=np.column_stack([record.u, np.ones(len(record))]),
        inputs=(*record.inputs, ONES),
    )
