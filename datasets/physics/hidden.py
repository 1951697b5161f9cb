"""What is hidden in a machine, and how causes are put together."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sysid_datasets.physics.parameters import Drive
from sysid_datasets.physics.robots import Change, Rig, each


@dataclass(frozen=True)
class Hidden:
    """One cause in a machine and the names that are right for it.

    Attributes:
        id: of the effect of the catalogue.
        cause: what it is physically, in words.
        also: other names that an engineer would accept for it.
        channels: numbers of the drives that have it; empty for what all share.
        sizes: what was drawn, with the unit in the key.
        same_meaning: parameters of the catalogue that mean what a size means, by their names
            there; compared with what a diagnosis states.
        spread: by what share drives that have it may differ from these.
        styles: commands that can show it; empty for any.
    """

    id: str
    cause: str
    sizes: Mapping[str, float]
    also: tuple[str, ...] = ()
    channels: tuple[int, ...] = ()
    same_meaning: Mapping[str, float] | None = None
    styles: tuple[str, ...] = ()
    spread: float = 0.0


Cause = Callable[[np.random.Generator, Rig, float], tuple[Rig, Hidden]]
"""Puts one cause into a rig: randomness, the rig, and a factor on its size."""


def in_drives(rng: np.random.Generator, rig: Rig, change: Change) -> tuple[Rig, tuple[int, ...]]:
    """The rig with a change in one drive or both, and which."""
    machine, channels = each(rig.machine, rng, change)
    return replace(rig, machine=machine), tuple(channels)


def part(name: str, **values: Any) -> Change:
    """A change that sets fields of a part of a drive, each the value times the spread."""

    def change(drive: Drive, spread: float) -> Drive:
        scaled = {k: v * spread for k, v in values.items()}
        return replace(drive, **{name: replace(getattr(drive, name), **scaled)})

    return change


def wired(rig: Rig, **values: Any) -> Rig:
    """The rig with fields of its wire set."""
    return replace(rig, wire=replace(rig.wire, **values))


def timed(rig: Rig, **values: Any) -> Rig:
    """The rig with fields of its clocks set."""
    return replace(rig, telemetry=replace(rig.telemetry, **values))
