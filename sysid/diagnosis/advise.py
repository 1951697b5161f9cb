"""Next experiments: command schedules that show what this log cannot.

For one effect the first of its programmes is written. For a tie the tied models are simulated on
the programmes of all tied effects, and the one on which they differ most is taken.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.diagnosis.diagnosis import Experiment
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.prepared import prepare
from sysid.diagnosis.search.selection import CandidateModel
from sysid.effects.catalogue import about, is_known
from sysid.effects.programmes import LONGEST, Programme, Row
from sysid.robot.calibration.windows import track_channels

SETTLES = 0.25
"""Time constant [s] of the robots that the programmes are written for: a slower machine gets more
time for each of their steps."""

MOST_SAMPLES = 200_000
"""No schedule is longer."""

CLEAR = 1.0
"""Models that differ by so many noise standard deviations (RMS) are clearly distinguished."""

FAINT = 0.2
"""Below this even a whole schedule hardly distinguishes them."""


def stretch_of(search: ForwardSelection, at: CandidateModel) -> float:
    """How many times longer than for a robot each step of a programme lasts, to one figure."""
    record = search.estimation[0]
    slowest = min(np.max(search.model.time_constants(at.q)), record.dt * len(record))
    longer = min(slowest / SETTLES, MOST_SAMPLES * record.dt / LONGEST)
    return max(1.0, float(f"{longer:.0e}"))


def experiment_between(
    search: ForwardSelection,
    tied: Mapping[str, CandidateModel],
    floor: Array,
) -> Experiment:
    """The schedule that separates models which explain the log equally well.

    Args:
        floor: noise of each output, (ny,).
    """
    ids = tuple(tied)
    record, stretch = search.estimation[0], stretch_of(search, next(iter(tied.values())))
    programmes = list(dict.fromkeys(p for id in ids for p in about(id).hints.programmes))
    best, least = programmes[0], -1.0
    for programme in programmes:
        apart = _apart(search, list(tied.values()), _stretched(programme, stretch), floor)
        if apart > least * 1.1:
            best, least = programme, apart
    hand = next((about(id).texts.by_hand for id in ids if about(id).texts.by_hand), "")
    if hand and 0.0 <= least < FAINT:
        purpose = f"No command distinguishes {_listed(ids)}: the models would differ by "
        return Experiment(f"{purpose}{least:.1g} times the noise. {hand}", ids, (), ())
    experiment = _written(
        f"To distinguish {_listed(ids)}:", ids, best, record, search.scales, stretch
    )
    if least < 0.0:
        return experiment
    clear = "clear" if least > CLEAR else "enough" if least > FAINT else "hardly enough"
    differ = f"The models then differ by {least:.2g} times the noise, which is {clear}."
    return replace(experiment, purpose=f"{experiment.purpose} {differ}")


def experiment_on_ground(ids: tuple[str, ...], record: Record, scales: Array) -> Experiment:
    """The schedule that the catalogue lists first for a tie between tracks and ground."""
    programme = about(ids[0]).hints.programmes[0]
    return _written(f"To distinguish {_listed(ids)}:", ids, programme, record, scales)


def next_experiments(
    record: Record,
    scales: Array,
    undetectable: Sequence[str],
    stretch: float = 1.0,
    most: int = 3,
) -> tuple[Experiment, ...]:
    """Schedules for effects that the log cannot show; effects of one programme share it.

    Args:
        stretch: see ``stretch_of``.
    """
    grouped: dict[Programme, list[str]] = {}
    one_way = bool(np.all(record.u >= 0.0)) and not _has_sides(record)
    for id in undetectable:
        if is_known(id) and not (one_way and about(id).hints.reverses):
            grouped.setdefault(about(id).hints.programmes[0], []).append(id)
    largest = sorted(grouped.items(), key=lambda item: -len(item[1]))[:most]
    return tuple(
        _written(
            f"This log cannot show {_listed(ids)};", tuple(ids), programme, record, scales, stretch
        )
        for programme, ids in largest
    )


def _apart(
    search: ForwardSelection,
    models: Sequence[CandidateModel],
    rows: Sequence[Row],
    floor: Array,
) -> float:
    """Smallest RMS difference of any two models on a schedule, in noise standard deviations."""
    record = search.estimation[0]
    u = sampled(rows, record, search.scales)
    y = np.zeros((len(u), record.ny))
    drive = replace(record, u=u, y=y, pose=None, references=None, sha256="")
    data = prepare([drive], search.scales, search.delay, later=search.later)
    runs = search.model.run(np.array([n.q for n in models]), data)
    sizes = np.maximum(floor, 1e-9 * np.max(np.abs(runs), initial=1e-9))
    return min(
        float(np.sqrt(np.nanmean(((a - b) / sizes) ** 2)))
        for k, a in enumerate(runs)
        for b in runs[:k]
    )


def _stretched(programme: Programme, stretch: float) -> tuple[Row, ...]:
    return tuple((stretch * t, left, right) for t, left, right in programme.rows)


def sampled(rows: Sequence[Row], record: Record, scales: Array) -> Array:
    """A schedule at the log's sample time, (N, nu), within the log's command range."""
    steps = _scaled(rows, record, scales)
    t = record.dt * np.arange(int(np.ceil(steps[-1][0] / record.dt)) + 1)
    at = np.searchsorted([r[0] for r in steps], t + 1e-9, side="right") - 1
    return np.array([r[1:] for r in steps])[at]


def _scaled(rows: Sequence[Row], record: Record, scales: Array) -> tuple[tuple[float, ...], ...]:
    """Rows in the log's commands: shares of the largest command that the log uses, on its grid.

    Commands that were never negative stay positive.
    """
    robot, sides = record.is_robot_log, _has_sides(record)
    low, high = record.u.min(axis=0), record.u.max(axis=0)
    largest = np.maximum(np.maximum(np.abs(low), np.abs(high)), 0.05 * scales)
    scaled_rows: list[tuple[float, ...]] = []
    for t, *shares in rows:
        values = []
        for j in range(record.nu):
            value = shares[min(j, 1)] * largest[j]
            if low[j] >= 0.0 and not sides:
                value = abs(value)
            values.append(float(round(value)) if robot else float(np.round(value, 6)))
        scaled_rows.append((float(np.round(np.round(t / record.dt) * record.dt, 9)), *values))
    return tuple(scaled_rows)


def _has_sides(record: Record) -> bool:
    """Whether it is a robot with two sides, which turns on the spot: a single drive that was never
    reversed may be a fan."""
    return record.is_robot_log and record.nu > 1


def _written(
    before: str,
    ids: tuple[str, ...],
    programme: Programme,
    record: Record,
    scales: Array,
    stretch: float = 1.0,
) -> Experiment:
    """The schedule of a programme; its purpose ends with what the programme does."""
    words = programme.words
    if track_channels(record) is None:
        words = programme.plain or words
    purpose = f"{before} {words[:1].lower()}{words[1:]}"
    rows = _scaled(_stretched(programme, stretch), record, scales)
    columns = ("t", *record.input_names)
    return Experiment(purpose, ids, columns, rows, f"next_{'_'.join(ids[:3])}.csv")


def _listed(ids: Sequence[str]) -> str:
    return ids[0] if len(ids) == 1 else f"{', '.join(ids[:-1])} and {ids[-1]}"
