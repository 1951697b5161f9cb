"""How far a doubtful parameter may move before runs differ: its profile on a twin without noise."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.estimation.information.subject import Subject
from sysid.fitting.options import FitOptions
from sysid.fitting.profile import LEVEL, NORMAL, profiled
from sysid.methods.grey_box import PROFILE_EVALUATIONS
from sysid.methods.grey_box_starts import Setting
from sysid.structures.grey_box.runs import trajectory
from sysid.structures.grey_box.structure import GreyBox

MOST_SAMPLES = 3000
"""Samples of the first log that a profile runs through."""


def profile(
    subject: Subject, record: Record, name: str, std_error: float
) -> tuple[float | None, float | None]:
    """Ends of the 95 % interval of a parameter of a grey box; None where it is open on that side.

    The plant runs on the log's inputs; the parameter is held beside its value and all others are
    fitted to that run, so slopes alone do not decide (Raue et al. 2009, Bioinformatics 25, 1923).

    Args:
        std_error: by slopes; infinite where these see nothing.
    """
    s = subject.structure
    assert isinstance(s, GreyBox)
    u = np.asarray(record.u)[:MOST_SAMPLES]
    x0 = subject.state(u, np.asarray(record.y)[:MOST_SAMPLES])
    y = trajectory(s, subject.theta, [u], x0[:, None])[1][0]
    twin = replace(record, u=u, y=y, pose=None, weights=None, t0=record.t0)
    user_fixed = (False,) * len(subject.parameters)
    setting = Setting(s, (twin,), subject.parameters, FitOptions(), user_fixed)
    k = next(i for i, p in enumerate(subject.parameters) if p.name == name)
    others = np.isin(np.arange(len(subject.theta)), subject.free)
    others[k] = False
    kept = [np.ones(len(u), dtype=bool)]

    def rise(value: float, start: Array) -> tuple[float, Array]:
        p = start.copy()
        p[k] = value
        end = setting.descend(p, others, kept, PROFILE_EVALUATIONS).p
        states = end[len(subject.theta) :][:, None]
        run = trajectory(s, end[: len(subject.theta)], [u], states)[1][0]
        with np.errstate(all="ignore"):
            far = float(np.sum(((y - run) / subject.noise) ** 2))
        return (far if np.isfinite(far) else 1e300), end

    p = np.concatenate([subject.theta, x0])
    value, of = float(subject.theta[k]), subject.parameters[k]
    first = std_error if np.isfinite(std_error) else max(abs(value), 1.0) / NORMAL
    found = profiled(rise, p, k, first, of.lower, of.upper)
    ends: list[float | None] = []
    for side, distance in ((-1.0, found.below), (1.0, found.above)):
        at = value + side * distance
        crossed = distance > 0.0 and rise(at, p)[0] > 0.9 * LEVEL
        ends.append(at if crossed else None)
    return ends[0], ends[1]


def interval_words(ends: Sequence[float | None]) -> str:
    """The interval as one reads it: ``0.2 … open``."""
    return " … ".join("open" if e is None else f"{e:.3g}" for e in ends)
