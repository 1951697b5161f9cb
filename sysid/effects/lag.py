"""A signal that follows another with a lag of first order: λ ẏ = x − y."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid.data.filtering import lfilter
from sysid.effects.base import Signal

SHORTEST = 1e-12
"""A lag [s] that is none."""

AT_ONCE, ENDLESS = 1e-9, 1.0 - 1e-6
"""A track that keeps so little of its speed in a sample follows at once; one that keeps so much
never comes to rest, and is no motion of first order."""

NO_TIME = 1e-9
"""A step of so small a share of the lag changes nothing; one of none would be 0/0."""


def lagging(xp: Any, p: Mapping[str, Signal], dt: float, kept: Signal) -> dict[str, Signal]:
    """Weights of one sample for the parameter ``lag``, exact for an x that runs straight.

        y(k) = decay y(k−1) + earlier x(k−1) + now x(k)

    Args:
        dt: time since the sample before [s].
    """
    x = xp.maximum(dt / xp.maximum(p["lag"], SHORTEST), NO_TIME)
    decay = xp.exp(-x)
    ramp = (1.0 - decay) / x
    return {"decay": decay, "earlier": ramp - decay, "now": 1.0 - ramp}


def lagging_drive(xp: Any, p: Mapping[str, Signal], dt: float, kept: Signal) -> dict[str, Signal]:
    """Weights of one sample for a drive that follows a held command, ahead of a first-order motion.

    Over a sample the drive is u + (d − u) e^(−s/λ), and a speed of time constant T weighs each
    instant by what of it has not died away at the end. The held drive that has the same effect is

        u + late (d − u),    late = z D/(1 − α),    D = (e^(−x) − e^(−z))/(z − x),

    x = dt/λ, z = dt/T, α = e^(−z). Without a motion behind it, late is the mean, (1 − e^(−x))/x.

    Args:
        p: parameters of the effect; ``lag`` [s].
        dt: time since the sample before [s].
        kept: α, the share of its speed that a track keeps in a sample.
    """
    x = _samples(xp, p["lag"], dt)
    share = -xp.expm1(-x)
    follows, alpha, z = _motion(xp, kept)
    late = xp.where(follows, z * _both_died(xp, x, z) / (1.0 - alpha), share / x)
    return {"share": share, "late": late}


def lagging_reading(xp: Any, p: Mapping[str, Signal], dt: float, kept: Signal) -> dict[str, Signal]:
    """Weights of one sample for a reading that follows a speed of a first-order motion, exactly.

        y(k) = decay y(k−1) + earlier ω(k−1) + now ω(k)

    The speed runs from ω(k−1) to ω(k) as 1 − e^(−s/T), so now = (1 − e^(−x) − x D)/(1 − α) with
    the terms of ``lagging_drive``. Without such a motion it runs straight.

    Args:
        xp, p, dt, kept: as of ``lagging_drive``.
    """
    x = _samples(xp, p["lag"], dt)
    straight = lagging(xp, p, dt, kept)
    follows, alpha, z = _motion(xp, kept)
    bent = (-xp.expm1(-x) - x * _both_died(xp, x, z)) / (1.0 - alpha)
    now = xp.where(follows, bent, straight["now"])
    return {"decay": straight["decay"], "earlier": 1.0 - straight["decay"] - now, "now": now}


def _samples(xp: Any, lag: Signal, dt: float) -> Signal:
    return xp.maximum(dt / xp.maximum(lag, SHORTEST), NO_TIME)


def _motion(xp: Any, kept: Signal) -> tuple[Signal, Signal, Signal]:
    """Whether a first-order motion follows, the share α that it keeps, and −ln α."""
    follows = kept < ENDLESS
    alpha = xp.where(follows, xp.maximum(kept, AT_ONCE), 0.5)
    return follows, alpha, -xp.log(alpha)


def _both_died(xp: Any, x: Signal, z: Signal) -> Signal:
    """(e^(−x) − e^(−z))/(z − x), which is e^(−x) where both are the same."""
    apart = xp.maximum(xp.abs(x - z), NO_TIME)
    return xp.exp(-xp.minimum(x, z)) * -xp.expm1(-apart) / apart


def followed(signal: Signal, lag: float, dt: float) -> Signal:
    """What follows a record's signals (N, …) with a lag [s], from rest or steady motion, (N, …)."""
    if lag <= 0.0:
        return signal
    k = lagging(np, {"lag": lag}, dt, 0.0)
    before = (k["decay"] + k["earlier"]) * signal[:1]
    return lfilter([k["now"], k["earlier"]], [1.0, -k["decay"]], signal, axis=0, zi=before)[0]
