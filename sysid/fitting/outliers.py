"""Bad measurements and disturbances among a model's prediction errors.

A bad *measurement* is an isolated one: it spoils its own error and, where past outputs enter the
prediction, the errors of the samples that look back at it, in a pattern π that the model knows;
with another value in its place all of them are ordinary (an additive outlier, Fox 1972). A
*disturbance* is in the plant: its own error stands out, and what follows is predicted from it (an
innovational outlier). With π(0) = 1 the measurement explains (πᵀε)²/πᵀπ of the errors' power, the
disturbance ε(t)²; what explains more is believed (Chen & Liu 1993).

A bad measurement is replaced by what the model predicts from the past, so that it spoils no
regressor, and neither its error nor that of a disturbance counts. Errors of the samples that look
back at the replaced measurement have the variance σ²(1 + π²): they count less, and not at all where
π is large.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import HARDLY, Array, Record
from sysid.fitting.outlier_events import Event, explained
from sysid.fitting.robust import NOTHING, robust_scale

Mask = NDArray[np.bool_]
Errors = Callable[[Array], Array]
"""y (N, ny) → one-step prediction errors (N, ny)."""

FALSE_ALARMS = 0.5
"""Good errors of a whole record, expected to lie beyond the threshold."""

TAIL = (0.8, 0.9)
"""Quantiles of the errors' size that, with the median, show how heavy their tail is. Before the bad
measurements are replaced only the first counts: one in twenty spoils a sixth of the errors where
two past outputs are looked at."""

MOST = 0.1
"""When more than this share of the errors stands out, these are no outliers: it is the model that
does not hold there."""

NEAR = 0.6
"""Errors beyond this share of the threshold are looked at: with what follows they may exceed it."""

LONGEST = 32
"""Samples over which a measurement's effect on later errors is followed; it has decayed by then."""

FELT = 0.03
"""Effects below this share of the error itself are not followed."""

STRONG = 0.15
"""Effect of a replaced measurement on later errors from which on a fit does not look at them: those
of several samples hold the same unknown, which biases what is fitted to their correlation."""

SOME = 0.25
"""Share of the places tried that must feel an effect so late. A measurement at the head also moves
the initial state that is fitted there, and so all errors a little."""

PASSES = 6
"""Rounds of search within one record: an outlier may hide behind a larger one."""

PRECISE = 1e-6
"""Replaced measurements are settled when they change by less than this share of the errors' "
"scale."""

APART = 4.0
"""Standard deviations of a rank sum beyond which errors stand out where inputs or outputs are
special, one chance in 10⁴ each: such errors are the model's, not accidents."""

SPECIAL = 0.1
"""Share of the samples that then count as special."""

WINDOWS = (1, 5, 20)
"""Samples back over which a change of an input is remembered there."""


@dataclass(frozen=True, eq=False)
class Outliers:
    """What stands out in one record.

    Attributes:
        bad_measurements: measurements to be replaced, (N, ny).
        disturbances: disturbances of the plant, (N, ny).
        change: what replaces every bad measurement, less the measurement, (N, ny); zero elsewhere.
        weights: how much each error counts, (N, ny), 0 for outliers.
        limits: size beyond which an error of each output stands out, (ny,).
        doubtful: errors that stood out where the model itself is to blame.
    """

    bad_measurements: Mask
    disturbances: Mask
    change: Array
    weights: Array
    limits: Array
    doubtful: int = 0

    @property
    def found(self) -> Mask:
        """Readings and disturbances that stand out, (N, ny)."""
        return np.asarray(self.bad_measurements | self.disturbances)

    def none(self) -> "Outliers":
        """The same with nothing left out."""
        nothing = np.zeros_like(self.bad_measurements)
        change, weights = np.zeros(nothing.shape), np.ones(nothing.shape)
        return Outliers(nothing, nothing, change, weights, self.limits, self.doubtful)

    def marked(self, record: Record) -> Record:
        """The record with bad measurements replaced and weights; itself where nothing stands out.

        Any offset of the outputs may have been removed from it.
        """
        if not self.found.any():
            return record
        return replace(record, y=record.y + self.change, weights=self.weights)


def find_outliers(errors: Errors, record: Record, first: int = 0) -> Outliers:
    """Find what stands out of a model's one-step prediction errors on a record.

    Args:
        errors: the model's errors on this record's inputs for any outputs.
        first: samples before this one have no error of their own.
    """
    return _Search(errors, record, first).run()


def limits_of(errors: Array, resolution: Array, tail: Sequence[float] = TAIL) -> Array:
    """Size beyond which an error of each output stands out, (ny,).

    c times the scale of their bulk, where c is such that of N errors FALSE_ALARMS are expected
    beyond it: for Gaussian errors or, where these have a heavier tail, for errors whose size has
    the Weibull distribution through their median and a high quantile. Reading in steps of q makes
    errors up to q/2, so that no scale is below q/√12.

    Args:
        errors: (N, ny); NaN are left out.
        resolution: step q in which each output is read, (ny,).
        tail: quantiles of the errors' size that show how heavy their tail is.
    """
    from scipy.special import ndtri

    limits = []
    for e, step in zip(errors.T, resolution, strict=True):
        size = np.abs(e[np.isfinite(e)])
        least = step / np.sqrt(12.0)
        scale = robust_scale(e, least)
        beyond = FALSE_ALARMS / max(len(size), 1)
        limit = -float(ndtri(beyond / 2.0)) * scale
        moving = size[size > NOTHING * np.max(size, initial=0.0)]
        if scale > least and len(moving):
            middle = float(np.median(moving))
            for high, share in zip(np.quantile(moving, tail), tail, strict=True):
                # P(size > x) = 2^(−(x/median)^shape)
                shape = np.log(-np.log2(1.0 - share)) / np.log(max(high / middle, 1.0 + 1e-9))
                limit = max(limit, middle * float(-np.log2(beyond)) ** (1.0 / shape))
        limits.append(limit)
    return np.array(limits)


def resolutions(y: Array) -> Array:
    """Step in which each output is read, (ny,): the usual distance of neighbouring values.

    Zero where hardly a value occurs twice: the log then says nothing about the sensor's steps.
    """
    steps = []
    for column in y.T:
        values = np.unique(column)
        gaps = np.diff(values)
        gaps = gaps[gaps > NOTHING * np.ptp(column)] if len(gaps) else gaps
        many = len(values) > len(column) // 2
        steps.append(0.0 if many or not len(gaps) else float(np.median(gaps)))
    return np.array(steps)


class _Search:
    def __init__(self, errors: Errors, record: Record, first: int) -> None:
        self.errors, self.record, self.first = errors, record, first
        self.resolution = resolutions(record.y)
        self.bad_measurements: Mask = np.zeros(record.y.shape, dtype=bool)
        self.disturbances: Mask = np.zeros(record.y.shape, dtype=bool)
        self.root = np.ones(record.y.shape)
        self.y = record.y.copy()
        self.e = self._known(errors(self.y))

    def run(self) -> Outliers:
        limits = self._limits(TAIL[:1])
        for _ in range(PASSES):
            events = self._events(limits)
            if not events:
                break
            for event in events:
                target = self.bad_measurements if event.bad_measurement else self.disturbances
                target[event.sample, event.output] = True
            self._replace(limits)
            limits = self._limits()
        self._withdraw(limits)
        doubtful = self._accidents_only()
        if np.mean(self.bad_measurements | self.disturbances) > MOST:
            doubtful += int(np.sum(self.bad_measurements | self.disturbances))
            self.bad_measurements[:] = self.disturbances[:] = False
        self._replace(limits)
        weights = np.where(self.root**2 < 1.0 / (1.0 + STRONG**2), HARDLY, self.root**2)
        weights = np.where(self.bad_measurements | self.disturbances, 0.0, weights)
        change = np.where(self.bad_measurements, self.y - self.record.y, 0.0)
        return Outliers(self.bad_measurements, self.disturbances, change, weights, limits, doubtful)

    @staticmethod
    def _known(e: Array) -> Array:
        return np.where(np.isfinite(e), e, 0.0)

    def _limits(self, tail: Sequence[float] = TAIL) -> Array:
        e = np.where(self.bad_measurements | self.disturbances, np.nan, self.root * self.e)
        e[: self.first] = np.nan
        return limits_of(e, self.resolution, tail)

    def _replace(self, limits: Array) -> None:
        """Every bad measurement replaced by its prediction, one after the other in time."""
        self.y = np.where(self.bad_measurements, self.y, self.record.y)
        e = self.e
        for _ in range(2 * LONGEST):
            e = self._known(self.errors(self.y))
            change = np.where(self.bad_measurements, e, 0.0)
            if not np.any(np.abs(change) > PRECISE * limits):
                break
            self.y = self.y - change
        self.e = e
        self.root = 1.0 / np.sqrt(self._inflation())

    def _events(self, limits: Array) -> list[Event]:
        """New outliers: each with what it does to the errors, the errors in units of the limits."""
        relative = self.root * self.e / limits
        fresh = ~(self.bad_measurements | self.disturbances)
        places = [
            (int(t), int(i))
            for t, i in np.argwhere((np.abs(relative) > NEAR) & fresh)
            if t >= self.first
        ]
        if not places or not np.any(np.abs(relative[fresh]) > 1.0):
            return []
        patterns = self._patterns(places, limits)
        return explained(relative, places, patterns)

    def _patterns(self, places: list[tuple[int, int]], limits: Array) -> list[Array]:
        """What a bad measurement of one limit at each place does to the errors from there on, (M,
        ny).

        Measured on the model: the measurement is replaced by its prediction and the change of the
        errors compared. Places far enough apart are tried at once.
        """
        spread = self._apart(places, LONGEST + 1)
        patterns: dict[tuple[int, int], Array] = {}
        tried = self._tried(spread[0], LONGEST, limits)
        felt = np.mean([np.max(np.abs(e), axis=1) > FELT for e in tried.values()], axis=0)
        memory = 1 + int(np.flatnonzero(felt > SOME).max(initial=0))
        patterns.update(tried)
        rest = [p for p in places if p not in patterns]
        if memory == 1:
            for place in rest:
                alone = np.zeros((1, self.y.shape[1]))
                alone[0, place[1]] = 1.0
                patterns[place] = alone
        else:
            for group in self._apart(rest, memory):
                patterns.update(self._tried(group, memory, limits))
        return [patterns[p][:memory] for p in places]

    def _apart(self, places: list[tuple[int, int]], distance: int) -> list[list[tuple[int, int]]]:
        """Places dealt out to as few groups as keep them ``distance`` samples apart, in order."""
        groups: list[list[tuple[int, int]]] = []
        for place in places:
            free = next((g for g in groups if place[0] - g[-1][0] >= distance), None)
            if free is None:
                groups.append([place])
            else:
                free.append(place)
        return groups

    def _tried(
        self, group: list[tuple[int, int]], length: int, limits: Array
    ) -> dict[tuple[int, int], Array]:
        y = self.y.copy()
        for t, i in group:
            y[t, i] -= self.e[t, i]
        change = (self.e - self._known(self.errors(y))) / limits
        scores = {}
        for t, i in group:
            size = self.e[t, i] / limits[i]
            effect = np.zeros((length, y.shape[1]))
            part = change[t : t + length]
            effect[: len(part)] = part / size
            effect[0] = np.where(np.arange(y.shape[1]) == i, 1.0, effect[0])
            effect[: len(part)] *= self.root[t : t + length]
            scores[t, i] = effect
        return scores

    def _withdraw(self, limits: Array) -> None:
        """Readings that are no longer strange once the others are replaced count again."""
        while self.bad_measurements.any():
            off = np.abs(self.record.y - self.y) / limits
            kept = self.bad_measurements & (off > NEAR)
            if np.array_equal(kept, self.bad_measurements):
                return
            self.bad_measurements = kept
            self._replace(limits)

    def _accidents_only(self) -> int:
        """Drop what stands out together with special inputs or outputs; how many that were.

        An accident knows nothing of the inputs. Errors that stand out where an input has just
        jumped, or where inputs or outputs are at an end of their range, are the model's own, and
        leaving them out would hide what it does not describe.
        """
        dropped = 0
        flagged = self.bad_measurements | self.disturbances
        for feature in _features(self.record.u, self.y - self.e):
            for i in range(flagged.shape[1]):
                of_output = flagged[:, i]
                special = _special(feature, of_output)
                dropped += int(np.sum(of_output & special))
                self.bad_measurements[:, i] &= ~special
                self.disturbances[:, i] &= ~special
        return dropped

    def _inflation(self) -> Array:
        """1 + Σ π² of the samples that look back at replaced measurements, 1 elsewhere, (N, ny)."""
        places = [
            (int(t), int(i)) for t, i in np.argwhere(self.bad_measurements) if t >= self.first
        ]
        inflation = np.ones(self.y.shape)
        if not places:
            return inflation
        scale = np.maximum(np.array([robust_scale(e[self.first :]) for e in self.e.T]), 1e-300)
        for group in self._apart(places, LONGEST + 1):
            y = self.y.copy()
            for t, i in group:
                y[t, i] += scale[i]
            change = (self._known(self.errors(y)) - self.e) / scale
            for t, _ in group:
                part = change[t + 1 : t + LONGEST]
                inflation[t + 1 : t + LONGEST] += np.where(np.abs(part) > FELT, part, 0.0) ** 2
        return inflation


def _features(u: Array, y: Array) -> list[Array]:
    """What may make a sample special: levels and changes of inputs and predicted outputs, (N,)."""
    features = []
    for x in u.T:
        change = np.abs(np.diff(x, prepend=x[:1]))
        features += [_recent(change, n) for n in WINDOWS]
        features.append(np.abs(x - np.median(x)))
    for x in y.T:
        features += [np.abs(np.diff(x, prepend=x[:1])), np.abs(x - np.median(x))]
    return features


def _recent(x: Array, samples: int) -> Array:
    """Largest of the last ``samples`` values."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(x, samples, origin=(samples - 1) // 2, mode="nearest"))


def _special(feature: Array, flagged: Mask) -> Mask:
    """The samples at the end of a feature where those found gather; none where they do not."""
    from scipy.stats import rankdata

    n, k = len(feature), int(flagged.sum())
    none = np.zeros(n, dtype=bool)
    if k == 0 or k == n:
        return none
    rank = rankdata(feature)
    # ties (an input that is mostly constant) lower the variance of the ranks
    spread = float(np.std(rank)) * np.sqrt(k * (n - k) / n)
    if spread == 0.0:
        return none
    score = (float(np.sum(rank[flagged])) - k * float(np.mean(rank))) / spread
    if abs(score) <= APART:
        return none
    order = rank if score > 0.0 else -rank
    return np.asarray(order > np.quantile(order, 1.0 - SPECIAL))
