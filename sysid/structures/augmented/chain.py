"""The chain command → torque → speed → reading that effects act on, written once over xp."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.effects.base import Context, Effect, Place, Signal, State, TorquePart

Parameters = Mapping[str, Mapping[str, Signal]]
"""Effect id → parameter name → one value a track."""

ChainState = tuple[Any, tuple[State, ...]]
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


def rest_state(
    xp: Any, effects: Sequence[Effect], core: Core, w: Signal, drive: Signal | None = None
) -> ChainState:
    """The state in which the tracks turn steadily with speed ``w`` (tracks,).

    Args:
        drive: what the effects of the command have seen so far; that of the speed when None.
    """
    n = core.f.shape[0]
    rows = [w, *(xp.sum((core.b[i:] - core.f[i:]) * w, axis=0) for i in range(1, n))]
    drive = w / core.gain if drive is None else drive
    return xp.stack(rows), tuple(_initial(e, w, drive) for e in effects)


STANDING = 0.1
"""A first reading below this share of the largest one is a track at standstill; readings that
change by more are none of steady motion."""

LAST = 5
"""Readings at the end of the first command, whose median is what it comes to."""


def at_standstill(y: Array) -> NDArray[np.bool_]:
    """Whether measurements (N, tracks) begin at standstill, (tracks,)."""
    return np.asarray(np.abs(y[0]) <= STANDING * np.max(np.abs(y), axis=0))


def share_before(u: Array, y: Array) -> Array:
    """Share of its first command that acted before a record began, (inputs,).

    All of it where the record begins in motion; none where it begins at standstill: then the
    command begins with the record. Where readings change much while the first command stays, a
    command that has held the first of them steady: y_0 over what they come to.

    Args:
        u: commands, (N, inputs).
        y: measurements, (N, outputs), one output or one for each input.
    """
    stays = np.cumprod(u == u[0], axis=0).sum(axis=0)
    ends = np.array([np.median(y[max(n - LAST, 0) : n], axis=0) for n in stays])
    settled = np.diagonal(ends) if y.shape[1] == u.shape[1] else ends[:, 0]
    moves = np.abs(settled - y[0]) > STANDING * np.max(np.abs(y), axis=0)
    share = np.where(moves, y[0] / np.where(moves, settled, 1.0), 1.0)
    share = np.nan_to_num(np.clip(share, 0.0, 1.0), nan=1.0)
    return np.asarray(np.where(at_standstill(y), 0.0, share))


def first_speed(effects: Sequence[Effect], parameters: Parameters, y: Signal) -> Signal:
    """The speed at a first measurement."""
    for effect in reversed(effects):
        if effect.undone is not None:
            y = effect.undone(y, parameters[effect.id])
    return y


def _initial(effect: Effect, w: Signal, drive: Signal) -> State:
    if effect.memory.at_rest is not None:
        return effect.memory.at_rest(w, drive)
    return (drive if effect.place is Place.COMMAND else w,) * effect.memory.states


def with_constants(
    xp: Any, effects: Sequence[Effect], core: Core, parameters: Parameters, dt: float
) -> Parameters:
    """The parameters with what the steps read besides and what does not change."""
    kept = xp.minimum(xp.maximum(1.0 - core.b[0], 1e-9), 1.0)
    return {
        e.id: {
            **parameters[e.id],
            **(e.constants(xp, parameters[e.id], dt, kept) if e.constants else {}),
        }
        for e in effects
    }


@dataclass(frozen=True, eq=False)
class Sample:
    """What enters one step.

    Attributes:
        drive: command as it was given, (tracks,).
        acting: what the effects outside this step have made of it.
        t: time [s].
        turned, counted: angles of the wheels from their speeds and from the measurements [rad].
        log: which of several logs it belongs to, from 0.
    """

    drive: Signal
    acting: Signal
    t: Signal
    turned: Signal
    counted: Signal
    log: Signal = 0.0


def step_with(
    xp: Any,
    effects: Sequence[Effect],
    core: Core,
    parameters: Parameters,
    state: ChainState,
    sample: Sample,
    dt: float,
    summed: bool = False,
) -> tuple[ChainState, Signal]:
    """One sample: (state, drive (tracks,)) → (next state, reading (tracks,)).

    Effects of one place act in the given order. The reading belongs to the instant at which the
    drive is applied and does not depend on it.

    Args:
        parameters: ``with_constants``.
        summed: whether tracks are the inputs of one machine: each is a copy of it that feels the
            torque of all inputs, K₁ d₁ + K₂ d₂ + …
    """
    x, effect_states = state
    w = x[0]
    n = core.f.shape[0]
    following = x[1] if n > 1 else 0.0 * w
    w_free = following - core.f[0] * w
    memory = dict(zip((e.id for e in effects), effect_states, strict=True))
    holds = sum((e.holds(parameters[e.id]) for e in effects if e.holds), 0.0 * w)

    def through(place: Place, signal: Signal, torque: Signal) -> Signal:
        other = torque[..., ::-1] if torque.shape[-1] > 1 else 0.0 * torque
        context = Context(
            dt,
            sample.t,
            w,
            w_free,
            core.b[0],
            torque,
            other,
            sample.drive,
            sample.turned,
            sample.counted,
            holds,
            core.gain,
            sample.log,
            signal,
        )
        for effect in effects:
            if effect.place is place:
                signal, memory[effect.id] = effect.step(
                    xp, signal, memory[effect.id], parameters[effect.id], context
                )
                if place is Place.TORQUE and effect.part is TorquePart.DRIVE:
                    context = replace(context, driven=signal)
        return signal

    reading = through(Place.READING, w, core.gain * sample.drive)
    acting = through(Place.COMMAND, sample.acting, core.gain * sample.drive)
    wanted = core.gain * acting
    if summed:
        each = (wanted[..., i : i + 1] for i in range(wanted.shape[-1]))
        wanted = xp.concatenate([sum(each, 0.0)] * wanted.shape[-1], axis=-1)
    torque = through(Place.TORQUE, wanted, wanted)
    rows = [
        (x[i + 1] if i + 1 < n else 0.0 * w) - core.f[i] * w + core.b[i] * torque for i in range(n)
    ]
    rows[0] = through(Place.SPEED, rows[0], wanted)
    return (xp.stack(rows), tuple(memory[e.id] for e in effects)), reading
