"""Which terms the equation of one output gets: pools, paths, and an inner hold-out that decides."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.estimation.candidate_runs import CandidateRuns, select_by_simulation
from sysid.estimation.frols import TermGram, bic_size, forward, term_gram
from sysid.estimation.holdout import HoldOut
from sysid.estimation.solvers import levenberg_marquardt
from sysid.structures.monomials import Factor, Term, pool, term
from sysid.structures.narmax import NARMAX
from sysid.structures.narmax_problems import ChunkedRuns
from sysid.structures.polynomial_runs import FreeRun

DEGREES = (1, 2, 3)
"""Degrees tried when none is given."""

MOST_TERMS = 30
"""Terms an output gets at most unless the user asks for more."""

SIZES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30)
SHORTLIST = 60
"""Candidates that the simulation-error selection runs."""

LADDER = (30, 150, 600)
"""Chunk lengths of the refinement, each started from the last."""

REFINED = 4
"""Sets of terms that are refined in free run."""

EVALUATIONS = 25
TIE = 0.01
"""Held-out errors closer than this are the same; the fewer terms win."""

KEEP = 0.002
"""Relative loss on the held-out data up to which a refined term is left out."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One set of terms of one output.

    Attributes:
        terms: in the row's own view (other outputs as inputs).
        theta: coefficients, (n,).
        error: free-run error on the held-out data relative to the output's spread.
        how: where it came from, in words.
        chunk: chunk length its coefficients were refined with; 0 for least squares.
    """

    terms: tuple[Term, ...]
    theta: Array
    error: float
    how: str
    chunk: int = 0


class Row:
    """One output on the estimation data, the other outputs measured: they count as inputs.

    Args:
        structure: with the ranges of the data.
        output: which output.
        data: what to fit on and what to choose on.
    """

    def __init__(self, structure: NARMAX, output: int, data: HoldOut) -> None:
        self.structure, self.output = structure, output
        self.others = [j for j in range(structure.ny) if j != output]
        self.limits = structure.limits[output]
        self.train = [self._view(r) for r in data.train]
        self.whole = [self._view(r) for r in data.whole]
        self.counted: Sequence[NDArray[np.bool_]] = data.counted
        held = np.concatenate([y[m, 0] for (_, y), m in zip(self.whole, self.counted, strict=True)])
        spread = float(np.sum((held - held.mean()) ** 2)) if len(held) else 0.0
        self.spread = spread if spread > 0.0 else 1.0
        self.scale = np.array([np.sqrt(np.mean(np.concatenate([y for _, y in self.train]) ** 2))])
        if not self.scale[0] > 0.0:
            self.scale = np.ones(1)

    def _view(self, r: Record) -> tuple[Array, Array]:
        return np.hstack([r.u, r.y[:, self.others]]), r.y[:, [self.output]]

    def inward(self, t: Term) -> Term:
        """A term of the structure in this row's view."""
        nu = self.structure.nu
        return term([
            f if f.kind == "u"
            else Factor("y", 0, f.lag) if f.channel == self.output
            else Factor("u", nu + self.others.index(f.channel), f.lag)
            for f in t
        ])  # fmt: skip

    def outward(self, t: Term) -> Term:
        """Undo ``inward``."""
        nu = self.structure.nu
        return term([
            Factor("y", self.output, f.lag) if f.kind == "y"
            else f if f.channel < nu
            else Factor("y", self.others[f.channel - nu], f.lag)
            for f in t
        ])  # fmt: skip

    def free_run(self, terms: Sequence[Term]) -> FreeRun:
        """This row's equation alone."""
        return FreeRun((tuple(terms),), self.whole[0][0].shape[1], (self.limits,))

    def held_out_error(self, terms: Sequence[Term], theta: Array) -> float:
        """Free-run error on the held-out samples of runs through the whole records."""
        run = self.free_run(terms)
        first = max(run.depth if run.slots else 0, run.before)
        total = 0.0
        for (u, y), counted in zip(self.whole, self.counted, strict=True):
            if len(y) > first:
                x0 = run.state(y[:first], u[:first])
                found = run.simulate(theta, u[first:], x0)
                total += float(np.sum((found - y[first:])[counted[first:]] ** 2))
        return float(np.sqrt(total / self.spread))


def pools(row: Row) -> tuple[tuple[Term, ...], list[tuple[int, int, list[int]]]]:
    """The largest pool, and (degree, lags, members) of the smaller ones inside it."""
    s = row.structure
    degrees = (s.degree,) if s.degree else DEGREES
    largest = pool_within(s, row.output, max(degrees))
    terms = [row.inward(t) for t in largest]
    most = max([f.lag for t in terms for f in t], default=0)
    caps = sorted({c for c in (1, 2, 3, 5, 8, 12, 20) if c < most} | {most})
    found = []
    for degree in degrees:
        for cap in caps:
            inside = [k for k, t in enumerate(terms)
                      if len(t) <= degree and all(f.lag <= cap for f in t)]  # fmt: skip
            if inside and (not found or inside != found[-1][2]):
                found.append((degree, cap, inside))
    return tuple(terms), found


def pool_within(s: NARMAX, output: int, degree: int) -> tuple[Term, ...]:
    """The pool of the highest degree that does not explode."""
    from sysid.errors import UsageError

    while True:
        try:
            return pool(s.orders, output, degree)
        except UsageError:
            if s.degree or degree <= 1:
                raise
            degree -= 1


def search_terms(row: Row, refine: bool, evaluations: int) -> tuple[Trial, list[Trial]]:
    """The best equation of one output, and all that were tried.

    Args:
        row: the output with its data.
        refine: whether coefficients may be refined in free run.
        evaluations: limit of each refinement.
    """
    s = row.structure
    terms, inside = pools(row)
    first = max((f.lag for t in terms for f in t), default=0)
    gram = term_gram(terms, row.train, 0, first)
    tried = _err_trials(row, gram, inside)
    if s.selection != "err":
        tried += _simulation_trials(row, gram, tried)
    usable = tried
    if s.size:
        exact = [t for t in tried if len(t.terms) == s.size]
        usable = exact or tried
    if refine:
        chosen = _distinct(sorted(usable, key=lambda t: t.error), REFINED)
        for trial in chosen:
            tried += (more := refined(row, trial, evaluations))
            usable = [*usable, *more]
        if not s.size:
            more = pruned(row, best(usable), evaluations)
            tried, usable = tried + more, usable + more
    return best(usable), tried


def best(trials: Sequence[Trial]) -> Trial:
    """The smallest of those that are as good as the best."""
    limit = (1.0 + TIE) * min(t.error for t in trials)
    close = [t for t in trials if t.error <= limit] or list(trials)
    return min(close, key=lambda t: (len(t.terms), t.error))


def _err_trials(
    row: Row, gram: TermGram, inside: Sequence[tuple[int, int, list[int]]]
) -> list[Trial]:
    """Least squares at several sizes along the path of every pool."""
    s = row.structure
    most = s.size or min(MOST_TERMS, max(gram.samples // 8, 1))
    seen: set[frozenset[int]] = set()
    found = []
    for degree, cap, members in inside:
        path = forward(gram, members, most)
        enough = bic_size(path, gram.samples)
        sizes = [s.size] if s.size else [n for n in SIZES if n < enough] + [enough]
        for n in sizes:
            chosen = path.order[:n].tolist()
            if not chosen or frozenset(chosen) in seen:
                continue
            seen.add(frozenset(chosen))
            how = f"error reduction, degree {degree}, lags to {cap}, {len(chosen)} terms"
            found.append(_least_squares(row, gram, chosen, how))
    return found


def _least_squares(row: Row, gram: TermGram, chosen: Sequence[int], how: str) -> Trial:
    terms = tuple(gram.terms[k] for k in chosen)
    theta = gram.solve(chosen)
    return Trial(terms, theta, row.held_out_error(terms, theta), how)


def _simulation_trials(row: Row, gram: TermGram, tried: Sequence[Trial]) -> list[Trial]:
    """Growing and pruning by the simulation error, from the best set and from its linear part."""
    s = row.structure
    place = {t: k for k, t in enumerate(gram.terms)}
    everything = range(len(gram.terms))
    ahead = best(tried)
    known = [
        k for t in sorted(tried, key=lambda t: t.error)[:8] for k in (place[x] for x in t.terms)
    ]
    linear = [k for k in everything if len(gram.terms[k]) == 1]
    path = forward(gram, list(everything), SHORTLIST).order.tolist()
    short = list(dict.fromkeys([*(place[x] for x in ahead.terms), *known, *linear, *path]))
    short = short[: max(SHORTLIST, len(ahead.terms))]
    part = subset(gram, short)
    runs = CandidateRuns(part.terms, row.train, row.limits)
    begin = [[short.index(place[x]) for x in ahead.terms]]
    begin.append([k for k in begin[0] if len(part.terms[k]) <= 1])
    most = s.size or min(MOST_TERMS, max(gram.samples // 8, 1))
    found = []
    seen: set[frozenset[int]] = set()
    for start in begin:
        if not start or frozenset(start) in seen or len(start) > most:
            continue
        for chosen, _ in select_by_simulation(part, runs, start, most):
            if frozenset(chosen) not in seen:
                seen.add(frozenset(chosen))
                how = f"simulation error, {len(chosen)} terms"
                found.append(_least_squares(row, part, chosen, how))
    return found


def subset(gram: TermGram, chosen: Sequence[int]) -> TermGram:
    """The Gram matrix of some of its terms."""
    where = np.asarray(chosen, dtype=int)
    return replace(
        gram,
        terms=tuple(gram.terms[k] for k in chosen),
        norms=gram.norms[where],
        gram=gram.gram[np.ix_(where, where)],
        right=gram.right[where],
    )


def _distinct(trials: Sequence[Trial], count: int) -> list[Trial]:
    found: list[Trial] = []
    for t in trials:
        if all(set(t.terms) != set(f.terms) for f in found):
            found.append(t)
        if len(found) == count:
            break
    return found


# ------------------------------------------------------------------------- in free run


def refined(
    row: Row, trial: Trial, evaluations: int, ladder: Sequence[int] = LADDER
) -> list[Trial]:
    """The same terms with coefficients fitted to free runs over longer and longer chunks."""
    theta, found = trial.theta, []
    longest = max(len(y) for _, y in row.train)
    for chunk in ladder:
        chunk = min(chunk, longest)
        theta = fit_chunks(row, trial.terms, theta, chunk, evaluations)[0]
        error = row.held_out_error(trial.terms, theta)
        words = f"{trial.how}, refined over {chunk} samples"
        found.append(Trial(trial.terms, theta, error, words, chunk))
        if chunk == longest:
            break
    return found


def fit_chunks(
    row: Row, terms: Sequence[Term], theta: Array, chunk: int, evaluations: int
) -> tuple[Array, Array]:
    """Coefficients fitted to free runs of ``chunk`` samples, and the Jacobian there."""
    problem = ChunkedRuns(row.free_run(terms), row.train, chunk, row.scale)
    n = len(theta)
    if sum(problem.lengths) <= n:
        return theta, np.zeros((0, n))
    free, bound = np.ones(n, dtype=bool), np.full(n, np.inf)
    found = levenberg_marquardt(
        problem, theta, free=free, lower=-bound, upper=bound, max_evaluations=evaluations,
        tolerance=1e-5,
    )  # fmt: skip
    return found.p, found.jacobian


def pruned(row: Row, trial: Trial, evaluations: int) -> list[Trial]:
    """Terms left out one by one, the least certain first, while the held-out error allows it."""
    if not trial.chunk:
        return []
    found: list[Trial] = []
    while len(trial.terms) > 2:
        _, J = fit_chunks(row, trial.terms, trial.theta, trial.chunk, 1)
        if not len(J):
            break
        R = np.linalg.qr(J, mode="r")
        spread = np.linalg.norm(np.linalg.pinv(R, rcond=1e-12), axis=1)
        weight = np.abs(trial.theta) / np.maximum(spread, 1e-300)
        accepted = None
        for out in np.argsort(weight)[:2]:
            keep = [k for k in range(len(trial.terms)) if k != out]
            terms = tuple(trial.terms[k] for k in keep)
            theta = fit_chunks(row, terms, trial.theta[keep], trial.chunk, evaluations)[0]
            error = row.held_out_error(terms, theta)
            if error <= (1.0 + KEEP) * trial.error:
                accepted = Trial(terms, theta, error, f"{trial.how}, pruned", trial.chunk)
                break
        if accepted is None:
            break
        found.append(accepted)
        trial = accepted
    return found
