"""Compensation: the drive that cancels the effects between command and torque.

An effect that can be undone says how (``Effect.inverse``); here the inverses of several are put
together, against the order in which the effects act.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.effects.base import ORDER, Context, Effect, Place, Signal, TorquePart


def can_be_compensated() -> tuple[str, ...]:
    """Ids of all effects that have an inverse."""
    from sysid.effects.catalogue import chain_effects  # all effects: a plain model needs none

    return tuple(e.id for e in chain_effects() if e.inverse is not None)


@dataclass(frozen=True, eq=False)
class Identified:
    """The effects of a plant that act between its commands and the torques, T = K d.

    Attributes:
        parameters: effect → parameter → value of each track, (tracks,).
        gain: K, steady speed at full drive, (tracks,).
        full: command at full drive, (tracks,).
        order: of the chain in which they act.
    """

    effects: tuple[str, ...] = ()
    parameters: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    gain: Array = field(default_factory=lambda: np.zeros(0))
    full: Array = field(default_factory=lambda: np.zeros(0))
    order: int = ORDER

    def on(self, tracks: Sequence[int]) -> "Identified":
        """The same for tracks in another order, or one of them twice."""
        at = list(tracks)
        own = {id: {n: v[at] for n, v in named.items()} for id, named in self.parameters.items()}
        return Identified(self.effects, own, self.gain[at], self.full[at], self.order)

    def undone(
        self, ids: Sequence[str], wanted: Signal, speed: Signal, t: Signal, xp: Any
    ) -> tuple[Signal, Signal]:
        """The drive that does what ``wanted`` would do without the effects.

        Args:
            ids: effects to make up for; the others stay.
            wanted: drive, (tracks,).
            speed: of the tracks, (tracks,).
            t: time [s].

        Returns:
            d, (tracks,), and the part of it that makes up for effects of the torque, (tracks,).
        """
        torque = self.gain * wanted
        context = self._context(torque, speed, t, xp)
        effects = self._chosen(ids, Place.TORQUE)
        driven = torque
        for effect in reversed([e for e in effects if e.part is TorquePart.LOAD]):
            driven = self._inverted(effect, driven, context, xp)
        context = replace(context, driven=driven)
        for effect in reversed(effects):
            torque = self._inverted(effect, torque, context, xp)
        drive = torque / self.gain
        added = drive - wanted
        for effect in reversed(self._chosen(ids, Place.COMMAND)):
            drive = self._inverted(effect, drive, context, xp)
        return drive, added

    def done(
        self, ids: Sequence[str], given: Signal, added: Signal, speed: Signal, t: Signal, xp: Any
    ) -> Signal:
        """The drive without the effects that does what ``given`` does with them, (tracks,).

        Args:
            ids: effects that were made up for.
            given: drive that reaches the plant, cut at its limits, (tracks,).
            added: as :meth:`undone` gave it, (tracks,).
            speed, t, xp: as there.
        """
        context = self._context(self.gain * given, speed, t, xp)
        for effect in self._chosen(ids, Place.COMMAND):
            given, _ = effect.step(xp, given, (), self.parameters[effect.id], context)
        return given - added

    def _chosen(self, ids: Sequence[str], place: Place) -> list[Effect]:
        """In the order in which they act, which is that of ``effects``."""
        from sysid.effects.catalogue import effect, in_chain

        chain = in_chain((effect(id) for id in self.effects), self.order)
        return [e for e in chain if e.id in ids and e.place is place]

    def _inverted(self, effect: Effect, signal: Signal, context: Context, xp: Any) -> Signal:
        assert effect.inverse is not None  # asked before
        return effect.inverse(xp, signal, self.parameters[effect.id], context)

    def _context(self, torque: Signal, speed: Signal, t: Signal, xp: Any) -> Context:
        """What an inverse may look at: time, speeds and torques."""
        other = torque[..., ::-1] if torque.shape[-1] > 1 else 0.0 * speed
        return Context(
            dt=0.0,
            t=t,
            w=speed,
            torque=torque,
            torque_other=other,
            drive=torque / self.gain,
            gain=self.gain,
            driven=torque,
        )
