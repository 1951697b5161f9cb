"""Robust fits: detect outliers by the model, leave them out, and fit again."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.fitting.options import FitOptions
from sysid.fitting.outliers import Outliers, find_outliers
from sysid.fitting.problem import Parameter
from sysid.fitting.robust import huber_pays
from sysid.fitting.searchable import InitialGuesses
from sysid.methods.method import Fitter
from sysid.methods.outcome import FitOutcome
from sysid.methods.table import method_of
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.motion import initial_state_window

ROUNDS = 4
"""Fits at most. Outliers are detected ever better as the model becomes free of them; from one
round to the next only a per cent of the data changes, so that few rounds settle it."""

WHOLE_ROUNDS = 2
"""Of these the fits that choose orders, statics and the like anew: before the outliers are left out
and after it."""

SETTLED = 0.05
"""Share of the outliers that may still change from round to round: those near the threshold do no
harm on either side of it."""

SAME = 0.02
"""Change of the replaced measurements, root mean square over the size at which an error stands out,
up to which they are the same: a twelfth of a standard deviation, in two samples of a hundred."""

RANKING_ROUNDS = 2
"""Fits of a candidate that is only ranked."""


def fitter(structure: Structure, options: FitOptions) -> Fitter:
    """The way to fit this structure: its own, or around it the search for outliers."""
    return without_outliers if options.robust else method_of(structure).fit


def without_outliers(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Fit with Huber's loss, leave out what stands out of the model's errors, and fit again.

    Huber's loss bounds what a large error does, but not what a bad measurement does among the past
    outputs from which others are predicted; so bad measurements are found, replaced by what the
    model predicts there, and searched for again with the better model until nothing changes. Where
    what is left has no heavy tail, least squares fits it better: data without outliers are fitted
    as without this search.

    Args:
        records: experiments, offsets removed.
        parameters: names, bounds and fixed values.

    Returns:
        The fit, with what was left out of each record.
    """
    road = method_of(structure).fit
    used = tuple(records)
    known: tuple[Outliers, ...] = ()
    ranked = options.patience is not None
    rounds = RANKING_ROUNDS if ranked else ROUNDS
    for k in range(rounds):
        if k < WHOLE_ROUNDS:
            outcome = road(structure, used, options, parameters, initial_guesses)
        else:
            outcome = refit(road, outcome, used, options, parameters)
        s, theta = outcome.structure, outcome.theta
        outliers = tuple(outliers_of(s, theta, r, initial_state_window(s, theta)) for r in records)
        marked = tuple(f.marked(r) for f, r in zip(outliers, records, strict=True))
        known = known or tuple(f.none() for f in outliers)
        bounded = options.robust and (
            ranked or not method_of(s).has_losses or _heavy_tailed(outcome, marked)
        )
        if k == rounds - 1 or (_settled(outliers, known) and bounded == options.robust):
            break
        known, used, options = outliers, marked, replace(options, robust=bounded)
    notes = (*outcome.warnings, *_words(known, records))
    return replace(outcome, warnings=notes, outliers=known)


def _heavy_tailed(outcome: FitOutcome, records: Sequence[Record]) -> bool:
    s, theta = outcome.structure, outcome.theta
    errors = [s.errors(theta, r.u, r.y, initial_state_window(s, theta)) for r in records]
    kept = [np.where(r.fitted, e, np.nan) for e, r in zip(errors, records, strict=True)]
    return huber_pays(np.concatenate(kept))


def refit(
    fitted: Fitter,
    before: FitOutcome,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
) -> FitOutcome:
    """Fit what a fit found to nearly the same data: nothing is chosen anew where that is costly."""
    refitter = method_of(before.structure).refit
    if refitter is None:
        start = [("the fit before", before.theta)]
        return fitted(before.structure, records, options, parameters, start)
    return refitter(before, records, options, parameters)


def _settled(outliers: Sequence[Outliers], known: Sequence[Outliers]) -> bool:
    """Whether two searches came to the same outliers and replaced them by the same values."""
    moved = [
        ((a.change - b.change) / a.limits)[a.bad_measurements & b.bad_measurements]
        for a, b in zip(outliers, known, strict=True)
    ]
    if np.sum(np.concatenate(moved) ** 2) > SAME**2 * sum(len(m) for m in moved):
        return False
    changed = sum(
        int(np.sum((a.found != b.found) | (a.bad_measurements != b.bad_measurements)))
        for a, b in zip(outliers, known, strict=True)
    )
    return changed <= SETTLED * sum(int(np.sum(b.found)) for b in known)


def outliers_of(structure: Structure, theta: Array, record: Record, window: int) -> Outliers:
    """What stands out of a model's one-step prediction errors on a record."""

    def errors(y: Array) -> Array:
        return structure.errors(theta, record.u, y, window)

    return find_outliers(errors, record, structure.first_sample())


def bounded_errors(errors: Array, outliers: Outliers) -> Array:
    """Errors in which outliers count with the size at which they begin to stand out, (N, ny).

    So every model is judged on the same samples, and one that calls more of them outliers gains
    nothing by it.
    """
    return np.where(outliers.found & np.isfinite(errors), outliers.limits, errors)


def _words(outliers: Sequence[Outliers], records: Sequence[Record]) -> list[str]:
    sentences = []
    for i, channel in enumerate(records[0].outputs):
        measurements = sum(int(np.sum(f.bad_measurements[:, i])) for f in outliers)
        disturbances = sum(int(np.sum(f.disturbances[:, i])) for f in outliers)
        parts = [
            f"{count} {word if count == 1 else word + 's'}"
            for count, word in (
                (measurements, "outlying measurement"),
                (disturbances, "disturbance"),
            )
            if count
        ]
        if parts:
            was = "was" if measurements + disturbances == 1 else "were"
            sentences.append(
                f"{' and '.join(parts)} of {channel.name} {was} left out of the fit "
                "and its figures."
            )
    doubtful = sum(f.doubtful for f in outliers)
    if doubtful:
        sentences.append(
            f"{doubtful} further large errors are at special inputs or outputs, or too frequent "
            "for outliers: they count as errors of the model and were kept."
        )
    return sentences


# Judging ---------------------------------------------------------------------------------------


def is_robust(model: Model) -> bool:
    """Whether the model was fitted with outliers left out."""
    return model.provenance.options.get("loss") == "huber"


def judged(model: Model, records: Sequence[Record]) -> tuple[Record, ...]:
    """The records as a model is to be judged on them.

    For a model that was fitted robustly bad measurements are replaced by what it predicts there,
    since predictions start from them, and they and the samples of disturbances have weight zero.
    All other records come back as they are, and those whose outliers are known already.
    """
    if not is_robust(model):
        return tuple(records)
    return tuple(r if r.weights is not None else _outliers(model, r).marked(r) for r in records)


def judged_errors(model: Model, records: Sequence[Record]) -> list[Array]:
    """One-step prediction errors (N, ny) from which criteria are computed, by record.

    Outliers of a robustly fitted model count with the size at which an error begins to stand out,
    so that all models are judged on the same samples.
    """
    for r in records:
        model.check(r)
    plain = [model.detrend.remove(r) for r in records]
    return counted_errors(model.structure, model.theta, plain, is_robust(model))


def counted_errors(
    structure: Structure, theta: Array, records: Sequence[Record], robust: bool
) -> list[Array]:
    """One-step prediction errors (N, ny) of records without offsets; outliers bounded if robust."""
    window, errors = initial_state_window(structure, theta), []
    for r in records:
        found = outliers_of(structure, theta, r, window) if robust else None
        y = r.y if found is None else found.marked(r).y
        e = structure.errors(theta, r.u, y, window)
        errors.append(e if found is None else bounded_errors(e, found))
    return errors


def _outliers(model: Model, record: Record) -> Outliers:
    model.check(record)
    window = initial_state_window(model.structure, model.theta)
    return outliers_of(model.structure, model.theta, model.detrend.remove(record), window)
