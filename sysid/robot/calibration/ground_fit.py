"""Maximum likelihood of vehicle effects from increments of the pose of known noise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np

from sysid.criteria.coloured import coloured_gram
from sysid.data.record import Array
from sysid.effects.base import NO_LAW, Effect, Law, Length
from sysid.effects.catalogue import ground_effects
from sysid.effects.ground import Ground
from sysid.fitting.holdout import Errors
from sysid.fitting.problem import LeastSquares
from sysid.fitting.solvers import Descent, levenberg_marquardt
from sysid.robot.calibration.windows import CHANNELS, Noise, Track
from sysid.vehicle.kinematics import Geometry

LEFT, RIGHT = 0, 1


@dataclass(frozen=True)
class Slot:
    """One number that a fit may free.

    Attributes:
        owner: effect, or what competes with the effects without being one.
        side: track it belongs to, −1 where both share it.
        null, lower, upper: value at which it does nothing, and bounds.
        starts: where a search begins. The increments are all but linear in the number of an
            effect that has one only, so that its first start serves.
    """

    owner: str
    name: str
    side: int
    null: float
    lower: float
    upper: float
    starts: tuple[float, ...]


BOTH_RADII = "both-radii"
SPEED_OFFSET = "speed-offset"
POSE_LAG, HEADING_LAG, POSE_FILTER = "pose-lag", "heading-lag", "pose-filter"
COMPETITORS = (
    Slot(BOTH_RADII, "scale", -1, 1.0, 0.5, 2.0, (0.95,)),
    *(Slot(SPEED_OFFSET, "offset", s, 0.0, -5.0, 5.0, (0.0,)) for s in (LEFT, RIGHT)),
    Slot(POSE_LAG, "delay", -1, 0.0, -1.0, 1.0, (0.0,)),
    # A place that comes later than its heading is what sliding outwards looks like.
    Slot(HEADING_LAG, "delay", -1, 0.0, 0.0, 1.0, (0.0,)),
    Slot(POSE_FILTER, "lag", -1, 0.0, 0.0, 2.0, (0.1,)),
)
"""Numbers that compete with the effects, so that a radius that the geometry has wrong, a sensor
that does not read zero at rest, or a pose whose measurements, or whose headings, come later than
the speeds, or are smoothed, lends its name to none."""

LAGS = (POSE_LAG, HEADING_LAG, POSE_FILTER)

DIFFERENCE = 1e-6
"""Step of a difference, as a share of what a number may span."""


@cache
def every_slot() -> tuple[Slot, ...]:
    """The numbers of every effect between tracks and ground, then the ``COMPETITORS``."""
    of_effects = (
        Slot(
            e.id,
            p.name,
            side,
            p.null,
            p.lower,
            p.upper,
            p.starts[:1] if len(e.parameters) == 1 else p.starts,
        )
        for e in ground_effects()
        for side in _sides(e)
        for p in e.parameters
    )
    return (*of_effects, *COMPETITORS)


def _sides(e: Effect) -> tuple[int, ...]:
    return (-1,) if e.shared else (LEFT, RIGHT)


def _at(owner: str, side: int | None = None) -> tuple[int, ...]:
    """The slots of an owner, on one side where one is named."""
    return tuple(
        k
        for k, s in enumerate(every_slot())
        if s.owner == owner and (side is None or s.side == side)
    )


@dataclass(frozen=True)
class Candidate:
    """What may be freed together.

    Attributes:
        id: effect, empty for what competes without being one.
        slots: its entries of ``every_slot``.
        length: the length of the vehicle that it changes, None for none.
        law: which of the effect's, where it has several; else one without parameters.
    """

    key: str
    id: str
    slots: tuple[int, ...]
    length: Length | None = None
    law: Law = NO_LAW


@cache
def every_candidate() -> tuple[Candidate, ...]:
    """Every effect, side by side where the sides have numbers of their own, law by law where it has
    several; and what competes."""
    both = Candidate(BOTH_RADII, "", _at(BOTH_RADII), Length.RADIUS)
    others = (Candidate(key, "", _at(key)) for key in (SPEED_OFFSET, *LAGS))
    return (*(c for e in ground_effects() for c in _of_effect(e)), both, *others)


def _of_effect(e: Effect) -> list[Candidate]:
    if not e.laws:
        return [
            Candidate(
                e.id if side < 0 else f"{e.id} {('left', 'right')[side]}",
                e.id,
                _at(e.id, side),
                e.on_ground.length,
            )
            for side in _sides(e)
        ]
    return [
        Candidate(
            f"{e.id} {' and '.join(law.parameters)}",
            e.id,
            tuple(k for k in _at(e.id) if every_slot()[k].name in law.parameters),
            law=law,
        )
        for law in e.laws
    ]


@cache
def lags() -> tuple[Candidate, ...]:
    """Delays and smoothing of the measured pose, which resemble an effect with memory."""
    return tuple(c for c in every_candidate() if c.key in LAGS)


def lengths() -> tuple[Candidate, ...]:
    """What belongs to the vehicle's geometry where that is estimated: what both sides share."""
    return tuple(
        c for c in every_candidate() if c.length and all(every_slot()[k].side < 0 for k in c.slots)
    )


def ground_of(q: Array, always: Sequence[Candidate] = ()) -> Ground:
    """The effects whose numbers are off their null values, but for what ``always`` is free."""
    lengths = {k for c in always for k in c.slots}
    parameters = [
        (s, v)
        for k, (s, v) in enumerate(zip(every_slot()[: -len(COMPETITORS)], q.tolist(), strict=False))
        if k not in lengths
    ]
    acting = {s.owner for s, v in parameters if v != s.null}
    by_effect: dict[str, dict[str, list[float]]] = {}
    for slot, value in parameters:
        if slot.owner in acting:
            both = by_effect.setdefault(slot.owner, {}).setdefault(
                slot.name, [slot.null, slot.null]
            )
            for side in (LEFT, RIGHT) if slot.side < 0 else (slot.side,):
                both[side] = value
    numbers = {
        id: {k: np.array(v) for k, v in parameters.items()} for id, parameters in by_effect.items()
    }
    return Ground(tuple(numbers), numbers)


@cache
def radius_slot() -> int:
    """The slot of the common scale of both radii."""
    return _at(BOTH_RADII)[0]


@cache
def distance_slot() -> int:
    """The slot of the effect that is another track distance: B over the one as the robot turns."""
    return next(c.slots[0] for c in lengths() if c.length is Length.TRACK_DISTANCE)


def geometry_of(q: Array, geometry: Geometry) -> Geometry:
    """The geometry with the common scale of both radii."""
    return Geometry(geometry.r * float(q[radius_slot()]), geometry.B)


@dataclass(frozen=True, eq=False)
class Fitted:
    """Numbers found for a set of candidates.

    Attributes:
        q: every number, (slots,).
        covariance: of the free ones in the order of ``free``.
        free: indices of the free ones.
        errors: errors of the increments of both parts in units of their floor, (W, 3) a record.
        white: the same as independent ones of variance one.
        at_bound: the numbers that ended on a bound.
    """

    q: Array
    covariance: Array
    free: tuple[int, ...]
    errors: Errors
    white: Errors
    at_bound: tuple[int, ...]

    @property
    def cost(self) -> float:
        """Mean squared white error over both parts; 1 where nothing but noise is left."""
        return float(np.mean(np.concatenate([*self.white.estimation, *self.white.holdout]) ** 2))

    def std_error(self, slot: int) -> float | None:
        """Standard error of a number, None where it was not free."""
        if slot not in self.free:
            return None
        k = self.free.index(slot)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))


@dataclass(frozen=True, eq=False)
class PoseProblem(LeastSquares):
    """White errors of the increments as a function of every number."""

    tracks: tuple[Track, ...]
    geometry: Geometry
    noise: Noise
    free: tuple[int, ...] = field(default_factory=lambda: tuple(range(len(every_slot()))))

    @cached_property
    def _measured(self) -> tuple[Array, ...]:
        return tuple(t.measured(self.geometry) for t in self.tracks)

    @cached_property
    def _white(self) -> tuple[Callable[[Array], Array], ...]:
        return tuple(self.noise.whitener(t) for t in self.tracks)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Residuals of each record."""
        return tuple(3 * len(m) for m in self._measured)

    def freeing(self, free: tuple[int, ...]) -> "PoseProblem":
        """The same problem with other free numbers; what was computed once is kept."""
        other = replace(self, free=free)
        other.__dict__.update(_measured=self._measured, _white=self._white)
        return other

    def errors(self, q: Array) -> tuple[Array, ...]:
        """Measured less predicted, (W, 3) of each record [m, m, rad]."""
        ground, geometry, offset = (
            ground_of(q),
            geometry_of(q, self.geometry),
            q[list(_at(SPEED_OFFSET))],
        )
        late = tuple(float(q[_at(key)[0]]) for key in LAGS)
        return tuple(
            m - t.predicted(ground, geometry, offset, late)
            for m, t in zip(self._measured, self.tracks, strict=True)
        )

    def whitened(self, errors: Sequence[Array]) -> tuple[Array, ...]:
        """Errors of each record as independent ones of variance one."""
        return tuple(w(e) for w, e in zip(self._white, errors, strict=True))

    def residual(self, p: Array) -> Array:
        return np.concatenate([e.ravel() for e in self.whitened(self.errors(p))])

    def jacobian(self, p: Array) -> Array:
        """Differences in the free numbers, within their bounds; other columns are zero.

        A step towards the farther bound: the increments are all but linear over one so short.
        """
        J = np.zeros((sum(self.lengths), len(every_slot())))
        here = self.residual(p)
        for k in self.free:
            slot, moved = every_slot()[k], p.copy()
            h = DIFFERENCE * max(slot.upper - slot.lower, 1.0)
            moved[k] += h if slot.upper - p[k] > p[k] - slot.lower else -h
            J[:, k] = (self.residual(moved) - here) / (moved[k] - p[k])
        return J


def with_memory(white: Array, influence: Array, lengths: Sequence[int]) -> Array:
    """The covariance of numbers, (n, n), whose variances are those of errors with a memory where
    that makes them larger than white ones do.

    Args:
        white: covariance by white errors, (n, n).
        influence: what each of the three errors of each window did to each number, (3W, n).
        lengths: of these rows, those of each record.
    """
    whole = np.array([n // len(CHANNELS) for n in lengths if n])
    each = influence.reshape(len(influence) // len(CHANNELS), len(CHANNELS), len(white)).sum(axis=1)
    pieces = np.split(each, np.cumsum(whole)[:-1])
    ones = [np.ones((len(p), 1)) for p in pieces]
    grown = [coloured_gram(ones, [p[:, k] for p in pieces])[0, 0] for k in range(len(white))]
    size = np.sqrt(np.maximum(np.array(grown) / np.maximum(np.diag(white), 1e-300), 1.0))
    return np.asarray(white * np.outer(size, size))


@dataclass(frozen=True, eq=False)
class PoseSearch:
    """Fits on the estimation part, judged on both.

    Attributes:
        always: what every fit frees: the lengths of a vehicle without given geometry.
        radius_known: whether somebody has given the radius, so that a way that falls short of it
            on both sides is slip.
        begun: what the same sets of candidates came to with another noise, where their fits begin.
    """

    estimation: PoseProblem
    holdout: PoseProblem
    always: tuple[Candidate, ...] = ()
    radius_known: bool = False
    begun: Mapping[frozenset[str], Fitted] = field(default_factory=dict)

    @cached_property
    def fits(self) -> dict[frozenset[str], Fitted]:
        """What was fitted so far, by the keys of the candidates."""
        return {}

    def fit(self, candidates: Sequence[Candidate], near: Fitted | None = None) -> Fitted:
        """The numbers of all candidates together, in whatever order; kept, as many are asked for
        again.

        Args:
            near: fit of some of them, where the search begins.
        """
        key = frozenset(c.key for c in candidates)
        if key not in self.fits:
            self.fits[key] = self._fitted(candidates, self.begun.get(key, near))
        return self.fits[key]

    def _fitted(self, candidates: Sequence[Candidate], near: Fitted | None) -> Fitted:
        """The numbers of all candidates together, estimated anew.

        The standard errors come from the Jacobian and the known noise, or the errors left where
        these are larger; and from what each window does to a number, where that varies by more:
        tracks slip more the faster they go, and for seconds at a time.
        """
        free = tuple(sorted(k for c in (*self.always, *candidates) for k in c.slots))
        slots = every_slot()
        mask = np.isin(np.arange(len(slots)), free)
        nulls = np.array([s.null for s in slots])
        how = Descent(
            free=mask,
            lower=np.array([s.lower for s in slots]),
            upper=np.array([s.upper for s in slots]),
            max_evaluations=30,
        )
        problem, known = self.estimation.freeing(free), near.free if near is not None else ()
        begun = mask & ~np.isin(np.arange(len(slots)), known)
        first = nulls if near is None else np.where(mask, near.q, nulls)
        fits = [
            levenberg_marquardt(
                problem,
                np.where(begun, [s.starts[min(j, len(s.starts) - 1)] for s in slots], first),
                how,
            )
            for j in range(max((len(slots[k].starts) for k in free if begun[k]), default=1))
        ]
        best = min(fits, key=lambda f: float(np.sum(f.residual**2)))
        J = best.jacobian[:, list(free)]
        variance = max(float(np.mean(best.residual**2)), 1.0)
        parts = self.estimation.errors(best.p), self.holdout.errors(best.p)
        floor = self.estimation.noise.floor
        errors = Errors(*(tuple(e / floor for e in part) for part in parts))
        white = Errors(self.estimation.whitened(parts[0]), self.holdout.whitened(parts[1]))
        bound = tuple(k for k in best.at_bound if k in free)
        inverse = np.linalg.pinv(J.T @ J, hermitian=True) if free else np.zeros((0, 0))
        influence = best.residual[:, None] * (J @ inverse)
        covariance = with_memory(np.asarray(variance * inverse), influence, self.estimation.lengths)
        return Fitted(best.p, covariance, free, errors, white, bound)
