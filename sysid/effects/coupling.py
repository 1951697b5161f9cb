"""Effects by which the body ties its tracks to each other.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects import inverses
from sysid.effects.base import Context, Effect, EffectParameter, Law, Place, Signal, State
from sysid.effects.programmes import ONE_AND_OTHER, REVERSALS

P = Mapping[str, Signal]


def _coupling(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # resistance to turning at the difference of the speeds amid the step, in closed form
    amid = 0.5 * (c.w + c.w_free + c.b * torque)
    turning = (amid - _of_both(amid)) / (1.0 + 0.5 * _of_both(c.b * p["turning"]))
    return torque - p["share"] * c.torque_other - p["turning"] * turning, s


def _of_both(x: Signal) -> Signal:
    """The mean of both tracks; of one its own."""
    return 0.5 * (x[..., :1] + x[..., -1:])


def _together(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    """Shares of the deviations from steady speed that a sample leaves: own and the other's.

    exp(−M⁻¹ dt) of M = [[τ_1, m], [m, τ_2]], m = μ √(τ_1 τ_2), in closed form.
    """
    if kept.shape[-1] != 2:
        return {"own": kept, "other": 0.0 * kept}
    rate = -xp.log(xp.maximum(kept, 1e-9))  # dt/τ
    free = 1.0 / (1.0 - p["share"] ** 2)
    mean = 0.5 * free * (rate + rate[..., ::-1])
    half = 0.5 * free * (rate - rate[..., ::-1])
    mixed = free * p["share"] * xp.sqrt(rate * rate[..., ::-1])
    apart = xp.sqrt(half**2 + mixed**2 + 1e-12)
    ratio = xp.exp(-mean) * xp.sinh(apart) / apart
    return {"own": xp.exp(-mean) * xp.cosh(apart) - ratio * half, "other": ratio * mixed}


def _inertia(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    if w.shape[-1] != 2:
        return w, s
    deviation = c.w - (w - c.w_free) / c.b
    # a track that sticks neither feels the other one nor moves it
    stands = (w == 0.0) & (c.w == 0.0) & (xp.abs(c.torque) < c.holds)
    apart = (p["share"] == 0.0) | stands[..., :1] | stands[..., 1:]
    # both less one is the other: turning the tracks round would cost most of a compiled step
    other = deviation[..., :1] + deviation[..., 1:] - deviation
    coupled = (p["own"] - (1.0 - c.b)) * deviation + p["other"] * other
    return w + xp.where(apart, 0.0, coupled), s


EFFECTS = (
    Effect(
        "cross-coupling",
        "motor",
        Place.TORQUE,
        "T → T − g T_other, or T → T − v (ω − ω_other)/2",
        "One side's torque loads the other through the body.",
        "A side gives way a little whenever the other one pulls.",
        "One side at a constant command while the other steps.",
        (
            EffectParameter("share", "", 0.0, -0.6, 0.6, (0.1, -0.1, 0.0, 0.0), "one"),
            EffectParameter("turning", "", 0.0, 0.0, 3.0, (0.0, 0.0, 0.1, 0.5), "one"),
            EffectParameter("of_rate", "", 0.0, 0.0, 1.0, (0.0, 0.0, 1.0, 1.0), choice=True),
        ),
        _coupling,
        laws=(
            Law(("share",), choices={"of_rate": 0.0}),
            Law(
                ("turning",),
                choices={"of_rate": 1.0},
                sentence="It resists turning in proportion to the rate, as soft ground does.",
            ),
        ),
        inverse=inverses.against_coupling,
        couples=True,
        opposite="One side's torque helps the other through the body.",
        programmes=(ONE_AND_OTHER, REVERSALS),
    ),
    Effect(
        "inertial-coupling",
        "motor",
        Place.SPEED,
        "τ ω̇ = T − ω − m ω̇_other, m = μ √(τ τ_other)",
        "The body's mass and yaw inertia tie both sides: one speeds up, the other feels it.",
        "A side twitches whenever the other one speeds up or slows down, not while it pulls.",
        "One side at a constant command while the other steps, then both together and opposed.",
        (EffectParameter("share", "", 0.0, -0.9, 0.9, (0.25, -0.25), "one"),),
        _inertia,
        _together,
        shared=True,
        couples=True,
        programmes=(ONE_AND_OTHER, REVERSALS),
    ),
)
