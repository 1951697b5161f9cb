"""Ground: the effects between tracks and ground, applied to wheel speeds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.effects.base import Context, Effect, Place, State
from sysid.errors import UsageError


@dataclass(frozen=True, eq=False)
class Ground:
    """Vehicle effects with their parameters, applied one after the other to the wheel speeds.

    The vehicle then moves as rolling tracks would at the speeds that remain.

    Attributes:
        effects: ids; they act in the catalogue's order, slip before radii before width.
        parameters: effect → parameter → value of the left and of the right track, (2,); parameters
            that the tracks share stand twice, and those that are left out do nothing.

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
        nulls = {id: {p.name: np.full(2, p.null) for p in effect(id).parameters} for id in ordered}
        whole = {id: {**nulls[id], **self.parameters[id]} for id in ordered}
        object.__setattr__(self, "effects", ordered)
        object.__setattr__(self, "parameters", whole)

    def __bool__(self) -> bool:
        return bool(self.effects)

    @cached_property
    def _acting(self) -> tuple[Effect, ...]:
        if not self.effects:
            return ()
        from sysid.effects.catalogue import effect

        return tuple(map(effect, self.effects))

    @property
    def remembers(self) -> bool:
        """Whether some effect has a memory, so that samples come one after the other."""
        return any(e.memory.states for e in self._acting)

    @property
    def slides(self) -> bool:
        """Whether the vehicle slides sideways."""
        return any(e.on_ground.sideways for e in self._acting)

    def rolled(self, omega: Array, dt: float = 0.0) -> Array:
        """Speeds at which tracks without slip and with nominal radii would move the vehicle alike.

        Args:
            omega: wheel speeds, left and right in the last axis, (…, 2) [rad/s]; where the ground
                ``remembers``, a record (N, 2), which begins in steady motion.
            dt: sample time [s], for a ground that remembers.
        """
        if self.remembers and not dt > 0.0:
            raise UsageError(
                f"{' and '.join(self.effects)} need the time between two samples, which is missing"
            )
        for e in self._acting:
            parameters = self.parameters[e.id]
            if e.on_ground.on_record is not None:
                omega = e.on_ground.on_record(omega, parameters, dt)
            elif e.memory.states:
                omega = _one_by_one(e, omega, parameters, dt)
            else:
                omega, _ = e.step(omega.__array_namespace__(), omega, (), parameters, Context(dt))
        return omega

    def lateral(self, forward: Any, yaw_rate: Any, xp: Any = np) -> Any:
        """Speed to the left [m/s]; 0 where nothing slides.

        Args:
            forward: speed [m/s] of tracks that roll at what ``rolled`` or ``step`` leave.
            yaw_rate: of the same [rad/s].
        """
        sliding = [
            (e.on_ground.sideways, self.parameters[e.id])
            for e in self._acting
            if e.on_ground.sideways
        ]
        return sum(sideways(xp, forward, yaw_rate, p) for sideways, p in sliding)

    def start(self) -> State:
        """What the effects remember of a vehicle at standstill."""
        return tuple((np.zeros(2),) * e.memory.states for e in self._acting)

    def step(self, state: State, omega: tuple[Any, Any], dt: Any) -> tuple[tuple[Any, Any], State]:
        """``rolled`` for one sample after the other.

        Args:
            state: after the sample before, or ``start``.
            omega: wheel speeds of the left and the right track at this sample [rad/s]: plain
                numbers, or those of another namespace.
            dt: time since the sample before [s], 0 at the first.

        Returns:
            The speeds at which tracks without slip would move the vehicle alike, and the state.
        """
        if not self.effects:
            return omega, state
        plain = isinstance(omega[0], float | np.floating)
        xp: Any = np if plain else omega[0].__array_namespace__()
        now, after = xp.stack([xp.asarray(w) for w in omega]), []
        context = Context(dt)
        for e, last in zip(self._acting, state, strict=True):
            now, state_of_effect = _stepped(e, xp, now, last, self.parameters[e.id], context)
            after.append(state_of_effect)
        return (float(now[0]), float(now[1])) if plain else (now[0], now[1]), tuple(after)

    def ordered(self, tracks: tuple[int, int]) -> "Ground":
        """For outputs in another order: ``tracks`` are the indices of left and right."""
        at = np.array(tracks)
        return Ground(
            self.effects,
            {k: {n: v[at] for n, v in named.items()} for k, named in self.parameters.items()},
        )

    def __call__(self, left: Any, right: Any) -> tuple[Any, Any]:
        """One pair of speeds in steady motion: plain numbers, or those of another namespace."""
        steady = _pair(left, right)
        states = tuple((steady,) * e.memory.states for e in self._acting)
        return self.step(states, (left, right), math.inf)[0]


def _stepped(
    e: Effect, xp: Any, omega: Any, state: State, parameters: Mapping[str, Any], context: Context
) -> tuple[Any, State]:
    more = e.constants(xp, parameters, context.dt, 0.0) if e.constants else {}
    return e.step(xp, omega, state, {**parameters, **more}, context)


def _one_by_one(e: Effect, omega: Array, parameters: Mapping[str, Array], dt: float) -> Array:
    """An effect on a record, sample after sample."""
    state: State = (omega[0],) * e.memory.states
    out, context = np.empty_like(omega), Context(dt)
    for k, now in enumerate(omega):
        out[k], state = _stepped(e, np, now, state, parameters, context)
    return out


def slipping(ground: Ground, share: Any) -> Ground:
    """The ground with more slip where the vehicle turns.

    Args:
        share: of the way that is lost in a turn on the spot, added to what is lost already.
    """
    from sysid.effects.vehicle import SLIP, SLIP_SHARE

    pair = _pair(share, share)
    there = ground.parameters.get(SLIP, {})
    more = {SLIP_SHARE: there[SLIP_SHARE] + pair if there else pair}
    return Ground(tuple({*ground.effects, SLIP}), {**ground.parameters, SLIP: more})


def _pair(left: Any, right: Any) -> Any:
    """Two plain numbers, or those of another namespace, in one array (2,)."""
    if isinstance(left, float | np.floating):
        return np.array([left, right])
    return left.__array_namespace__().stack([left, right])
