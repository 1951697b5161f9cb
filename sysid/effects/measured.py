"""Effect parameters measured on a bench, for missions and as start values of a search.

An effect's parameter says by ``measured_as`` which key of a mission's ``vehicle.supply`` is its
value.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sysid.data import documents
from sysid.data.files import contents
from sysid.data.schema import DAMAGED
from sysid.effects.base import Effect, EffectParameter
from sysid.errors import DataError, UsageError

WIDTH = 3.0
"""Standard errors on either side within which a measured parameter is looked for."""
AT_LEAST = 0.1
"""Share of the parameter that it may differ in any case: a battery on a bench is not as warm and
charged as on the floor."""
SMALLEST = 0.01
"""Half of the narrowest interval, in parts of the effect's first start: a search needs room."""


@dataclass(frozen=True)
class Measured:
    """A parameter with its standard error."""

    value: float
    std_error: float


def read_measured(path: str | Path) -> dict[str, Measured]:
    """The measured parameters of a file that ``bench power`` wrote."""
    path = Path(path)
    try:
        document = documents.parsed(contents(path))
        measured = {
            str(key): Measured(float(entry["value"]), float(entry["std_error"]))
            for key, entry in document["measured"].items()
        }
    except FileNotFoundError:
        raise UsageError(f"{path}: file not found; write one with `sysid bench power`") from None
    except (OSError, *DAMAGED):
        raise DataError(f"{path} is not a file of `sysid bench power`; write it again") from None
    if not all(math.isfinite(m.value) and m.std_error >= 0.0 for m in measured.values()):
        raise DataError(f"{path} holds impossible values; write it again")
    return measured


def within(effects: Sequence[Effect], measured: Mapping[str, Measured]) -> tuple[Effect, ...]:
    """The effects with the measured parameters as starts, and bounds of three standard errors.

    Args:
        measured: by key of ``vehicle.supply``.
    """
    return tuple(
        replace(e, parameters=tuple(_narrowed(p, measured) for p in e.parameters)) for e in effects
    )


def _narrowed(p: EffectParameter, measured: Mapping[str, Measured]) -> EffectParameter:
    value = measured.get(p.measured_as) if p.measured_as else None
    if value is None:
        return p
    room = max(
        WIDTH * value.std_error,
        AT_LEAST * abs(value.value),
        SMALLEST * max(abs(s) for s in (*p.starts, 1e-3)),
    )
    lower = min(max(value.value - room, p.lower), p.upper)
    upper = max(min(value.value + room, p.upper), lower)
    start = min(max(value.value, lower), upper)
    return replace(p, lower=lower, upper=upper, starts=(start,) * len(p.starts))


def measured_keys(effects: Sequence[Effect]) -> tuple[str, ...]:
    """Keys of ``vehicle.supply`` that parameters of these effects are measured as."""
    return tuple(p.measured_as for e in effects for p in e.parameters if p.measured_as)
