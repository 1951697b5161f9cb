"""Natural modes of a signal without inputs: frequencies and time constants."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.estimation.assessment.delta_method import delta_errors
from sysid.estimation.assessment.step_response import Estimate
from sysid.structures import motion
from sysid.structures.model import Model


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


def own_modes(model: Model) -> tuple[OwnMode, ...]:
    """The modes of a model without inputs with their standard errors, the slowest first.

    Poles p = e^(s Ts) with s = −ζω ± jω√(1 − ζ²), or s = −1/T; poles that are negative or at the
    origin mean nothing in continuous time and are left out.

    Args:
        model: a fitted model; nothing is said of one with inputs.
    """
    if model.inputs:
        return ()

    def poles(theta: Array) -> "np.ndarray[Any, Any]":
        return motion.poles(model.structure, theta)

    kept = [p for p in poles(model.theta) if p.imag > 0.0 or (p.imag == 0.0 and p.real > 0.0)]
    kept.sort(key=lambda p: -abs(p))

    def numbers(theta: Array) -> Array:
        modes: list[float] = []
        now = poles(theta)
        for p in kept:
            s = np.log(complex(now[np.argmin(np.abs(now - p))])) / model.dt
            modes += [abs(s), -s.real / abs(s)] if p.imag else [-1.0 / s.real if s.real else np.inf]
        return np.array(modes)

    centre = numbers(model.theta)
    errors = delta_errors(model, numbers, centre)
    rest = iter(Estimate(float(v), float(e)) for v, e in zip(centre, errors, strict=True))
    return tuple(
        OwnMode(next(rest), next(rest), None) if p.imag else OwnMode(None, None, next(rest))
        for p in kept
    )
