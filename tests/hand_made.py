"""Models put together from a structure and its parameters, without a fit."""

from dataclasses import replace

import numpy as np

from sysid.criteria.table import BUILT_IN
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel
from sysid.errors import Termination
from sysid.structures.base import Structure
from sysid.structures.model import Model

DT = 0.05


def channels(letter: str, n: int) -> tuple[Channel, ...]:
    """u or y alone, else u1, u2 …"""
    return tuple(Channel(letter if n == 1 else f"{letter}{k + 1}", "V") for k in range(n))


def hand_made(
    structure: Structure,
    theta: Array,
    offsets: tuple[float, float] = (0.0, 0.0),
    reach: tuple[float, float] = (-1.0, 1.0),
    unit: str | None = None,
) -> Model:
    """A model whose numbers are given; ``offsets`` are those of all inputs and of all outputs.

    Args:
        structure: what it is.
        theta: its parameters.
        offsets: operating point.
        reach: range of the inputs about the operating point.
        unit: of all outputs, where it matters.
    """
    nu, ny = structure.nu, structure.ny
    inputs, outputs = channels("u", nu), channels("y", ny)
    if unit is not None:
        outputs = tuple(replace(c, unit=unit) for c in outputs)
    theta = np.asarray(theta, dtype=np.float64)
    parameters = structure.parameters(inputs, outputs)
    assert len(parameters) == len(theta)
    low, high = reach
    return Model(
        structure=structure,
        theta=theta,
        covariance=np.eye(len(theta)),
        parameters=parameters,
        dt=DT,
        inputs=inputs,
        outputs=outputs,
        detrend=Detrend(np.full(nu, offsets[0]), np.full(ny, offsets[1])),
        noise_covariance=np.eye(ny),
        n_estimated=len(theta),
        criteria={n: 0.0 for n, c in BUILT_IN.items() if c.value is not None},
        termination=Termination.CONVERGED_COST,
        ranges=np.array([[offsets[0] + low, offsets[0] + high]] * nu + [[-10.0, 10.0]] * ny),
    )
