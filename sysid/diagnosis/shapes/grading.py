"""Shapes against names: what is proven, and which names a shape explains better.

A name is withheld where a shape of another place of the chain, or of time, explains clearly more of
the data: by the rule of acceptance, with the numbers of both counted. At the same place a better
shape is what the law misses: the name stands, and the curve shows the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import SHAPES
from sysid.diagnosis.search.candidates import CandidateSearch
from sysid.diagnosis.search.evidence import Evidence, compare_errors, effective_samples
from sysid.diagnosis.search.selection import CandidateModel, SelectedEffect, Selection
from sysid.diagnosis.shapes.fitted import BOTH, FittedShape, fitted_shapes
from sysid.diagnosis.shapes.shape import Curve, ShapePlace
from sysid.diagnosis.shapes.track import tracks_of
from sysid.effects.base import Place
from sysid.effects.catalogue import about
from sysid.fitting.holdout import Errors

PLACES = {
    Place.COMMAND: ShapePlace.COMMAND,
    Place.TORQUE: ShapePlace.TORQUE,
    Place.SPEED: ShapePlace.SPEED,
    Place.READING: ShapePlace.READING,
}


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
    delta_bic: float
    p_value: float
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
            "evidence": {"delta_bic": self.delta_bic, "p_value": self.p_value},
            "sentence": self.sentence,
            "curve": self.curve,
            "effect": self.effect,
        }


def shapes_around(
    search: CandidateSearch, candidate: CandidateModel, floor: Array, moves: bool
) -> tuple[FittedShape, ...]:
    """Every shape on every track around a candidate model, those with most evidence first."""
    return fitted_shapes(tracks_of(search, candidate), floor, moves)


def proven(fitted: Sequence[FittedShape]) -> tuple[FoundShape, ...]:
    """The best proven shape of each track; of equals the one with fewest numbers."""
    found = []
    for i in sorted({s.index for s in fitted}):
        passed = [s for s in fitted if s.index == i and s.proven]
        if not passed:
            continue
        near = [s for s in passed if s.score > passed[0].score - SHAPES.near]
        best = min(near, key=lambda s: s.numbers)
        found.append(_found(best))
    return tuple(found)


def _found(shape: FittedShape, effect: str = "") -> FoundShape:
    sentence, curve = shape.says()
    return FoundShape(
        shape.shape.id,
        shape.shape.place.value,
        shape.track.output.name,
        shape.share,
        shape.numbers,
        shape.evidence.delta_bic,
        shape.evidence.p_value,
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
            if (
                s.shape.in_time
                if effect.hints.gathers
                else s.shape.place is PLACES.get(effect.place)
            )
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
    """The shape that explains clearly more than some names together, on each of their tracks.

    Args:
        fitted: around the model ``without`` the names.
        model_tracks: the track of each parameter of the full model; −1 where all share it.
    """
    places = {PLACES.get(about(n.id).place) for n in names}
    touched = np.flatnonzero(np.any([n.touched for n in names], axis=0))
    best = None
    for i in touched.tolist():
        rivals = [
            s
            for s in fitted
            if s.index == i and s.proven and (s.shape.in_time or s.shape.place not in places)
        ]
        added = [k for k in selection.final.free if k not in without.free]
        numbers = sum(model_tracks[k] in (-1, i) for k in added)
        beaten = [s for s in rivals if _clearly_more(s, selection.final.errors, i, numbers)]
        if not beaten:
            return None
        best = best or beaten[0]
    return best


def _clearly_more(shape: FittedShape, errors: Errors, i: int, numbers: int) -> bool:
    """Whether the shape leaves clearly less than names with so many numbers."""
    evidence = against(shape, errors, i, numbers)
    return evidence.significant and evidence.ratio < SHAPES.clearly_more


def against(shape: FittedShape, errors: Errors, i: int, numbers: int) -> Evidence:
    """The shape against the errors of a model with names, on the rows of the shape.

    In rows that only the shape holds out, the names were fitted: that speaks for them.
    """
    named = [_either(a, b)[:, [i]] for a, b in _pairs(errors, shape)]
    kept = [
        tuple(
            np.where(np.isfinite(part), whole, np.nan)
            for part, whole in zip(parts, named, strict=True)
        )
        for parts in (shape.after.estimation, shape.after.holdout)
    ]
    before = Errors(*kept)
    samples = effective_samples(shape.after.estimation)
    return compare_errors(before, shape.after, shape.numbers - numbers, 1, BOTH, samples)


def _pairs(errors: Errors, shape: FittedShape) -> list[tuple[Array, Array]]:
    """Errors of both parts of each record as the shape has them: the same records, or after each
    other."""
    if len(errors.estimation) == len(shape.after.estimation):
        return list(zip(errors.estimation, errors.holdout, strict=True))
    return [(e, np.full_like(e, np.nan)) for e in (*errors.estimation, *errors.holdout)]


def _either(a: Array, b: Array) -> Array:
    return np.where(np.isfinite(a), a, b)
