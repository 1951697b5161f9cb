"""Fit of grey boxes: many initial guesses at once, the best refined, mechanisms added if useful."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.errors import ModelError, Termination
from sysid.fitting.holdout import hold_out, tie_margin
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.fitting.profile import profiled
from sysid.fitting.robust import huber_widths
from sysid.fitting.run_errors import Masks
from sysid.fitting.searchable import InitialGuesses, StartReport
from sysid.fitting.solvers import Solution
from sysid.methods.grey_box_starts import Setting, cost_of, started
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome, Part, outcome_of, with_covariance
from sysid.structures.base import Structure
from sysid.structures.grey_box.physics import Rung
from sysid.structures.grey_box.structure import GreyBox, read_off

Mask = NDArray[np.bool_]

STEPS_IN_TIME_CONSTANT = 30.0
"""Substeps in the shortest time constant: on 1500 samples of a motor that sticks, with noise of a
twentieth of its speed, 15 move the time constant by a fifth of its standard error, 30 by a
twentieth."""

MOST_SUBSTEPS = 20

COARSER = 3
"""So many times fewer substeps serve while starts and mechanisms are compared."""

RUNG_EVALUATIONS = 25
"""Limit of a descent that decides on a mechanism."""

DETERMINED = 0.5
"""Largest relative standard error of a constant of a rung: a Stribeck speed that may as well be
nothing, or twice as large, is no finding, however well the breakaway beside it pays."""

PROFILE_EVALUATIONS = 8
"""Limit of a descent with one entry held: it begins beside its end."""

REPEATS = 3
"""Times a fit is moved to a better minimum that a profile met."""

RUNG_STARTS = 2
"""Starts of a rung that are followed, those of lowest cost."""


def by_multi_start(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Fit a grey box: starts, ladder, polish, uncertainty.

    1. Starts: what ``first_guess`` reads off the data and variations of it by each constant's
       spread (seed fixed); a few rounds from each on part of the data.
    2. The best ones are polished by the bounded solver with exact derivatives.
    3. Rung by rung, mechanisms of the structure's ladder are kept where a free run over held-out
       samples errs significantly less with them.
    4. The last descent sees all samples.
    """
    setting, guesses, free = prepared(structure, records, options, parameters, initial_guesses)
    structure = setting.structure
    coarse = _cut(structure, -(-structure.sampling.substeps // COARSER))
    setting = replace(setting, structure=coarse)
    cut = hold_out(records) if structure.physics.ladder() else None
    kept = None if cut is None else [~m for m in cut.counted]
    p, reports = started(setting, guesses, free, kept)
    notes: list[StartReport] = []
    if cut is not None:
        p, free, notes = _climbed(setting, p, free, cut.counted, tie_margin(cut.holdout))
    setting = replace(setting, structure=structure)
    huber = None
    if options.robust:
        problem = setting.problem(None)
        huber = huber_widths(problem, problem.residual(p))
    last = setting.descend(p, free, None, options.limit(), huber)
    last, wider = _profiled(setting, last, free, huber)
    return _outcome(setting, last, free, wider, (*reports, *notes))


def prepared(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> tuple[Setting, list[tuple[str, Array]], Mask]:
    """The setting of a fit, named admissible guesses, and which entries of θ are estimated."""
    assert isinstance(structure, GreyBox)
    structure = read_off(structure, records)
    bare = structure.parameters(records[0].inputs, records[0].outputs)
    given = {p.name: p for p in parameters}
    names = [p.name for p in bare]
    # the user's word counts; elsewhere constants are held where the structure holds them
    constrained = [given[n].fixed is not None or n in options.bounds for n in names]
    table = tuple(
        replace(
            given[n],
            unit=b.unit,  # a position's are others than a speed's
            fixed=given[n].fixed if a else b.fixed,
            upper=given[n].upper if a else b.upper,
        )
        for n, a, b in zip(names, constrained, bare, strict=True)
    )
    free = np.array([p.fixed is None for p in table])
    guesses = [(n, _admissible(t, table, free)) for n, t in structure.physics.first_guess(records)]
    guesses += [
        (n, _admissible(t, table, free)) for n, t in initial_guesses if len(t) == len(table)
    ]
    structure = cut_finely(structure, [t for _, t in guesses])
    return Setting(structure, tuple(records), table, options, tuple(constrained)), guesses, free


def cut_finely(structure: GreyBox[Any], guesses: Sequence[Array]) -> GreyBox[Any]:
    """With as many substeps as the first guess needs, unless their number is given."""
    if structure.sampling.substeps:
        return structure
    return _cut(structure, _substeps(structure, guesses))


def _cut(structure: GreyBox[Any], substeps: int) -> GreyBox[Any]:
    return replace(structure, sampling=replace(structure.sampling, substeps=substeps))


def _substeps(structure: GreyBox[Any], guesses: Sequence[Array]) -> int:
    dt = structure.sampling.dt
    fastest = min((structure.physics.time_scale(t, dt) for t in guesses[:1]), default=np.inf)
    steps = STEPS_IN_TIME_CONSTANT * dt / max(fastest, 1e-12)
    return int(min(max(np.ceil(steps), 1.0), MOST_SUBSTEPS))


def _admissible(theta: Array, table: Sequence[Parameter], free: Mask) -> Array:
    fixed = np.array([np.nan if p.fixed is None else p.fixed for p in table])
    lower, upper = np.array([p.lower for p in table]), np.array([p.upper for p in table])
    return np.where(np.isnan(fixed), np.clip(theta, lower, upper), np.nan_to_num(fixed))


# --------------------------------------------------------------------- ladder


def _climbed(
    s: Setting,
    p: Array,
    free: Mask,
    counted: Masks,
    margin: float,
) -> tuple[Array, Mask, list[StartReport]]:
    """Free the constants of each rung in turn; keep them where held-out data pay for them.

    A rung may have been kept only because another one was still missing, so at the end each is
    taken away again and stays away where neither held-out nor fitted data lose by it.
    """
    kept = [~m for m in counted]
    output = ",".join(s.records[0].output_names)
    base_error, cost = _holdout_error(s, p, counted), np.inf
    reports = [StartReport(output, f"base: held-out error {base_error:.4g}", None, None, 0)]
    climbed: list[tuple[Rung, list[int]]] = []

    def report(rung: Rung, verdict: str, error: float, solution: Solution) -> None:
        words = f"{rung.words}: {verdict}, held-out error {error:.4g}"
        reports.append(StartReport(output, words, None, solution.cost, solution.evaluations))

    for rung in s.structure.physics.ladder():
        entries = [k for k in _entries(s, rung) if not free[k]]
        if not entries:
            continue
        wider = free.copy()
        wider[entries] = True
        problem = s.problem(kept)
        starts = [
            np.concatenate([theta, p[len(free) :]])
            for theta in s.structure.physics.rung_starts(p[: len(free)], rung, s.records)
        ]
        starts.sort(key=lambda q: cost_of(problem.residual(q)))
        runs = [s.descend(q, wider, kept, RUNG_EVALUATIONS) for q in starts[:RUNG_STARTS]]
        best = min(runs, key=lambda run: run.cost)
        error = _holdout_error(s, best.p, counted)
        pays = error < (1.0 - margin) * base_error
        known = _determined(s, best, wider, rung, kept)
        verdict = "not kept" if not pays else "kept" if known else "not determined"
        report(rung, verdict, error, best)
        pays = pays and known
        if pays:
            p, free, base_error, cost = best.p, wider, error, best.cost
            climbed.append((rung, entries))
    null = s.structure.physics.pack({})
    for rung, entries in climbed[:-1]:
        narrower, without = free.copy(), p.copy()
        narrower[entries] = False
        without[entries] = null[entries]
        solution = s.descend(without, narrower, kept, RUNG_EVALUATIONS)
        error = _holdout_error(s, solution.p, counted)
        if error < (1.0 + margin) * base_error and solution.cost < (1.0 + 2.0 * margin) * cost:
            report(rung, "taken away again", error, solution)
            p, free, base_error, cost = solution.p, narrower, error, solution.cost
    return p, free, reports


def _entries(s: Setting, rung: Rung) -> list[int]:
    """Entries of a rung that neither the user nor an option has settled."""
    entries = [k for name in rung.names for k in s.structure.physics.entries(name)]
    return [k for k in entries if not s.user_fixed[k]]


def _determined(s: Setting, solution: Solution, free: Mask, rung: Rung, kept: Masks) -> bool:
    """Whether the data determine each constant of one sign of a rung, at one output at least.

    One that is alone on its rung is seen by what it pays.
    """
    if len(rung.names) == 1:
        return True
    n, part = len(free), _part(s, solution, free, kept)
    error = np.full(n, np.inf)
    inside = part.free < n
    error[part.free[inside]] = np.sqrt(np.diag(part.uncertainty.covariance))[inside]
    known = error < DETERMINED * np.abs(solution.p[:n])
    lower = np.array([p.lower for p in s.parameters])
    return all(
        any(
            known[k] or (lower[k] < 0.0 and np.isfinite(error[k]))
            for k in s.structure.physics.entries(name)
            if free[k]
        )
        for name in rung.names
    )


def _holdout_error(s: Setting, p: Array, counted: Masks) -> float:
    e = s.problem(counted).residual(p)
    size = float(np.sqrt(np.mean(e**2))) if len(e) else float("nan")
    return size if size < 1e6 else float("inf")


# ---------------------------------------------------------------- uncertainty


def _part(s: Setting, solution: Solution, free: Mask, kept: Masks | None = None) -> Part:
    """The free entries and the states that matter, with their covariance and null space."""
    # a state nothing depends on (a track that stands) is no unknown
    states = np.linalg.norm(solution.jacobian[:, len(free) :], axis=0) > 0.0
    return with_covariance(
        s.problem(kept), solution, np.flatnonzero(np.concatenate([free, states]))
    )


def _profiled(
    s: Setting, solution: Solution, free: Mask, huber: Array | None
) -> tuple[Solution, dict[int, float]]:
    """The fit, moved where profiles met a better minimum, and errors of entries that jump.

    The rise of the cost counts in units of the variance that slopes and the colour of the
    residuals give: for white ones 2 Δ(½‖ε‖²)/σ².
    """
    jumps = s.structure.physics.by_entry(lambda c: float(c.jumps)) > 0.0
    entries = [int(k) for k in np.flatnonzero(jumps & free) if k not in solution.at_bound]
    errors: dict[int, float] = {}
    for _ in range(REPEATS if entries else 0):
        if solution.termination is Termination.DIVERGED:
            break
        part = _part(s, solution, free)
        value = part.uncertainty
        scaled = value.plain / np.diag(value.covariance)
        errors, better = {}, None
        for k in entries:
            at = int(np.flatnonzero(part.free == k)[0])
            error = float(np.sqrt(value.covariance[at, at]))
            if not np.isfinite(error) or error <= 0.0:
                continue
            others = free.copy()
            others[k] = False

            def rise(
                v: float,
                start: Array,
                k: int = k,
                others: Mask = others,
                unit: float = float(scaled[at]),
                cost: float = solution.cost,
            ) -> tuple[float, Array]:
                p = start.copy()
                p[k] = v
                run = s.descend(p, others, None, PROFILE_EVALUATIONS, huber)
                return 2.0 * (run.cost - cost) * unit, run.p

            lower, upper = s.parameters[k].lower, s.parameters[k].upper
            profile = profiled(rise, solution.p, k, error, lower, upper)
            better = profile.better
            if better is not None:
                break
            errors[k] = max(profile.error, error)
        if better is None:
            break
        descended = s.descend(better, free, None, s.options.limit(), huber)
        if descended.cost >= solution.cost:
            break
        solution = descended
    return solution, errors


def _outcome(
    s: Setting,
    solution: Solution,
    free: Mask,
    errors: dict[int, float],
    reports: tuple[StartReport, ...],
) -> FitOutcome:
    n = len(free)
    if solution.termination is Termination.DIVERGED:
        raise ModelError(f"{s.structure.name}: {Termination.DIVERGED.value}")
    theta = solution.p[:n]
    table = tuple(
        replace(p, fixed=None if f else float(v))
        for p, f, v in zip(s.parameters, free, theta, strict=True)
    )
    outcome = outcome_of(s.structure, table, theta, [_part(s, solution, free)], reports)
    wider = np.ones(n)
    for k, error in errors.items():
        wider[k] = error / np.sqrt(outcome.covariance[k, k])
    factors, known = np.outer(wider, wider), outcome.determined
    if known is not None:
        known = replace(known, covariance=known.covariance * factors)
    return replace(outcome, covariance=outcome.covariance * factors, determined=known)


METHOD = Method(by_multi_start, takes_method=False)
