"""Prediction errors of a vehicle model on held-out windows of its pose."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.errors import DataError
from sysid.robot.calibration.slip_model import Motion
from sysid.robot.calibration.trajectory import Part, Trajectory

ESTIMATED = 0.7
"""Share of each trajectory's windows used for estimation where there is no validation log."""

MIN_WINDOWS = 6
"""Windows each part needs for a judgement."""

LONG = 10.0
"""Length of the stretches [s] over which drift is reported."""

Errors = Callable[[Sequence[Part]], Array]
"""Measured less predicted increments of windows, (W, 3) [m, m, rad]."""


@dataclass(frozen=True)
class PathErrors:
    """Mean errors over windows.

    Attributes:
        path, heading: mean distance [m] and mean size of the turn's error [rad] at a window's end.
        path_rms, heading_rms: root mean squares of the same.
    """

    path: float
    heading: float
    path_rms: float
    heading_rms: float
    windows: int

    @classmethod
    def of(cls, errors: Array) -> "PathErrors":
        away, turned = np.hypot(errors[:, 0], errors[:, 1]), np.abs(errors[:, 2])
        return cls(
            float(away.mean()),
            float(turned.mean()),
            float(np.sqrt(np.mean(away**2))),
            float(np.sqrt(np.mean(turned**2))),
            len(errors),
        )


@dataclass(frozen=True)
class Drift:
    """How errors grow with the way: over stretches of ``LONG`` seconds.

    Attributes:
        per_metre: distance from where the vehicle is, for each metre driven [m/m].
        per_turn: error of the heading for each whole turn [rad].
        stretches: how many, which overlap fourfold.
    """

    per_metre: float | None
    per_turn: float | None
    stretches: int


def split(
    trajectories: Sequence[Trajectory], share: float = ESTIMATED
) -> tuple[list[Part], list[Part]]:
    """The first windows of each trajectory, and those that begin after them."""
    first, second = [], []
    for d in trajectories:
        every = d.windows()
        cut = round(share * len(every))
        head = every[:cut]
        end = head[-1, 1] if len(head) else 0
        first.append(Part(d, head))
        second.append(Part(d, every[cut:][every[cut:, 0] >= end]))
    return _not_empty(first), _not_empty(second)


def whole(trajectories: Sequence[Trajectory]) -> list[Part]:
    """All windows of each trajectory."""
    return _not_empty([Part(d, d.windows()) for d in trajectories])


def enough(parts: Sequence[Part]) -> bool:
    """Whether windows are enough to estimate from or to judge by."""
    return sum(len(p.windows) for p in parts) >= MIN_WINDOWS


def check_enough(parts: Sequence[Part], name: str) -> None:
    """Refuse a log with too few windows."""
    if not enough(parts):
        count = sum(len(p.windows) for p in parts)
        raise DataError(
            f"{name} has {count} two-second window{'' if count == 1 else 's'} with motion and a "
            f"pose at both ends, and {MIN_WINDOWS} are needed; drive for at least 20 s"
        )


def long_stretches(parts: Sequence[Part]) -> list[Part]:
    """Stretches of ``LONG`` seconds in the time of these windows."""
    stretches = []
    for p in parts:
        windows = p.trajectory.windows(LONG)
        inside = (windows[:, 0] >= p.windows[0, 0]) & (windows[:, 1] <= p.windows[-1, 1])
        stretches.append(Part(p.trajectory, windows[inside]))
    return _not_empty(stretches)


def drift(errors: Errors, model: Motion, parts: Sequence[Part]) -> Drift:
    """How errors grow with the way that a model says was driven."""
    if not parts:
        return Drift(None, None, 0)
    error = errors(parts)
    way, turned = (
        np.concatenate([_over(p, model.driven(p.trajectory)[k]) for p in parts]) for k in (0, 1)
    )
    away = float(np.hypot(error[:, 0], error[:, 1]).sum())
    turns = float(turned.sum()) / (2.0 * np.pi)
    return Drift(
        away / float(way.sum()) if way.sum() > 0.0 else None,
        float(np.abs(error[:, 2]).sum()) / turns if turns > 0.0 else None,
        len(error),
    )


def mean_way(model: Motion, parts: Sequence[Part]) -> float:
    """Mean way that a vehicle drives in a window [m]."""
    return float(np.mean(np.concatenate([_over(p, model.driven(p.trajectory)[0]) for p in parts])))


def _over(part: Part, steps: Array) -> Array:
    d = part.trajectory
    total = np.concatenate([[0.0], np.cumsum(np.abs(steps))])
    ends = np.interp(d.at[part.windows], d.nodes, total)
    return np.asarray(ends[:, 1] - ends[:, 0])


def _not_empty(parts: Sequence[Part]) -> list[Part]:
    return [p for p in parts if len(p.windows)]
