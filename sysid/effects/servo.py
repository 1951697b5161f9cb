"""Laws of a servo: the command is the position to be reached, the reading the position.

In the chain T is then the set point and ω the position: laws of torque and speed say nothing.
"""

from dataclasses import replace

from sysid.effects.base import Effect

OF_SERVO = "of_servo"
"""The choice by which an effect has a law of servos (1) and others (0)."""


def of_servo(effect: Effect) -> Effect:
    """The effect with its laws of servos only; as it is where it has none."""
    return _where(effect, 1.0)


def of_motor(effect: Effect) -> Effect:
    """The effect without its laws of servos."""
    return _where(effect, 0.0)


def is_of_servo(effect: Effect) -> bool:
    """Whether an effect has laws of servos only."""
    return any(p.name == OF_SERVO and set(p.starts) == {1.0} for p in effect.parameters)


def _where(effect: Effect, value: float) -> Effect:
    choice = next((p for p in effect.parameters if p.name == OF_SERVO), None)
    if choice is None:
        return effect
    rows = [k for k, v in enumerate(choice.starts) if v == value]
    parameters = tuple(
        replace(p, starts=tuple(p.starts[k] for k in rows) if len(p.starts) > 1 else p.starts)
        for p in effect.parameters
    )
    laws = tuple(law for law in effect.laws if law.choices.get(OF_SERVO) == value)
    return replace(effect, parameters=parameters, laws=laws)
