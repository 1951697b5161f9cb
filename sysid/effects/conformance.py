"""Conformance tests of effects: what every effect must satisfy, tried on its own step."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sysid.effects.base import Context, Effect, Place, Signal, State

DT, KEPT = 0.05, 0.8
"""A sample [s], and the share of its speed that a track keeps in one."""

TRIALS = 8
"""Random instants of two tracks that are tried: a clip or a dead zone acts on some of them only."""

ROUNDING = 1e-9
"""Changes below this share of the signals, which are of size one, are rounding."""

_PER_TRACK = ("w", "w_free", "torque", "drive", "turned", "counted")


def fault(effect: Effect) -> str:
    """What is wrong with an effect, e.g. "has a step that fails (…)"; empty where nothing is."""
    try:
        with np.errstate(all="ignore"):
            return _fault(effect)
    except Exception as error:  # whatever somebody else's step does
        return f"has a step that fails ({type(error).__name__}: {error})"


def _fault(effect: Effect) -> str:
    if not effect.parameters or effect.place is Place.SAMPLES:
        return "has no parameter, or no place in the chain"
    nulls = {p.name: np.full(2, p.null) for p in effect.parameters}
    sets = max(len(p.starts) for p in effect.parameters)
    rng = np.random.default_rng(1)
    for trial in range(TRIALS):
        signal, context, state = _instant(effect, rng)
        at_null, _ = _stepped(effect, signal, state, nulls, context)
        if at_null.shape != signal.shape or np.max(np.abs(at_null - signal)) > ROUNDING:
            return "changes the signal at the null values of its parameters"
        if effect.place is Place.POSE or effect.couples or effect.shared:
            continue
        k = trial % sets
        own = {p.name: np.full(2, p.starts[min(k, len(p.starts) - 1)]) for p in effect.parameters}
        result, _ = _stepped(effect, signal, state, own, context)
        moved = _other_track_moved(context, rng)
        apart = signal + np.array([0.0, 0.3])
        others = tuple(s + np.array([0.0, 0.3]) for s in state)
        other_result, _ = _stepped(effect, apart, others, own, moved)
        if abs(result[0] - other_result[0]) > ROUNDING:
            return "ties the tracks to each other but does not say so: give it couples=True"
    return ""


def _instant(effect: Effect, rng: np.random.Generator) -> tuple[Signal, Context, State]:
    """A signal, what is beside it, and a state in which nothing has happened yet."""
    signals = {name: rng.uniform(-1.0, 1.0, 2) for name in _PER_TRACK}
    context = Context(
        dt=DT,
        t=np.float64(3.0),
        b=np.full(2, 1.0 - KEPT),
        torque_other=signals["torque"][::-1],
        driven=signals["torque"],
        **signals,
    )
    signal = rng.uniform(-1.0, 1.0, 2)
    if effect.memory.at_rest is not None:
        return signal, context, effect.memory.at_rest(signal, context.drive)
    return signal, context, (signal,) * effect.memory.states


def _other_track_moved(context: Context, rng: np.random.Generator) -> Context:
    """The same instant for the first track, another one for the second."""
    change = np.array([0.0, 1.0])
    moved = {n: getattr(context, n) + change * rng.uniform(0.2, 1.0) for n in _PER_TRACK}
    return replace(context, torque_other=moved["torque"][::-1], driven=moved["torque"], **moved)


def _stepped(
    effect: Effect, signal: Signal, state: State, parameters: Mapping[str, Signal], context: Context
) -> tuple[Signal, State]:
    constants = effect.constants
    more = constants(np, parameters, DT, np.full(2, KEPT)) if constants else {}
    return effect.step(np, signal, state, {**parameters, **more}, context)
