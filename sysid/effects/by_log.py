"""Differences between logs of one machine that are not effects: gain and load of each log.

They are searched like effects, beside them and by the same rule, so that neither takes what is the
other's: a battery that was fuller in one log is no curve, and a curve is no fuller battery.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Place,
    Signal,
    State,
    Texts,
    TorquePart,
)

P = Mapping[str, Signal]

MOST_LOGS = 12
"""Logs that may differ; of more a person makes groups."""


def parameter_of_log(log: int) -> str:
    """The name of a log's parameter, counted from 0."""
    return f"log{log + 1}"


def _by_log(xp: Any, p: P, c: Context) -> Signal:
    """The number of the log to which each sample belongs; 0 for a log that has none."""
    logs = [k for k in range(MOST_LOGS) if parameter_of_log(k) in p]
    return sum((xp.where(c.log == k, p[parameter_of_log(k)], 0.0) for k in logs), 0.0 * c.t)


def _gain(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return torque * (1.0 + _by_log(xp, p, c)), s


def _load(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return torque - _by_log(xp, p, c), s


GAIN_BY_LOG = Effect(
    "gain-by-log",
    "any",
    Place.TORQUE,
    Texts(
        "T → (1 + g_log) T",
        "The gain of the machine differs between logs: battery, temperature or load.",
        "Every response is larger or smaller by one factor, from one log to the next.",
        "The same steps with a battery that was charged.",
    ),
    tuple(
        EffectParameter(parameter_of_log(k), "1", 0.0, -0.7, 2.0, (0.08, -0.08))
        for k in range(1, MOST_LOGS)
    ),
    _gain,
    part=TorquePart.DRIVE,
)
"""The first log's gain is the model's own."""

LOAD_BY_LOG = Effect(
    "load-by-log",
    "any",
    Place.TORQUE,
    Texts(
        "T → T − b_log",
        "A constant load or zero point differs between logs: a slope, a cable, a cold sensor.",
        "All measurements of one log are higher or lower than those of another.",
        "The same steps in both directions on level ground.",
    ),
    tuple(
        EffectParameter(parameter_of_log(k), "speed", 0.0, -0.8, 0.8, (0.05, -0.05))
        for k in range(MOST_LOGS)
    ),
    _load,
)

BY_LOG = {e.id: e for e in (GAIN_BY_LOG, LOAD_BY_LOG)}


def for_logs(count: int, own_level: bool) -> tuple[Effect, ...]:
    """What may differ between so many logs; none for one log, or for too many.

    Args:
        count: logs, validation logs included.
        own_level: whether the base has a level already, which is then the first log's.
    """
    if not 1 < count <= MOST_LOGS:
        return ()
    first = {GAIN_BY_LOG.id: 1, LOAD_BY_LOG.id: int(own_level)}
    return tuple(_of(e, range(first[e.id], count)) for e in BY_LOG.values())


def _of(e: Effect, logs: Sequence[int]) -> Effect:
    names = {parameter_of_log(k) for k in logs}
    return replace(e, parameters=tuple(p for p in e.parameters if p.name in names))
