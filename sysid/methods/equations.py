"""What the fits of equations that feed back have in common: their free runs judge them."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from sysid.data.record import Array, Channel, Record
from sysid.fitting.searchable import StartReport
from sysid.methods.held_out_error import relative_error
from sysid.methods.procedure import Judgement
from sysid.structures.difference_equations.structure import RecursiveStructure
from sysid.structures.difference_equations.trials import Trial, start_report


def searched(
    rows: Iterable[tuple[Channel, Callable[[], tuple[Trial, list[Trial]]]]],
) -> tuple[list[Trial], list[StartReport]]:
    """The best equation of each output, and what became of every trial, best first.

    Args:
        rows: each output with its search, which gives the best and all.
    """
    winners, reports = [], []
    for channel, search in rows:
        best, tried = search()
        winners.append(best)
        reports += [
            start_report(channel.name, t.how, t.error, t.evaluations)
            for t in sorted(tried, key=lambda t: t.error)
        ]
    return winners, reports


def judged_by_runs(
    s: RecursiveStructure,
    runs: Sequence[Array],
    records: Sequence[Record],
    advice: str,
    robust: bool = False,
) -> Judgement:
    """Free runs from the measured past, judged; outputs held at a limit are said, with advice."""
    first = s.first_sample()
    used = [r for r in records if len(r) > first]
    counted = np.concatenate([r.counted[first:] for r in used])
    measured = np.concatenate([r.y[first:] for r in used])[counted]
    with np.errstate(over="ignore", invalid="ignore"):
        errors = measured - np.concatenate(runs)[counted]
    warnings = s.limit_warnings(runs, records[0].outputs, advice)
    return Judgement(relative_error(errors, measured, robust), warnings)
