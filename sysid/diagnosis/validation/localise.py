"""Where simulation and data disagree: the excess error by regime, with its uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.robot.calibration.windows import track_channels

Mask = NDArray[np.bool_]
REPLICATES = 200
MIN_EXCESS_SHARE = 0.2
"""An excess below this share of the floor's square has no place: the floor is known to some 7 %."""

MIN_SAMPLE_SHARE = 0.01
"""Regimes with less than this share of the samples are not reported."""

STANDS_OUT = 1.15
"""A regime stands out where its share of the excess exceeds its share of the samples so far."""


@dataclass(frozen=True)
class Region:
    """One regime of one output.

    Attributes:
        share_of_excess: share of the squared error above the noise floor that lies here.
        share_of_samples: share of the samples that lie here.
        interval: 95 % interval of the share of excess (block bootstrap).
    """

    region: str
    share_of_excess: float
    share_of_samples: float
    interval: tuple[float, float]

    @property
    def sentence(self) -> str:
        """The finding in words."""
        return (
            f"{100 * self.share_of_excess:.0f} % of the excess error lies in the "
            f"{100 * self.share_of_samples:.0f} % of samples where {self.region} "
            f"(95 % interval {100 * self.interval[0]:.0f}–{100 * self.interval[1]:.0f} %)."
        )


def localise(
    records: Sequence[Record], errors: Sequence[Array], floor: Array, scales: Array, seed: int = 0
) -> tuple[Region, ...]:
    """Regimes ordered by how much of the excess error they hold beyond their size.

    Args:
        errors: free-run errors (N, ny) on each; NaN where a sample does not count.
        floor: measurement noise of each output, (ny,).
    """
    rng = np.random.default_rng(seed)
    regions: list[Region] = []
    for i, channel in enumerate(records[0].outputs):
        counted = [np.isfinite(e[:, i]) for e in errors]
        excess = [e[c, i] ** 2 - floor[i] ** 2 for e, c in zip(errors, counted, strict=True)]
        total = float(np.sum(np.concatenate(excess)))
        if total <= MIN_EXCESS_SHARE * floor[i] ** 2 * sum(len(e) for e in excess):
            continue
        masks = [regimes(r, i, scales) for r in records]
        for name in masks[0]:
            inside = [m[name][c] for m, c in zip(masks, counted, strict=True)]
            share = float(np.mean(np.concatenate(inside)))
            if not MIN_SAMPLE_SHARE <= share <= 0.9:
                continue
            part, low, high = _share(excess, inside, rng)
            regions.append(Region(f"{channel.name}: {name}", part, share, (low, high)))
    return tuple(sorted(regions, key=lambda r: -(r.share_of_excess - r.share_of_samples)))


def leading(regions: Sequence[Region], outputs: Sequence[str]) -> str:
    """Where most of the excess of some outputs lies beyond its size, in words; empty for nowhere.

    A regime counts whose share of the excess is surely above its share of the samples.
    """
    parts = [(r, *r.region.partition(": ")[::2]) for r in regions]
    standing_out = [
        (r.share_of_excess - r.share_of_samples, where)
        for r, output, where in parts
        if output in outputs and r.interval[0] > STANDS_OUT * r.share_of_samples
    ]
    where = max(standing_out)[1] if standing_out else ""
    return f"it is {where}" if where.endswith("of the log") else where


def _share(
    excess: Sequence[Array], inside: Sequence[Mask], rng: np.random.Generator
) -> tuple[float, float, float]:
    size = max(sum(len(e) for e in excess) // 40, 10)
    blocks = np.concatenate(
        [
            np.add.reduceat(np.column_stack([e, e * m]), np.arange(0, len(e), size))
            for e, m in zip(excess, inside, strict=True)
        ]
    )
    whole, part = blocks.sum(axis=0)
    draws = rng.integers(0, len(blocks), size=(REPLICATES, len(blocks)))
    sums = blocks[draws].sum(axis=1)
    shares = np.divide(sums[:, 1], sums[:, 0], out=np.zeros(REPLICATES), where=sums[:, 0] > 0)
    ends = np.clip([part / whole, *np.quantile(shares, [0.025, 0.975])], 0.0, 1.0)
    return float(ends[0]), float(ends[1]), float(ends[2])


def regimes(record: Record, i: int, scales: Array) -> dict[str, Mask]:
    """Masks (N,) of the regimes of output ``i``, named in words that fit after 'where'."""
    d, w = record.u / scales, record.y[:, i]
    drive, robot = d[:, min(i, d.shape[1] - 1)], track_channels(record) is not None
    size, change = np.abs(w) / (float(np.quantile(np.abs(w), 0.98)) or 1.0), np.abs(drive)
    steep, idle, stands = np.gradient(size), change <= 0.01, size < 0.03
    steady = (np.abs(steep) <= 0.01) & ~stands
    left = _after(np.diff(stands.astype(int)) < 0, len(w), 4)
    reversal = _after(np.sign(drive[1:]) * np.sign(drive[:-1]) < 0, len(w), 8)
    time = np.arange(len(w)) / max(len(w) - 1, 1)
    # in words for a robot, and for a log that is none: an oven neither stands nor runs
    rows = [
        (
            "it is stalled under command",
            "it is near zero although its command is not",
            stands & ~idle,
        ),
        ("it is at standstill", "it is near zero", stands),
        ("it breaks away", "it has just left zero", left),
        ("it runs forward", "it is positive", (size > 0.03) & (w > 0.0)),
        ("it runs backward", "it is negative", (size > 0.03) & (w < 0.0)),
        ("its command has just reversed", "its command has just reversed", reversal),
        ("it speeds up", "it moves away from zero", steep > 0.01),
        ("it slows down", "it moves towards zero", steep < -0.01),
        (
            "its command is zero while it runs",
            "its command is zero while it is not",
            idle & ~stands,
        ),
        ("it runs at steady speed", "it is steady away from zero", steady),
    ]
    whole = "full drive" if record.full_drive_is_known else "its largest"
    for low, high in ((0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 10.0)):
        where = f"{100 * low:.0f} to {100 * high:.0f} %" if high < 1.0 else "above 75 %"
        words = f"the command is {where} of {whole}"
        rows.append((words, words, (change > low) & (change <= high)))
    for low, high in ((0.03, 0.35), (0.35, 0.7), (0.7, 10.0)):
        where = f"between {100 * low:.0f} and {100 * high:.0f} %" if high < 1.0 else "above 70 %"
        both = (f"speed is {where} of the largest", f"it is {where} of its largest value")
        rows.append((*both, (size > low) & (size <= high)))
    if d.shape[1] > 1:
        other = d[:, 1 - min(i, 1)]
        far, near = "the other input is above 60 % of its largest", "the other input is near zero"
        rows.append(("the other side is driven hard", far, np.abs(other) > 0.6))
        rows.append(("the other side is at rest", near, np.abs(other) < 0.05))
        if robot:
            turns, straight = np.sign(drive) * np.sign(other) < 0, np.abs(drive - other) < 0.1
            rows += [("the robot turns", "", turns), ("the robot runs straight", "", straight)]
    masks = {(name if robot else plain): mask for name, plain, mask in rows}
    return masks | {
        "the first third of the log": time < 1 / 3,
        "the last third of the log": time > 2 / 3,
    }


def _after(events: Mask, n: int, samples: int) -> Mask:
    out = np.zeros(n, dtype=bool)
    for k in np.flatnonzero(events):
        out[k + 1 : k + 1 + samples] = True
    return out
