"""Intervals where the likelihood is ragged, by an affine-invariant ensemble sampler.

With backlash each shock jumps with gap, inertia and friction together, so that searches and
profiles end on the next ledge. Walkers propose positions on lines through each other (Goodman &
Weare 2010, Comm. App. Math. Comp. Sci. 5, 65) and accept by ln L = −½ Σ_i n_i ln V_i within the
bounds; their spread is that of the parameters. All walkers run as one batch.
"""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.batched_search import information
from sysid.diagnosis.search.evidence import effective_samples
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.selection import CandidateModel, Interval

WALKERS = 128
"""Walkers; half of them move at once, which fills a batch of simulations."""

DRIFT, KEPT = 90, 50
"""Rounds until the walkers have spread, and rounds that are kept."""

STRETCH = 2.0
"""Longest stretch of a move along a line through two walkers."""

FIRST_SPREAD = 0.3
"""How far the parameters of a ragged effect are spread at first, as a share of their size."""

TAIL = 0.005
"""Share of the walkers beyond either end: in so few rounds they have not spread all the way, and
the interval of 99 % of them held the truth in 94 % of 66 parameters of made logs, and in 96 % of 80
gaps of logs of two inertias with a stiff damped contact and coloured noise."""


_HALVES = (
    (slice(0, WALKERS // 2), slice(WALKERS // 2, None)),
    (slice(WALKERS // 2, None), slice(0, WALKERS // 2)),
)


@dataclass(frozen=True, eq=False)
class EnsembleResult:
    """What the walkers found.

    Attributes:
        intervals: 95 % intervals by parameter.
        best: all parameters where the likelihood was highest, track by track, (parameters,).
    """

    intervals: dict[int, Interval]
    best: Array


def sample_ensemble(
    base: ForwardSelection,
    candidate: CandidateModel,
    parameters: tuple[int, ...],
    joined: bool,
    seed: int = 0,
) -> EnsembleResult:
    """Let walkers drift over the free parameters of a candidate model.

    Args:
        parameters: whose intervals are asked for.
        joined: whether the tracks feel each other, so that they move together.
    """
    model, rng = base.model, np.random.default_rng(seed)
    groups = _groups(base, candidate, joined)
    samples = effective_samples(candidate.errors.estimation)
    positions = _initial_positions(base, candidate, rng)
    positions[0] = candidate.q
    log_likelihood = _log_likelihoods(base, positions, groups, samples)
    best, top = positions[0].copy(), log_likelihood[0].copy()
    kept: list[Array] = []
    half = WALKERS // 2
    for turn in range(DRIFT + KEPT):
        for movers, others in _HALVES:
            trial = positions[movers].copy()
            allowed = np.ones((half, len(groups)), dtype=bool)
            stretch = np.zeros((half, len(groups)))
            for g, (group, _) in enumerate(groups):
                index = np.array(group)
                partner = positions[others][rng.integers(0, half, half)][:, index]
                z = ((STRETCH - 1.0) * rng.random(half) + 1.0) ** 2 / STRETCH
                trial[:, index] = partner + z[:, None] * (trial[:, index] - partner)
                stretch[:, g] = (len(group) - 1) * np.log(z)
                low = np.array([model.parameters[k].lower for k in group])
                high = np.array([model.parameters[k].upper for k in group])
                inside = np.all((trial[:, index] >= low) & (trial[:, index] <= high), axis=1)
                allowed[:, g] = inside
                trial[np.ix_(~inside, index)] = positions[movers][np.ix_(~inside, index)]
            new = _log_likelihoods(base, trial, groups, samples)
            gain = stretch + new - log_likelihood[movers]
            taken = allowed & (np.log(rng.random(gain.shape)) < gain)
            for g, (group, _) in enumerate(groups):
                rows = np.flatnonzero(taken[:, g])
                at = rows + (movers.start or 0)
                index = np.array(group)
                positions[np.ix_(at, index)] = trial[np.ix_(rows, index)]
                log_likelihood[at, g] = new[rows, g]
                k = int(np.argmax(log_likelihood[:, g]))
                if log_likelihood[k, g] > top[g]:
                    top[g] = log_likelihood[k, g]
                    best[list(group)] = positions[k, list(group)]
        if turn >= DRIFT:
            kept.append(positions[:, list(parameters)].copy())
    low, high = np.quantile(np.concatenate(kept), [TAIL, 1.0 - TAIL], axis=0)
    return EnsembleResult(
        {k: Interval(float(a), float(b)) for k, a, b in zip(parameters, low, high, strict=True)},
        best,
    )


Groups = list[tuple[tuple[int, ...], tuple[int, ...]]]
"""(parameters, tracks) that move together."""


def _groups(base: ForwardSelection, candidate: CandidateModel, joined: bool) -> Groups:
    every = tuple(range(base.model.tracks))
    if joined:
        return [(tuple(candidate.free), every)]
    parts = [tuple(k for k in candidate.free if base.model.parameters[k].track == i) for i in every]
    return [(part, (i,)) for i, part in zip(every, parts, strict=True) if part]


def _initial_positions(
    base: ForwardSelection, candidate: CandidateModel, rng: np.random.Generator
) -> Array:
    """Walkers around the candidate: smooth parameters spread by their errors, ragged by a share."""
    H = information(base.model, candidate.q, candidate.free, base.data)
    variance = float(np.nanmean(np.concatenate(candidate.errors.estimation) ** 2))
    errors = np.sqrt(np.maximum(variance * np.diag(np.linalg.pinv(H, hermitian=True)), 0.0))
    positions = np.repeat(candidate.q[None], WALKERS, axis=0)
    for k, error in zip(candidate.free, errors, strict=True):
        s = base.model.parameters[k]
        size = FIRST_SPREAD * abs(float(candidate.q[k])) if s.rough else float(error)
        drawn = candidate.q[k] + size * rng.standard_normal(WALKERS)
        positions[:, k] = np.clip(drawn, s.lower, s.upper)
    return positions


def _log_likelihoods(base: ForwardSelection, rows: Array, groups: Groups, samples: Array) -> Array:
    """ln L of every walker, group by group, (walkers, groups)."""
    data = base.data
    runs = base.model.run(rows, data)
    cost = np.nan_to_num(np.sum((data.weight * (data.y - runs)) ** 2, axis=1), nan=np.inf)
    each = -0.5 * samples * np.log(cost + 1e-300)
    return np.array([each[:, list(tracks)].sum(axis=1) for _, tracks in groups]).T
