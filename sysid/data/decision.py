"""Decision: one thing that reading a log assumed, and the field with which a person changes it."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Decision:
    """One thing that was decided.

    Attributes:
        what: the subject: time, dt, in, out, pose, rows, held, wraps, filter, offsets.
        value: what was decided, in the words of the file.
        fields: the fields that decide otherwise.
    """

    what: str
    value: str
    fields: tuple[str, ...]

    def to_json(self) -> dict[str, str]:
        """The decision as a JSON object, with its fields as a message names them."""
        change = ", ".join(f"`{field}`" for field in self.fields)
        return {"what": self.what, "value": self.value, "change": change}


def amount(count: int, noun: str) -> str:
    """``1 row``, ``2 rows``."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def listed(names: Sequence[str], most: int = 6, last: str = ", ") -> str:
    """The names, cut short where there are many; ``last`` stands before the last of all."""
    rest = len(names) - most
    if rest > 0:
        return f"{', '.join(names[:most])} and {rest} more"
    return last.join([", ".join(names[:-1]), *names[-1:]] if len(names) > 1 else names)
