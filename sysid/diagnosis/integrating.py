"""Outputs that integrate, such as the position of an axis: their rate is modelled instead."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.data.record import Channel, Record

MOST_SAMPLES = 3000
"""Rates are taken over several samples where a log has more: differences amplify noise."""


def step_of(records: Sequence[Record]) -> int:
    """Samples over which rates are taken."""
    return max(max(len(r) for r in records) // MOST_SAMPLES, 1)


def rates(records: Sequence[Record], step: int) -> tuple[Record, ...]:
    """The logs with the rate of the output in its place, one every ``step`` samples.

    ẏ(t_k) = (y(t_{k+1}) − y(t_{k−1}))/(2Δ), u averaged over the step that follows t_k.
    """
    records_of_rates = []
    for r in records:
        coarse = r.every(step)
        rate = (coarse.y[2:] - coarse.y[:-2]) / (2.0 * coarse.dt)
        outputs = tuple(
            Channel(
                f"{c.name}_rate",
                f"{c.unit}/s" if c.unit else "",
                c.scale,
                f"{c.file_unit}/s" if c.file_unit else "",
            )
            for c in r.outputs
        )
        records_of_rates.append(
            replace(
                r,
                u=coarse.u[1:-1],
                y=rate,
                dt=coarse.dt,
                outputs=outputs,
                pose=None,
                references=None,
                t0=r.t0 + coarse.dt,
            )
        )
    return tuple(records_of_rates)
