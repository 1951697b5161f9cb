"""A signal that follows another with a lag of first order: λ ẏ = x − y."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid.data.filtering import lfilter
from sysid.effects.base import Signal

SHORTEST = 1e-12
"""A lag [s] that is none."""

NO_TIME = 1e-9
"""A step of so small a share of the lag changes nothing; one of none would be 0/0."""


def lagging(xp: Any, p: Mapping[str, Signal], dt: float, kept: Signal) -> dict[str, Signal]:
    """Weights of one sample for the parameter ``lag``, exact for an x that runs straight.

        y(k) = decay y(k−1) + earlier x(k−1) + now x(k)

    Args:
        xp: array namespace.
        p: numbers of the effect.
        dt: time since the sample before [s].
        kept: not used.
    """
    x = xp.maximum(dt / xp.maximum(p["lag"], SHORTEST), NO_TIME)
    decay = xp.exp(-x)
    ramp = (1.0 - decay) / x
    return {"decay": decay, "earlier": ramp - decay, "now": 1.0 - ramp}


def followed(signal: Signal, lag: float, dt: float) -> Signal:
    """What follows a record's signals (N, …) with a lag [s], from rest or steady motion, (N, …)."""
    if lag <= 0.0:
        return signal
    k = lagging(np, {"lag": lag}, dt, 0.0)
    before = (k["decay"] + k["earlier"]) * signal[:1]
    return lfilter([k["now"], k["earlier"]], [1.0, -k["decay"]], signal, axis=0, zi=before)[0]
