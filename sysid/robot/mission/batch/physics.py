"""Samples of vehicle and floor parameters, for motions that need them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.contracts import Scene
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.variation import Variation
from sysid.vehicle.soil import Soil

LEAST = 0.05
"""Share of its nominal value that a drawn number keeps: a soil without any friction, or a vehicle
without mass, is none."""

_MOST = {"friction_angle": 1.5, "residual": 1.0}
"""Largest values of numbers that have one: [rad], below a right angle, and [1]."""


class Number(NamedTuple):
    """A number of a soil that varies.

    Attributes:
        soil: 0 for the floor's own, then the patches'.
    """

    soil: int
    name: str
    value: float
    std: float


@dataclass(frozen=True)
class PhysicsSampler:
    """How mass and soils of the runs of one mission are drawn; mass first, then soil by soil."""

    mission: Mission
    variation: Variation

    @cached_property
    def _asked(self) -> Sequence[str]:
        asked: Sequence[str] = getattr(self.mission.motion, "wanted", ())
        return asked

    @property
    def _varies_mass(self) -> bool:
        return bool(self.variation.mass) and "mass" in self._asked

    @cached_property
    def _scene(self) -> Scene:
        return self.mission.scene()

    @cached_property
    def _numbers(self) -> tuple[Number, ...]:
        floor = self._scene.floor
        if floor is None or not self.variation.soil or "soil" not in self._asked:
            return ()
        soils = (floor.soil, *(p.soil for p in floor.patches))
        return tuple(
            Number(k, name, getattr(soil, name), self.variation.soil * std)
            for k, soil in enumerate(soils)
            for name, std in soil.std
            if std > 0.0 and np.isfinite(getattr(soil, name))
        )

    @property
    def size(self) -> int:
        return int(self._varies_mass) + len(self._numbers)

    @property
    def names(self) -> tuple[str, ...]:
        """What each of them is behind: ``mass``, ``soil.rolling``, ``soil[2].rolling`` …"""
        mass = ("mass",) if self._varies_mass else ()
        return mass + tuple(
            f"soil{f'[{n.soil + 1}]' if n.soil else ''}.{n.name}" for n in self._numbers
        )

    def drawn(self, z: Array) -> Array:
        """Mass over its nominal value, and numbers of soils, (K, size), of numbers (K, size)."""
        columns = []
        if self._varies_mass:
            columns.append(np.maximum(1.0 + self.variation.mass.deviation(z[:, 0]), LEAST))
        for k, n in enumerate(self._numbers, len(columns)):
            value = np.maximum(n.value + n.std * z[:, k], LEAST * n.value)
            columns.append(np.minimum(value, _MOST.get(n.name, np.inf)))
        return np.stack(columns, axis=1) if columns else np.zeros((len(z), 0))

    @property
    def nominal(self) -> Array:
        """The values of a run in which nothing varies, (size,)."""
        mass = [1.0] if self._varies_mass else []
        return np.array([*mass, *(n.value for n in self._numbers)])

    def overrides(self, values: Sequence[Any]) -> Mapping[str, Any]:
        """Keys of the vehicle for the drawn values of a run, of plain numbers or traced."""
        car, floor = self._scene.car, self._scene.floor
        changed_keys: dict[str, Any] = {}
        if car is not None and self._varies_mass:
            changed_keys |= {
                "mass": values[0] * car.mass,
                "yaw_inertia": values[0] * car.yaw_inertia,
            }
        if floor is not None and self._numbers:
            soils: list[Soil] = [floor.soil, *(p.soil for p in floor.patches)]
            changed: list[dict[str, Any]] = [{} for _ in soils]
            first = len(values) - len(self._numbers)
            for n, value in zip(self._numbers, values[first:], strict=True):
                changed[n.soil][n.name] = value
            soils = [replace(s, **c) for s, c in zip(soils, changed, strict=True)]
            patches = zip(floor.patches, soils[1:], strict=True)
            changed_keys |= {"soil": soils[0]}
            changed_keys |= {"patches": tuple(replace(p, soil=s) for p, s in patches)}
        return changed_keys
