"""Shapes against names: what is proven, and which names a shape explains better.

A name is withheld where a shape of another place of the chain, or of time, explains clearly more of
the data: by the rule of acceptance, with the numbers of both counted. At the same place a curve
that explains more is what the law misses: the name stands, and the curve shows the rest; only a
shape with as few numbers as a law takes its place. A drift is a free curve of time; one of more
numbers than the command has moves follows anything, and is told only where no other shape explains
half as much. A column of the log that acts comes before time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import RULE, SHAPES
from sysid.diagnosis.search.candidates import CandidateSearch
from sysid.diagnosis.search.evidence import Evidence, compare_errors, effective_samples
from sysid.diagnosis.search.selection import CandidateModel, SelectedEffect, Selection
from sysid.diagnosis.shapes.fitted import FittedShape, fitted_shapes
from sysid.diagnosis.shapes.shape import Curve, ShapePlace
from sysid.diagnosis.shapes.track import tracks_of
from sysid.effects.base import Effect, Place
from sysid.effects.catalogue import about
from sysid.fitting.holdout import Errors

PLACES = {
    Place.COMMAND: ShapePlace.COMMAND,
    Place.TORQUE: ShapePlace.TORQUE,
    Place.SPEED: ShapePlace.SPEED,
    Place.READING: ShapePlace.READING,
}


def _places_of(effect: Effect) -> set[ShapePlace | None]:
    """Where shapes lie that may be an effect's own law, bent: of a coupling also the tie between
    tracks, which is in the torque."""
    tied = {ShapePlace.TORQUE} if effect.couples else set()
    return {PLACES.get(effect.place), *tied}


@dataclass(frozen=True, eq=False)
class FoundShape:
    """A proven shape on one output.

    Attributes:
        share: share of the held-out squared error above the noise that it explains.
        numbers: effective numbers of it.
        curve: what a page draws; None where the sentence says all.
        effect: the effect at whose place it lies; empty for what no effect explains.
    """

    id: str
    place: str
    output: str
    share: float
    numbers: float
    evidence: Evidence
    sentence: str
    curve: Curve | None
    effect: str = ""

    def to_json(self) -> dict[str, object]:
        """As ``diagnosis.json`` holds it."""
        return {
            "id": self.id,
            "place": self.place,
            "output": self.output,
            "share_of_excess": self.share,
            "effective_numbers": self.numbers,
            "evidence": self.evidence.to_json(),
            "sentence": self.sentence,
            "curve": self.curve,
            "effect": self.effect,
        }


def shapes_around(
    search: CandidateSearch, candidate: CandidateModel, floor: Array, moves: bool
) -> tuple[FittedShape, ...]:
    """Every shape on every track around a candidate model, those with most evidence first."""
    return fitted_shapes(tracks_of(search, candidate), floor, moves)


def proven(
    fitted: Sequence[FittedShape], of_signals: Sequence[float], drifts: Sequence[float]
) -> tuple[FoundShape, ...]:
    """The best proven shape of each track; of equals the one with fewest numbers.

    Args:
        of_signals: share of each track's excess error that commands and outputs predict, (tracks,).
            What these predict as well is none of time.
        drifts: of each output, 0 where the level does not drift; what the inputs do is no part of
            these, so that a curve of the level need not stand back.
    """
    found = []
    for i in sorted({s.index for s in fitted}):
        passed = [s for s in fitted if s.index == i and s.proven]
        shown = max((s.share for s in passed if not s.shape.in_time), default=0.0)
        unused = [s.share for s in passed if s.shape.place is ShapePlace.UNUSED]
        alone = drifts[i] > 0.0 and not unused
        told = [s for s in passed if _is_told(s, shown, of_signals[i], alone)]
        near = [s for s in told if s.score > told[0].score - SHAPES.near]
        best = min(near, key=lambda s: s.numbers, default=None)
        if best is not None and best.shape.in_time:
            least = SHAPES.of_names * best.share
            measured = (s for s in told if s.shape.place is ShapePlace.UNUSED and s.share > least)
            best = next(measured, best)
        if best is not None:
            found.append(_beside_drift(best, passed) if best.follows_anything else _found(best))
    return tuple(found)


def _is_told(s: FittedShape, shown: float, of_signals: float, drifts: bool) -> bool:
    """Whether a proven shape may be told first; of those of time what nothing else explains.

    Args:
        shown: share of the excess error that the best shape of the machine itself explains.
        of_signals: the same of commands and outputs together.
        drifts: whether the level of the output drifts, whatever the inputs do, and no column that
            is not used explains a part of it.
    """
    if not s.shape.in_time:
        return True
    if drifts and s.shape.of_level:
        return max(shown, of_signals) < s.share
    if s.follows_anything:
        return max(shown, of_signals) < SHAPES.of_signals * s.share
    return of_signals < s.share


def _beside_drift(best: FittedShape, passed: Sequence[FittedShape]) -> FoundShape:
    """A free curve on a log of few moves, and a drift with clearly more evidence there, its many
    numbers counted: either may be what happened."""
    found = _found(best)
    drift = next((s for s in passed if s.shape.in_time and s.share >= best.share), None)
    if drift is None or best.shape.in_time or best.score > RULE.held_out * drift.score:
        return found
    sentence = (
        f"{found.sentence}; or {drift.says()[0]}: {best.track.command.name} moves only "
        f"{best.track.moves} times here, too few to distinguish them"
    )
    return replace(found, place=f"{found.place} or {drift.shape.place.value}", sentence=sentence)


def _found(shape: FittedShape, effect: str = "") -> FoundShape:
    sentence, curve = shape.says()
    return FoundShape(
        shape.shape.id,
        shape.shape.place.value,
        shape.track.output.name,
        shape.share,
        shape.numbers,
        shape.evidence,
        sentence,
        curve,
        effect,
    )


def curves_of(fitted: Sequence[FittedShape], named: SelectedEffect) -> tuple[FoundShape, ...]:
    """The best proven curve at the place of a named effect, one for each of its tracks.

    Args:
        fitted: around the model without the effect.
    """
    effect, curves = about(named.id), []
    for i in np.flatnonzero(named.touched).tolist():
        here = (s for s in fitted if s.index == i and s.proven)
        same = (
            s
            for s in here
            if (s.shape.in_time if effect.hints.gathers else s.shape.place in _places_of(effect))
        )
        best = next((found for found in (_found(s, named.id) for s in same) if found.curve), None)
        if best is not None:
            curves.append(best)
    return tuple(curves)


def better_shape(
    fitted: Sequence[FittedShape],
    selection: Selection,
    names: Sequence[SelectedEffect],
    without: CandidateModel,
    model_tracks: Sequence[int],
) -> FittedShape | None:
    """The shape that explains clearly more than some names together, over all of their tracks.

    Args:
        fitted: around the model ``without`` the names.
        model_tracks: the track of each parameter of the full model; −1 where all share it.
    """
    places = set().union(*(_places_of(about(n.id)) for n in names))
    added = [model_tracks[k] for k in selection.final.free if k not in without.free]
    pairs: list[tuple[Errors, Errors]] = []
    numbers, best = 0.0, None
    for i in np.flatnonzero(np.any([n.touched for n in names], axis=0)).tolist():
        costs = sum(k in (-1, i) for k in added)
        few = max(costs, SHAPES.numbers_of_law)
        rivals = [
            s
            for s in fitted
            if s.index == i
            and s.proven
            and (s.shape.in_time or s.shape.place not in places or s.numbers <= few)
        ]
        if not rivals:
            return None
        rival = min(rivals, key=lambda s: _ratio(s, selection.final.errors))
        best = best or rival
        numbers += rival.numbers - costs
        pairs.append((_as_judged(rival, selection.final.errors), rival.after))
    if best is None:
        return None
    named, shaped = (_beside(parts) for parts in zip(*pairs, strict=True))
    samples = effective_samples(shaped.estimation)
    every = np.ones(len(pairs), dtype=bool)
    evidence = compare_errors(named, shaped, numbers, 1, every, samples)
    # of two that explain the log, the one with more numbers has to prove that it needs them
    proven = evidence.significant or (numbers < 0.0 and evidence.delta_bic < RULE.bic)
    return best if proven and evidence.ratio < RULE.held_out else None


def _ratio(shape: FittedShape, errors: Errors) -> float:
    """Held-out RMSE of the shape over that of a model with names."""
    named, shaped = _as_judged(shape, errors).mean_squares()[1], shape.after.mean_squares()[1]
    return float(np.sqrt(shaped[0] / max(named[0], 1e-300)))


def _as_judged(shape: FittedShape, errors: Errors) -> Errors:
    """Errors of a model with names on the rows of a shape, one column.

    In rows that only the shape holds out, the names were fitted: that speaks for them.
    """
    named = [np.where(np.isfinite(a), a, b)[:, [shape.index]] for a, b in _pairs(errors, shape)]
    estimation, holdout = (
        tuple(
            np.where(np.isfinite(part), whole, np.nan)
            for part, whole in zip(parts, named, strict=True)
        )
        for parts in (shape.after.estimation, shape.after.holdout)
    )
    return Errors(estimation, holdout)


def _beside(parts: Sequence[Errors]) -> Errors:
    """Errors of several tracks, one column each."""
    return Errors(
        tuple(np.hstack(e) for e in zip(*(p.estimation for p in parts), strict=True)),
        tuple(np.hstack(e) for e in zip(*(p.holdout for p in parts), strict=True)),
    )


def _pairs(errors: Errors, shape: FittedShape) -> list[tuple[Array, Array]]:
    """Errors of both parts of each record as the shape has them: the same records, or after each
    other."""
    if len(errors.estimation) == len(shape.after.estimation):
        return list(zip(errors.estimation, errors.holdout, strict=True))
    return [(e, np.full_like(e, np.nan)) for e in (*errors.estimation, *errors.holdout)]
