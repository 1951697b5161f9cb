"""Modes of a model: frequencies and time constants; those of a signal without inputs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.estimation.assessment.delta_method import Estimate, estimates
from sysid.structures import motion
from sysid.structures.model import Model

Poles = NDArray[np.complex128]
"""Poles in z, (n,)."""


@dataclass(frozen=True)
class OwnMode:
    """One mode of a signal: it oscillates, or it decays.

    Attributes:
        frequency: natural frequency [rad/s], None for a mode that only dies out.
        damping: damping ratio, None for such a mode.
        time_constant: of a mode that only dies out [s], else None.
    """

    frequency: Estimate | None
    damping: Estimate | None
    time_constant: Estimate | None


def mode_numbers(poles: Poles, like: Poles, dt: float) -> list[float]:
    """Of every mode its time constant, or its natural frequency and its damping.

    Poles p = e^(s Ts) with s = −ζω ± jω√(1 − ζ²), or s = −1/T. The poles at θ̂, ``like``, decide
    which of them: near a double root a real pair turns complex and back with the smallest change
    of θ, and the numbers must stay the same ones.

    Args:
        poles: at some θ, of which the nearest to each of ``like`` counts.
    """
    numbers: list[float] = []
    for p in like:
        s = np.log(complex(poles[np.argmin(np.abs(poles - p))])) / dt
        if p.imag:
            numbers += [float(abs(s)), float(-s.real / abs(s))]
        else:
            numbers.append(float(-1.0 / s.real) if s.real else float("inf"))
    return numbers


def modes_of(poles: Poles, numbers: Iterator[Estimate]) -> tuple[OwnMode, ...]:
    """The modes of poles from the ``mode_numbers`` that follow."""
    return tuple(
        OwnMode(next(numbers), next(numbers), None)
        if p.imag
        else OwnMode(None, None, next(numbers))
        for p in poles
    )


def own_modes(model: Model) -> tuple[OwnMode, ...]:
    """The modes of a model without inputs with their standard errors, the slowest first.

    Poles that are negative or at the origin mean nothing in continuous time and are left out.

    Args:
        model: a fitted model; nothing is said of one with inputs.
    """
    if model.inputs:
        return ()

    def poles(theta: Array) -> Poles:
        return motion.poles(model.structure, theta)

    kept = [p for p in poles(model.theta) if p.imag > 0.0 or (p.imag == 0.0 and p.real > 0.0)]
    like = np.array(sorted(kept, key=lambda p: -abs(p)))

    def numbers(theta: Array) -> Array:
        return np.array(mode_numbers(poles(theta), like, model.dt))

    return modes_of(like, estimates(model, numbers))
