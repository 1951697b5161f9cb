"""Fits of each log alone: its own core and its own parameters of the effects found in all logs.

Every log is fitted by itself from where all together ended; its standard errors are those of its
own errors. What the logs share, and where one of them says otherwise, is for ``constancy``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.policies import BUDGET
from sysid.diagnosis.search.batched_search import information, search
from sysid.diagnosis.search.evidence import effective_samples
from sysid.diagnosis.search.prepared import Data
from sysid.diagnosis.search.selection import CandidateModel, Selection
from sysid.effects.by_log import BY_LOG, LOAD_BY_LOG, parameter_of_log

STEPS = 8
"""Of the fit of one log: it begins at the optimum of all."""

REACH = 2.0
"""So many standard errors away the likelihood must have fallen as far as they promise."""

BEFOREHAND = 10.0
"""So many typical sizes a parameter is from where it is, before the log is looked at."""

CERTAIN = 0.95

UNKNOWN_ABOVE = 3.0
"""A parameter whose standard error is more of its typical size is not determined by the log."""


@dataclass(frozen=True, eq=False)
class LogFit:
    """What one log says alone.

    Attributes:
        std_errors: of the free parameters that the log determines, by index.
        rms: free-run error of each output with all effects, parameters of all logs.
        lacks: effects that the log alone does as well without, by their own parameters at null.
    """

    log: int
    q: Array
    std_errors: Mapping[int, float]
    rms: Array
    without: Mapping[str, Array]
    lacks: frozenset[str] = frozenset()


def fits_of_logs(base: Base, selection: Selection) -> tuple[LogFit, ...]:
    """The fit of each log by itself around the model of all."""
    logs, model, fits = base.search.logs, base.search.model, []
    for k in range(len(logs.names)):
        data = _data_of(base, k)
        models = (selection.final, *(n.rest for n in selection.selected))
        rows = np.array([m.q for m in models])
        if k in logs.validation:  # it has its own gain and load
            rows = np.array([base.search.in_phase(m.q, m.effects) for m in models])
        rms = [_rms(data, run) for run in model.run(rows, data)]
        q, free = rows[0], _free(base, selection.final, k)
        while untold := _least_known(base, free, _std_errors(base, data, q, free)):
            free = tuple(i for i in free if i != untold)  # held at the value of all
        q = search(model, q[None], [free], data, STEPS, BUDGET.coarse)[0][0]
        errors = _stretched(base, data, q, _std_errors(base, data, q, free))
        known = {i: e for i, e in errors.items() if e < UNKNOWN_ABOVE * model.parameters[i].scale}
        names = [n.id for n in selection.selected]
        lacks = frozenset(name for name in names if _lacks(base, data, q, free, name))
        fits.append(LogFit(k, q, known, rms[0], dict(zip(names, rms[1:], strict=True)), lacks))
    return tuple(fits)


def _lacks(base: Base, data: Data, q: Array, free: Sequence[int], id: str) -> bool:
    """Whether the log alone is fitted as well with an effect's parameters at null.

    Parameters of one effect may cancel (the width of a dead zone and the jump at
    its edge), each away from null, and do nothing together. 2·log-likelihood is compared with χ².
    """
    from scipy.special import chdtri

    model = base.search.model
    of_effect = [k for k in model.of(id) if k in free]
    rest = [k for k in free if k not in of_effect]
    if not of_effect or not rest:
        return False
    start = q.copy()
    start[list(model.of(id))] = [model.parameters[k].null for k in model.of(id)]
    without = search(model, start[None], [rest], data, STEPS, BUDGET.coarse)[0][0]
    judged = _judged(base, data, q)
    with_effect, null = judged.squared_error(model.run(np.array([q, without]), judged)).sum(axis=1)
    return bool(null - with_effect < float(chdtri(len(of_effect), 1.0 - CERTAIN)))


def _least_known(base: Base, free: Sequence[int], errors: Mapping[int, float]) -> int | None:
    """The last effect parameter that the log does not determine beside the others, if any."""
    parameters = base.search.model.parameters
    vague = [k for k in free if not errors[k] < UNKNOWN_ABOVE * parameters[k].scale]
    return max((k for k in vague if parameters[k].owner != "core"), default=None)


def _data_of(base: Base, k: int) -> Data:
    """The rows of one log, held-out ones included; the others do not count."""
    s = base.search
    if k in s.logs.validation:
        return replace(s.holdout_data, weight=s.holdout_data.weight * (s.holdout_data.log == k))
    whole = s.data.weight
    if s.holdout == s.estimation:
        whole = np.maximum(whole, s.holdout_data.weight)
    return replace(s.data, weight=whole * (s.data.log == k))


def _free(base: Base, candidate: CandidateModel, k: int) -> tuple[int, ...]:
    """The free parameters, of those that belong to logs only the log's own load.

    Its gain is the core's.
    """
    own, every = (LOAD_BY_LOG.id, parameter_of_log(k)), base.search.model.parameters
    pairs = ((j, (every[j].owner, every[j].name)) for j in candidate.free)
    return tuple(j for j, pair in pairs if pair[0] not in BY_LOG or pair == own)


def _rms(data: Data, run: Array) -> Array:
    errors = np.where(data.weight > 0.0, data.y - run, np.nan)
    return np.asarray(np.sqrt(np.nanmean(errors**2, axis=0)))


def _judged(base: Base, data: Data, q: Array) -> Data:
    """The data in units of their errors, as coloured as these are: sums of squares are χ²."""
    run = base.search.model.run(q, data)[0]
    counted = data.weight > 0.0
    errors = np.where(counted, data.y - run, np.nan)
    count = np.maximum(counted.sum(axis=0), 1)
    variance = np.nanmean(errors**2, axis=0) * count / effective_samples([errors])
    return replace(data, weight=data.weight / np.sqrt(variance + 1e-300))


def _std_errors(base: Base, data: Data, q: Array, free: Sequence[int]) -> dict[int, float]:
    """Standard errors of parameters by gradients; large where the log does not determine them."""
    if not free:
        return {}
    model = base.search.model
    size = np.array([model.parameters[k].scale for k in free])
    precision = information(model, q, free, _judged(base, data, q)) * np.outer(size, size)
    before = np.eye(len(free)) / BEFOREHAND**2
    slopes = size * np.sqrt(np.diag(np.linalg.inv(precision + before)))
    return {k: float(e) for k, e in zip(free, slopes, strict=True)}


def _stretched(base: Base, data: Data, q: Array, errors: Mapping[int, float]) -> dict[int, float]:
    """Standard errors that hold on either side of a parameter, within its bounds.

    With the others held, χ² rises by at least ``REACH``² so many errors away.
    """
    model, rows, parameters = base.search.model, [q], []
    for k, error in errors.items():
        s = model.parameters[k]
        for value in (q[k] - REACH * error, q[k] + REACH * error):
            if s.lower <= value <= s.upper:
                row = q.copy()
                row[k] = value
                rows.append(row)
                parameters.append(k)
    runs = model.run(np.array(rows), judged := _judged(base, data, q))
    chi = judged.squared_error(runs).sum(axis=1)
    stretched = dict(errors)
    for k, rise in zip(parameters, chi[1:] - chi[0], strict=True):
        stretched[k] = max(stretched[k], errors[k] * REACH / float(np.sqrt(max(rise, 1e-9))))
    return stretched
