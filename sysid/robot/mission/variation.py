"""Quantities that vary between the runs of a mission: the section ``vary`` of its file."""

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from sysid.data.record import Array
from sysid.data.yaml_files.source import shown
from sysid.errors import UsageError
from sysid.robot.mission.settings import Settings

QUANTITIES = (
    *("parameters", "noise", "start", "obstacles"),
    *("friction", "soil", "mass", "models"),
)
"""Quantities that can vary, in the order of the report."""

Deviation = Annotated[float, Field(ge=-1e6, le=1e6)]


class Spread(Settings):
    """How far a number lies from its nominal value, in its own unit.

    In a file it is a number, the standard deviation of a normal distribution, or
    ``[lowest, highest]``, the ends of a uniform one; ``false`` is no deviation at all.

    Attributes:
        sigma: standard deviation.
        between: lowest and highest deviation; then ``sigma`` does not count.
    """

    sigma: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    between: tuple[Deviation, Deviation] | None = None

    @model_validator(mode="before")
    @classmethod
    def _forms(cls, value: Any) -> Any:
        """Accept a number, ``[lowest, highest]`` and ``false``."""
        if value is False:
            return {}
        if isinstance(value, bool):
            raise _wrong(f"is {shown(value)}")
        if isinstance(value, int | float):
            return {"sigma": float(value)}
        if isinstance(value, list | tuple):
            if len(value) != 2:
                raise _wrong(f"has {len(value)} numbers")
            return {"between": tuple(value)}
        if isinstance(value, str):
            raise _wrong(f"is {shown(value)}")
        return value

    @model_validator(mode="after")
    def _rising(self) -> "Spread":
        if self.between is not None and self.between[0] > self.between[1]:
            raise _wrong(f"goes from {self.between[0]:g} down to {self.between[1]:g}")
        return self

    def __bool__(self) -> bool:
        if self.between is None:
            return self.sigma > 0.0
        return self.between != (0.0, 0.0)

    def deviation(self, z: Array) -> Array:
        """What standard normal numbers become: σz, or low + (high − low)Φ(z)."""
        if self.between is None:
            return self.sigma * z
        low, high = self.between
        below = [0.5 * math.erfc(-v / math.sqrt(2.0)) for v in z.ravel().tolist()]
        return low + (high - low) * np.reshape(below, z.shape)


def _wrong(what: str) -> PydanticCustomError:
    form = "a standard deviation, or [lowest, highest] with the lower one first"
    return PydanticCustomError("named", "{what}: write {form}", {"what": what, "form": form})


class StartSpread(Settings):
    """Where the robot is put down: by hand on a mark, within some centimetres and degrees.

    Attributes:
        x, y: position [m].
        psi: heading [rad]; 0.03 is not quite two degrees.
    """

    x: Spread = Spread(sigma=0.02)
    y: Spread = Spread(sigma=0.02)
    psi: Spread = Spread(sigma=0.03)

    def __bool__(self) -> bool:
        return bool(self.x or self.y or self.psi)


class FrictionSpread(Settings):
    """What another floor and another temperature do.

    Attributes:
        dry: deviation of every number of dry friction of the plant, as a share of it; grease and
            load change it by a tenth. A plant without dry friction has none to vary.
        slip: share of its way that the robot loses where it turns on the spot (the size counts,
            not the sign): a hard floor takes some hundredths.
    """

    dry: Spread = Spread(sigma=0.1)
    slip: Spread = Spread(sigma=0.02)

    def __bool__(self) -> bool:
        return bool(self.dry or self.slip)


class Variation(Settings):
    """What varies from run to run; each key may be ``false``, and every number replaced.

    Attributes:
        parameters: factor of the standard errors with which the plant's parameters were
            estimated; 1 takes them as they are, with their correlations.
        noise: whether each run has its own sensor noise.
        obstacles: X and Y of every obstacle [m]; a tape measure and a hand are that good.
        friction: dry friction of the plant, and slip on the ground.
        soil: factor of the standard deviations that the numbers of soils come with, where the
            motion asks for a soil: soils of one name differ so much from place to place.
        mass: deviation of mass and yaw inertia together, as a share of them, where the motion needs
            them: a battery more or less is some per cent.
        models: whether each run takes one of several models of a comparison.
    """

    parameters: Annotated[float, Field(ge=0, le=100)] = 1.0
    noise: bool = True
    start: StartSpread = StartSpread()
    obstacles: Spread = Spread(sigma=0.02)
    friction: FrictionSpread = FrictionSpread()
    soil: Annotated[float, Field(ge=0, le=100)] = 1.0
    mass: Spread = Spread(sigma=0.02)
    models: bool = False

    @model_validator(mode="before")
    @classmethod
    def _switches(cls, value: Any) -> Any:
        """Accept ``true`` for what is on by default, and ``false`` for nothing."""
        if not isinstance(value, dict):
            return value
        switched = {}
        for key, given in value.items():
            if key in ("start", "friction") and given is False:
                given = dict.fromkeys(_PARTS[key], False)
            if given is True and key != "noise" and key != "models":
                continue  # its default
            factor = key in ("parameters", "soil") and given is False
            switched[key] = 0.0 if factor else given
        return switched

    def of(self, names: Sequence[str]) -> "Variation":
        """The same sizes with these quantities alone; one that was switched off is on again."""
        unknown = [n for n in names if n not in QUANTITIES]
        if unknown:
            raise UsageError(f"{unknown[0]!r} cannot vary; choose from {', '.join(QUANTITIES)}")
        usual = Variation(models=True)
        return Variation.model_construct(
            **{
                name: (getattr(self, name) or getattr(usual, name))
                if name in names
                else getattr(_OFF, name)
                for name in QUANTITIES
            }
        )

    @property
    def active(self) -> tuple[str, ...]:
        return tuple(name for name in QUANTITIES if getattr(self, name))


_PARTS = {"start": ("x", "y", "psi"), "friction": ("dry", "slip")}

_OFF = Variation.model_validate(dict.fromkeys(QUANTITIES, False))
"""Every quantity without variation."""
