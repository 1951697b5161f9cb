"""Fitting chains of blocks: descents on part of the data, and where gains are put."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from sysid.data.record import Array, Record
from sysid.estimation.search import STATE_LEVEL, FitOptions, Search, assembled
from sysid.estimation.strategies import Outcome
from sysid.structures.base import Initial, Parameter
from sysid.structures.block_chain import BlockChain, LinearLayer, StaticLayer
from sysid.structures.block_structure import BlockStructure, ChainErrors, output_scales
from sysid.structures.model import StartReport
from sysid.structures.static import Stage, Static, spline_knots

Mask = NDArray[np.bool_]

ROUGH_TOLERANCE = 1e-4
"""Relative gain of a step below which a descent that only ranks candidates ends."""


@dataclass(frozen=True, eq=False)
class ChainData:
    """Experiments with the samples that are fitted and those that choose.

    Attributes:
        data: (u, y) of each experiment.
        kept: samples to fit on.
        held: samples to choose on.
        scales: standard deviation of each output.
    """

    data: tuple[tuple[Array, Array], ...]
    kept: tuple[Mask, ...]
    held: tuple[Mask, ...]
    scales: Array

    @staticmethod
    def of(records: Sequence[Record], held: Sequence[Mask] | None = None) -> "ChainData":
        """All samples of the records are fitted, except those held out."""
        data = tuple((np.asarray(r.u), np.asarray(r.y)) for r in records)
        none = tuple(np.zeros(len(y), dtype=bool) for _, y in data) if held is None else tuple(held)
        return ChainData(data, tuple(~m for m in none), none, output_scales([y for _, y in data]))

    def problem(self, chain: BlockChain, kept: Sequence[Mask] | None = None) -> ChainErrors:
        """The free-run errors of a chain, initial states estimated."""
        return ChainErrors(chain, self.data, True, self.kept if kept is None else kept, self.scales)

    def held_error(self, chain: BlockChain, p: Array) -> float:
        """Root mean square of the held-out errors relative to the outputs' spread."""
        e = self.problem(chain, self.held).residual(p)
        size = float(np.sqrt(np.mean(e**2))) if len(e) else float("nan")
        return size if size < 1e6 else float("inf")

    @property
    def samples(self) -> int:
        """Samples that are fitted."""
        return sum(int(k.sum()) for k in self.kept)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A chain with parameters and initial states, and how well it does.

    Attributes:
        chain: the chain.
        p: θ and the initial states of each experiment.
        cost: ½ Σ (ε/scale)² of the fitted samples.
        held: relative error of the held-out samples, NaN without any.
        evaluations: residual evaluations spent.
    """

    chain: BlockChain
    p: Array
    cost: float
    held: float
    evaluations: int

    @property
    def theta(self) -> Array:
        """The parameters without initial states."""
        return self.p[: self.chain.n]


def descend(
    chain: BlockChain,
    p0: Array,
    data: ChainData,
    *,
    evaluations: int,
    held_entries: Sequence[int] = (),
    tolerance: float = ROUGH_TOLERANCE,
) -> Fitted:
    """Levenberg-Marquardt on the fitted samples from p0 (θ, or θ and initial states).

    The normal equations are summed experiment by experiment, so that 10⁵ samples of 40 parameters
    cost 50 ms a step; Marquardt's damping is steered as Nielsen (1999) does. Their condition is
    that of J squared, which the damping bears; the last search works on J itself.
    """
    problem = data.problem(chain)
    p = problem.initial_guess(p0) if len(p0) == chain.n else p0.copy()
    free = np.ones(len(p), dtype=bool)
    free[list(held_entries)] = False
    r = problem.residual(p)
    cost, spent, damping, growth = _half_square(r), 1, 1e-3, 2.0
    fresh, gram, gradient = True, np.zeros((0, 0)), np.zeros(0)
    while spent < evaluations:
        if fresh:
            full, slope = problem.normal_equations(p, r)
            gram, gradient = full[np.ix_(free, free)], slope[free]
            if not (np.all(np.isfinite(gram)) and np.all(np.isfinite(gradient))):
                break
            scale = np.sqrt(np.diag(gram))
            scale[scale == 0.0] = 1.0
            gram, gradient = gram / np.outer(scale, scale), gradient / scale
        step = -_solved(gram, damping, gradient)
        trial = p.copy()
        trial[free] += step / scale
        foreseen = float(step @ (damping * step - gradient)) / 2.0
        e = problem.residual(trial)
        new, spent = _half_square(e), spent + 1
        fresh = new < cost
        if fresh:
            ratio = (cost - new) / max(foreseen, 1e-300)
            gained = (cost - new) / max(cost, 1e-300)
            p, r, cost = trial, e, new
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
            growth = 2.0
            if gained < tolerance and foreseen < tolerance * max(cost, 1e-300):
                break
        else:
            if foreseen < 0.01 * tolerance * cost or damping > 1e12:
                break
            damping, growth = damping * growth, growth * 2.0
    return Fitted(chain, p, cost, data.held_error(chain, p), spent)


def _solved(gram: Array, damping: float, gradient: Array) -> Array:
    """(gram + damping I)⁻¹ gradient for a gram with a unit diagonal."""
    eye = np.eye(len(gram))
    try:
        return np.asarray(cho_solve(cho_factor(gram + damping * eye), gradient))
    except np.linalg.LinAlgError:
        return np.asarray(cho_solve(cho_factor(gram + (damping + 1e-8) * eye), gradient))


def _half_square(r: Array) -> float:
    with np.errstate(over="ignore"):
        return 0.5 * float(r @ r)


def abscissae(chain: BlockChain) -> list[int]:
    """Entries of θ that are abscissae of piecewise-linear statics, all but none."""
    found = []
    for k, layer in enumerate(chain.layers):
        if not isinstance(layer, StaticLayer):
            continue
        for static, at in zip(layer.statics, layer.edges[:-1], strict=True):
            for stage, part in zip(static.stages, static.slices(), strict=True):
                if stage.kind == "piecewise":
                    first = chain.edges[k] + at + part.start
                    found += list(range(first, first + stage.size))
    return found


def outer_abscissae(chain: BlockChain) -> list[int]:
    """Those at either end: only the slope of an outer segment is seen, not where it ends."""
    every = abscissae(chain)
    return [k for k in every if k - 1 not in every or k + 1 not in every]


def argument_scaled(static: Static, p: Array, factor: float) -> tuple[Static, Array]:
    """The static g' with g'(factor·w) = g(w), where it has a gain to take the factor up."""
    stages, parts, alive = [], [], True
    for stage, place in zip(static.stages, static.slices(), strict=True):
        part = p[place].copy()
        if alive and stage.kind == "polynomial":
            part /= factor ** np.arange(1.0, stage.size + 1)
            alive = False
        elif alive and stage.kind == "piecewise":
            part[: stage.size] *= factor
            alive = False
        elif alive and stage.kind == "spline":
            stage = replace(stage, knots=tuple((spline_knots(stage) * factor).tolist()))
            alive = False
        elif alive:
            part *= factor
        stages.append(stage)
        parts.append(part)
    return Static(tuple(stages)), np.concatenate([*parts, np.zeros(0)])


def value_scaled(static: Static, p: Array, factor: float) -> Array:
    """Parameters with which the static is ``factor`` times what it was, where it has a gain."""
    out = p.copy()
    places = static.slices()
    last = max(k for k, s in enumerate(static.stages) if s.kind in _GAINS)
    stage, part = static.stages[last], places[last]
    out[part.stop - stage.size : part.stop] *= factor
    for place in places[last + 1 :]:
        out[place] *= factor
    return out


_GAINS = ("polynomial", "piecewise", "spline")


def normalised(
    chain: BlockChain, theta: Array, data: Sequence[tuple[Array, Array]]
) -> tuple[BlockChain, Array, list[int]]:
    """The same input-output map with every gain in one place, and the entries that pin it.

    Signals behind a first linear block and before a static with a gain get the spread of what
    they come from or go to; a static with a gain before a linear block takes the spread of its
    argument: its highest and lowest point lie on a line of slope one (of a polynomial the
    largest term is the identity at the end of the range). What was divided out goes to B.

    Returns:
        (chain, θ, entries of θ to hold).
    """
    theta = theta.copy()
    layers = list(chain.layers)
    held: list[int] = []
    signals = [chain.signals(theta, u) for u, _ in data]
    joined = [np.concatenate([s[k] for s in signals], axis=1) for k in range(len(layers))]
    for k, layer in enumerate(layers):
        if not isinstance(layer, StaticLayer):
            continue
        base = chain.edges[k]
        for c, static in enumerate(layer.statics):
            place = slice(base + layer.edges[c], base + layer.edges[c] + static.n)
            before = layers[k - 1] if k else None
            if isinstance(before, LinearLayer) and not static.is_identity:
                movable = static.has_gain or not layer.last
                if movable:
                    towards = (
                        np.concatenate([y[:, c] for _, y in data]) if layer.last else joined[0][c]
                    )
                    spread = float(joined[k][c].std())
                    factor = float(towards.std()) / spread if spread > 0 else 1.0
                    held += _row_scaled(chain, k - 1, c, theta, factor)
                    if static.has_gain:
                        static, theta[place] = argument_scaled(static, theta[place], factor)
                    else:
                        theta[place] *= factor
                        if k + 1 < len(layers) and not layer.last:
                            _column_scaled(chain, k + 1, c, theta, 1.0 / factor)
                    layers[k] = replace(
                        layers[k],
                        statics=(
                            *layers[k].statics[:c],  # type: ignore[union-attr]
                            static,
                            *layers[k].statics[c + 1 :],  # type: ignore[union-attr]
                        ),
                    )
                    joined[k][c] = joined[k][c] * factor
            if static.has_gain and not layer.last:
                factor, pins = _unit_gain(static, theta[place], joined[k][c])
                theta[place] = value_scaled(static, theta[place], factor)
                _column_scaled(chain, k + 1, c, theta, 1.0 / factor)
                held += [place.start + q for q in pins]
    return BlockChain(tuple(layers), chain.nu), theta, sorted(held)


def _row_scaled(
    chain: BlockChain, k: int, i: int, theta: Array, factor: float
) -> list[int]:
    """Multiply the B of row i of layer k; returns the largest coefficient's place."""
    layer = chain.layers[k]
    assert isinstance(layer, LinearLayer)
    entries: list[int] = []
    for out, j, _, s, _, _ in layer.entries(theta[chain.place(k)]):
        if out == i:
            first = chain.edges[k] + s.start
            entries += list(range(first, first + layer.nb[out][j]))
    theta[entries] *= factor
    return [max(entries, key=lambda q: abs(theta[q]))] if entries else []


def _column_scaled(chain: BlockChain, k: int, j: int, theta: Array, factor: float) -> None:
    """Multiply the B of column j of layer k."""
    layer = chain.layers[k]
    assert isinstance(layer, LinearLayer)
    for i, column, _, s, _, _ in layer.entries(theta[chain.place(k)]):
        if column == j:
            first = chain.edges[k] + s.start
            theta[first : first + layer.nb[i][j]] *= factor


def _unit_gain(static: Static, p: Array, x: Array) -> tuple[float, list[int]]:
    """Factor that gives a static the spread of its argument, and the entries that pin it."""
    last = max(k for k, s in enumerate(static.stages) if s.kind in _GAINS)
    stage: Stage = static.stages[last]
    place = static.slices()[last]
    for inner, part in zip(static.stages[:last], static.slices()[:last], strict=True):
        x = inner.value(x, p[part])
    if stage.kind == "polynomial":
        reach = max(float(np.max(np.abs(x))), 1e-300)
        sizes = np.abs(p[place]) * reach ** np.arange(1.0, stage.size + 1)
        largest = int(np.argmax(sizes))
        value = p[place][largest] * reach**largest
        return (1.0 / value if value else 1.0), [place.start + largest]
    values = p[place][-stage.size :]
    points = p[place][: stage.size] if stage.kind == "piecewise" else spline_knots(stage)
    low, high = sorted((int(np.argmin(values)), int(np.argmax(values))))
    rise = values[high] - values[low]
    first = place.stop - stage.size
    if high == low or rise == 0.0:
        return 1.0, [first]
    return float((points[high] - points[low]) / rise), [first + low, first + high]


def finished(
    structure: BlockStructure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    starts: Sequence[tuple[str, Array]],
    reports: tuple[StartReport, ...],
) -> Outcome:
    """The last search on all data from the given starts, every gain in one place.

    Args:
        structure: orders and statics settled.
        records: experiments, offsets removed.
        options: how to fit.
        parameters: bounds and fixed values the user gave, by name.
        starts: named θ of ``structure``, the best first.
        reports: starts tried before.
    """
    data = [(np.asarray(r.u), np.asarray(r.y)) for r in records]
    given = {p.name: p for p in parameters}
    bare = structure.parameters(records[0].inputs, records[0].outputs)
    bound_by_user = {
        k
        for k, p in enumerate(bare)
        if p.name in given and _constrained(given[p.name])
    }
    chain, theta, pins = structure.chain, starts[0][1], list[int]()
    if not bound_by_user:
        chain, theta, pins = normalised(chain, theta, data)
    pins = sorted({*pins, *outer_abscissae(chain)})
    structure = structure.with_chain(chain)
    table = tuple(
        given[p.name]
        if k in bound_by_user
        else replace(p, fixed=float(theta[k]))
        if k in pins
        else p
        for k, p in enumerate(bare)
    )
    if options.initial is Initial.AUTO:
        options = replace(options, initial=_initial(chain, theta, records))
    search = Search(structure, records, options, table)
    own = [(starts[0][0], theta), *starts[1:]]
    theta, parts, last = search.run(own)
    covariance, null = assembled(parts, len(theta))
    stuck = tuple(
        table[p.problem.index[k]].name
        for p in parts
        for k in p.solution.at_bound
        if k < len(p.problem.index)
    )
    return Outcome(
        structure,
        table,
        theta,
        covariance,
        null,
        n_states=sum(int(np.sum(p.free >= len(p.problem.index))) for p in parts),
        termination=parts[0].solution.termination,
        at_bound=stuck,
        starts=(*reports, *last),
    )


def _constrained(p: Parameter) -> bool:
    return p.fixed is not None or bool(np.isfinite(p.lower)) or bool(np.isfinite(p.upper))


def _initial(chain: BlockChain, theta: Array, records: Sequence[Record]) -> Initial:
    """Rest, unless initial states of their own lower the cost significantly (F-test, 99 %)."""
    from scipy.stats import f

    data = ChainData.of(records)
    free = data.problem(chain)
    rest = ChainErrors(chain, data.data, False, scales=data.scales)
    k = free.n_initial
    if k == 0:
        return Initial.ZERO
    p = free.initial_guess(theta)
    r = free.residual(p)
    basis = free.jacobian(p)[:, chain.n :]
    left = r - basis @ np.linalg.lstsq(basis, r, rcond=1e-10)[0]
    e, dof = rest.residual(theta), len(r) - k - chain.n
    if dof <= 0:
        return Initial.ZERO
    after = max(float(left @ left), 1e-300)
    ratio = (float(e @ e) - after) / k / (after / dof)
    return Initial.ESTIMATED if ratio > f.ppf(STATE_LEVEL, k, dof) else Initial.ZERO
