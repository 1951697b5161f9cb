"""Fitting grey boxes: many starts at once, the best of them polished, mechanisms that pay kept."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import ModelError, Termination
from sysid.estimation.holdout import hold_out, shortened
from sysid.estimation.orders import tie_margin
from sysid.estimation.search import FitOptions
from sysid.estimation.solvers import HUBER_WIDTH, Solution, levenberg_marquardt, many_starts
from sysid.estimation.strategies import Outcome, Warm
from sysid.estimation.uncertainty import uncertainty
from sysid.structures.base import Initial, Parameter
from sysid.structures.grey_box import GreyBox, Rung
from sysid.structures.grey_box_runs import GreyErrors, Masks
from sysid.structures.model import StartReport

STARTS = 12
"""Starts of the search: the guesses read off the data, then variations of them."""

POLISHED = 3
"""Starts that are polished, unless the best ones all ended at the same cost."""

START_SAMPLES = 1500
"""Samples, all records together, that the many starts see; the polish sees all."""

START_ROUNDS = 15
SAME = 1.02
"""Costs within this ratio of the best one count as the same minimum."""

STEPS_IN_TIME_CONSTANT = 15.0
"""Substeps in the shortest time constant; errors of friction's event times are then below the
noise of any encoder."""

MOST_SUBSTEPS = 20

SAMPLES_IN_TIME_CONSTANT = 5.0
"""Samples of a time constant that are left where starts are compared on thinned data."""

EVALUATIONS = 40
RUNG_EVALUATIONS = 25
"""Limits of descents on part of the data; the last one takes the user's limit."""

COARSER = 3
"""So many times fewer substeps serve while starts and mechanisms are compared."""

RUNG_STARTS = 2
"""Starts of a rung that are followed, those of lowest cost."""


@dataclass(frozen=True, eq=False)
class _Setting:
    """What every descent of one fit shares."""

    structure: GreyBox
    records: tuple[Record, ...]
    parameters: tuple[Parameter, ...]
    options: FitOptions
    user_fixed: tuple[bool, ...]

    @property
    def lower(self) -> Array:
        return np.array([p.lower for p in self.parameters])

    @property
    def upper(self) -> Array:
        return np.array([p.upper for p in self.parameters])

    def problem(self, kept: Masks | None) -> GreyErrors:
        data = [(np.asarray(r.u), np.asarray(r.y)) for r in self.records]
        return GreyErrors(self.structure, data, self.options.initial is not Initial.ZERO, kept)

    def descend(
        self,
        p0: Array,
        free: Array,
        kept: Masks | None,
        evaluations: int,
        huber: float | None = None,
    ) -> Solution:
        problem = self.problem(kept)
        if len(p0) == problem.n_theta:
            p0 = problem.initial_guess(p0)
        none = np.full(problem.n_initial, np.inf)
        return levenberg_marquardt(
            problem,
            p0,
            free=np.concatenate([free, np.ones(problem.n_initial, dtype=bool)]),
            lower=np.concatenate([self.lower, -none]),
            upper=np.concatenate([self.upper, none]),
            huber=huber,
            max_evaluations=evaluations,
            tolerance=1e-5 if kept is not None else 1e-9,
        )


def by_multi_start(
    structure: GreyBox,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    warm: Warm,
) -> Outcome:
    """Fit a grey box: starts, ladder, polish, uncertainty.

    1. Starts: what ``first_guess`` reads off the data and variations of it by each constant's
       spread (seed fixed), all run at once through a vmapped Levenberg-Marquardt in coordinates
       that respect the bounds.
    2. The best ones are polished by the bounded solver with exact derivatives.
    3. Rung by rung, mechanisms of the structure's ladder are kept where a free run over held-out
       samples errs significantly less with them.
    4. The last descent sees all samples.

    Raises:
        ModelError: no start gives a finite cost.
    """
    structure = structure.for_record(records[0]).sampled(records[0].dt)
    bare = structure.parameters(records[0].inputs, records[0].outputs)
    given = {p.name: p for p in parameters}
    names = [p.name for p in bare]
    # the user's word counts; elsewhere constants are held where the structure holds them
    asked = [given[n].fixed is not None or n in options.bounds for n in names]
    table = tuple(
        replace(
            given[n], fixed=given[n].fixed if a else b.fixed, upper=given[n].upper if a else b.upper
        )
        for n, a, b in zip(names, asked, bare, strict=True)
    )
    free = np.array([p.fixed is None for p in table])
    guesses = [(n, _admissible(t, table, free)) for n, t in structure.first_guess(records)]
    guesses += [(n, _admissible(t, table, free)) for n, t in warm if len(t) == len(table)]
    if structure.substeps == 0:
        structure = replace(structure, substeps=_substeps(structure, [t for _, t in guesses]))
    coarse = replace(structure, substeps=-(-structure.substeps // COARSER))
    setting = _Setting(coarse, tuple(records), table, options, tuple(asked))
    held = hold_out(records) if structure.ladder() else None
    kept = None if held is None else [~m for m in held.counted]
    p, reports = _started(setting, guesses, free, kept)
    notes: list[StartReport] = []
    if held is not None:
        p, free, notes = _climbed(setting, p, free, held.counted, tie_margin(held.held))
    setting = replace(setting, structure=structure)
    huber = None
    if options.robust:
        r = setting.problem(None).residual(p)
        huber = HUBER_WIDTH * max(1.4826 * float(np.median(np.abs(r))), 1e-12)
    last = setting.descend(p, free, None, options.max_evaluations, huber)
    return _outcome(setting, last, free, (*reports, *notes))


def _substeps(structure: GreyBox, guesses: Sequence[Array]) -> int:
    fastest = min((structure.time_scale(t) for t in guesses[:1]), default=np.inf)
    steps = STEPS_IN_TIME_CONSTANT * structure.dt / max(fastest, 1e-12)
    return int(min(max(np.ceil(steps), 1.0), MOST_SUBSTEPS))


def _admissible(theta: Array, table: Sequence[Parameter], free: Array) -> Array:
    held = np.array([np.nan if p.fixed is None else p.fixed for p in table])
    lower, upper = np.array([p.lower for p in table]), np.array([p.upper for p in table])
    return np.where(np.isnan(held), np.clip(theta, lower, upper), np.nan_to_num(held))


# --------------------------------------------------------------------- many starts


@dataclass(frozen=True, eq=False)
class Coordinates:
    """θ of the free entries as numbers z without bounds, of size one.

    A constant bounded below is lower + scale·exp(z), one bounded on both sides a logistic curve
    between them, one of either sign scale·z.
    """

    lower: Array
    upper: Array
    scale: Array

    @staticmethod
    def of(lower: Array, upper: Array, typical: Array, spread: Array) -> "Coordinates":
        """Coordinates around a typical θ; a two-sided range much wider than it counts as open."""
        finite = np.where(np.isfinite(lower), lower, 0.0)
        wide = (upper - finite) > 1e3 * np.maximum(np.abs(typical - finite), 1e-12)
        upper = np.where(wide & np.isfinite(lower), np.inf, upper)
        size = np.where(np.isfinite(lower), np.maximum(typical - finite, 1e-12), np.abs(typical))
        return Coordinates(
            lower, upper, np.where(size > 0, size, np.where(spread > 0, spread, 1.0))
        )

    def theta(self, xp: Any, z: Any) -> Any:
        """z → θ."""
        low = np.where(np.isfinite(self.lower), self.lower, 0.0)
        width = np.where(np.isfinite(self.upper), self.upper, 1.0) - low
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        one_sided = np.isfinite(self.lower) & ~bounded
        return xp.where(
            bounded,
            low + width / (1.0 + xp.exp(-z)),
            xp.where(one_sided, low + self.scale * xp.exp(xp.minimum(z, 50.0)), self.scale * z),
        )

    def z(self, theta: Array) -> Array:
        """θ → z; a constant on its bound is moved inside a little."""
        low = np.where(np.isfinite(self.lower), self.lower, 0.0)
        high = np.where(np.isfinite(self.upper), self.upper, 1.0)
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        one_sided = np.isfinite(self.lower) & ~bounded
        share = np.clip((theta - low) / (high - low), 0.02, 0.98)
        above = np.maximum(theta - low, 1e-3 * self.scale)
        return np.where(
            bounded,
            np.log(share / (1.0 - share)),
            np.where(one_sided, np.log(above / self.scale), theta / self.scale),
        )


def _started(
    s: _Setting,
    guesses: Sequence[tuple[str, Array]],
    free: Array,
    kept: Masks | None,
) -> tuple[Array, list[StartReport]]:
    """Parameters (and initial states) from the best start, and what became of every start."""
    structure = s.structure
    output = ",".join(s.records[0].output_names)
    names, thetas = _varied(s, guesses, free)
    problem = s.problem(kept)
    costs = [_half_square(problem.residual(problem.initial_guess(t))) for t in thetas]
    ends = thetas
    endings: list[tuple[float | None, int]] = [(None, 0)] * len(thetas)
    if np.any(free) and len(thetas) > 1:
        ends, endings = _at_once(s, thetas, free)
    after = [_half_square(problem.residual(problem.initial_guess(t))) for t in ends]
    ends = [e if a <= c else t for e, a, c, t in zip(ends, after, costs, thetas, strict=True)]
    after = [min(a, c) for a, c in zip(after, costs, strict=True)]
    order = sorted(range(len(ends)), key=lambda k: after[k])
    if not np.isfinite(after[order[0]]):
        raise ModelError(f"{structure.name}: {Termination.DIVERGED.value}")
    found: dict[int, Solution] = {}
    for k in order[:POLISHED]:
        if found and after[k] > 4.0 * min(v.cost for v in found.values()):
            break
        found[k] = s.descend(ends[k], free, kept, EVALUATIONS)
    best = min(found, key=lambda k: found[k].cost)
    reports = [
        StartReport(
            output,
            names[k],
            costs[k] if np.isfinite(costs[k]) else None,
            found[k].cost if k in found else (after[k] if np.isfinite(after[k]) else None),
            endings[k][1] + (found[k].evaluations if k in found else 0),
        )
        for k in sorted(order, key=lambda k: found[k].cost if k in found else after[k])
    ]
    return found[best].p, reports


def _varied(
    s: _Setting, guesses: Sequence[tuple[str, Array]], free: Array
) -> tuple[list[str], list[Array]]:
    """The guesses, then variations of the best ones by each constant's spread."""
    names, thetas = [n for n, _ in guesses], [t for _, t in guesses]
    rng = np.random.default_rng(0)
    spread = s.structure.spreads()
    base = list(thetas)
    k = 0
    while len(thetas) < max(STARTS, len(base)) and base and np.any(free):
        center = base[k % len(base)]
        draw = rng.uniform(-1.0, 1.0, len(center))
        low = np.where(np.isfinite(s.lower), s.lower, 0.0)
        one = np.isfinite(s.lower)
        factor = np.maximum(spread, 1.0) ** draw
        varied = np.where(
            one, low + (center - low) * factor, center + spread * draw * np.abs(center)
        )
        thetas.append(np.where(free, np.clip(varied, s.lower, s.upper), center))
        names.append(f"variation {k + 1} of {names[k % len(base)]}")
        k += 1
    return names, thetas


def _at_once(
    s: _Setting, thetas: Sequence[Array], free: Array
) -> tuple[list[Array], list[tuple[float | None, int]]]:
    """Every start through the vmapped solver, on part of the data, initial states as guessed."""
    every = _decimation(s, thetas[0])
    pieces = shortened([_thinned(r, every) for r in s.records], START_SAMPLES)
    structure = s.structure.sampled(pieces[0].dt)
    problem = replace(s, records=pieces, structure=structure).problem(None)
    longest = max(len(r) for r in pieces)
    u = np.zeros((longest, s.structure.nu, len(pieces)))
    y = np.zeros((longest, s.structure.ny, len(pieces)))
    weight = np.zeros_like(y)
    for k, r in enumerate(pieces):
        u[: len(r), :, k], y[: len(r), :, k] = r.u, r.y
        weight[: len(r), :, k] = 1.0 / problem.scales
    weight /= np.sqrt(np.count_nonzero(weight))
    x0 = np.stack([problem.states(problem.initial_guess(t)) for t in thetas])
    where = np.flatnonzero(free)
    typical = np.asarray(thetas[0])
    spread = s.structure.spreads()
    c = Coordinates.of(s.lower[where], s.upper[where], typical[where], spread[where])

    def residual(xp: Any, lax: Any, z: Any, start: Any, shared: Any) -> Any:
        base, x = start
        inputs, measured, weights = shared
        theta = base.at[where].set(c.theta(xp, z))
        p = structure.prepared(xp, structure.unpack(xp, theta))

        def one(x: Any, u: Any) -> Any:
            return structure.sample(xp, x, u, p), structure.reading(xp, x, p)

        _, out = lax.scan(one, x, inputs)
        return ((measured - out) * weights).ravel()

    z0 = np.stack([c.z(t[where]) for t in thetas])
    endings = many_starts(residual, z0, (np.stack(thetas), x0), (u, y, weight), START_ROUNDS)
    ends = []
    for t, end in zip(thetas, endings, strict=True):
        theta = t.copy()
        if np.all(np.isfinite(end.z)):
            theta[where] = np.clip(c.theta(np, end.z), s.lower[where], s.upper[where])
        ends.append(theta)
    return ends, [(e.cost, e.iterations) for e in endings]


def _decimation(s: _Setting, theta: Array) -> int:
    """How many samples may be taken as one while starts are compared."""
    total = sum(len(r) for r in s.records)
    room = s.structure.time_scale(theta) / (SAMPLES_IN_TIME_CONSTANT * s.structure.dt)
    return int(max(min(total // START_SAMPLES, room), 1))


def _thinned(r: Record, every: int) -> Record:
    """Every so many samples, the input held at the mean of those it replaces."""
    if every == 1:
        return r
    n = len(r) // every
    u = np.asarray(r.u)[: n * every].reshape(n, every, r.nu).mean(axis=1)
    return replace(r, u=u, y=r.y[: n * every : every], dt=r.dt * every, pose=None)


def _half_square(r: Array) -> float:
    with np.errstate(over="ignore"):
        value = 0.5 * float(r @ r)
    return value if value < 1e99 else float("inf")


# --------------------------------------------------------------------- ladder


def _climbed(
    s: _Setting,
    p: Array,
    free: Array,
    counted: Masks,
    margin: float,
) -> tuple[Array, Array, list[StartReport]]:
    """Free the constants of each rung in turn; keep them where held-out data pay for them.

    A rung may have been kept only because another one was still missing, so at the end each is
    taken away again and stays away where nothing is lost.
    """
    kept = [~m for m in counted]
    output = ",".join(s.records[0].output_names)
    held = _held_error(s, p, counted)
    reports = [StartReport(output, f"base: held-out error {held:.4g}", None, None, 0)]
    climbed: list[tuple[Rung, list[int]]] = []

    def told(rung: Rung, verdict: str, error: float, found: Solution) -> None:
        words = f"{rung.words}: {verdict}, held-out error {error:.4g}"
        reports.append(StartReport(output, words, None, found.cost, found.evaluations))

    for rung in s.structure.ladder():
        entries = [k for k in _entries(s, rung) if not free[k]]
        if not entries:
            continue
        wider = free.copy()
        wider[entries] = True
        problem = s.problem(kept)
        starts = [
            np.concatenate([theta, p[len(free) :]])
            for theta in s.structure.rung_starts(p[: len(free)], rung, s.records)
        ]
        starts.sort(key=lambda q: _half_square(problem.residual(q)))
        runs = [s.descend(q, wider, kept, RUNG_EVALUATIONS) for q in starts[:RUNG_STARTS]]
        best = min(runs, key=lambda run: run.cost)
        error = _held_error(s, best.p, counted)
        seen = np.linalg.norm(best.jacobian[:, entries], axis=0) > 0.0
        pays = error < (1.0 - margin) * held and bool(np.all(seen))
        told(rung, "kept" if pays else "not kept", error, best)
        if pays:
            p, free, held = best.p, wider, error
            climbed.append((rung, entries))
    null = s.structure.pack({})
    for rung, entries in climbed[:-1]:
        narrower, without = free.copy(), p.copy()
        narrower[entries] = False
        without[entries] = null[entries]
        found = s.descend(without, narrower, kept, RUNG_EVALUATIONS)
        error = _held_error(s, found.p, counted)
        if error < (1.0 + margin) * held:
            told(rung, "taken away again", error, found)
            p, free, held = found.p, narrower, error
    return p, free, reports


def _entries(s: _Setting, rung: Rung) -> list[int]:
    """Entries of a rung that neither the user nor an option has settled."""
    found = [k for name in rung.names for k in s.structure.entries(name)]
    return [k for k in found if not s.user_fixed[k]]


def _held_error(s: _Setting, p: Array, counted: Masks) -> float:
    e = s.problem(counted).residual(p)
    size = float(np.sqrt(np.mean(e**2))) if len(e) else float("nan")
    return size if size < 1e6 else float("inf")


# --------------------------------------------------------------------- worth


def _outcome(
    s: _Setting, found: Solution, free: Array, reports: tuple[StartReport, ...]
) -> Outcome:
    n = len(free)
    if found.termination is Termination.DIVERGED:
        raise ModelError(f"{s.structure.name}: {Termination.DIVERGED.value}")
    problem = s.problem(None)
    states = np.ones(problem.n_initial, dtype=bool)
    # a state nothing depends on (a track that stands) is no unknown
    states &= np.linalg.norm(found.jacobian[:, n:], axis=0) > 0.0
    which = np.flatnonzero(np.concatenate([free, states]))
    value = uncertainty(
        found.jacobian[:, which],
        found.residual,
        tuple(zip(problem.channels, problem.lengths, strict=True)),
        found.weights,
    )
    covariance = np.zeros((n, n))
    inside = which < n
    entries = which[inside]
    covariance[np.ix_(entries, entries)] = value.covariance[np.ix_(inside, inside)]
    null = []
    for direction in value.null.T:
        part = direction[inside]
        if np.linalg.norm(part) > 1e-3 * np.linalg.norm(direction):
            whole = np.zeros(n)
            whole[entries] = part / np.linalg.norm(part)
            null.append(whole)
    theta = found.p[:n]
    table = tuple(
        replace(p, fixed=None if f else float(v))
        for p, f, v in zip(s.parameters, free, theta, strict=True)
    )
    return Outcome(
        s.structure,
        table,
        theta,
        covariance,
        np.array(null).T if null else np.zeros((n, 0)),
        n_states=int(np.sum(~inside)),
        termination=found.termination,
        at_bound=tuple(s.parameters[k].name for k in found.at_bound if k < n),
        starts=reports,
    )
