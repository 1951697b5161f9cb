"""Block cross-validation: each structure fitted and validated on rotating blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Record
from sysid.errors import DataError, SysidError, UsageError
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.pem import fit
from sysid.estimation.robust_fit import judged
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus, Initial
from sysid.methods.table import method_of
from sysid.structures.model import Model

SHORTEST_BLOCK = 20


@dataclass(frozen=True)
class CrossValidation:
    """Free-run errors of one structure over the folds.

    Attributes:
        fit_percent: per output, of all held-out blocks together.
        rmse: per output, in the output's unit.
        spread: per output, standard deviation of the folds' RMSE.
        failed: folds in which the structure could not be fitted.
    """

    folds: int
    fit_percent: Mapping[str, float]
    rmse: Mapping[str, float]
    spread: Mapping[str, float]
    failed: int


def cross_validate(
    model: Model, records: Sequence[Record], folds: int = 5, options: FitOptions | None = None
) -> CrossValidation:
    """Refit the model's structure with its orders on all blocks but one, free-run on that one.

    Every record is cut into ``folds`` contiguous blocks; block k of all records is held out in
    fold k, and the free run on it starts from a state fitted to its own head (Stone 1974; blocks
    instead of single samples because neighbours in time are not independent).

    Args:
        model: gives structure, orders and offsets.
        folds: number of blocks, at least 2.
        options: how to fit; as the model itself was, unless given.

    Raises:
        UsageError: fewer than 2 folds.
        DataError: the blocks are too short.
    """
    if folds < 2:
        raise UsageError(f"cross-validation needs at least 2 folds, got {folds}")
    if min(len(r) for r in records) < folds * SHORTEST_BLOCK:
        raise DataError(
            f"{records[0].name}: {folds} folds leave blocks under {SHORTEST_BLOCK} samples; use "
            "fewer folds or a longer log"
        )
    offsets = (
        Offsets.refit(model.detrend, model.operating_point, len(model.outputs))
        if model.operating_point.estimated
        else model.detrend
    )
    options = options or options_of(model)
    # a structure without starting values of its own begins at the model's: what the held-out block
    # shows is where a search begins, not where it ends
    initial_guesses = (
        [("all data", model.theta)] if method_of(model.structure).begins_at_values else []
    )
    squares, counts, failed = [], [], 0
    total = np.zeros(len(model.outputs))
    for k in range(folds):
        inside, holdout = _fold(records, folds, k)
        try:
            refit = fit(
                model.structure, inside, options, detrend=offsets, initial_guesses=initial_guesses
            )
        except SysidError:
            failed += 1
            continue
        holdout = judged(refit, holdout)
        runs = [outputs(refit, r, None, Start.ESTIMATED)[r.counted] for r in holdout]
        measured = [r.y[r.counted] for r in holdout]
        square = np.sum([np.sum((m - y) ** 2, 0) for m, y in zip(measured, runs, strict=True)], 0)
        squares.append(square)
        counts.append(sum(len(m) for m in measured))
        total += np.sum([np.sum((m - m.mean(0)) ** 2, 0) for m in measured], 0)
    if not squares:
        raise DataError(f"{model.structure.name} could not be fitted in any of {folds} folds")
    square, count = np.sum(squares, 0), int(np.sum(counts))
    each = np.sqrt(np.array(squares) / np.array(counts)[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 100.0 * (1.0 - np.sqrt(square / total))
    names = [c.name for c in model.outputs]
    return CrossValidation(
        folds,
        dict(zip(names, share.tolist(), strict=True)),
        dict(zip(names, np.sqrt(square / count).tolist(), strict=True)),
        dict(zip(names, each.std(axis=0).tolist(), strict=True)),
        failed,
    )


def options_of(model: Model) -> FitOptions:
    """How a model was fitted, as far as it says: focus, states, loss, stability, held values.

    Bounds are those of its parameters that differ from its structure's own.
    """
    recorded = model.provenance.options
    defaults = model.structure.parameters(model.inputs, model.outputs)
    default_limits = {p.name: (p.lower, p.upper, p.fixed) for p in defaults}
    fixed, bounds = {}, {}
    for p in model.parameters:
        lower, upper, default_fixed = default_limits.get(p.name, (p.lower, p.upper, p.fixed))
        if p.fixed is not None and default_fixed is None:
            fixed[p.name] = p.fixed
        elif (p.lower, p.upper) != (lower, upper):
            bounds[p.name] = (p.lower, p.upper)
    return FitOptions(
        focus=Focus(recorded.get("focus", Focus.PREDICTION.value)),
        initial=Initial(recorded.get("initial", Initial.AUTO.value)),
        robust=recorded.get("loss") == "huber",
        stable=bool(recorded.get("stable", False)),
        fixed=fixed,
        bounds=bounds,
    )


def _fold(
    records: Sequence[Record], folds: int, k: int
) -> tuple[tuple[Record, ...], tuple[Record, ...]]:
    inside: list[Record] = []
    holdout: list[Record] = []
    for r in records:
        edges = [round(j * len(r) / folds) for j in range(folds + 1)]
        holdout.append(r.rows(edges[k], edges[k + 1]))
        if edges[k] > 0:
            inside.append(r.rows(0, edges[k]))
        if edges[k + 1] < len(r):
            inside.append(r.rows(edges[k + 1], len(r)))
    return tuple(inside), tuple(holdout)
