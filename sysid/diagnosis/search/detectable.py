"""Detectable sizes: for each effect the smallest size that the log would have revealed.

An effect of size s changes the output by Δ(s) = run(q + s) − run(q). The part that the present
parameters can follow is projected out, Δ⊥ = Δ − J(JᵀJ)⁻¹JᵀΔ, and with the noise e

    V₀/V₁ = 1 + ‖Δ⊥‖²/‖e‖²

The effect is detectable where this passes the ``AcceptanceRule`` on estimation and held-out
records. Of an effect's other parameters the least favourable count.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import ENDLESS
from sysid.diagnosis.samples import smallest_named
from sysid.diagnosis.search.evidence import effective_samples, needed_power
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import NO_LIMIT, ModelParameter
from sysid.diagnosis.search.selection import CandidateModel
from sysid.effects.base import Effect, EffectParameter
from sysid.effects.sensor import MOST_SAMPLED

SIZES = 2.2 ** -np.arange(8.0)
"""Severities tried, in units of the greatest that the bounds allow."""

WIDE = 20.0
"""Limits whose bounds are further apart than this factor are tried on a logarithmic scale."""


def detectable(
    search: ForwardSelection, model: CandidateModel, ids: Sequence[str]
) -> dict[str, float | None]:
    """Smallest size of each effect, in the unit of its first parameter.

    For a ratio (null 1) the size is its distance from 1, for a limit (saturations, rate limit,
    freewheel) the loosest limit that would have shown. All tracks have the effect at once; the size
    is their mean. None: no size within the effect's bounds would have shown on this log.
    """
    smallest: dict[str, float | None] = dict.fromkeys(ids)
    smallest |= {k: v for k, v in smallest_named(search.estimation).items() if k in smallest}
    effects = [
        e
        for e in search.model.effects
        if e.id in smallest
        and e.id not in model.effects
        and not set(search.model.of(e.id)) & set(model.free)
    ]
    if not effects:
        return smallest
    weight = 1.0 / np.maximum(np.sqrt(model.errors.mean_squares()[0]), 1e-300)
    parts = (model.errors.estimation, model.errors.holdout)
    noise = [float(np.nansum((np.concatenate(part) * weight) ** 2)) for part in parts]
    effective = float(np.min(effective_samples(model.errors.estimation))) * len(weight)
    least_ratio, steep = 1.0 / search.needed**2 - 1.0, _steepest(search, model)
    ways = [(e, start) for e in effects for start in _ways(search, e)]
    batch = np.array([_with(search, model.q, *way, float(s), steep) for way in ways for s in SIZES])
    squares = _unexplained(search, model, batch, weight).reshape(2, len(ways), len(SIZES))
    for e in effects:
        ways_of_effect = [k for k, (other, _) in enumerate(ways) if other is e]
        asked = needed_power(len(search.model.of(e.id)), effective, search.needed), least_ratio
        needed = np.array([ratio * square for ratio, square in zip(asked, noise, strict=True)])
        shares = np.min(squares[:, ways_of_effect] / needed[:, None, None], axis=0)
        smallest[e.id] = None
        severities = [v for v in map(_smallest, shares) if v is not None]
        if len(severities) == len(ways_of_effect):
            smallest[e.id] = _size(search, e, max(severities), steep)
    return smallest


def _ways(search: ForwardSelection, e: Effect) -> Sequence[Mapping[int, float]]:
    """Starts of an effect that differ in other parameters than its size, all of its first law.

    A gap before a tenth of the inertia shows less than one before all of it: nobody who asks what
    a log could have shown knows such parameters, so a size has to show with the least favourable.
    """
    model, first = search.model, e.parameters[0]
    starts, track = model.starts(e), model.sides(e)[0]
    choices = [model.index[e.id, p.name, track] for p in e.parameters if p.choice]
    others = [
        model.index[e.id, p.name, track]
        for p in e.parameters
        if not p.choice and (p.null != first.null or p.unit != first.unit)
    ]
    same = [s for s in starts if all(s[k] == starts[0][k] for k in choices)]
    return list({tuple(s[k] for k in others): s for s in reversed(same)}.values())[::-1]


def _unexplained(
    search: ForwardSelection, model: CandidateModel, batch: Array, noise_weight: Array
) -> Array:
    """‖Δ⊥‖² of every item on estimation and held-out records, (2, batch).

    Args:
        noise_weight: one over the RMS error of each output, (ny,).
    """
    squares = []
    coefficients: Array | None = None
    for holdout in (False, True):
        data = search.holdout_data if holdout else search.data
        weight = np.sqrt(data.weight) * noise_weight
        J = np.concatenate(search.slopes(model, holdout)) * weight[:, :, None]
        J = J.reshape(J.shape[0] * J.shape[1], J.shape[2])
        base = search.model.run(model.q, data)[0]
        with np.errstate(over="ignore", invalid="ignore"):
            change = (search.model.run(batch, data) - base) * weight
        flat = np.nan_to_num(change.reshape(len(batch), -1), posinf=0.0, neginf=0.0)
        flat = np.clip(flat, -ENDLESS, ENDLESS)
        if coefficients is None:
            size = np.maximum(np.sqrt(np.sum(J**2, axis=0)), 1e-300)
            A = (J / size).T @ (J / size)
            inverse = np.linalg.pinv(A, 1e-9, hermitian=True)
            coefficients = (inverse @ ((J / size).T @ flat.T)) / size[:, None]
        squares.append(np.sum((flat - (J @ coefficients).T) ** 2, axis=1))
    return np.array(squares)


def _smallest(share: Array) -> float | None:
    """The severity at which ``share`` (at ``SIZES``, falling) passes 1, by power law."""
    above = np.flatnonzero(share >= 1.0)
    if not len(above):
        return None
    k = int(above[-1])
    if k == len(share) - 1:
        return float(SIZES[k])
    low, high = np.log(max(float(share[k + 1]), 1e-12)), np.log(float(share[k]))
    part = -low / max(high - low, 1e-12)
    return float(SIZES[k + 1] * (SIZES[k] / SIZES[k + 1]) ** part)


def _steepest(search: ForwardSelection, model: CandidateModel) -> Array:
    """Fastest change of the simulated outputs, (tracks,): a slower fall is a looser freewheel."""
    run = search.model.run(model.q, search.data)[0][: search.data.lengths[0]]
    return np.asarray(np.max(np.abs(np.diff(run, axis=0)), axis=0, initial=0.0) / search.model.dt)


def _is_limit(p: EffectParameter | ModelParameter) -> bool:
    return abs(p.null) > NO_LIMIT


def _value(p: ModelParameter, start: float, severity: float, steepest: Array) -> float:
    """An effect's size at a severity of 0 (null, or the loosest limit) to 1 (its bound)."""
    upper, tightest = p.upper, 1.05 * p.lower
    if p.of.unit == "speed/s" and p.track >= 0:  # the loosest value that means anything
        upper = float(np.clip(steepest[p.track], 2.0 * p.lower, p.upper))
    if not _is_limit(p):
        return p.null + 0.98 * severity * ((upper if start >= p.null else p.lower) - p.null)
    if upper > WIDE * p.lower:
        tightness = 1.0 + np.log(max(severity, 1e-6)) / -np.log(SIZES[-1])
        return float(upper * (tightest / upper) ** float(np.clip(tightness, 0.0, 1.0)))
    return upper - severity * (upper - tightest)


def _with(
    search: ForwardSelection,
    q: Array,
    e: Effect,
    start: Mapping[int, float],
    severity: float,
    steepest: Array,
) -> Array:
    """The model with an effect on all tracks; parameters other than its size at a start value."""
    model, moved, first = search.model, q.copy(), e.parameters[0]
    for track in model.sides(e):
        at = model.index[e.id, first.name, track]
        size = model.parameters[at]
        value = _value(size, start[at], severity, steepest)
        for p in e.parameters:
            k = model.index[e.id, p.name, track]
            other, moved[k] = model.parameters[k], value
            if p.null != first.null or p.unit != first.unit:
                moved[k] = start[k]
            elif not _is_limit(first):
                ratio = (start[k] - other.null) / (start[at] - size.null)
                moved[k] = other.null + ratio * (value - size.null)
            moved[k] = other.within(moved[k])
    return moved


def _size(search: ForwardSelection, e: Effect, severity: float, steepest: Array) -> float:
    """The size in the unit of the first parameter."""
    model, values = search.model, []
    for track in model.sides(e):
        at = model.index[e.id, e.parameters[0].name, track]
        p = model.parameters[at]
        value = _value(p, model.starts(e)[0][at], severity, steepest)
        values.append(value if _is_limit(p.of) else abs(value - p.null))
    size = float(np.mean(values))
    return max(size, MOST_SAMPLED * model.dt) if e.hints.beyond_sampling else size
