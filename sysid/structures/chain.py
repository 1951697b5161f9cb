"""The chain command → torque → speed → reading that effects act on, written once over xp."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.effects.base import Context, Effect, Place, Signal

Parameters = Mapping[str, Mapping[str, Signal]]
"""Effect id → parameter name → one value a track."""

ChainState = tuple[Any, tuple[tuple[Signal, ...], ...]]
"""(core state (n, tracks), states of each effect)."""


@dataclass(frozen=True, eq=False)
class Core:
    """A linear core per track with static gain one from torque to speed.

    ω = x_1, x_i⁺ = x_{i+1} − f_i ω + b_i T with Σb = 1 + Σf, so that T counts in units of
    steady speed; T = K d.

    Attributes:
        gain: K per track, (tracks,).
        f: denominator coefficients, (n, tracks).
        b: numerator coefficients, (n, tracks).
    """

    gain: Signal
    f: Signal
    b: Signal


def rest_state(xp: Any, effects: Sequence[Effect], core: Core, w: Signal) -> ChainState:
    """The state in which the tracks turn steadily with speed ``w`` (tracks,)."""
    n = core.f.shape[0]
    rows = [w, *(xp.sum((core.b[i:] - core.f[i:]) * w, axis=0) for i in range(1, n))]
    drive = w / core.gain
    states = tuple(_initial(effect, w, drive) for effect in effects)
    return xp.stack(rows), states


def _initial(effect: Effect, w: Signal, drive: Signal) -> tuple[Signal, ...]:
    if effect.place is Place.COMMAND:
        return (drive,) * effect.states
    if effect.id == "backlash":
        return (0.0 * w, w)
    if effect.id == "thermal-fade":
        return (0.0 * w,)
    return (w,) * effect.states


def chain_step(
    xp: Any,
    effects: Sequence[Effect],
    core: Core,
    parameters: Parameters,
    state: ChainState,
    drive: Signal,
    t: Signal,
    angle: Signal,
    dt: float,
) -> tuple[ChainState, Signal]:
    """One sample: (state, drive (tracks,)) → (next state, reading (tracks,)).

    Effects of one place act in the given order. The reading belongs to the instant at which the
    drive is applied and does not depend on it.
    """
    x, held = state
    w = x[0]
    n = core.f.shape[0]
    following = x[1] if n > 1 else 0.0 * w
    w_free = following - core.f[0] * w
    memory = dict(zip((e.id for e in effects), held, strict=True))

    def through(place: Place, signal: Signal, torque: Signal) -> Signal:
        context = Context(dt, t, w, w_free, core.b[0], torque, drive, angle)
        for effect in effects:
            if effect.place is place:
                signal, memory[effect.id] = effect.step(
                    xp, signal, memory[effect.id], parameters[effect.id], context
                )
        return signal

    reading = through(Place.READING, w, core.gain * drive)
    acting = through(Place.COMMAND, drive, core.gain * drive)
    wanted = core.gain * acting
    torque = through(Place.TORQUE, wanted, wanted)
    rows = [
        (x[i + 1] if i + 1 < n else 0.0 * w) - core.f[i] * w + core.b[i] * torque for i in range(n)
    ]
    rows[0] = through(Place.SPEED, rows[0], wanted)
    return (xp.stack(rows), tuple(memory[e.id] for e in effects)), reading
