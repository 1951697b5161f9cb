"""LogFacts: what a log says without a model, each fact computed when first asked for, and once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid.data.checks.constancy import (
    Beside,
    Change,
    change_within,
    level_drifts,
    regions_differ,
)
from sysid.data.checks.delay import Delay, estimate_delays, process_of, refined_delays
from sysid.data.checks.feedback import SURE, FeedbackTest, feedback_tests
from sysid.data.checks.integral import Integral, integrals
from sysid.data.checks.nonlinearity import (
    NONLINEAR,
    TRACE,
    NonlinearityTest,
    nonlinearity_tests,
)
from sysid.data.checks.unused_columns import change_with_column, drift_with_column
from sysid.data.finding import Finding
from sysid.data.noise import measurement_noise, settles
from sysid.data.outliers import Bridged, bridged
from sysid.data.process import ProcessFit
from sysid.data.reading.stale import Refresh, at_own_rate, refreshes, without_repeats
from sysid.data.record import Array, Record, shortened
from sysid.data.resolution import sensor_step
from sysid.data.rest import Rest, rest_head
from sysid.data.speed import Speed, estimate_speed
from sysid.errors import DataError

SAMPLES = 12_000
"""Samples that delays, feedback and orders are judged on: more would only find trifles."""

BENT = 0.2
"""Share of a linear predictor's errors that a nonlinearity predicts from which on a change in time
may be a curve, even where the regions are alike."""

LONGEST_DELAY = 30
"""Delays up to this one are looked for everywhere, longer ones where a correlation shows them."""


@dataclass(frozen=True, eq=False)
class LogFacts:
    """What some records say without a model.

    A command makes one and passes it down; nobody below estimates a fact again. A fact is None
    where the records are too short for it.

    Attributes:
        records: experiments with the same channels, on a uniform grid each.
        reading: what the reader found and did: sample times, gaps, repeated rows.
    """

    records: tuple[Record, ...]
    reading: tuple[Finding, ...] = ()

    @staticmethod
    def of(data: "Sequence[Record] | LogFacts") -> "LogFacts":
        """Facts as they are, or of records of which nothing is known yet."""
        return data if isinstance(data, LogFacts) else LogFacts(tuple(data))

    @cached_property
    def outliers(self) -> Bridged:
        """Single outputs that stand out, and the records with lines in their place."""
        return bridged(self.records)

    @cached_property
    def sample(self) -> tuple[Record, ...]:
        """At most ``SAMPLES`` samples without outliers: one of these outweighs all else."""
        return shortened(self.outliers.records, SAMPLES)

    @cached_property
    def refreshes(self) -> tuple[Refresh | None, ...]:
        """The rate of each output that is measured less often than logged; None for the others."""
        return refreshes(self.records)

    @cached_property
    def at_own_rate(self) -> "LogFacts":
        """Of the records at the rate of the slowest sensor; these where none is slower."""
        if not any(self.refreshes):
            return self
        return LogFacts(at_own_rate(self.records, self.refreshes))

    @cached_property
    def without_repeats(self) -> "LogFacts":
        """Of the records with repeats of slow sensors replaced by what lies between."""
        if not any(self.refreshes):
            return self
        return LogFacts(without_repeats(self.records, self.refreshes))

    @cached_property
    def noise(self) -> Array:
        """Measurement noise of each output, (ny,)."""
        return measurement_noise(self.records, self.refreshes)

    @cached_property
    def settles(self) -> NDArray[np.bool_]:
        """Outputs whose commands rest often enough to see the noise between changes, (ny,)."""
        return settles(self.records)

    @cached_property
    def steps(self) -> tuple[float, ...]:
        """The step in which the sensor of each output measures; 0 for none."""
        columns = np.concatenate([r.y for r in self.records]).T
        return tuple(sensor_step(y) for y in columns)

    @cached_property
    def rest(self) -> Rest | None:
        """Where the first record rests before its first command; None where it begins in motion."""
        return rest_head(self.outliers.records[0])

    @cached_property
    def as_logged(self) -> "LogFacts":
        """Of the records before they were filtered or decimated; these where none was."""
        logged = {id(r.as_logged): r.as_logged for r in self.records if r.as_logged}
        return LogFacts(tuple(logged.values())) if logged else self

    @cached_property
    def feedback(self) -> tuple[FeedbackTest, ...] | None:
        """Whether inputs follow from outputs, one verdict an output."""
        try:
            return feedback_tests(self.as_logged.sample)
        except DataError:
            return None

    @property
    def closed_loop(self) -> bool:
        """Whether an input follows from an output: beyond chance, and not a trace."""
        return any(t.seen for t in self.feedback or ())

    @property
    def laws_alone(self) -> tuple[FeedbackTest, ...]:
        """Laws that explain the only input by an output, no set point beside it: a controller
        alone moves it, or, where feedback is not seen, may do so. A set point that never moves
        beside sure feedback says the same of a law that does not show: of a sensor of its own."""
        rests = any(r.still_references for r in self.records)
        rests = rests and all(r.references is None for r in self.records)
        laws = [
            t
            for t in self.feedback or ()
            if not t.reference and not t.relay and (t.law is not None or (rests and t.sure))
        ]
        return tuple(laws) if self.records[0].nu == 1 else ()

    @property
    def surely_closed_loop(self) -> bool:
        """Whether it does so for sure and strongly, and with commands that seldom rest."""
        return any(t.sure for t in self.feedback or ())

    @cached_property
    def _unfiltered(self) -> tuple[Record, ...]:
        """The sample as it was measured: a filter leaves the delay, and too little to see it by."""
        logged = self.as_logged
        return (logged if logged.records[0].dt == self.records[0].dt else self).sample

    @cached_property
    def _lags(self) -> tuple[Delay, ...] | None:
        """The delay of every pair as a regression sees it."""
        sample = self._unfiltered
        longest = min(LONGEST_DELAY, max(min(len(r) for r in sample) // 20, 2))
        try:
            return estimate_delays(sample, longest, shortest=self._shortest)
        except DataError:
            return None

    @property
    def _shortest(self) -> int:
        """1 where a response within the sample is without doubt a controller's, else 0."""
        return int(any(t.seen and t.p_value < SURE for t in self.feedback or ()))

    @cached_property
    def processes(self) -> tuple[ProcessFit | None, ...]:
        """Each output as lags and dead times of the inputs; None where that is not believed."""
        lags = self._lags or ()
        return tuple(
            process_of(self._unfiltered, j, [d for d in lags if d.output == s.output], s)
            for j, s in enumerate(self.speeds)
        )

    @cached_property
    def delays(self) -> tuple[Delay, ...] | None:
        """The delay of every pair; within the sample only where no controller responds."""
        if self._lags is None:
            return None
        return refined_delays(self._lags, self.processes, self.records[0].dt, self._shortest)

    @cached_property
    def changes(self) -> tuple[Change, ...]:
        """What changes within the log, by output: a gain or lags, with an unused column or, if
        none explains as much, at a time or all along."""
        return tuple(c for c, curved in self._seen_changes if not curved)

    @cached_property
    def changes_or_curves(self) -> tuple[Change, ...]:
        """The same where a curve of a nonlinear output may look like it."""
        return tuple(c for c, curved in self._seen_changes if curved)

    @cached_property
    def _seen_changes(self) -> tuple[tuple[Change, bool], ...]:
        seen: list[tuple[Change, bool]] = []
        for j, fit in enumerate(self.processes):
            if fit is None:
                continue
            beside = Beside(self._unfiltered, j, fit)
            other = change_with_column(beside)
            if other is None and self.drifts[j]:
                other = drift_with_column(beside)
            change = other or change_within(beside)
            if change is not None:
                seen.append((change, other is None and self._by_region(change)))
        return tuple(seen)

    def _by_region(self, change: Change) -> bool:
        """Whether a curve of a nonlinear output may look like this change: all along, or where
        its other parts are visited."""
        share = self._bent(change.output)
        elsewhere = not change.is_step or regions_differ(self.sample, change.at)
        return share > BENT or (share > 0.0 and elsewhere)

    def _bent(self, output: str) -> float:
        """Share of the errors that a nonlinearity predicts; 0 where it is none, or a trace."""
        test = {t.output: t for t in self.nonlinearity or ()}.get(output)
        seen = test is not None and test.p_value < NONLINEAR and test.share >= TRACE
        return test.share if test is not None and seen else 0.0

    @cached_property
    def drifts(self) -> Array:
        """Range of the drift of each output's level, in its unit; 0 where there is none, (ny,)."""
        ranges = np.zeros(self.records[0].ny)
        for j, fit in enumerate(self.processes):
            seen = 0.0 if fit is None else level_drifts(self.sample, j, fit)
            if seen and not self._bent(self.records[0].output_names[j]):
                ranges[j] = seen
        return ranges

    @cached_property
    def nonlinearity(self) -> tuple[NonlinearityTest, ...] | None:
        """Whether products of past inputs and outputs predict what a linear predictor leaves.

        Empty where an input follows an output by a law: the two have then no predictor to
        themselves, and what it simulates may grow without end.
        """
        if any(t.law for t in self.feedback or ()):
            return ()
        try:
            return nonlinearity_tests(self.outliers.records, feedback=self.closed_loop)
        except DataError:
            return None

    @cached_property
    def integrals(self) -> tuple[Integral, ...]:
        """The outputs that integrate an input."""
        return integrals(self.outliers.records)

    @cached_property
    def speeds(self) -> tuple[Speed, ...]:
        """The time of each output to 63 % of its step response."""
        return estimate_speed(self.outliers.records)


def without_drift(record: Record) -> Record:
    """The record less the slow drift of its outputs about their means (see ``processes``).

    A log longer than ``SAMPLES`` is looked at in means of a few samples.
    """
    every = -(-len(record) // SAMPLES)
    n = len(record) // every
    coarse = replace(record.averaged(every), sha256="")
    moved = record.y.copy()
    at = np.arange(len(record)) / every - 0.5 * (every - 1) / every
    for j, fit in enumerate(LogFacts((coarse,)).processes):
        if fit is None:
            raise DataError(
                f"{record.name}: how {record.output_names[j]} follows the inputs is not clear "
                "enough to tell a drift from it; omit `remove_drift`"
            )
        moved[:, j] -= np.interp(at, np.arange(n), fit.drift - fit.drift.mean())
    return replace(record, y=moved)
