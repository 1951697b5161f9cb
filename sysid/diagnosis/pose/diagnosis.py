"""Diagnosis of what is missing between tracks and ground, from logs with a pose.

The *measured* wheel speeds drive the vehicle, so that errors of the motors do not enter, and
increments of the pose over two seconds are compared, so that nothing accumulates:

    Δ(x, y, ψ) measured − Δ(x, y, ψ) by the wheel speeds, in the body frame at a window's start

Effects are selected one at a time by the rule of ``evidence``. Some explanations compete with them
without being effects: another radius of both tracks, speed offsets, and a late pose or heading.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.diagnosis.diagnosis import NamedEffect, Value
from sysid.diagnosis.gap import Gap
from sysid.diagnosis.policies import POSE, RULE
from sysid.diagnosis.pose.evidence import PoseResiduals, holdout_pairs, pose_gap, pose_residuals
from sysid.diagnosis.pose.growth import Step, allowed, grown
from sysid.diagnosis.pose.words import sentence_of, warnings_of
from sysid.effects.catalogue import effect
from sysid.effects.ground import Ground
from sysid.robot.calibration.geometry import GeometryEstimate, contradicted, in_one_frame
from sysid.robot.calibration.ground_fit import (
    BOTH_RADII,
    SPEED_OFFSET,
    Candidate,
    Fitted,
    PoseProblem,
    PoseSearch,
    distance_slot,
    every_candidate,
    every_slot,
    ground_of,
    lengths,
    radius_slot,
)
from sysid.robot.calibration.windows import (
    CHANNELS,
    Noise,
    Track,
    increments_noise,
    track_channels,
    tracks_of,
)
from sysid.vehicle.kinematics import Geometry

MIN_WINDOWS = 6
"""Windows that each part must hold."""

MIN_RECORDS = 4
"""From so many records on they are parted as a whole, which loses no window to a border; two each,
so that none stands for its part alone."""

MIN_HOLDOUT_SHARE = 0.25
"""Share of all windows that the held-out part must hold, where there are records to choose
from: a vehicle that starts hard once a mission shows in a single one whether it slips then by
chance only."""

MIN_TURN_SHARE = 0.1
"""Share of all turning that the held-out records must hold: a mission turns where it begins, and
a straight way to the goal does not show the gain of that turn."""

BESIDE = 0.005
"""Share of a length that is uncertain at least where it is fitted together with effects: noise of
the speeds, which the fit takes for true, draws it by so much on made logs."""

_STAGE = "vehicle"


@dataclass(frozen=True, eq=False)
class PoseDiagnosis:
    """What is missing between tracks and ground.

    Attributes:
        std_errors: effect → parameter → standard error of the left and the right track, (2,);
            0 where a parameter was not free.
        candidates: (effect, score) of every one at the first stage, best first; the score is the
            share of the error of the increments that it takes away.
        gap: held-out increments x, y (forward, lateral [m]) and psi [rad] before and after.
        detectable: per effect the smallest change of its parameter that these logs would have
            shown; None where they cannot.
        windows: windows (estimation, held-out); they overlap fourfold.
        geometry: the vehicle's lengths, where they had to be estimated from the pose.
    """

    effects: tuple[NamedEffect, ...]
    ground: Ground
    std_errors: dict[str, dict[str, Array]]
    candidates: tuple[tuple[str, float], ...]
    gap: Gap
    detectable: dict[str, float | None]
    windows: tuple[int, int]
    residuals: PoseResiduals
    warnings: tuple[str, ...] = field(default=())
    geometry: GeometryEstimate | None = None


def diagnose_pose(
    estimation: Sequence[Record], holdout: Sequence[Record], geometry: Geometry | None = None
) -> PoseDiagnosis | None:
    """Name effects of the vehicle stage.

    Args:
        holdout: held-out records; where they hold too few windows, or hardly a turn, all records,
            or stretches of them, estimate and judge in turn.
        geometry: lengths of the vehicle. Unless given, those of the thesis's robot, or estimated
            together with the effects where the pose contradicts those; what only another radius or
            track distance does is then no effect.

    Returns:
        None where the records hold no pose, no two wheel speeds in rad/s, or too few windows.
    """
    channels = track_channels(estimation[0])
    if channels is None:
        return None
    parts = _parted(estimation, holdout, channels)
    if parts is None:
        return None
    tracks, others = parts
    every, changed = in_one_frame((*tracks, *others))
    tracks, others = every[: len(tracks)], every[len(tracks) :]
    estimate = contradicted(every, Geometry()) if geometry is None else None
    known = geometry is not None
    geometry = estimate.geometry if estimate is not None else geometry or Geometry()
    diagnosis = _diagnosed(tracks, others, geometry, estimate, known)
    beside = diagnosis.geometry
    if estimate is not None and beside is not None and not beside.contradicts:
        # what is missing explains it: beside the effects the lengths are those assumed
        diagnosis = _diagnosed(tracks, others, estimate.assumed, None, known)
    return replace(diagnosis, warnings=(*changed, *diagnosis.warnings))


def _diagnosed(
    tracks: tuple[Track, ...],
    others: tuple[Track, ...],
    geometry: Geometry,
    estimate: GeometryEstimate | None,
    known: bool,
) -> PoseDiagnosis:
    """What is missing with these lengths, which are fitted too where they are estimates."""
    always = lengths() if estimate is not None else ()
    noise = increments_noise((*tracks, *others), geometry)

    def search(noise: Noise, begun: Mapping[frozenset[str], Fitted]) -> PoseSearch:
        first, second = (PoseProblem(part, geometry, noise) for part in (tracks, others))
        return PoseSearch(first, second, always, known, begun)

    first = search(noise, {})
    beyond = _beyond(grown(first)[1], noise)
    again = search(replace(noise, beyond=beyond), first.fits)
    return _pose_diagnosis(again, *grown(again), estimate)


def _beyond(final: Fitted, noise: Noise) -> Array:
    """Variance of the errors that are left beyond the noise, increment by increment, (3,).

    Speeds that change between samples, or noise with a memory, are in no reading's third
    differences. A channel that holds more than its noise must not outweigh the others.
    """
    residuals = np.concatenate([*final.errors.estimation, *final.errors.holdout])
    return np.asarray(noise.floor**2 * np.maximum(np.mean(residuals**2, axis=0) - 1.0, 0.0))


_Parts = tuple[tuple[Track, ...], tuple[Track, ...]]


def _parted(
    estimation: Sequence[Record], holdout: Sequence[Record], channels: tuple[int, int]
) -> _Parts | None:
    """Estimation and held-out part: as given, else record by record in turn, else stretch by
    stretch; None where there is too little in any way."""
    both = (*estimation, *holdout)
    given = tracks_of(estimation, channels), tracks_of(holdout, channels)
    serves = _serves(given)
    if len(both) >= MIN_RECORDS:
        first, second = map(_windows, given)
        if serves and second >= MIN_HOLDOUT_SHARE * (first + second):
            return given
        parts = tracks_of(both[::2], channels), tracks_of(both[1::2], channels)
        if _serves(parts):
            return parts
    if serves:
        return given
    parts = tracks_of(both, channels, 0), tracks_of(both, channels, 1)
    return parts if min(map(_windows, parts)) >= MIN_WINDOWS else None


def _serves(parts: _Parts) -> bool:
    """Whether each part holds enough windows, and the held-out one its share of the turning."""
    turns = [sum(float(np.sum(t.measured(Geometry())[:, 2] ** 2)) for t in part) for part in parts]
    enough = min(map(_windows, parts)) >= MIN_WINDOWS
    return enough and turns[1] >= MIN_TURN_SHARE * max(sum(turns), 1e-300)


def _windows(part: Sequence[Track]) -> int:
    return sum(len(t.starts) for t in part)


# The findings ----------------------------------------------------------------------------------


def _pose_diagnosis(
    search: PoseSearch,
    steps: Sequence[Step],
    final: Fitted,
    ranking: tuple[tuple[str, float], ...],
    estimate: GeometryEstimate | None,
) -> PoseDiagnosis:
    pairs = holdout_pairs(search, [s.candidate for s in steps])
    beside = (*search.always, *(s.candidate for s in steps if not s.claimed))
    floor = search.estimation.noise.floor
    return PoseDiagnosis(
        effects=tuple(_named(s, final) for s in steps if s.claimed and s.candidate.id),
        ground=ground_of(final.q, beside),
        std_errors=_std_errors(final, beside),
        candidates=ranking,
        gap=pose_gap(pairs, floor),
        detectable=_detectable(search, final),
        windows=(sum(map(len, final.errors.estimation)), sum(map(len, final.errors.holdout))),
        residuals=pose_residuals(search, final),
        warnings=warnings_of(search, final, [(s.candidate, s.ties) for s in steps]),
        geometry=_beside(estimate, final) if estimate is not None and steps else estimate,
    )


def _beside(estimate: GeometryEstimate, final: Fitted) -> GeometryEstimate:
    """The lengths fitted together with the effects; undetermined ones are unchanged."""
    r, B = estimate.geometry.r, estimate.geometry.B
    at_radius, at_distance = radius_slot(), distance_slot()
    scale, turn = float(final.q[at_radius]), float(final.q[at_distance])
    r_error, b_error = estimate.std_errors
    if r_error is not None:
        r, r_error = r * scale, r * math.hypot(final.std_error(at_radius) or 0.0, BESIDE)
    if b_error is not None:
        B = B / turn
        b_error = B * math.hypot((final.std_error(at_distance) or 0.0) / turn, BESIDE)
    return replace(estimate, geometry=Geometry(r, B), std_errors=(r_error, b_error))


def _named(step: Step, final: Fitted) -> NamedEffect:
    c = step.candidate
    side = every_slot()[c.slots[0]].side
    tag = "" if side < 0 else ("[left]", "[right]")[side]
    units = {p.name: p.unit.replace("speed", "rad/s") for p in effect(c.id).parameters}
    values = tuple(
        Value(f"{s.name}{tag}", float(final.q[k]), final.std_error(k), units[s.name])
        for k, s in ((k, every_slot()[k]) for k in c.slots)
    )
    return NamedEffect(
        id=c.id,
        stage=_STAGE,
        channels=CHANNELS,
        parameters=values,
        evidence=step.evidence,
        indistinguishable=tuple(dict.fromkeys(t.id for t in step.ties if t.id)),
        sentence=sentence_of(c, values[0].value, values[0].std_error or 0.0, side),
    )


def _std_errors(final: Fitted, always: Sequence[Candidate]) -> dict[str, dict[str, Array]]:
    errors: dict[str, dict[str, Array]] = {}
    lengths = {k for c in always for k in c.slots}
    for k in final.free:
        slot = every_slot()[k]
        if slot.owner in (BOTH_RADII, SPEED_OFFSET) or k in lengths:
            continue
        both = errors.setdefault(slot.owner, {}).setdefault(slot.name, np.zeros(2))
        sides = [0, 1] if slot.side < 0 else [slot.side]
        both[sides] = final.std_error(k)
    return errors


def _detectable(search: PoseSearch, final: Fitted) -> dict[str, float | None]:
    """Per effect the larger of two sizes: a few standard errors, and what lowers the error enough.

    Both by linearisation at the augmented model; the second asks that the whitened error grows by
    1/``RULE.held_out`` where the effect is left out.
    """
    J = search.estimation.jacobian(final.q)
    r = search.estimation.residual(final.q)
    variance = float(np.mean(r**2))
    smallest: dict[str, float | None] = {}
    for c in every_candidate():
        first = every_slot()[c.slots[0]].name
        if not c.id or first != effect(c.id).parameters[0].name:
            continue
        power = float(np.sum(J[:, c.slots[0]] ** 2))
        size: float | None = None
        # a length that is estimated hides it
        if power > 0 and c not in search.always and allowed(c, search, ()):
            seen = POSE.detectable_std_errors * math.sqrt(variance / power)
            needed = math.sqrt((RULE.held_out**-2 - 1.0) * variance * len(r) / power)
            slot = every_slot()[c.slots[0]]
            size = max(seen, needed)
            size = size if size < max(slot.upper - slot.null, slot.null - slot.lower) else None
        if c.id not in smallest or (size or math.inf) > (smallest[c.id] or math.inf):
            smallest[c.id] = size
    return smallest
