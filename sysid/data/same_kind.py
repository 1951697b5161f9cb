"""Whether a record has the channels, units and sample time of another record or of a model."""

from collections.abc import Sequence
from typing import Protocol

from sysid.data.record import Channel, Record
from sysid.errors import DataError

SAME_CLOCK = 0.01
"""Relative difference of sample times below which two clocks are the same."""


class Sampled(Protocol):
    """What has channels and a sample time."""

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """Input channels."""

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """Output channels."""

    @property
    def dt(self) -> float:
        """Sample time [s]."""


def difference(record: Record, other: Sampled, called: str, unstated_fits: bool = False) -> str:
    """In what a record is of another kind, as a sentence without its full stop; empty where alike.

    Args:
        record: the record.
        other: what it is compared with.
        called: the name of ``other`` in the sentence.
        unstated_fits: whether a unit that one of both does not state is taken for the other's.
    """
    if (names := _names(record)) != (wanted := _names(other)):
        return (
            f"{record.name} has {_arrow(names)} but {called} has {_arrow(wanted)}; choose the "
            "same columns with `inputs` and `outputs`"
        )
    for channel, same in zip(_channels(record), _channels(other), strict=True):
        fits = unstated_fits and not (channel.unit and same.unit)
        if channel.unit != same.unit and not fits:
            return (
                f"{channel.name} is in {channel.unit or 'no unit'} in {record.name}, in "
                f"{same.unit or 'no unit'} in {called}; give its unit with `units`"
            )
    if abs(record.dt - other.dt) > SAME_CLOCK * other.dt:
        return (
            f"{record.name} is sampled every {record.dt:.4g} s, {called} every {other.dt:.4g} s; "
            "resample the log"
        )
    return ""


def require_same_kind(records: Sequence[Record], first: Record) -> None:
    """Refuse records whose channels, units or sample time are not those of the first one.

    Raises:
        DataError: they are not.
    """
    for record in records:
        if unlike := difference(record, first, first.name):
            raise DataError(unlike)


def _channels(owner: Sampled) -> tuple[Channel, ...]:
    return (*owner.inputs, *owner.outputs)


def _names(owner: Sampled) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return tuple(c.name for c in owner.inputs), tuple(c.name for c in owner.outputs)


def _arrow(names: tuple[tuple[str, ...], tuple[str, ...]]) -> str:
    inputs, outputs = (", ".join(side) or "nothing" for side in names)
    return f"{inputs} -> {outputs}"
