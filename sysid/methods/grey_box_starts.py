"""Initial guesses of grey boxes: a few rounds from many, the best refined."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record, shortened
from sysid.errors import ModelError, Termination
from sysid.fitting.marquardt import loss
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Initial, Parameter
from sysid.fitting.run_errors import Masks
from sysid.fitting.searchable import StartReport
from sysid.fitting.solvers import Descent, Solution, levenberg_marquardt
from sysid.structures.grey_box.runs import GreyErrors
from sysid.structures.grey_box.structure import GreyBox

STARTS = 12
"""Starts of the search: the guesses read off the data, then variations of them."""

POLISHED = 3
"""Starts that are polished, the best ones."""

RIVAL = 4.0
"""Of these only those whose cost is below this multiple of the best one's."""

COARSE = 1e-4
"""Relative tolerance of descents that only decide between starts or mechanisms: their errors
differ by per cents."""

SAME = 1e-3
"""Starts that ended within this share of each other's cost have found the same minimum."""

START_SAMPLES = 1500
"""Samples, all records together, that short descents from every start see; the polish sees all."""

START_ROUNDS = 15
"""Evaluations of such a descent."""

SAMPLES_IN_TIME_CONSTANT = 5.0
"""Samples of a time constant that are left where starts are compared on thinned data."""

EVALUATIONS = 40
"""Limit of a descent on part of the data."""

DIVERGED = 1e99


@dataclass(frozen=True, eq=False)
class Setting:
    """What every descent of one fit shares."""

    structure: GreyBox[Any]
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

    def problem(self, kept: Masks | None, free: NDArray[np.bool_] | None = None) -> GreyErrors:
        """Free-run errors on the samples ``kept``, outliers left out; slopes by ``free`` of θ."""
        data = [(np.asarray(r.u), np.asarray(r.y)) for r in self.records]
        estimated = self.options.initial is not Initial.ZERO
        if kept is None and any(r.weights is not None for r in self.records):
            kept = [np.ones(len(r), dtype=bool) for r in self.records]
        if kept is not None:
            kept = [k & r.counted for k, r in zip(kept, self.records, strict=True)]
        return GreyErrors(self.structure, data, estimated, kept, wanted=free)

    def descend(
        self,
        p0: Array,
        free: NDArray[np.bool_],
        kept: Masks | None,
        evaluations: int,
        huber: Array | None = None,
    ) -> Solution:
        problem = self.problem(kept, free)
        if len(p0) == problem.n_theta:
            p0 = problem.initial_guess(p0)
        none = np.full(problem.n_initial, np.inf)
        moved = np.array(self.structure.physics.estimated_states() * len(self.records), dtype=bool)
        return levenberg_marquardt(
            problem,
            p0,
            Descent(
                free=np.concatenate([free, moved[: problem.n_initial]]),
                lower=np.concatenate([self.lower, -none]),
                upper=np.concatenate([self.upper, none]),
                huber=huber,
                max_evaluations=evaluations,
                tolerance=COARSE if kept is not None else self.options.precision(),
            ),
        )


def started(
    s: Setting,
    guesses: Sequence[tuple[str, Array]],
    free: NDArray[np.bool_],
    kept: Masks | None,
) -> tuple[Array, list[StartReport]]:
    """Parameters (and initial states) from the best start, and what became of every start."""
    structure = s.structure
    output = ",".join(s.records[0].output_names)
    names, thetas = varied(s, guesses, free)
    problem = s.problem(kept)
    costs = [cost_of(problem.residual(problem.initial_guess(t))) for t in thetas]
    ends, spent = thetas, [0] * len(thetas)
    if np.any(free) and len(thetas) > 1:
        ends, spent = _approached(s, thetas, free)
    after = [cost_of(problem.residual(problem.initial_guess(t))) for t in ends]
    ends = [e if a <= c else t for e, a, c, t in zip(ends, after, costs, thetas, strict=True)]
    after = [min(a, c) for a, c in zip(after, costs, strict=True)]
    order = sorted(range(len(ends)), key=lambda k: after[k])
    if not np.isfinite(after[order[0]]):
        raise ModelError(f"{structure.name}: {Termination.DIVERGED.value}")
    solutions: dict[int, Solution] = {}
    for k in _distinct(order, after)[:POLISHED]:
        if solutions and after[k] > RIVAL * min(v.cost for v in solutions.values()):
            break
        solutions[k] = s.descend(ends[k], free, kept, EVALUATIONS)
    best = min(solutions, key=lambda k: solutions[k].cost)
    reports = [
        StartReport(
            output,
            names[k],
            costs[k] if np.isfinite(costs[k]) else None,
            solutions[k].cost if k in solutions else (after[k] if np.isfinite(after[k]) else None),
            spent[k] + (solutions[k].evaluations if k in solutions else 0),
        )
        for k in sorted(order, key=lambda k: solutions[k].cost if k in solutions else after[k])
    ]
    return solutions[best].p, reports


def _distinct(order: Sequence[int], costs: Sequence[float]) -> list[int]:
    """Of starts in order of their costs those that did not end where an earlier one did."""
    kept: list[int] = []
    for k in order:
        if not kept or costs[k] > (1.0 + SAME) * costs[kept[-1]]:
            kept.append(k)
    return kept


def varied(
    s: Setting, guesses: Sequence[tuple[str, Array]], free: NDArray[np.bool_]
) -> tuple[list[str], list[Array]]:
    """The guesses, then variations of the best ones by each constant's spread."""
    names, thetas = [n for n, _ in guesses], [t for _, t in guesses]
    rng = np.random.default_rng(0)
    spread = s.structure.physics.by_entry(lambda c: c.spread)
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


def _approached(
    s: Setting, thetas: Sequence[Array], free: NDArray[np.bool_]
) -> tuple[list[Array], list[int]]:
    """Where a few rounds from every start lead on part of the data, and their evaluations."""
    every = _decimation(s, thetas[0])
    pieces = shortened([r.every(every) for r in s.records], START_SAMPLES)
    sampling = replace(s.structure.sampling, dt=pieces[0].dt)
    part = replace(s, records=pieces, structure=replace(s.structure, sampling=sampling))
    every_sample = [np.ones(len(r), dtype=bool) for r in pieces]
    runs = [part.descend(t, free, every_sample, START_ROUNDS) for t in thetas]
    return [run.p[: len(free)] for run in runs], [run.evaluations for run in runs]


def _decimation(s: Setting, theta: Array) -> int:
    """How many samples may be taken as one while starts are compared."""
    total = sum(len(r) for r in s.records)
    dt = s.structure.sampling.dt
    room = s.structure.physics.time_scale(theta, dt) / (SAMPLES_IN_TIME_CONSTANT * dt)
    return int(max(min(total // START_SAMPLES, room), 1))


def cost_of(r: Array) -> float:
    """½‖r‖², infinite where the run diverged."""
    value = loss(r)
    return value if value < DIVERGED else float("inf")
