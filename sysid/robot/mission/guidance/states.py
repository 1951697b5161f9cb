"""Selection between values and between states of laws, traced or not."""

from collections.abc import Sequence
from typing import Any

from sysid.robot.mission.contracts import State
from sysid.vehicle.kinematics import Real


def pick(values: Sequence[Real], k: Real, xp: Any) -> Real:
    """``values[k]`` for a number ``k`` that may be traced."""
    chosen = values[0]
    for j, value in enumerate(values[1:], 1):
        chosen = xp.where(k == j, value, chosen)
    return chosen


def chosen(condition: Any, one: State, other: State, xp: Any) -> State:
    """``one`` where the condition holds, else ``other``: two states of the same shape."""
    if isinstance(one, dict):
        return {k: chosen(condition, v, other[k], xp) for k, v in one.items()}
    if isinstance(one, tuple):
        parts = [chosen(condition, a, b, xp) for a, b in zip(one, other, strict=True)]
        return type(one)(*parts) if hasattr(one, "_fields") else tuple(parts)
    return xp.where(condition, one, other)
