"""Instants of the messages of all streams on one clock, by the senders' stamps where usable.

A message is stamped by its sender (header.stamp) and again when the recorder receives it. The first
is the moment of the measurement; but senders have clocks of their own. δ = received − stamped is
the difference of the clocks plus the time on the way, which is never negative: the line under all δ
is the clocks' difference with the shortest way (Moon, Skelly and Towsley 1999, INFOCOM; by the
convex hull: Zhang, Liu and Xia 2002, INFOCOM). Streams whose lines agree were stamped by one clock
and are moved together, so that their order stays what it was.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sysid.data.bags.streams import Stream, Streams
from sysid.data.finding import Finding, Severity
from sysid.data.record import Array
from sysid.errors import DataError

RESTART = 1.0
"""Stamps that go back by more [s] come from a clock that started again; less is disorder."""
FEW = 1.0 / 3.0
"""Share of missing or repeated stamps from which the stamps are not used."""
EARLY = 0.005
"""A message may seem to be received so much before it was stamped [s]: two clocks on one network
differ by that, and it is below the jitter of a computer without real time."""
LONGEST_WAY = 1.0
"""A message that took longer on its way [s] was stamped by another clock."""
ONE_CLOCK = 0.1
"""Streams whose lines differ by less [s] at both ends of the recording were stamped by one clock:
the shortest ways within one computer and its network are shorter."""
DRIFTS = 0.01
"""A drift counts where over the recording it moves stamps by this share of a step: 0.2 ms of 20."""
LEAST_DRIFT = 50
"""Messages needed to estimate a drift."""


@dataclass(frozen=True)
class Line:
    """δ = ``offset`` + ``slope`` · (t − ``middle``): the least difference of two clocks [s]."""

    offset: float
    slope: float = 0.0
    middle: float = 0.0

    def at(self, t: Array) -> Array:
        """The difference at instants of the stamps [s]."""
        return np.asarray(self.offset + self.slope * (t - self.middle))


def runs(recording: Streams) -> Iterator[Streams]:
    """The parts of a recording between restarts of a simulation's clock."""
    back = np.flatnonzero(np.diff(recording.clock[:, 1]) < -RESTART) + 1
    edges = [-np.inf, *recording.clock[back, 0].tolist(), np.inf]
    for low, high in pairwise(edges):
        clock = recording.clock[(recording.clock[:, 0] >= low) & (recording.clock[:, 0] < high)]
        streams = [s.rows((s.t >= low) & (s.t < high)) for s in recording.streams]
        if all(len(s.t) for s in streams):
            yield replace(recording, streams=tuple(streams), clock=clock)


def timed(recording: Streams, policy: str) -> tuple[tuple[Stream, ...], tuple[Finding, ...]]:
    """Every stream in the order of its instants, all on one clock, and what was done."""
    stamped = {s.topic: _doubt(s) for s in recording.streams}
    if policy == "header" and (bad := [t for t, why in stamped.items() if why]):
        raise DataError(f"{recording.where}: {bad[0]}: {stamped[bad[0]]}; leave `stamps` at auto")
    simulated = len(recording.clock) > 1
    if simulated:
        low, high = float(recording.clock[0, 1]) - RESTART, float(recording.clock[-1, 1]) + RESTART
        for s in (s for s in recording.streams if not stamped[s.topic]):
            if not (low <= s.stamped[0] and s.stamped[-1] <= high):
                stamped[s.topic] = "the stamps are not on the clock of the simulation"
    good = [s for s in recording.streams if not stamped[s.topic] and policy != "received"]
    all_stamped = simulated or len(good) == len(recording.streams)
    placed: dict[str, tuple[Array, float, str]] = {}
    for group, line in _clocks(good):
        recorders_clock = -EARLY <= line.offset <= LONGEST_WAY
        stays = simulated or recorders_clock or (all_stamped and len(group) == len(good))
        for s in group:
            t = s.stamped if stays else s.stamped + line.at(s.stamped)
            way = float(np.median(s.t - s.stamped)) if recorders_clock and not simulated else np.nan
            placed[s.topic] = (t, way, "" if stays else _moved(line))
    pairs = [_timed(s, recording, stamped[s.topic], placed, policy) for s in recording.streams]
    streams, findings = zip(*pairs, strict=True)
    return streams, tuple(f for of_stream in findings for f in of_stream)


def _timed(
    stream: Stream,
    recording: Streams,
    doubt: str,
    placed: dict[str, tuple[Array, float, str]],
    policy: str,
) -> tuple[Stream, list[Finding]]:
    notes = []
    if stream.topic in placed:
        t, way, moved = placed[stream.topic]
        by = "header.stamp"
        if moved:
            notes.append((Severity.NOTE, moved, "`stamps='received'` uses the times of receipt."))
    else:
        t, way, by = stream.t, np.nan, "the time of receipt"
        if len(recording.clock) > 1 and policy != "received":
            t = np.interp(t, recording.clock[:, 0], recording.clock[:, 1])
            by = "the time of receipt, on the clock of the simulation"
        if doubt and np.isfinite(stream.stamped).any() and policy == "auto":
            notes.append((Severity.WARNING, f"{doubt}; the time of receipt was used.", ""))
    order = np.argsort(t, kind="stable")
    late = int(np.count_nonzero(np.diff(t) < 0.0))
    t = t[order]
    keep = np.append(np.diff(t) > 0.0, True)
    twice = int(np.count_nonzero(~keep))
    if late:
        notes.append((Severity.NOTE, f"{_messages(late)} out of order and sorted.", ""))
    if twice:
        text = f"{_messages(twice)} stamped like the next one and left out."
        notes.append((Severity.WARNING if twice > 0.02 * len(t) else Severity.NOTE, text, ""))
    at = f"{recording.where}: {stream.topic}"
    findings = [Finding("bag", sev, f"{at}: {text}", do, record=recording.where)
                for sev, text, do in notes]  # fmt: skip
    return replace(stream.rows(order[keep]), t=t[keep], by=by, way=way), findings


def _messages(count: int) -> str:
    return f"{count} message{' was' if count == 1 else 's were'}"


def _doubt(stream: Stream) -> str:
    """Why the stamps of a stream are not usable; empty where they are."""
    known = np.isfinite(stream.stamped)
    if not known.any():
        return "the messages have no stamp"
    if not known.all():
        return f"{np.count_nonzero(~known)} messages have no stamp"
    steps = np.diff(stream.stamped)
    if len(steps) and np.mean(steps == 0.0) > FEW:
        return f"the stamps do not increase in {100 * np.mean(steps == 0.0):.0f} % of the messages"
    if np.any(steps < -RESTART):
        return f"the stamps restart {np.count_nonzero(steps < -RESTART)} times"
    return ""


def _clocks(streams: Sequence[Stream]) -> list[tuple[list[Stream], Line]]:
    """The streams of each sender's clock with the line under their differences to the recorder."""
    groups: list[list[Stream]] = []
    recorder: list[Stream] = []
    for stream in streams:
        line = line_under([stream])
        ends = stream.stamped[[0, -1]]
        if np.all((line.at(ends) >= -EARLY) & (line.at(ends) <= LONGEST_WAY)):
            recorder.append(stream)
            continue
        for group in groups:
            if np.all(np.abs(line.at(ends) - line_under(group).at(ends)) < ONE_CLOCK):
                group.append(stream)
                break
        else:
            groups.append([stream])
    groups = [recorder, *groups] if recorder else groups
    return [(group, line_under(group)) for group in groups]


def line_under(streams: Sequence[Stream]) -> Line:
    """The line under received − stamped of all messages of some streams that comes closest to them.

    It is the edge of the lower convex hull over the mean of the stamps.
    """
    t = np.concatenate([s.stamped for s in streams])
    delta = np.concatenate([s.t - s.stamped for s in streams])
    middle, length = float(np.mean(t)), float(np.ptp(t))
    flat = Line(float(np.min(delta)), 0.0, middle)
    if len(t) < LEAST_DRIFT or not length > 0.0:
        return flat
    order = np.lexsort((delta, t))
    hull: list[tuple[float, float]] = []
    for p in zip((t[order] - middle).tolist(), delta[order].tolist(), strict=True):
        while len(hull) > 1 and _turns_right(hull[-2], hull[-1], p):
            hull.pop()
        hull.append(p)
    at = next((k for k, (x, _) in enumerate(hull) if x > 0.0), len(hull) - 1)
    (x0, y0), (x1, y1) = hull[max(at - 1, 0)], hull[at]
    if x1 <= x0:
        return flat
    slope = (y1 - y0) / (x1 - x0)
    step = min(float(np.median(np.diff(s.stamped))) for s in streams if len(s.stamped) > 1)
    if abs(slope) * length < DRIFTS * step:
        return flat
    return Line(y0 - slope * x0, slope, middle)


def _turns_right(o: tuple[float, float], a: tuple[float, float], b: tuple[float, float]) -> bool:
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]) <= 0.0


def _moved(line: Line) -> str:
    """How the stamps of another clock were moved."""
    side = "behind" if line.offset > 0.0 else "ahead of"
    drift = f" and drifts by {1e6 * line.slope:.0f} µs a second" if line.slope else ""
    return (
        f"header.stamp comes from a clock {abs(line.offset):.4g} s {side} the recorder's{drift}; "
        "the stamps were moved onto that clock by the fastest messages, whose delay remains."
    )
