"""Effects by which the body couples the tracks.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Hints,
    Law,
    Memory,
    Place,
    Signal,
    State,
    Texts,
)
from sysid.effects.programmes import ONE_AND_OTHER, REVERSALS

P = Mapping[str, Signal]


def _coupling(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # resistance to turning at the difference of the speeds amid the step
    amid = 0.5 * (c.w + c.w_free + c.b * torque)
    free, damped = amid - _of_both(amid), 0.5 * _of_both(c.b * p["turning"])
    turning = free / (1.0 + damped)
    # where tracks slide: δ (1 + k/(1 + |δ|/s)) = free, in |δ| a quadratic equation where both
    # slide alike; two steps of Newton's method where they do not
    over = xp.abs(free) / xp.maximum(_of_both(p["sliding"]), 1e-6)
    half = 1.0 + damped - over
    slid = 2.0 * free / (half + xp.sqrt(half**2 + 4.0 * over))
    for _ in range(2):
        remaining = _before_sliding(xp, slid, p)
        over = slid * (1.0 + 0.5 * _of_both(c.b * p["turning"] * remaining)) - free
        slid = slid - over / (1.0 + 0.5 * _of_both(c.b * p["turning"] * remaining**2))
    turning = xp.where(p["of_rate"] > 1.5, slid * _before_sliding(xp, slid, p), turning)
    return torque - p["share"] * c.torque_other - p["turning"] * turning, s


def _before_sliding(xp: Any, turning: Signal, p: P) -> Signal:
    """What is left of the resistance to turning where tracks slide: 1/(1 + |δ|/s)."""
    return 1.0 / (1.0 + xp.abs(turning) / xp.maximum(p["sliding"], 1e-6))


def _against_coupling(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """The x with x_i − g_i x_j = T_i of both tracks; with T_i + v_i δ_i for T_i.

    δ_i = (ω_i − ω_j)/2, times what is left of it where tracks slide.
    """
    share = p["share"]
    if share.shape[-1] != 2:
        return torque
    apart = 0.5 * (c.w - c.w[..., ::-1])
    remaining = xp.where(p["of_rate"] > 1.5, _before_sliding(xp, apart, p), 1.0)
    torque = torque + p["turning"] * apart * remaining
    return (torque + share * torque[..., ::-1]) / (1.0 - share * share[..., ::-1])


def _of_both(x: Signal) -> Signal:
    """The mean of both tracks; of one its own."""
    return 0.5 * (x[..., :1] + x[..., -1:])


def _together(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    """Shares of the deviations from steady speed that a sample leaves.

    ``own`` and ``other``: exp(−M⁻¹ dt) of M = [[τ_1, m], [m, τ_2]], m = μ √(τ_1 τ_2), in closed
    form.

    The others are of a body that the tracks pull through ground that gives, for both on average:
    straight on (+) and turning (−) the track keeps the inertia ι τ, ι = wheel (1 − |μ|), and the
    body has the rest of τ (1 ± μ); the damper is such that the heavier way follows with ``lag``.
    """
    if kept.shape[-1] != 2:
        return {"own": kept, "other": 0.0 * kept} | dict.fromkeys(_SOFT, 0.0 * kept)
    rate = -xp.log(xp.maximum(kept, 1e-9))  # dt/τ
    free = 1.0 / (1.0 - p["share"] ** 2)
    mean = 0.5 * free * (rate + rate[..., ::-1])
    half = 0.5 * free * (rate - rate[..., ::-1])
    mixed = free * p["share"] * xp.sqrt(rate * rate[..., ::-1])
    apart = xp.sqrt(half**2 + mixed**2 + 1e-12)
    ratio = xp.exp(-mean) * xp.sinh(apart) / apart
    rigid = {"own": xp.exp(-mean) * xp.cosh(apart) - ratio * half, "other": ratio * mixed}
    share, wheel = p["share"], p["wheel"] * (1.0 - xp.abs(p["share"]))
    per_sample = _of_both(rate)
    body = 1.0 - wheel - xp.abs(share)
    damper = (body + 2.0 * xp.abs(share)) * dt / (per_sample * xp.maximum(p["lag"], 1e-2 * dt))
    soft = {"alone": xp.exp(-per_sample)}
    for name, sign in (("straight", 1.0), ("turning", -1.0)):
        carried = body + xp.abs(share) + sign * share
        weights = _mode(xp, per_sample, wheel, carried, damper)
        soft |= {f"{name}_{part}": w for part, w in zip(_PARTS, weights, strict=True)}
    return rigid | soft


_PARTS = ("of_track", "of_body", "body_of_track", "body_of_body")
_SOFT = ("alone", *(f"{mode}_{part}" for mode in ("straight", "turning") for part in _PARTS))


def _mode(xp: Any, rate: Signal, wheel: Signal, body: Signal, damper: Signal) -> tuple[Signal, ...]:
    """exp(A dt) of a track that pulls a body through a damper, by rows.

    ι τ ω̇ = T − ω − D (ω − z), m τ ż = D (ω − z), with deviations of ω and z from T; both
    eigenvalues are real and negative.
    """
    a, c = rate / wheel, damper * rate / body
    fast, det = 0.5 * (a * (1.0 + damper) + c), a * c
    apart = xp.sqrt(xp.maximum(fast**2 - det, 1e-12))
    second = fast + apart
    first = det / second
    slow, quick = xp.exp(-first), xp.exp(-second)
    each = (slow - quick) / (2.0 * apart)  # E = slow I + each (A + first I)
    return (
        slow + each * (first - a * (1.0 + damper)),
        each * a * damper,
        each * c,
        slow + each * (first - c),
    )


ROUNDING = 1e-9
"""Share of what friction takes below which a speed is zero."""


def _inertia(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    """The coupled motion; dry friction of a track takes of the other one's push what it can hold.

    The chain has stepped each track by itself. Where it stood, or its friction stopped it, the push
    is added to the torque that friction had to hold: at most ``holds``, it stays and the other one
    moves as if alone; beyond, it slides. A track that the push takes through zero feels friction
    from the other side for the rest of the sample.
    """
    if w.shape[-1] != 2:
        return w, s
    (body,) = s
    soft, hold = p["soft"] > 0.5, c.b * c.holds
    stopped = xp.minimum(xp.abs(w), xp.abs(c.w)) < ROUNDING * hold
    acting = (w - c.w_free) / c.b
    change, _ = _pushed(xp, c.w - xp.where(stopped, c.torque, acting), body, p, c)
    free = c.w_free + c.b * c.torque + change
    stays = stopped & (xp.abs(free) <= hold)
    stands = stays[..., :1] | stays[..., 1:]
    acting = xp.where(stopped, c.torque - c.holds * xp.sign(free), acting)
    change, carried = _pushed(xp, c.w - acting, body, p, c)
    moved = c.w_free + c.b * acting + change
    turned = (moved * c.w < 0.0) & (w * c.w > 0.0)
    rest = moved / xp.where(turned, moved - c.w, 1.0)  # share of the sample behind zero
    slowed = xp.maximum(xp.abs(moved) - 2.0 * rest * hold, 0.0) * xp.sign(moved)
    moved = xp.where(turned, slowed, moved)
    moved = xp.where(stands, xp.where(stays, 0.0, w), moved)
    moved = xp.where((p["share"] == 0.0) & ~soft, w, moved)
    return moved, (xp.where(stands | ~soft, moved, acting + carried),)


def _pushed(xp: Any, deviation: Signal, body: Signal, p: P, c: Context) -> tuple[Signal, Signal]:
    """What coupling changes in a sample, and the body's own deviation after it.

    Args:
        deviation: from the speeds that the torques hold.
        body: its speeds at the tracks.
    """
    # both less one is the other: turning the tracks round would cost most of a compiled step
    other = deviation[..., :1] + deviation[..., 1:] - deviation
    rigid = (p["own"] - (1.0 - c.b)) * deviation + p["other"] * other
    behind = deviation + body - c.w
    mean, mean_behind = _of_both(deviation), _of_both(behind)
    turns, led = deviation - mean, behind - mean_behind
    track = p["straight_of_track"] * mean + p["straight_of_body"] * mean_behind
    track = track + p["turning_of_track"] * turns + p["turning_of_body"] * led
    carried = p["straight_body_of_track"] * mean + p["straight_body_of_body"] * mean_behind
    carried = carried + p["turning_body_of_track"] * turns + p["turning_body_of_body"] * led
    return xp.where(p["soft"] > 0.5, track - p["alone"] * deviation, rigid), carried


EFFECTS = (
    Effect(
        "cross-coupling",
        "motor",
        Place.TORQUE,
        Texts(
            "T → T − g T_other, or T → T − v δ or T − v δ/(1 + |δ|/s) with δ = (ω − ω_other)/2",
            "One side's torque loads the other through the body.",
            "A side gives way a little whenever the other one pulls.",
            "One side at a constant command while the other steps.",
            opposite="One side's torque helps the other through the body.",
        ),
        (
            EffectParameter("share", "", 0.0, -0.6, 0.6, (0.1, -0.1) + (0.0,) * 3),
            EffectParameter("turning", "", 0.0, 0.0, 30.0, (0.0, 0.0, 0.3, 1.0, 3.0)),
            EffectParameter("sliding", "speed", 0.0, 0.0, 10.0, (0.0,) * 3 + (0.3, 0.1)),
            EffectParameter("of_rate", "", 0.0, 0.0, 2.0, (0.0, 0.0, 1.0, 2.0, 2.0), choice=True),
        ),
        _coupling,
        laws=(
            Law(("share",), choices={"of_rate": 0.0}),
            Law(
                ("turning",),
                choices={"of_rate": 1.0},
                sentence="It resists turning in proportion to the rate, as soft ground does.",
            ),
            Law(
                ("turning", "sliding"),
                choices={"of_rate": 2.0},
                sentence="It resists turning, ever less in addition as the tracks slide sideways.",
            ),
        ),
        inverse=_against_coupling,
        couples=True,
        hints=Hints(
            programmes=(ONE_AND_OTHER, REVERSALS),
        ),
    ),
    Effect(
        "inertial-coupling",
        "motor",
        Place.SPEED,
        Texts(
            "τ ω̇ = T − ω − m ω̇_other, m = μ √(τ τ_other), or with a body at z that follows "
            "through a damper: ι τ ω̇ = T − ω − D (ω − z)",
            "The body's mass and yaw inertia tie both sides: one speeds up, the other feels it.",
            "A side twitches whenever the other one speeds up or slows down, not while it pulls.",
            "One side at a constant command while the other steps, then both together and opposed.",
        ),
        (
            EffectParameter("share", "", 0.0, -0.9, 0.9, (0.25, -0.25, 0.3, -0.4)),
            EffectParameter("wheel", "", 0.3, 0.01, 0.99, (0.3,) * 4, at_limit=True),
            EffectParameter("lag", "s", 0.0, 0.0, 300.0, (0.0, 0.0, 5.0, 5.0), in_samples=True),
            EffectParameter("soft", "", 0.0, 0.0, 1.0, (0.0, 0.0, 1.0, 1.0), choice=True),
        ),
        _inertia,
        _together,
        memory=Memory(
            1,
        ),
        laws=(
            Law(("share",), choices={"soft": 0.0}),
            Law(
                ("share", "wheel", "lag"),
                choices={"soft": 1.0},
                sentence="The body follows the tracks late, as on soft ground.",
            ),
        ),
        shared=True,
        couples=True,
        hints=Hints(
            programmes=(ONE_AND_OTHER, REVERSALS),
        ),
    ),
)
