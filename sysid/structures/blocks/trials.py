"""Trials of a block-oriented fit: what data fit and choose, descents, changes of shape."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record, shortened
from sysid.fitting.holdout import error_margin, hold_out, independent_samples
from sysid.fitting.marquardt import Conditions, loss, marquardt
from sysid.fitting.run_errors import output_scales
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.blocks.errors import ChainErrors
from sysid.structures.blocks.gains import argument_scaled, scale_gain
from sysid.structures.blocks.layers import LinearLayer, StaticLayer
from sysid.structures.blocks.static.functions import Static
from sysid.structures.blocks.static.starts import shaped
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.orders import Orders

FELT_STATE = 0.1
"""Share of the errors that the whole range of an initial state is taken to change at least: one
that changes less says nothing, and its step shall be small."""


SIZES = (1e-300, 1e300)
"""Least and largest squared error in a logarithm: some models have none, and some run away."""


@dataclass(frozen=True, eq=False)
class ChainData:
    """Experiments with the samples that are fitted and those that choose.

    Attributes:
        kept: samples to fit on, (N,) of each.
        scales: standard deviation of each output.
        states: whether initial states are estimated, or those of rest.
    """

    records: tuple[Record, ...]
    kept: tuple[NDArray[np.bool_], ...]
    holdout: tuple[NDArray[np.bool_], ...]
    scales: Array
    states: bool = True

    @staticmethod
    def of(
        records: Sequence[Record], holdout: Sequence[NDArray[np.bool_]] | None = None
    ) -> "ChainData":
        """All samples of the records are fitted, except those held out and outliers."""
        masks = [np.zeros(len(r), dtype=bool) for r in records] if holdout is None else holdout
        pairs = list(zip(masks, records, strict=True))
        return ChainData(
            tuple(records),
            tuple(~m & r.counted for m, r in pairs),
            tuple(m & r.counted for m, r in pairs),
            output_scales([r.y for r in records]),
        )

    @staticmethod
    def held_out(records: Sequence[Record], samples: int) -> "ChainData":
        """So many samples of the records in pieces, a part of them held out."""
        cut = hold_out(shortened(records, samples))
        return ChainData.of(cut.whole, cut.counted)

    @property
    def pairs(self) -> list[tuple[Array, Array]]:
        """(u, y) of each experiment."""
        return [(np.asarray(r.u), np.asarray(r.y)) for r in self.records]

    @property
    def samples(self) -> int:
        """Samples that are fitted."""
        return sum(int(k.sum()) for k in self.kept)

    def problem(
        self, chain: BlockChain, kept: Sequence[NDArray[np.bool_]] | None = None
    ) -> ChainErrors:
        """The free-run errors of a chain on the samples that are fitted, or on others."""
        masks = self.kept if kept is None else kept
        return ChainErrors(chain, self.pairs, self.states, masks, self.scales)

    def holdout_error(self, chain: BlockChain, p: Array) -> float:
        """Root mean square of the held-out errors relative to the outputs' spread."""
        e = self.problem(chain, self.holdout).residual(p)
        size = float(np.sqrt(np.mean(e**2))) if len(e) else float("nan")
        return size if size < 1e6 else float("inf")

    def holdout_margin(self, chain: BlockChain, p: Array) -> float:
        """Fraction by which that error is uncertain: one standard error."""
        return error_margin(self.errors(chain, p, self.holdout))

    def errors(
        self, chain: BlockChain, p: Array, masks: Sequence[NDArray[np.bool_]]
    ) -> list[Array]:
        """Relative errors of each output and experiment, zero where a mask leaves them out."""
        problem = self.problem(chain, masks)
        parts = np.split(problem.residual(p), np.cumsum(problem.lengths)[:-1])
        which = [mask for mask in masks for _ in self.scales]
        series = [np.zeros(len(mask)) for mask in which]
        for whole, mask, part in zip(series, which, parts, strict=True):
            whole[mask] = part
        return series


class Effort(NamedTuple):
    """What a descent may cost.

    Attributes:
        evaluations: residual evaluations at most.
        tolerance: relative gain of a step below which it ends.
    """

    evaluations: int
    tolerance: float = 1e-4


@dataclass(frozen=True, eq=False)
class Trial:
    """Orders and statics with parameters and initial states, and how well they do.

    Attributes:
        p: θ, and the initial states of each experiment where they are known.
        label: how it came about.
        cost: ½ Σ (ε/scale)² of the fitted samples.
        holdout_error: relative error of the held-out samples, NaN without any.
        evaluations: residual evaluations of the last descent.
    """

    structure: BlockStructure
    p: Array
    label: str = ""
    cost: float = float("inf")
    holdout_error: float = float("nan")
    evaluations: int = 0

    @property
    def chain(self) -> BlockChain:
        return self.structure.chain

    @property
    def theta(self) -> Array:
        """The parameters without initial states."""
        return self.p[: self.chain.n]

    def descended(
        self, data: ChainData, effort: Effort, fixed_entries: Sequence[int] = ()
    ) -> "Trial":
        """Levenberg-Marquardt on the fitted samples.

        The normal equations are summed experiment by experiment, so that 10⁵ samples of 40
        parameters cost 50 ms a step. Their condition is that of J squared, which the damping
        bears; the last search works on J itself. An initial state that is felt next to nothing,
        within a dead zone or where a sensor saturates, would run away with every step, and no
        other entry could move: it counts as if it were felt a little.
        """
        chain, problem = self.chain, data.problem(self.chain)
        missing = len(self.p) < chain.n + problem.n_initial
        p = problem.with_states(self.p) if missing else self.p.copy()
        free = np.ones(len(p), dtype=bool)
        free[list(fixed_entries)] = False
        sizes = np.concatenate([np.full(chain.n, np.inf), problem.state_sizes(p)])[free]

        def full(x: Array) -> Array:
            out = p.copy()
            out[free] = x
            return out

        def normal(x: Array, r: Array) -> tuple[Array, Array]:
            gram, slope = problem.normal_equations(full(x), r)
            return gram[np.ix_(free, free)], slope[free]

        limits = Conditions(effort.tolerance, effort.evaluations, least_scale=FELT_STATE / sizes)
        x, spent, _ = marquardt(lambda x: problem.residual(full(x)), p[free], None, limits, normal)
        p = full(x)
        holdout_error = float("nan")
        if any(m.any() for m in data.holdout):
            holdout_error = data.holdout_error(chain, p)
        cost = loss(problem.residual(p))
        return replace(self, p=p, cost=cost, holdout_error=holdout_error, evaluations=spent)

    def moved(self, data: ChainData, effort: Effort) -> "Trial":
        """The same model fitted to other data, points of piecewise-linear statics held."""
        return replace(self, p=self.theta).descended(data, effort, abscissae(self.chain))

    def refined(self, data: ChainData, effort: Effort) -> "Trial":
        """All parameters together, points of piecewise-linear statics last."""
        fixed = abscissae(self.chain)
        settled = self.descended(data, effort, fixed)
        if not fixed:
            return settled
        points = settled.descended(data, effort, outer_abscissae(self.chain))
        # points may wander after noise: keep them where that does not help on held-out samples
        return settled if points.holdout_error > settled.holdout_error else points

    def with_orders(
        self, linear_blocks: tuple[Orders, ...], data: ChainData, effort: Effort, label: str = ""
    ) -> "Trial":
        """The statics of this model and its linear blocks with other coefficients, fitted.

        Coefficients of the same name stay, new ones begin at zero.
        """
        names = parameter_names(self.structure, data)
        values = dict(zip(names, self.theta.tolist(), strict=True))
        structure = replace(self.structure, linear_blocks=linear_blocks)
        trial = Trial(structure, by_names(structure, values, data), label or structure.words)
        return trial.refined(data, effort)

    def with_statics(
        self,
        statics: Sequence[Sequence[Static]],
        data: ChainData,
        effort: Effort,
        flexible: Static | None = None,
    ) -> "Trial":
        """Other statics that follow those of this model as well as they can, then fitted.

        Args:
            statics: at each place, one a channel.
            flexible: what stands for each of them first and takes the shape of the data, which
                they then follow; None to have them follow what is there.
        """
        trial = self
        if flexible is not None:
            stand_ins = [tuple(s if s.is_identity else flexible for s in at) for at in statics]
            trial = trial.reshaped(stand_ins, data)
            if stand_ins != [tuple(at) for at in statics]:
                trial = trial.descended(data, effort, abscissae(trial.chain))
        return trial.reshaped(statics, data).refined(data, effort)

    def reshaped(self, statics: Sequence[Sequence[Static]], data: ChainData) -> "Trial":
        """The same with other statics, before any descent."""
        trial = self
        for layer, at in zip(self.structure.places.values(), statics, strict=True):
            trial = _with_statics(trial, layer, at, data)
        return replace(trial, label=trial.structure.words)


def best_start(
    structure: BlockStructure,
    starts: Iterable[Mapping[str, float]],
    data: ChainData,
    effort: Effort,
) -> Trial | None:
    """The best end of descents from values by name; None without any."""
    trials = [
        Trial(structure, by_names(structure, s, data), structure.words).descended(data, effort)
        for s in starts
    ]
    return min(trials, key=lambda trial: trial.cost, default=None)


Improbability = Callable[[Trial, Trial, ChainData], float]
"""−2 ln of how probable one model is beside another that the same data chose from."""


def preferred(
    tried: Sequence[Trial], data: ChainData, improbability: Improbability | None = None
) -> Trial:
    """Of the models within one standard error of the smallest held-out error the most probable.

    Args:
        improbability: of a model beside the one ahead; None for ``every_sample_counts``.
    """
    improbable = improbability or every_sample_counts
    ahead = min(tried, key=lambda t: t.holdout_error)
    limit = (1.0 + data.holdout_margin(ahead.chain, ahead.p)) * ahead.holdout_error
    near = [t for t in tried if t.holdout_error <= limit] or list(tried)
    return min(near, key=lambda t: (improbable(t, ahead, data), t.holdout_error))


def every_sample_counts(t: Trial, ahead: Trial, data: ChainData) -> float:
    """N ln(V/V₀) + (n − n₀) ln N of the N fitted samples (Schwarz 1978)."""
    size = data.samples * len(data.scales)
    powers = np.log(np.clip([t.cost, ahead.cost], *SIZES))
    return float(size * (powers[0] - powers[1]) + (t.chain.n - ahead.chain.n) * np.log(size))


def independent_samples_count(t: Trial, ahead: Trial, data: ChainData) -> float:
    """M ln(V/V₀) + (n − n₀) ln M + M' ln(V'/V'₀), by p(all) = p(fitted) p(held out | fitted).

    V, V' are the mean squares of the fitted and of the held-out errors, M and M' the independent
    samples that say how the two models differ there (``independent_samples``): counted one by one,
    errors that follow each other would pay for any bend of a curve, while a quick change, as a
    further coefficient of a numerator makes it, is told from them by every sample.
    """
    if t is ahead:
        return 0.0
    counts = []
    for mask in (data.kept, data.holdout):
        errors, others = (data.errors(x.chain, x.p, mask) for x in (ahead, t))
        change = [b - a for a, b in zip(errors, others, strict=True)]
        counts.append(independent_samples(errors, change))
    powers = np.log(np.clip([[x.cost, x.holdout_error**2] for x in (t, ahead)], *SIZES))
    penalty = (t.chain.n - ahead.chain.n) * np.log(counts[0])
    return float((powers[0] - powers[1]) @ counts + penalty)


def by_names(structure: BlockStructure, values: Mapping[str, float], data: ChainData) -> Array:
    """θ of a structure from values by name, zero where there is none."""
    return np.array([values.get(name, 0.0) for name in parameter_names(structure, data)])


def parameter_names(structure: BlockStructure, data: ChainData) -> list[str]:
    """Names of θ, those of channels as the data have them."""
    first = data.records[0]
    return [p.name for p in structure.parameters(first.inputs, first.outputs)]


def abscissae(chain: BlockChain) -> list[int]:
    """Entries of θ that are abscissae of piecewise-linear statics, all but none."""
    points = []
    for k, layer in enumerate(chain.layers):
        if not isinstance(layer, StaticLayer):
            continue
        for static, at in zip(layer.statics, layer.edges[:-1], strict=True):
            for stage, part in zip(static.stages, static.slices(), strict=True):
                if stage.kind == "piecewise":
                    first = chain.edges[k] + at + part.start
                    points += list(range(first, first + stage.size))
    return points


def outer_abscissae(chain: BlockChain) -> list[int]:
    """Those at either end: only the slope of an outer segment is seen, not where it ends."""
    every = abscissae(chain)
    return [k for k in every if k - 1 not in every or k + 1 not in every]


def _with_statics(trial: Trial, layer: int, statics: Sequence[Static], data: ChainData) -> Trial:
    """The trial with other statics in one layer, each following the one it replaces.

    A spline ends where the samples that are fitted end: what is held out would stretch it to where
    nothing says how it goes, and one such sample would decide between all trials.

    A gain that the new static does not have goes to the linear block beside it. Statics of the
    same text stay as they are, points included. Nothing is fitted: cost and held-out error are
    those of before.
    """
    chain, theta = trial.chain, trial.theta.copy()
    old = chain.layers[layer]
    assert isinstance(old, StaticLayer)
    signals = [chain.signals(theta, u) for u, _ in data.pairs]
    states = trial.p[chain.n :].reshape(len(signals), chain.n_states).copy()
    place = chain.place(layer)
    new: list[Static] = []
    parts: list[Array] = []
    for c, static in enumerate(statics):
        parameters_of_static = theta[place][old.edges[c] : old.edges[c + 1]]
        if static.text == old.statics[c].text:
            new.append(old.statics[c])
            parts.append(parameters_of_static)
            continue
        shown = data.kept if _has_spline(static) else [np.ones_like(k) for k in data.kept]
        x, value = (
            np.concatenate([s[k][c][mask] for s, mask in zip(signals, shown, strict=True)])
            for k in (layer, layer + 1)
        )
        shape = shaped(static, x, value, upright=old.last)
        p = shape.p
        if shape.gain != 1.0 and old.last:
            # gain · g(w) = g'(gain · w) for limits and kinks
            _, p = argument_scaled(shape.static, p, shape.gain)
            scale_gain(chain, layer - 1, theta, shape.gain, row=c)
            _scale_states(chain, layer - 1, states, shape.gain, c)
        elif shape.gain != 1.0:
            scale_gain(chain, layer + 1, theta, shape.gain, column=c)
        new.append(shape.static)
        if old.last and not shape.static.has_offset:
            p = np.append(p, shape.offset)
        parts.append(p)
    layers = list(chain.layers)
    layers[layer] = replace(old, statics=tuple(new))
    structure = trial.structure.with_chain(BlockChain(tuple(layers), chain.nu))
    start = np.concatenate([theta[: place.start], *parts, theta[place.stop :], states.ravel()])
    return replace(trial, structure=structure, p=start)


def _has_spline(static: Static) -> bool:
    return any(stage.kind == "spline" for stage in static.stages)


def _scale_states(chain: BlockChain, k: int, states: Array, gain: float, row: int) -> None:
    """Multiply the states behind one row of linear layer k, in place."""
    at = sum(layer.n_states for layer in chain.layers[:k])
    layer = chain.layers[k]
    assert isinstance(layer, LinearLayer)
    for (i, _), order in zip(layer.pairs, layer.orders, strict=True):
        if i == row:
            states[:, at : at + order] *= gain
        at += order
