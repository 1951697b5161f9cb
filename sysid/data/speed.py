"""Speed of a plant without a model: time to 63 % of its step response."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.impulse import long_regression
from sysid.data.record import Array, Record, shortened
from sysid.errors import DataError


@dataclass(frozen=True)
class Speed:
    """How fast an output responds.

    Attributes:
        output: channel name.
        time_constant: time to 63 % of the final value of the step response [s]; None if unknown.
        settles: whether a final value was found; False for an integrator or too short a record.
    """

    output: str
    time_constant: float | None
    settles: bool


SAMPLES = 20_000
"""Blocks that are looked at: a slow plant is met once the blocks are long."""

RISEN = 1.0 - np.exp(-1.0)
"""Part of the final value that a first-order plant reaches after one time constant."""
AT_ONCE, SLOWER = 0.75, 4.0
"""A response within so many samples is one only if it explains less behind a lag of so many."""
ALIKE = 0.02
"""Shares explained closer than this are as good."""
TRUSTED = 0.4
"""A step response is believed if it explains this share of the output's variance."""


def estimate_speed(records: Sequence[Record]) -> tuple[Speed, ...]:
    """Time to 63 % of the step response of each output, from its strongest input.

    The samples are averaged in blocks of 1, 2, 4, … until the response takes fewer than ten blocks:
    a regression on samples much faster than the plant only sees the noise.
    """
    speeds: dict[int, Speed] = {}
    dt, names = records[0].dt, records[0].output_names
    factor, current = 1, list(records)
    while len(speeds) < len(names):
        part = shortened(current, SAMPLES)
        candidates = _step_responses(part)
        if not candidates:
            break
        spread = np.concatenate([r.u - r.u.mean(axis=0) for r in part]).std(axis=0)
        for j, name in enumerate(names):
            if j not in speeds:
                step = _simplest_good(candidates, j)
                samples = None if step is None else _rise(step[:, j, :] * spread)
                if step is None or samples is None or samples >= 10:
                    continue
                known = samples >= AT_ONCE or not _slower_as_good(part, step, j)
                speeds[j] = Speed(name, samples * factor * dt if known else None, True)
        factor *= 2
        current = [r.averaged(2) for r in current if len(r) >= 40]
    return tuple(speeds.get(j, Speed(n, None, False)) for j, n in enumerate(names))


def _step_responses(records: Sequence[Record]) -> list[tuple[Array, Array]]:
    """Step responses of regressions of rising order, each with the share it explains."""
    responses = []
    for order in (1, 2, 4, 8):
        try:
            step = long_regression(records, order).step_response(120)
        except (DataError, IndexError):
            break
        responses.append((step, _explained(records, step)))
    return responses


def _simplest_good(candidates: list[tuple[Array, Array]], j: int) -> Array | None:
    """The step response of lowest order that explains output j nearly as well as the best one."""
    best = max(float(explained[j]) for _, explained in candidates)
    if not best >= TRUSTED:  # nor where it is no number
        return None
    return next(step for step, explained in candidates if explained[j] >= best - ALIKE)


def _slower_as_good(records: Sequence[Record], step: Array, j: int) -> bool:
    """Whether a step response behind a lag explains output j as well: no input is fast enough."""
    a = np.exp(-1.0 / SLOWER)
    late = _explained(records, lfilter([1.0 - a], [1.0, -a], step, axis=0))
    return bool(late[j] >= _explained(records, step)[j] - ALIKE)


def _explained(records: Sequence[Record], step: Array) -> Array:
    """Share of each output's variance that the inputs explain through the step responses."""
    if not np.all(np.isfinite(step)):
        return np.zeros(step.shape[1])
    impulse = np.diff(step, axis=0, prepend=0.0)
    unexplained, total = np.zeros(step.shape[1]), np.zeros(step.shape[1])
    for r in records:
        u = r.u - r.u.mean(axis=0)
        for j in range(r.ny):
            predicted = sum(np.convolve(u[:, i], impulse[:, j, i])[: len(r)] for i in range(r.nu))
            error = r.y[:, j] - predicted
            with np.errstate(over="ignore"):  # an unstable regression
                unexplained[j] += np.sum((error - error.mean()) ** 2)
            total[j] += np.sum((r.y[:, j] - r.y[:, j].mean()) ** 2)
    return np.asarray(1.0 - unexplained / np.where(total > 0, total, 1.0))


def _rise(step: Array) -> float | None:
    """Samples to 63 % of the end value for the input of largest effect, or None."""
    if not np.all(np.isfinite(step)):
        return None
    end = step[-20:].mean(axis=0)
    i = int(np.argmax(np.abs(end)))
    response = step[:, i] / end[i] if end[i] != 0 else step[:, i]
    if end[i] == 0 or np.max(np.abs(response[60:] - 1.0)) > 0.3:
        return None
    hit = int(np.argmax(response >= RISEN))
    if hit == 0:
        return 0.0
    before = response[hit - 1]
    return float(hit - 1 + (RISEN - before) / (response[hit] - before))
