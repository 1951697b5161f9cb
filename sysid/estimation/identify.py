"""identify: from records to validated models, as ``sysid fit`` does."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sysid.criteria.table import known_name
from sysid.data.checks.signal_checks import MIN_SAMPLES
from sysid.data.facts import LogFacts
from sysid.data.finding import Finding
from sysid.data.inspection import inspect_records
from sysid.data.record import Record, names_of
from sysid.data.same_kind import require_same_kind
from sysid.errors import DataError, UsageError
from sysid.estimation.assessment.advice import notes_for
from sysid.estimation.assessment.figures import require_samples
from sysid.estimation.assessment.findings import Assessment, Policy, assess
from sysid.estimation.offsets.choice import known_policy
from sysid.estimation.pem import INSTRUMENTS
from sysid.estimation.selection.defaults import structures_for
from sysid.estimation.selection.grid import parse_grids
from sysid.estimation.selection.ranking import Entry
from sysid.estimation.selection.residual_check import valid_first
from sysid.estimation.selection.select_structure import select_structure
from sysid.estimation.soundness import undetermined
from sysid.estimation.two_stage import STAGES
from sysid.fitting.marquardt import Method
from sysid.fitting.options import FitOptions
from sysid.structures.model import Model
from sysid.structures.orders import orders_text
from sysid.structures.own_names import options_in_generic_names
from sysid.structures.registry import structure_class

SHOWN_CANDIDATES = 10


@dataclass(frozen=True)
class Request:
    """What is to be identified and how.

    Attributes:
        structures: names; empty for the default ones (``usual_orders`` adds by the data).
        orders: text such as ``na=2 nb=2 nk=1`` or ``na=1:4 nb=1:4 nk=1``; None to search.
        detrend: what is done about levels, one of ``offsets.choice.POLICIES``.
        criterion: what ranks orders and structures.
        split: share of each record used for estimation, None for all of it.
    """

    structures: tuple[str, ...] = ()
    orders: str | None = None
    options: FitOptions = field(default_factory=FitOptions)
    detrend: str = "auto"
    criterion: str = "fit"
    split: float | None = None
    policy: Policy = field(default_factory=Policy)
    jobs: int = 1


@dataclass(frozen=True, eq=False)
class Identification:
    """Judged models, the winner first, why it is ahead, what could not be fitted, and what the
    checks of the estimation data found.
    """

    assessments: tuple[Assessment, ...]
    reason: str
    failed: Mapping[str, str]
    estimation: tuple[Record, ...]
    validation: tuple[Record, ...]
    findings: tuple[Finding, ...] = ()


def identify(
    data: Sequence[Record] | LogFacts,
    validation: Sequence[Record],
    request: Request,
    progress: Callable[[float, str], None] | None = None,
    inspect: bool = False,
) -> Identification:
    """Choose orders and structures on the estimation data, fit them, and judge them.

    Validation data are only looked at by the figures; they never choose anything.

    Args:
        data: all records of the estimation logs, or what is known of them.
        validation: records of separate validation logs, may be empty.
        progress: called with (share done, what).
        inspect: whether the data are inspected, and what matters to a model said with it. With
            orders given, the one slow check is left to the residual tests of the fit.

    Raises:
        DataError: the data cannot serve.
        UsageError: the request contradicts itself or the data.
    """
    facts = LogFacts.of(data)
    records = facts.records
    require_same_kind(validation, records[0])
    require_unseen(records, validation)
    inside, outside, labels = _parts(records, validation, request.split)
    for part in filter(None, (inside, outside)):
        require_samples(part, request.policy.skip)
    require_enough(inside, outside, request.split)
    if request.split is not None:
        facts = LogFacts(inside, facts.reading)
    known_policy(request.detrend)
    findings = inspect_records(facts, nonlinearity=request.orders is None) if inspect else ()
    names = structures_for(request.structures, records[0].input_names)
    _require_search(names, request.options)
    grids = None if request.orders is None else parse_grids(request.orders, names)
    request = replace(request, criterion=known_name(request.criterion))
    options = replace(
        request.options,
        structure_options=options_in_generic_names(
            request.options.structure_options, inside[0].inputs, inside[0].outputs
        ),
        extra={
            **request.options.extra,
            "detrend": request.detrend,
            "split": request.split,
            "criterion": request.criterion,
        },
    )
    contest = select_structure(
        request.structures if grids is None else names,
        facts,
        options,
        request.detrend,
        grid=grids,
        criterion=request.criterion,
        jobs=request.jobs,
        progress=progress,
    )
    judged = tuple(
        assess(
            _as_known(entry.model, facts, request, inspect),
            (inside, labels[0]),
            (outside, labels[1]) if outside else None,
            request.policy,
            entry.seconds,
            _searched(entry),
            (*notes_for(entry.model.structure, findings), *entry.notes),
            criteria,
        )
        for entry, criteria in contest.with_criteria(inside)
    )
    leads = valid_first(judged, contest.reason, request.criterion, names)
    return Identification(*leads, contest.failed, inside, outside, tuple(findings))


def _as_known(model: Model, facts: LogFacts, request: Request, inspect: bool) -> Model:
    """The model, without errors where a controller alone moves the input, or may do so.

    A fit with given orders does not wait for that unless feedback is looked for; who gives a delay
    of 0 says that the plant passes on its input within the sample, which a log does not show.
    """
    if request.orders is not None and not inspect:
        return model
    laws = facts.laws_alone
    passes_on = request.orders is not None and model.structure.order_values().get("nk") == 0
    sure = any(t.seen for t in laws)
    return undetermined(model) if laws and (sure or not passes_on) else model


def _require_search(names: Sequence[str], options: FitOptions) -> None:
    usual = replace(options, method=Method.LEVENBERG_MARQUARDT, extra={})
    if options.method in (usual.method, *INSTRUMENTS, *STAGES) or usual != FitOptions():
        return
    if all(structure_class(n).traits.solved_at_once for n in names):
        raise UsageError(
            f"{', '.join(names)} is solved in closed form, without a search; omit `method`, or fit "
            "with `focus='simulation'`"
        )


def _parts(
    records: Sequence[Record], validation: Sequence[Record], split: float | None
) -> tuple[tuple[Record, ...], tuple[Record, ...], tuple[str, str]]:
    names = names_of(records)
    if split is None:
        validation_names = names_of(validation)
        return tuple(records), tuple(validation), (names, validation_names)
    if validation:
        raise UsageError("give either `validation` or `split`, not both")
    if not 0.0 < split < 1.0:
        raise UsageError(f"`split` is the share to fit on, between 0 and 1, got {split:g}")
    pairs = [r.split(split) for r in records]
    share = 100.0 * split
    labels = (f"{names}, first {share:g} %", f"{names}, last {100.0 - share:g} %")
    return tuple(a for a, _ in pairs), tuple(b for _, b in pairs), labels


def _searched(entry: Entry) -> dict[str, Any]:
    if entry.search is None:
        return {}
    return {
        "criterion": entry.search.criterion,
        "tried": len(entry.search.candidates),
        "candidates": [
            {"orders": orders_text(c.orders), "n": c.n, "score": c.score, "stable": c.stable}
            for c in entry.search.candidates[:SHOWN_CANDIDATES]
        ],
    }


def require_enough(
    inside: Sequence[Record], outside: Sequence[Record], split: float | None
) -> None:
    """Refuse a split that leaves one of its parts too short to fit on or to judge on."""
    if split is None:
        return
    parts = ((sum(map(len, inside)), "fit on"), (sum(map(len, outside)), "judge on"))
    for samples, what in parts:
        if samples < MIN_SAMPLES:
            raise DataError(
                f"a split at {split:g} of {sum(n for n, _ in parts)} samples leaves {samples} to "
                f"{what}, at least {MIN_SAMPLES} are needed; split elsewhere or record longer"
            )


def _overlap(a: Record, b: Record) -> bool:
    half = 0.5 * min(a.dt, b.dt)
    return bool(max(a.t0, b.t0) <= min(a.t[-1], b.t[-1]) + half)


def shares_samples(a: Record, b: Record) -> bool:
    """Whether two records hold the same samples; two stretches of one log may judge each other."""
    same_file = bool(a.sha256) and a.sha256 == b.sha256 and _overlap(a, b)
    return same_file or (np.array_equal(a.u, b.u) and np.array_equal(a.y, b.y))


def require_unseen(records: Sequence[Record], validation: Sequence[Record]) -> None:
    """Refuse validation records that are estimation records too, whatever the file names."""
    for r in validation:
        for e in records:
            if shares_samples(r, e):
                called = r.name if r.name == e.name else f"{r.name} (the same as {e.name})"
                raise UsageError(
                    f"{called} is estimation data; the validation log must differ: give another "
                    "log, or hold out a part of this one with `split=0.7`"
                )
