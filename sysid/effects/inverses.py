"""Inverses of effects: the signal before an effect that gives the wanted signal behind it."""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import Context, Signal

P = Mapping[str, Signal]

EMPTY = 0.1
"""Share of its strength below which no command makes up for an empty battery."""

STANDS = 0.05
"""Share of the larger of speed and torque below which a track counts as at standstill: there
friction acts against the torque, otherwise against the motion."""


def out_of_dead_zone(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """d → sign(d)(δ± + |d| − j); of what lies within the jump, the nearer of 0 and j."""
    width = xp.where(d >= 0.0, p["plus"], p["minus"])
    size = xp.abs(d)
    beyond = width + xp.maximum(size - p["jump"], 1e-9)
    return xp.sign(d) * xp.where(size > 0.5 * p["jump"], beyond, 0.0)


def within_saturation(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """d → clip(d, −s−, s+): no command does more."""
    return xp.minimum(xp.maximum(d, -p["minus"]), p["plus"])


CUBIC_STEPS = 12
"""Newton's steps on x − κ x³ = d; from x = d they come from one side and end at rounding, but for
the last percent before the most that there is."""


def out_of_concave(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """The smaller x with x(1 − κ|x|) = d, or x(1 − κ x²) = d; beyond, the x that gives most."""
    kappa, size = p["kappa"], xp.abs(d)
    # the root as a quotient, which κ = 0 does not upset
    root = xp.sqrt(xp.maximum(1.0 - 4.0 * kappa * size, 0.0))
    bent = xp.minimum(2.0 * size / (1.0 + root), 0.5 / xp.maximum(kappa, 1e-9))
    most = 1.0 / xp.sqrt(3.0 * xp.maximum(kappa, 1e-9))
    x = xp.minimum(size, most)
    for _ in range(CUBIC_STEPS):
        slope = xp.maximum(1.0 - 3.0 * kappa * x * x, 1e-3)
        x = xp.minimum(x - (x * (1.0 - kappa * x * x) - size) / slope, most)
    return xp.sign(d) * xp.where(p["cubic"] > 0.5, x, bent)


def out_of_direction(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """d → d/ρ for d < 0."""
    return xp.where(d < 0.0, d / p["rho"], d)


def charged(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """d → d/(1 − b t); of a charge that is taken nothing is known ahead."""
    loss = xp.where(p["charge"] > 0.5, 0.0, p["loss"])
    return d / xp.maximum(1.0 - loss * c.t, EMPTY)


def through_dead_time(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + δ K clip(i/ρ, ±1), i = T − ε ω; none where nothing is wanted."""
    full = xp.abs(c.gain)
    way = (torque - p["emf"] * c.w) / xp.maximum(p["ripple"] * full, 1e-9)
    lost = p["share"] * full * xp.minimum(xp.maximum(way, -1.0), 1.0)
    return torque + xp.where(torque == 0.0, 0.0, lost)


def _onward(xp: Any, torque: Signal, c: Context) -> Signal:
    """The direction against which friction acts: that of the motion, at rest that of the torque.

    None where nothing is wanted: there friction may do its work.
    """
    moves = xp.abs(c.w) > STANDS * xp.maximum(xp.abs(c.w), xp.abs(torque))
    onward = xp.where(moves, xp.sign(c.w), xp.sign(torque))
    return xp.where(torque == 0.0, 0.0, onward)


def against_coulomb(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """The x with x − (c + s |x − ω|) sign ω = T, in the direction against which friction acts.

    Of a servo the set point beyond the wanted one, T + c sign(T − y).
    """
    way = _onward(xp, torque, c)
    wanted = torque - c.w + p["level"] * way
    against = xp.where(wanted * way >= 0.0, 1.0 - p["of_load"], 1.0 + p["of_load"])
    short = torque + p["level"] * xp.sign(torque - c.w)
    return xp.where(p["of_servo"] > 0.5, short, c.w + wanted / against)


def against_stiction(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + c + c_s e^{−(ω/v)²} in the direction against which friction acts."""
    slow = xp.exp(-((c.w / p["speed"]) ** 2))
    return torque + (p["level"] + p["excess"] * slow) * _onward(xp, torque, c)


def against_drag(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + q ω|ω|."""
    return torque + p["drag"] * c.w * xp.abs(c.w)


def against_bias(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + b."""
    return torque + p["load"]


def against_viscous(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + (ratio − 1) min(ω, 0), or (T + ε (ratio² − 1) min(ω, 0))/ratio for ω < 0."""
    constant, w = p["by_constant"] > 0.5, xp.minimum(c.w, 0.0)
    more = xp.where(constant, p["emf"] * (p["ratio"] ** 2 - 1.0), p["ratio"] - 1.0)
    return (torque + more * w) / xp.where(constant & (c.w < 0.0), p["ratio"], 1.0)


def before_sliding(xp: Any, turning: Signal, p: P) -> Signal:
    """What is left of the resistance to turning where tracks slide: 1/(1 + |δ|/s)."""
    return 1.0 / (1.0 + xp.abs(turning) / xp.maximum(p["sliding"], 1e-6))


def against_coupling(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """The x with x_i − g_i x_j = T_i of both tracks; with T_i + v_i δ_i for T_i.

    δ_i = (ω_i − ω_j)/2, times what is left of it where tracks slide.
    """
    share = p["share"]
    if share.shape[-1] != 2:
        return torque
    apart = 0.5 * (c.w - c.w[..., ::-1])
    remaining = xp.where(p["of_rate"] > 1.5, before_sliding(xp, apart, p), 1.0)
    torque = torque + p["turning"] * apart * remaining
    return (torque + share * torque[..., ::-1]) / (1.0 - share * share[..., ::-1])
