"""How the gate judges: what a row holds, when a value fails, when a row is measured again.

Nothing here measures anything of the package or reads a file, so that all of it is tested with rows
made up for the purpose.
"""

import gc
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

Value = float | tuple[str, ...]
"""What a row comes to: a number, or names that must be exactly these."""


class Skip(Exception):  # noqa: N818 - not an error
    """A row cannot be measured here; its text is the reason."""


class Verdict(Enum):
    """What becomes of a row; only FAIL makes the command fail."""

    OK = "ok"
    BETTER = "ok, better: the committed value can be tightened"
    FAIL = "FAIL"
    SKIP = "skip"


@dataclass(frozen=True)
class SpeedLimits:
    """How many times its committed value a ratio of times may reach.

    Attributes:
        hand: by hand; half as slow again is what a person who has just changed something wants
            to be told of.
        ci: in CI, where nobody looks and the machine is loaded. Below 2, as a measured doubling
            scatters around 2: the lowest of twenty was 1.89.
        rounds: how often all rows are measured, one after another, before any is judged: a load
            that makes everything slow for seconds then meets no row every time.
        repeats: how often a row over its limit is measured again before it fails, at the end of the
            queue for the same reason.
        better: below this part of its committed value a ratio is called better; above, the
            difference may be noise.
    """

    hand: float = 1.5
    ci: float = 1.7
    rounds: int = 3
    repeats: int = 2
    better: float = 0.75


LIMITS = SpeedLimits()


@dataclass(frozen=True)
class Committed:
    """A line of ``gate.json``.

    Attributes:
        value: what was reached.
        reason: why the tolerance, or what the value stands for, in a sentence.
        tolerance: part of the value by which a number may be worse; of accuracy rows.
        higher_is_better: whether a larger number is the better one.
        unit: of the number.
    """

    value: Value
    reason: str
    tolerance: float = 0.0
    higher_is_better: bool = False
    unit: str = ""

    @staticmethod
    def of(raw: Mapping[str, Any]) -> "Committed":
        """From JSON, where names are a list.

        Raises:
            TypeError: a key is not known, or one is missing.
        """
        value = raw["value"]
        kept = tuple(value) if isinstance(value, list) else float(value)
        return Committed(**{**raw, "value": kept})

    @property
    def limit(self) -> Value:
        """The worst value that an accuracy row may have."""
        if isinstance(self.value, tuple):
            return self.value
        margin = self.tolerance * abs(self.value)
        return self.value - margin if self.higher_is_better else self.value + margin


@dataclass(frozen=True)
class Judged:
    """A row of the answer.

    Attributes:
        row: its name.
        verdict: what becomes of it.
        value: measured; None where nothing could be.
        committed: of ``gate.json``; None where there is no such line.
        limit: the worst value that passes.
        words: why it was skipped or failed, where the numbers do not say so.
        measured: how often.
    """

    row: str
    verdict: Verdict
    value: Value | None = None
    committed: Value | None = None
    limit: Value | None = None
    words: str = ""
    measured: int = 1

    def to_json(self) -> dict[str, Any]:
        """By name; names as lists."""
        return {k: v.value if isinstance(v, Verdict) else v for k, v in vars(self).items()}


def judge_accuracy(row: str, value: Value, committed: Committed | None) -> Judged:
    """One-sided: worse than the limit fails, better is said."""
    if committed is None:
        return uncommitted(row, value)
    told = Judged(row, Verdict.OK, value, committed.value, committed.limit)
    if isinstance(value, tuple) or isinstance(committed.value, tuple):
        return told if value == committed.value else replace(told, verdict=Verdict.FAIL)
    if not math.isfinite(value):
        return replace(told, verdict=Verdict.FAIL, words="not a finite number")
    sign = -1.0 if committed.higher_is_better else 1.0
    worse = sign * (value - committed.value)
    margin = committed.tolerance * abs(committed.value)
    if worse > margin:
        return replace(told, verdict=Verdict.FAIL)
    return replace(told, verdict=Verdict.BETTER) if worse < -margin else told


def uncommitted(row: str, value: Value) -> Judged:
    """A row that ``gate.json`` does not know fails: nothing guards it."""
    words = f"no committed value: gate.py --update {row}"
    return Judged(row, Verdict.FAIL, value, words=words)


@dataclass(frozen=True)
class Times:
    """Quickest times of subject and reference [s], and how often both were measured in a row."""

    subject: float = math.inf
    reference: float = math.inf
    measured: int = 0

    def with_times(self, subject: float, reference: float) -> "Times":
        """The quicker of each: load only ever adds to what the work itself costs."""
        return replace(
            self,
            subject=min(self.subject, subject),
            reference=min(self.reference, reference),
        )

    @property
    def ratio(self) -> float:
        """Subject over reference."""
        return self.subject / self.reference


@dataclass(frozen=True, eq=False)
class SpeedRow:
    """Two pieces of work whose times are compared.

    Attributes:
        name: of the row.
        what: subject and reference in words.
        subject, reference: the work.
        clock: time that counts [s].
        repetitions: how many times both are timed, in turns.
        bursts: how often the reference runs within one timing, so that a short one is not lost in
            the resolution of the clock.
    """

    name: str
    what: str
    subject: Callable[[], object]
    reference: Callable[[], object]
    clock: Callable[[], float]
    repetitions: int = 5
    bursts: int = 1


def measure(row: SpeedRow, so_far: Times, times_over: int = 1) -> Times:
    """The row measured once more: subject, reference, subject, reference …

    Args:
        row: what.
        so_far: earlier measurements of it, which count on.
        times_over: how often the subject runs where it should run once: 2 is a true doubling of
            its work, which the gate must catch.
    """
    best = so_far
    for _ in range(row.repetitions):
        with _no_collection():
            began = row.clock()
            for _ in range(times_over):
                row.subject()
            between = row.clock()
            for _ in range(row.bursts):
                row.reference()
            best = best.with_times(between - began, (row.clock() - between) / row.bursts)
    return replace(best, measured=so_far.measured + 1)


@contextmanager
def _no_collection() -> Iterator[None]:
    """No garbage is collected meanwhile: it would cost what earlier rows have left, not this one.

    The same as in ``timeit`` of the standard library.
    """
    gc.collect()
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def judge_speed(
    row: str, times: Times, committed: Committed | None, ci: bool, limits: SpeedLimits = LIMITS
) -> Judged:
    """A ratio against its committed value."""
    if committed is None or isinstance(committed.value, tuple):
        return uncommitted(row, times.ratio)
    limit = committed.value * (limits.ci if ci else limits.hand)
    verdict = Verdict.FAIL if times.ratio > limit else Verdict.OK
    if times.ratio < limits.better * committed.value:
        verdict = Verdict.BETTER
    return Judged(
        row, verdict, times.ratio, committed.value, limit, measured=max(times.measured, 1)
    )


Prepare = Callable[[], SpeedRow]


def measure_in_turns(
    rows: Mapping[str, Prepare],
    committed: Mapping[str, Committed],
    ci: bool,
    *,
    doubled: Iterable[str] = (),
    limits: SpeedLimits = LIMITS,
    said: Callable[[str], None] = lambda words: None,
) -> tuple[Judged, ...]:
    """Measure and judge speed rows: rounds over all of them, then those over the limit again.

    A work that became slow stays slow however often it is measured, so a repetition can only take
    a false alarm back.

    Args:
        rows: name → what makes it ready, called once.
        committed: lines of ``gate.json``.
        ci: whether the limit is that of CI.
        doubled: rows whose subject runs twice.
        limits: how far is too far.
        said: called with what is measured next.

    Returns:
        One judgement a row, in the order of ``rows``.
    """
    twice = set(doubled)
    ready: dict[str, SpeedRow] = {}
    times: dict[str, Times] = {}
    found: dict[str, Judged] = {}
    queue = [*rows] * limits.rounds
    for name in queue:  # grows while it is walked
        if name in found and found[name].verdict is Verdict.SKIP:
            continue
        said(name)
        try:
            row = ready[name] if name in ready else ready.setdefault(name, rows[name]())
        except Skip as reason:
            found[name] = Judged(name, Verdict.SKIP, words=str(reason))
            continue
        times[name] = measure(row, times.get(name, Times()), 2 if name in twice else 1)
        if times[name].measured >= limits.rounds:
            found[name] = judge_speed(name, times[name], committed.get(name), ci, limits)
            failed = found[name].verdict is Verdict.FAIL and name in committed
            if failed and times[name].measured < limits.rounds + limits.repeats:
                queue.append(name)
    return tuple(found[name] for name in rows)


@dataclass(frozen=True)
class Gate:
    """The committed lines, by kind."""

    accuracy: Mapping[str, Committed] = field(default_factory=dict)
    speed: Mapping[str, Committed] = field(default_factory=dict)

    @staticmethod
    def of(raw: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> "Gate":
        """From the content of ``gate.json``."""
        return Gate(
            *({n: Committed.of(x) for n, x in raw[kind].items()} for kind in ("accuracy", "speed"))
        )


def chosen(asked: Sequence[str], known: Iterable[str]) -> tuple[str, ...]:
    """Rows by name, or by the part of a name before its slash; all where none is asked for.

    Raises:
        KeyError: there is no such row; its text lists all.
    """
    names = tuple(known)
    for word in asked:
        if not any(_is_asked(word, name) for name in names):
            raise KeyError(f"there is no row {word}; there are {', '.join(names)}")
    return tuple(n for n in names if not asked or any(_is_asked(word, n) for word in asked))


def _is_asked(word: str, name: str) -> bool:
    return word in ("all", name, name.partition("/")[0])
