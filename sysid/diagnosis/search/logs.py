"""The log of each record, and the check that logs are of one machine."""

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.data.record import Record

PART = " part "
"""Between a file's name and the number of a stretch that was cut out of it."""


@dataclass(frozen=True)
class Logs:
    """The logs of a diagnosis.

    Attributes:
        names: of each log, validation logs last.
        estimation, holdout: the log that each record belongs to, from 0.
    """

    names: tuple[str, ...]
    estimation: tuple[int, ...]
    holdout: tuple[int, ...]

    @property
    def validation(self) -> tuple[int, ...]:
        """Validation logs."""
        return tuple(k for k in range(len(self.names)) if k not in self.estimation)


def logs_of(estimation: Sequence[Record], holdout: Sequence[Record]) -> Logs:
    """Records by log: stretches of one file are one log, whatever number of times it is named."""
    order: dict[str, int] = {}
    names: list[str] = []
    log_of_record: list[list[int]] = []
    for part in (estimation, holdout):
        log_of_record.append([])
        for r in part:
            if r.sha256 not in order:
                order[r.sha256] = len(names)
                names.append(_unused(r.name.rpartition(PART)[0] or r.name, names))
            log_of_record[-1].append(order[r.sha256])
    return Logs(tuple(names), tuple(log_of_record[0]), tuple(log_of_record[1]))


def _unused(name: str, names: Sequence[str]) -> str:
    """The name, with a number behind it where another log has it."""
    same = sum(n.partition(" (")[0] == name for n in names)
    return f"{name} ({same + 1})" if same else name
