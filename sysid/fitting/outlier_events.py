"""Bad measurements and disturbances that explain large errors best."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sysid.data.record import Array

CLUSTER = 10
"""Samples of a stretch in which every combination of a few outliers is tried."""

TOGETHER = 3
"""Outliers tried together there; more at once are found one after the other."""


@dataclass(frozen=True)
class Event:
    """One outlier.

    Attributes:
        sample: when.
        bad_measurement: whether the measurement is bad; otherwise the plant was disturbed.
    """

    sample: int
    output: int
    bad_measurement: bool


def explained(
    errors: Array, places: Sequence[tuple[int, int]], patterns: Sequence[Array]
) -> list[Event]:
    """The outliers that explain what stands out, fewest first.

    The errors are in units of the size beyond which one stands out, so that an outlier has to
    explain a power of one. The one that explains most is taken first and its effect removed;
    then, where several stand close together, every combination of up to TOGETHER of them is
    tried, because the largest error of a pair may belong to neither.

    Args:
        errors: (N, ny) in these units.
        places: (sample, output) of the errors looked at, in order of time.
        patterns: of each, what a bad measurement of one unit there does to the errors, (M, ny).
    """
    residuals = errors.copy()
    chosen: dict[tuple[int, int], bool] = {}
    values = [
        _gain(residuals, place, pattern) for place, pattern in zip(places, patterns, strict=True)
    ]
    gains = np.array([gain for gain, _, _ in values])
    memory = len(patterns[0]) if patterns else 1
    samples = np.array([t for t, _ in places])
    while np.max(gains, initial=0.0) > 1.0:
        best = int(np.argmax(gains))
        (t, i), (_, size, bad) = places[best], values[best]
        chosen[t, i] = bad
        if bad:
            part = residuals[t : t + memory]
            part -= size * patterns[best][: len(part)]
        else:
            residuals[t, i] = 0.0
        # samples are in order of time
        start, stop = np.searchsorted(samples, [t - 2 * memory + 1, t + 2 * memory])
        for k in range(int(start), int(stop)):
            known = places[k] in chosen
            values[k] = (0.0, 0.0, False) if known else _gain(residuals, places[k], patterns[k])
            gains[k] = values[k][0]
    events = []
    for cluster in _clusters(sorted(chosen), memory):
        events += _best_set(errors, cluster, places, patterns, chosen)
    return events


def _gain(errors: Array, place: tuple[int, int], pattern: Array) -> tuple[float, float, bool]:
    """(power explained, size, whether as a measurement) of the better of the two kinds."""
    t, i = place
    part = errors[t : t + len(pattern)]
    pi = pattern[: len(part)]
    share, power = float(np.sum(pi * part)), float(np.sum(pi * pi))
    error = float(errors[t, i])
    if share * share >= power * error * error:
        return share * share / power, share / power, True
    return error * error, error, False


def _clusters(chosen: Sequence[tuple[int, int]], memory: int) -> list[list[tuple[int, int]]]:
    """Outliers whose effects overlap, together."""
    groups: list[list[tuple[int, int]]] = []
    for place in chosen:
        if groups and place[0] - groups[-1][-1][0] < memory:
            groups[-1].append(place)
        else:
            groups.append([place])
    return groups


def _best_set(
    errors: Array,
    cluster: Sequence[tuple[int, int]],
    places: Sequence[tuple[int, int]],
    patterns: Sequence[Array],
    chosen: dict[tuple[int, int], bool],
) -> list[Event]:
    """The outliers of one cluster; all combinations tried where several stand close together."""
    greedy = [Event(t, i, chosen[t, i]) for t, i in cluster]
    memory = len(patterns[0])
    start, stop = cluster[0][0] - memory + 1, cluster[-1][0]
    if len(cluster) == 1 or stop - cluster[0][0] >= CLUSTER:
        return greedy
    known = {
        p: pattern
        for p, pattern in zip(places, patterns, strict=True)
        if start <= p[0] <= stop and stop - p[0] <= CLUSTER + 1
    }
    first = max(min(t for t, _ in known), 0)
    window = errors[first : stop + memory]

    def column(event: Event) -> Array:
        out = np.zeros(window.shape)
        at = event.sample - first
        if event.bad_measurement:
            part = out[at : at + memory]
            part += known[event.sample, event.output][: len(part)]
        else:
            out[at, event.output] = 1.0
        return out.ravel()

    kinds = (True, False) if memory > 1 else (True,)
    candidates = [Event(t, i, kind) for t, i in known for kind in kinds]
    usable = all((e.sample, e.output) in known for e in greedy)
    # without memory measurements alone are tried, but a disturbance may have explained more
    columns = {e: column(e) for e in (*candidates, *(greedy if usable else ()))}
    target = window.ravel()

    def cost(events: Sequence[Event]) -> float:
        basis = np.column_stack([columns[e] for e in events])
        size = np.linalg.lstsq(basis, target, rcond=1e-9)[0]
        residuals = target - basis @ size
        return float(residuals @ residuals) + len(events)

    best = min(
        (
            events
            for count in range(1, min(TOGETHER, len(greedy)) + 1)
            for events in combinations(candidates, count)
            if len({(e.sample, e.output) for e in events}) == count
        ),
        key=cost,
    )
    return greedy if usable and cost(greedy) <= cost(best) else list(best)
