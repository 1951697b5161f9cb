"""Ground: what effects between tracks and ground make of wheel speeds."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.effects.base import Context, Place
from sysid.errors import UsageError

_CONTEXT = Context(*((0.0,) * len(fields(Context))))
"""Vehicle effects look at the speeds alone."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Vehicle effects with their numbers, applied one after the other to the wheel speeds.

    The vehicle then moves as rolling tracks would at the speeds that remain.

    Attributes:
        effects: ids; they act in the catalogue's order, slip before radii before width.
        parameters: effect → parameter → value of the left and of the right track, (2,); numbers
            that the tracks share stand twice.

    Raises:
        UsageError: an id is no effect of the vehicle.
    """

    effects: tuple[str, ...] = ()
    parameters: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.effects:  # as in nearly every model: spare it the import of all effects
            return
        from sysid.effects.catalogue import catalogue, effect

        for id in self.effects:
            if effect(id).place is not Place.POSE:
                raise UsageError(f"{id} does not act between the tracks and the ground")
        ordered = tuple(id for id in catalogue() if id in self.effects)
        object.__setattr__(self, "effects", ordered)

    def __bool__(self) -> bool:
        return bool(self.effects)

    def rolled(self, omega: Array) -> Array:
        """Speeds at which tracks without slip and with nominal radii would move the vehicle alike.

        Args:
            omega: wheel speeds, left and right in the last axis, (…, 2) [rad/s].
        """
        if not self.effects:
            return omega
        from sysid.effects.catalogue import effect

        xp: Any = omega.__array_namespace__()
        for id in self.effects:
            omega, _ = effect(id).step(xp, omega, (), self.parameters[id], _CONTEXT)
        return omega

    def ordered(self, tracks: tuple[int, int]) -> "Ground":
        """For outputs in another order: ``tracks`` are the indices of left and right."""
        at = np.array(tracks)
        return Ground(
            self.effects,
            {k: {n: v[at] for n, v in named.items()} for k, named in self.parameters.items()},
        )

    def __call__(self, left: Any, right: Any) -> tuple[Any, Any]:
        """``rolled`` for one pair of speeds: plain numbers, or those of another namespace."""
        if isinstance(left, float | np.floating):
            rolled = self.rolled(np.array([left, right]))
            return float(rolled[0]), float(rolled[1])
        pair = self.rolled(left.__array_namespace__().stack([left, right]))
        return pair[0], pair[1]


def slipping(ground: Ground, share: Any) -> Ground:
    """The ground with more slip where the vehicle turns.

    Args:
        ground: what is there.
        share: of the way that is lost in a turn on the spot, added to what is lost already.
    """
    from sysid.effects.vehicle import SLIP, SLIP_SHARE

    pair = _both(share)
    there = ground.parameters.get(SLIP, {})
    more = {SLIP_SHARE: there[SLIP_SHARE] + pair if there else pair}
    return Ground(tuple({*ground.effects, SLIP}), {**ground.parameters, SLIP: more})


def _both(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return np.full(2, value)
    return value.__array_namespace__().stack([value, value])
