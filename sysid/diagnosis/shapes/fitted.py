"""Shapes fitted to the errors of a model, each with its evidence on held-out data."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.evidence import (
    Evidence,
    compare_errors,
    effective_samples,
    likelihood,
)
from sysid.diagnosis.shapes.shape import Curve, Shape, Terms, best_of_scan
from sysid.diagnosis.shapes.smoother import Fit, fit, residual_of
from sysid.diagnosis.shapes.table import SHAPES
from sysid.diagnosis.shapes.track import Mask, Track
from sysid.fitting.holdout import Errors

ROUNDS = 4
"""Fits of a shape, each with the speed that the last one simulates; the best counts."""

SETTLED = 1e-3
"""Change of the squared error by which a further round is not worth its time."""

LEAST_FITTED, LEAST_JUDGED = 30, 10

BOTH = np.ones(1, dtype=bool)


@dataclass(frozen=True, eq=False)
class FittedShape:
    """A shape on one track.

    Attributes:
        numbers: what it costs: effective numbers, and one where a value is scanned.
        before, after: errors without and with it, one column; of what may be fitted without it the
            better.
        share: share of the held-out squared error above the noise that it explains.
        score: penalised likelihood ratio to the candidate model over both parts.
    """

    shape: Shape
    track: Track
    index: int
    numbers: float
    before: Errors
    after: Errors
    evidence: Evidence
    share: float
    score: float
    _terms: Terms = field(repr=False)
    _fit: Fit = field(repr=False)
    _at: int = 0

    @property
    def proven(self) -> bool:
        """Whether it passes the rule that effects pass."""
        return self.evidence.accepted

    @property
    def follows_anything(self) -> bool:
        """Whether it is a free curve that has, with the core, more numbers than the command has
        moves: whatever these do to the output, it can do, too."""
        free = self._terms.penalty is not None
        return free and self.numbers + self.track.own.shape[1] > self.track.moves

    def says(self) -> tuple[str, Curve | None]:
        """The sentence and the curve, with its band."""
        v = float(self.after.mean_squares()[0][0])
        n = sum(int(np.isfinite(e).sum()) for e in self.after.estimation)
        inflated = v * n / float(effective_samples(self.after.estimation)[0])
        return self._terms.says(self._fit, self._at, float(np.sqrt(inflated)))


def fitted_shapes(
    tracks: Sequence[Track], floor: Array, moves: bool, shapes: Sequence[Shape] = SHAPES
) -> tuple[FittedShape, ...]:
    """Every shape on every track, those with most evidence first.

    Args:
        floor: noise of each output, (tracks,).
        moves: whether the outputs may be of something that turns or moves.
    """
    possible = [s for s in shapes if moves or not s.of_motion]
    found: list[FittedShape] = []
    for i, track in enumerate(tracks):
        if not track.bounded:
            continue  # a model without one of its effects may run away
        found += _on_track(track, i, float(floor[i]), possible, len(possible) * len(tracks))
    return tuple(sorted(found, key=lambda s: -s.score))


def _on_track(
    track: Track, index: int, floor: float, shapes: Sequence[Shape], tried: int
) -> list[FittedShape]:
    fits: list[tuple[Shape, Terms, int, Fit, Mask, Mask]] = []
    for shape in shapes:
        fitted, judged = (
            (track.fitted_in_time, track.judged_in_time)
            if shape.in_time
            else (track.fitted, track.judged)
        )
        there = np.isfinite(track.error)
        fitted, judged = fitted & there, judged & there
        if fitted.sum() < LEAST_FITTED or judged.sum() < LEAST_JUDGED:
            continue
        if (done := _fitted(shape, track, fitted)) is not None:
            fits.append((shape, *done, fitted, judged))
    if not fits:
        return []
    least = min(fits, key=lambda f: f[3].rss / f[4].sum())
    samples = effective_samples(_column(least[3].residual, least[4], track))
    judged_shapes = []
    for shape, terms, at, result, fitted, judged in fits:
        before = _without(track, terms, fitted, judged)
        after = Errors(
            _column(result.residual, fitted, track), _column(result.residual, judged, track)
        )
        numbers = result.numbers + (len(terms.columns) > 1)
        beside = 0 if terms.beside is None else terms.beside.shape[1]
        plain = _plain(track, fitted, judged)
        evidence = compare_errors(before, after, numbers, tried, BOTH, samples)
        judged_shapes.append(
            FittedShape(
                shape,
                track,
                index,
                numbers,
                before,
                after,
                evidence,
                share_of_excess(before, after, floor),
                likelihood(plain, after, numbers + beside, samples),
                terms,
                result,
                at,
            )
        )
    return judged_shapes


def _fitted(shape: Shape, track: Track, rows: Mask) -> tuple[Terms, int, Fit] | None:
    """The terms, which of the scanned values is best, and the fit; None where nothing fits."""
    terms = shape.terms(track)
    if terms is None or not np.isfinite(terms.columns).all():
        return None
    at = 0
    if len(terms.columns) > 1:
        at, _ = best_of_scan(track.error, _own(track, terms), terms.columns, rows)
    seen, best = track, None
    for _ in range(ROUNDS):
        # curves of the speed already hold what the core's own numbers would do to it
        own = _own(track if shape.of_speed and not shape.in_time else seen, terms)
        if not (np.isfinite(own).all() and np.isfinite(terms.columns[at]).all()):
            break  # a simulated speed that grows without end
        result = fit(track.error, own, terms.columns[at], terms.penalty, rows)
        result = replace(result, on_base=seen is track)
        if not np.isfinite(result.rss):
            break
        before = np.inf if best is None else best[2].rss
        if best is None or result.rss < before:
            best = terms, at, result
        if result.rss < before < (1.0 + SETTLED) * result.rss:
            break
        seen = replace(track, speed=track.run + result.moved)
        if shape.of_speed:
            terms = shape.terms(seen) or terms
            at = min(at, len(terms.columns) - 1)
            if len(terms.columns) > 1 and np.isfinite(terms.columns).all():
                at, _ = best_of_scan(track.error, _own(track, terms), terms.columns, rows)
    return best


def _own(track: Track, terms: Terms) -> Array:
    return track.own if terms.beside is None else np.column_stack([track.own, terms.beside])


def _without(track: Track, terms: Terms, fitted: Mask, judged: Mask) -> Errors:
    """Errors of the candidate model, or of what else may be fitted without the shape's own terms
    where those are smaller."""
    plain = _plain(track, fitted, judged)
    if terms.beside is None:
        return plain
    beside = residual_of(track.error, _own(track, terms), fitted)
    other = Errors(_column(beside, fitted, track), _column(beside, judged, track))
    better = other.mean_squares()[1][0] < plain.mean_squares()[1][0]
    return other if better else plain


def _plain(track: Track, fitted: Mask, judged: Mask) -> Errors:
    """Errors of the candidate model."""
    return Errors(_column(track.error, fitted, track), _column(track.error, judged, track))


def _column(error: Array, rows: Mask, track: Track) -> tuple[Array, ...]:
    """Errors of the rows that count, NaN elsewhere, (N, 1) a record."""
    whole = np.where(rows, error, np.nan)[:, None]
    return tuple(np.split(whole, track.starts[1:-1]))


def share_of_excess(before: Errors, after: Errors, floor: float) -> float:
    """Share of the held-out squared error above the noise that is explained, 0 … 1."""
    old, new = (float(e.mean_squares()[1][0]) for e in (before, after))
    above = old - floor**2
    return float(np.clip((old - new) / above, 0.0, 1.0)) if above > 0.0 else 0.0
