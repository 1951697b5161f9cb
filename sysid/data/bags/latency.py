"""Latency of the streams of a bag relative to each other: estimated, reported, removed.

Measurements respond to commands through a plant, so that their lateness is its dead time: the θ of

    y(t) = c + Σ_i K_i F_i(t − θ),    F = u_i through one lag τ₁, or through two (τ₁, τ₂)

fitted to the messages at their own instants. Two topics that measure one motion show their lateness
without a plant: increments of the one are regressed on those of the other at every shift
(:func:`sysid.data.joining.clock_offset.clock_shift`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.bags.streams import Stream
from sysid.data.filtering import lfilter
from sysid.data.finding import Finding, Severity
from sysid.data.joining.clock_offset import AGREES, clock_shift, travelled, way_and_turn
from sysid.data.reading.timing import zero_order_hold_means
from sysid.data.record import Array
from sysid.errors import UsageError

REMOVE = "remove"

LONGEST = 1.0
"""Longest latency [s]: a topic that is later measures something else."""
EARLIEST = -0.2
"""A measurement may seem to come before its command by this [s], where stamps disagree."""
MAX_MEASUREMENTS = 6000
"""Measurements that serve: more take longer and add no information."""
MIN_MEASUREMENTS = 20
"""Measurements needed for an estimate."""
SLOWEST = 5.0
"""Longest lag tried [s]: a slower plant's dead time is hidden in it."""
AWAY = 1.0
"""Added to a dead time [s] while it is searched: the search steps by shares, 0 has none."""
EVERY = slice(None)
RESOLVED = 0.01
"""Share of a step that lines between the steps resolve where commands are filtered."""
SURE = 3.0
"""A latency counts where it is so many of its standard errors."""
TELLS = 0.25
"""… which must be below this share of a row of the log, or the latency is not known at all."""
MATTERS = 0.2
"""Offset of two measurements, as a share of a row, from which a fit to both is distorted."""


@dataclass(frozen=True)
class Latency:
    """How late a topic is.

    Attributes:
        seconds: how late [s]; negative where it is early.
        std_error: of that [s].
        behind: the topic it was compared with.
        responds: whether that one commands it, so that a plant's dead time is in the number.
    """

    topic: str
    seconds: float
    std_error: float
    behind: str
    responds: bool

    @property
    def seen(self) -> bool:
        """Whether it differs from none."""
        return abs(self.seconds) > SURE * self.std_error


def check_latency(given: Sequence[str]) -> dict[str, float]:
    """Topic → seconds, of the texts that name a topic.

    Raises:
        UsageError: a text is none of ``remove`` and ``/topic=SECONDS``.
    """
    stated = {}
    for text in given:
        topic, sign, number = (part.strip() for part in text.rpartition("="))
        if text == REMOVE:
            continue
        try:
            seconds = float(number)
        except ValueError:
            seconds = np.nan
        if not (sign and topic and np.isfinite(seconds)):
            raise UsageError(
                f"`latency` cannot read {text!r}; write remove, or /topic=SECONDS such as "
                "/joint_states=0.05"
            )
        stated[topic if topic.startswith("/") else f"/{topic}"] = seconds
    return stated


def without_latency(
    streams: Sequence[Stream], zero_order_hold: frozenset[str], given: Sequence[str], where: str
) -> tuple[tuple[Stream, ...], tuple[Finding, ...]]:
    """The streams, those that are late moved back where that was asked for, and what is said.

    Args:
        streams: on one clock.
        zero_order_hold: names of the columns that are commands.
        given: as ``ReadOptions.latency`` has it.
        where: the bag, for messages.
    """
    stated = check_latency(given)
    topics = [s.topic for s in streams]
    for topic in stated.keys() - set(topics):
        raise UsageError(
            f"`latency` names {topic}, which is not mapped; those of {where} are "
            f"{', '.join(topics)}"
        )
    estimates = () if stated.keys() >= set(topics) else latencies(streams, zero_order_hold)
    late = {one.topic: one.seconds for one in estimates if one.seen} if REMOVE in given else {}
    late |= stated
    findings = [_latency_finding(one, where, late) for one in estimates if one.topic not in stated]
    findings += [
        Finding("latency", Severity.NOTE, f"{where}: {t} was moved back by {1e3 * s:.4g} ms.")
        for t, s in stated.items()
    ]
    moved = tuple(replace(s, t=s.t - late.get(s.topic, 0.0)) for s in streams)
    return moved, tuple(replace(f, record=where) for f in findings)


def latencies(streams: Sequence[Stream], zero_order_hold: frozenset[str]) -> tuple[Latency, ...]:
    """How late measurements respond to the commands, and how late they are behind one another.

    Where possible a topic is compared with the commands; any other one is compared with the
    topic that responds to them most surely, or with the fastest one.
    """
    streams = _window(streams)
    commands = [s for s in streams if set(s.names) <= zero_order_hold and len(s.t) > 1]
    measured = [s for s in streams if s not in commands and len(s.t) > MIN_MEASUREMENTS]
    row = max((s.step for s in streams if s.regular), default=np.inf)
    by_plant = [
        a for s in measured if (a := _answer(s, commands, zero_order_hold, row)) is not None
    ]
    by_topic = {a.topic: a for a in by_plant}
    by_rate = sorted(measured, key=lambda s: s.step)
    surest = min(by_plant, key=lambda a: a.std_error, default=None)
    reference = next(
        (s for s in by_rate if surest is not None and s.topic == surest.topic),
        by_rate[0] if by_rate else None,
    )
    estimates = list(by_plant)
    for other in (s for s in measured if s is not reference and s.topic not in by_topic):
        assert reference is not None
        apart = _apart(reference, other, zero_order_hold, row)
        if apart is None:
            continue
        start = by_topic.get(reference.topic)
        if start is not None:  # against the command, as those that respond to it
            error = float(np.hypot(apart.std_error, start.std_error))
            apart = replace(apart, seconds=apart.seconds + start.seconds, std_error=error)
            apart = replace(apart, behind=start.behind, responds=True)
        estimates.append(apart)
    return tuple(estimates)


def _window(streams: Sequence[Stream]) -> list[Stream]:
    """The part of the recording that serves, from the first command that moves on."""
    counts = max(len(s.t) for s in streams)
    if counts <= MAX_MEASUREMENTS:
        return list(streams)
    fastest = max(streams, key=lambda s: len(s.t))
    moves = [s.t[np.flatnonzero(np.any(np.diff(s.values, axis=0) != 0.0, axis=1))[:1]]
             for s in streams]  # fmt: skip
    start = max((float(m[0]) for m in moves if len(m)), default=float(fastest.t[0]))
    start = min(start, float(fastest.t[-MAX_MEASUREMENTS])) - fastest.step
    last = min(int(np.searchsorted(fastest.t, start)) + MAX_MEASUREMENTS, len(fastest.t) - 1)
    end = float(fastest.t[last])
    return [_between(s, start, end) for s in streams]


def _between(stream: Stream, start: float, end: float) -> Stream:
    """A stream from the last message before a start to an end."""
    first = max(int(np.searchsorted(stream.t, start)) - 1, 0)
    kept = np.arange(first, int(np.searchsorted(stream.t, end)))
    return stream.rows(kept)


def _answer(
    measured: Stream, commands: Sequence[Stream], zero_order_hold: frozenset[str], row: float
) -> Latency | None:
    """How late a topic responds to the commands; None where it cannot be estimated."""
    if not commands:
        return None
    delays = []
    for name, y in zip(measured.names, measured.values.T, strict=True):
        if name in zero_order_hold or name in measured.angles or not np.isfinite(y).all():
            continue
        delay = dead_time(measured.t, y, [(c.t, c.values) for c in commands])
        if delay is not None and delay.std_error < TELLS * row:
            delays.append((delay.seconds, delay.std_error))
    if not delays:
        return None
    seconds, errors = np.array(delays).T
    weights = errors**-2 / np.sum(errors**-2)
    mean = float(weights @ seconds)
    spread = float(np.sqrt(weights @ (seconds - mean) ** 2))
    error = float(max(np.sum(errors**-2) ** -0.5, spread))
    names = ", ".join(c.topic for c in commands)
    return Latency(measured.topic, mean, error, names, responds=True)


@dataclass(frozen=True)
class DeadTime:
    """How a measurement responds to commands.

    Attributes:
        seconds: dead time θ [s].
        std_error: of θ [s].
        share: of the measurement's variance that a lag with this dead time explains.
    """

    seconds: float
    std_error: float
    share: float


def dead_time(t: Array, y: Array, commands: Sequence[tuple[Array, Array]]) -> DeadTime | None:
    """Dead time from held commands to a reading.

    Args:
        t, y: instants and measurements, (N,).
        commands: instants (M,) and values (M, n) of each topic of commands.

    Returns:
        None where a lag with dead time does not explain the reading.
    """
    from scipy.optimize import least_squares

    known = t >= max(float(c[0]) for c, _ in commands)  # what was commanded before is not
    t, y = t[known], y[known]
    if len(t) < MIN_MEASUREMENTS or not np.ptp(y) > 0.0:
        return None
    fit = _Lagged.of(t, y, commands)
    if fit is None:
        return None
    start = fit.coarse()
    best: tuple[float, DeadTime] | None = None
    for lags in (1, 2):
        first = [start[0] + AWAY, *(np.log(start[1] / (1.0 + 2.0 * k)) for k in range(lags))]
        low = [EARLIEST + AWAY, *[np.log(0.1 * fit.step)] * lags]
        high = [LONGEST + AWAY, *[np.log(3.0 * SLOWEST)] * lags]
        x0 = np.clip(first, np.array(low) + 1e-9, np.array(high) - 1e-9)
        solution = least_squares(
            fit.error, x0, bounds=(low, high), diff_step=[1e-4] * len(x0), max_nfev=40
        )
        n, e = len(t), np.asarray(solution.fun)
        power = float(e @ e)
        info = np.asarray(solution.jac).T @ np.asarray(solution.jac)
        if not np.all(np.isfinite(info)) or np.linalg.cond(info) > 1e14:
            continue
        rho = float(np.clip(e[1:] @ e[:-1] / max(power, 1e-300), 0.0, 0.99))
        variance = power / n * (1.0 + rho) / (1.0 - rho) * np.linalg.inv(info)[0, 0]
        criterion = n * np.log(max(power, 1e-300) / n) + (lags + 2) * np.log(n)
        share = 1.0 - power / (n * float(np.var(y)))
        if share >= AGREES and (best is None or criterion < best[0]):
            theta = float(solution.x[0]) - AWAY
            error = float(np.sqrt(variance + (RESOLVED * fit.step) ** 2))
            best = (criterion, DeadTime(theta, error, share))
    return None if best is None else best[1]


@dataclass(frozen=True, eq=False)
class _Lagged:
    """Commands through lags and a dead time, fitted to a reading.

    Attributes:
        t, y: the measurement, (N,).
        start, step: of the fine grid on which commands are filtered [s].
        u: means of the held commands on it, (M, n).
    """

    t: Array
    y: Array
    start: float
    step: float
    u: Array

    @classmethod
    def of(cls, t: Array, y: Array, commands: Sequence[tuple[Array, Array]]) -> "_Lagged | None":
        """None where the commands do not move."""
        usual = [float(np.median(np.diff(t))), *(float(np.median(np.diff(c))) for c, _ in commands)]
        start = min(float(t[0]), *(float(c[0]) for c, _ in commands)) - LONGEST
        step = max(min(usual) / 2.0, (float(t[-1]) - start) / (10 * MAX_MEASUREMENTS))
        edges = np.arange(0.0, np.ceil((float(t[-1]) + LONGEST - start) / step) + 1.0)
        parts = [
            zero_order_hold_means(np.append(0.0, (c - start) / step), np.vstack([u[:1], u]), edges)
            for c, u in commands
        ]
        u = np.hstack(parts)
        u = u[:, np.all(np.isfinite(u), axis=0) & (np.ptp(u, axis=0) > 0.0)]
        return cls(t, y, start, step, u - u[0]) if u.shape[1] else None

    def filtered(self, lags: Sequence[float]) -> Array:
        """The commands behind the lags [s], at the edges of the grid, (M + 1, n)."""
        x = np.vstack([np.zeros(self.u.shape[1]), self.u])
        for number, lag in enumerate(lags):
            a = float(np.exp(-self.step / lag))
            b = [1.0 - a] if number == 0 else [0.5 * (1.0 - a), 0.5 * (1.0 - a)]
            x = np.asarray(lfilter(b, [1.0, -a], x, axis=0))
        return x

    def error(self, parameters: Array) -> Array:
        """What the best gains leave of the measurement, (N,).

        Args:
            parameters: dead time and ``AWAY`` [s], then logarithms of the lags.
        """
        lags = np.exp(parameters[1:]).tolist()
        return self._left(self.filtered(lags), float(parameters[0]) - AWAY, lags)

    def _left(self, x: Array, theta: float, lags: list[float], some: slice = EVERY) -> Array:
        t, y = self.t[some], self.y[some]
        at = (t - theta - self.start) / self.step
        grid = np.arange(len(x), dtype=np.float64)
        fading = [np.exp((self.t[0] - t) / lag) for lag in lags]  # of what moved before the first
        responses = [np.interp(at, grid, c) for c in x.T]
        phi = np.column_stack([np.ones(len(t)), *fading, *responses])
        return np.asarray(y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0])

    def coarse(self) -> tuple[float, float]:
        """The best of a grid of dead times and lags [s]."""
        some = slice(None, None, max(len(self.t) // 1000, 1))
        best = (np.inf, 0.0, 1.0)
        for lag in np.geomspace(2.0 * self.step, SLOWEST, 10):
            x = self.filtered([float(lag)])
            for theta in np.linspace(EARLIEST, LONGEST, 25):
                e = self._left(x, float(theta), [float(lag)], some)
                best = min(best, (float(e @ e), float(theta), float(lag)))
        return best[1], best[2]


def _apart(
    reference: Stream, other: Stream, zero_order_hold: frozenset[str], row: float
) -> Latency | None:
    """How late a topic is behind another one that measures the same motion."""
    moved, also = (_motion(stream, zero_order_hold) for stream in (reference, other))
    if moved is None or also is None:
        return None
    shift = clock_shift(reference.t, moved, other.t, also)
    sure = shift.agreement >= AGREES and shift.rival is None and shift.std_error > 0.0
    if not sure or abs(shift.seconds) > LONGEST or shift.std_error > TELLS * row:
        return None
    topics = other.topic, reference.topic
    return Latency(topics[0], -shift.seconds, shift.std_error, topics[1], responds=False)


def _motion(stream: Stream, zero_order_hold: frozenset[str]) -> Array | None:
    """What a stream has moved since its start, (N, k)."""
    if np.isfinite(stream.values).all():
        column = dict(zip(stream.names, stream.values.T, strict=True))
        if {"x", "y", "psi"} <= column.keys():
            return way_and_turn(column["x"], column["y"], np.unwrap(column["psi"]))
        others = {*zero_order_hold, *stream.angles}
        rates = [v for n, v in column.items() if n not in others and np.ptp(v)]
        return travelled(stream.t, np.column_stack(rates)) if rates else None
    return None


def _latency_finding(one: Latency, where: str, late: Mapping[str, float]) -> Finding:
    size = f"{1e3 * abs(one.seconds):.3g} ± {1e3 * one.std_error:.2g} ms"
    size += " late" if one.seconds >= 0.0 else " early"
    text = f"is {size} beside {one.behind}, by the motion that both measure"
    advice = "`latency='remove'` moves it back."
    if one.responds:
        text = f"responds to {one.behind} {size}, by a fit of a lag with dead time"
        advice = "The model includes this dead time; `latency='remove'` removes it from the log."
    if one.topic in late:
        text, advice = f"{text}; it was moved back by that time.", ""
    elif not one.seen:
        text, advice = f"{text}: not significant.", ""
    else:
        text += "."
    return Finding("latency", Severity.NOTE, f"{where}: {one.topic} {text}", advice)
