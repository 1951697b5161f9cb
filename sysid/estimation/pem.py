"""fit: the entry from a structure and records to a Model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.criteria.fit import complete_rows
from sysid.criteria.information import information_criteria
from sysid.data.facts import LogFacts
from sysid.data.operating_point import OperatingPoint
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.data.same_kind import require_same_kind
from sysid.errors import DataError, UsageError
from sysid.estimation.offsets.estimated_offset import FitWithOffset, fit_with_offset
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.robust_fit import bounded_errors, fitter
from sysid.estimation.two_stage import (
    STAGES,
    as_asked,
    biased_by_feedback,
    in_two_stages,
    without_feedback,
)
from sysid.fitting.marquardt import Method
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus, Initial, Parameter
from sysid.methods.method import Fitter
from sysid.methods.outcome import FitOutcome
from sysid.methods.table import method_of
from sysid.structures.base import Structure
from sysid.structures.linear.base import LinearStructure
from sysid.structures.model import Model, Provenance, Source
from sysid.structures.motion import initial_state_window
from sysid.version import __version__

INSTRUMENTS = {Method.IV4: ("arx",), Method.SRIV: ("oe", "tf")}
"""The structures that instrumental variables estimate."""


def fit(
    structure: Structure,
    data: Sequence[Record] | LogFacts,
    options: FitOptions | None = None,
    *,
    detrend: Detrend | Offsets | str = "auto",
    initial_guesses: Sequence[tuple[str, Array]] = (),
    solver: Fitter | None = None,
) -> Model:
    """Estimate a structure's parameters from one or several experiments.

    Minimises Σ ε(k, θ)² (Ljung 1999, ch. 7 and 10) from every start known for the structure. Where
    a controller would bias that and its reference is recorded, a second fit takes only what follows
    from the reference (``two_stage``).

    Args:
        data: experiments with equal channels and sample time, or what is known of them.
        options: focus, initial states, loss, constraints.
        detrend: a policy as ``sysid fit`` knows them (see ``offsets.choice.POLICIES``), offsets
            chosen before, or what to remove and to store with the model; a physical structure
            takes the records as they are.
        initial_guesses: further named starts, e.g. from a neighbouring order.
        solver: what estimates, None for the structure's own way.

    Raises:
        DataError: too few samples, a constant channel, or numbers that are not finite.
        UsageError: ``fixed`` or ``bounds`` name no parameter or contradict each other.
        ModelError: no start gives a finite cost.
    """
    options = options or FitOptions()
    facts = LogFacts.of(data)
    records = facts.records
    check_records(structure, records)
    offsets = offsets_of(structure, facts, detrend)
    parameters = constrained(structure, records[0], options)
    _check_length(structure, records, parameters)

    def estimated(seen: LogFacts) -> Model:
        """The model fitted to what is seen, its errors those on the records themselves."""
        # an offset is the coefficient of a constant input, which linear structures have
        if any(offsets.estimated) and isinstance(structure, LinearStructure):
            fitted = fit_with_offset(
                structure, seen, offsets, options, parameters, initial_guesses, solver
            )
            if fitted is not None:
                return model_with_offset(fitted, records, options)
        remove = offsets.detrend.remove
        solve = solver or fitter(structure, options)
        outcome = solve(
            structure, tuple(map(remove, seen.records)), options, parameters, initial_guesses
        )
        plain = tuple(map(remove, records))
        return model_of(outcome, records, plain, options, offsets.detrend, offsets.operating_point)

    if options.method in STAGES:
        seen = as_asked(facts, options.method)
        return in_two_stages(estimated(seen), facts, seen, options.method)
    model = estimated(facts)
    referenced = all(r.references is not None for r in records)
    if solver is not None or not referenced or not biased_by_feedback(model, facts, options):
        return model
    without = without_feedback(facts)
    return model if without is None else in_two_stages(estimated(without), facts, without)


def fit_prepared(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    initial_guesses: Sequence[tuple[str, Array]] = (),
) -> FitOutcome:
    """Fit to records from which offsets are removed already, which were checked as a whole.

    A piece of a log may hold a channel that never moves, and so does the constant of an offset.
    """
    records = tuple(records)
    parameters = constrained(structure, records[0], options)
    _check_length(structure, records, parameters)
    return fitter(structure, options)(structure, records, options, parameters, initial_guesses)


def offsets_of(structure: Structure, facts: LogFacts, detrend: Detrend | Offsets | str) -> Offsets:
    """What is removed from the records before a structure is fitted, and what is estimated."""
    if isinstance(detrend, Detrend):
        offsets = Offsets.of_detrend(detrend)
    elif isinstance(detrend, Offsets):
        offsets = detrend
    elif structure.traits.physical:
        return Offsets.none(structure.nu, structure.ny)
    else:
        # it tries models on held-out data, which are fitted here
        from sysid.estimation.offsets.choice import choose_offsets

        offsets = choose_offsets(facts, detrend)
    return offsets.for_structure(structure, facts.records)


def check_records(structure: Structure, records: Sequence[Record]) -> None:
    """Refuse records that no fit can use."""
    if not records:
        raise DataError("no record to fit; give at least one log")
    first = records[0]
    if (first.nu, first.ny) != (structure.nu, structure.ny):
        raise DataError(
            f"{first.name} has {first.nu} inputs and {first.ny} outputs but the structure has "
            f"{structure.nu} and {structure.ny}"
        )
    check_data(records)


def check_data(records: Sequence[Record]) -> None:
    """Refuse records that no structure can be fitted to."""
    first = records[0]
    require_same_kind(records, first)
    for r in records:
        for channel, values in zip((*r.inputs, *r.outputs), (*r.u.T, *r.y.T), strict=True):
            if not np.all(np.isfinite(values)):
                raise DataError(
                    f"{r.name}: {channel.name} holds numbers that are not finite; repair or cut "
                    "these samples first"
                )
    for k, channel in enumerate((*first.inputs, *first.outputs)):
        columns = [r.u[:, k] if k < r.nu else r.y[:, k - r.nu] for r in records]
        if (
            all(len(c) == 0 or np.ptp(c) == 0.0 for c in columns)
            and len({float(c[0]) for c in columns if len(c)}) < 2
        ):
            kind = "input" if k < first.nu else "output"
            raise DataError(
                f"{first.name}: {kind} {channel.name} is constant, so nothing can be "
                "identified from it; leave it out or record a run in which it varies"
            )


def constrained(structure: Structure, record: Record, options: FitOptions) -> tuple[Parameter, ...]:
    """The structure's parameters with the user's bounds and fixed values."""
    if not structure.traits.takes_inputs and options.focus is Focus.SIMULATION:
        raise UsageError(
            f"{structure.name} has no input, so that its free run from rest stays at zero; fit it "
            "with the focus on prediction"
        )
    _require_method(structure, options)
    parameters = structure.parameters(record.inputs, record.outputs)
    names = [p.name for p in parameters]
    for name in (*options.fixed, *options.bounds):
        if name not in names:
            raise UsageError(
                f"{structure.name} has no parameter {name!r}; its parameters are "
                + ", ".join(names[:12])
                + (" …" if len(names) > 12 else "")
            )
    constrained = []
    for p in parameters:
        low, high = options.bounds.get(p.name, (p.lower, p.upper))
        if not low < high:
            raise UsageError(f"the bounds of {p.name} are empty: {low:g} is not below {high:g}")
        value = options.fixed.get(p.name)
        if value is not None and not low <= value <= high:
            raise UsageError(f"{p.name} is fixed at {value:g}, outside its bounds {low:g}…{high:g}")
        constrained.append(replace(p, lower=low, upper=high, fixed=value))
    return tuple(constrained)


def _require_method(structure: Structure, options: FitOptions) -> None:
    """Refuse a method that does not fit a structure."""
    if options.method is not Method.LEVENBERG_MARQUARDT and not method_of(structure).takes_method:
        raise UsageError(
            f"{structure.name} has a search of its own, on which `method` does not act; omit "
            "`method`, or choose another structure"
        )
    method, able = options.method.value, INSTRUMENTS.get(options.method, (structure.name,))
    if structure.name not in able:
        raise UsageError(
            f"`method='{method}'` fits {' and '.join(able)}, not {structure.name}: omit `method`, "
            f"or fit {' or '.join(able)} alone"
        )
    traits = structure.traits
    if options.method in STAGES and not (traits.linear and traits.takes_inputs):
        raise UsageError(
            f"`method='{method}'` fits linear structures with inputs, not {structure.name}: omit "
            "`method`, or fit another structure"
        )
    if options.method is Method.SRIV and options.robust:
        raise UsageError("`method='sriv'` knows no `robust`: omit one of them")


def _check_length(
    structure: Structure, records: Sequence[Record], parameters: Sequence[Parameter]
) -> None:
    first = structure.first_sample()
    for r in records:
        if len(r) <= first:
            raise DataError(
                f"{r.name}: none of its {len(r)} samples can be predicted with these orders, the "
                f"first one that can is number {first + 1}; leave it out or lower the orders"
            )
    usable = sum(len(r) - first for r in records)
    per_output = len(parameters) / max(structure.ny, 1)
    if usable <= per_output + 1:
        total = sum(len(r) for r in records)
        raise DataError(
            f"{records[0].name}: {total} samples leave {usable} equations for about "
            f"{per_output:.0f} parameters an output; record more or lower the orders"
        )


def _ranges(records: Sequence[Record]) -> Array:
    channels = [(*r.u.T, *r.y.T) for r in records]
    lows = np.min([[c.min() for c in columns] for columns in channels], axis=0)
    highs = np.max([[c.max() for c in columns] for columns in channels], axis=0)
    return np.column_stack([lows, highs])


def model_with_offset(
    fitted: FitWithOffset, records: Sequence[Record], options: FitOptions
) -> Model:
    """The model that a fit with an estimated offset stands for."""
    plain = tuple(fitted.at_fit.remove(r) for r in records)
    return model_of(fitted.outcome, records, plain, options, fitted.detrend, fitted.operating_point)


def model_of(
    outcome: FitOutcome,
    records: Sequence[Record],
    plain: Sequence[Record],
    options: FitOptions,
    detrend: Detrend,
    operating_point: OperatingPoint,
) -> Model:
    """The model that an outcome stands for.

    Args:
        records, plain: the data, as read and without their offsets.
        detrend, operating_point: the offsets, and what they are.
    """
    structure, theta, parameters = outcome.structure, outcome.theta, outcome.parameters
    n_states = outcome.n_states
    n_estimated = sum(p.fixed is None for p in parameters) + operating_point.estimated + n_states
    # the errors that were minimised: from rest, or from states fitted to the whole record
    own_states = n_states > 0 or options.initial is Initial.BACKCAST
    outliers = outcome.outliers
    if outliers:
        plain = [o.marked(r) for o, r in zip(outliers, plain, strict=True)]
        records = [o.marked(r) for o, r in zip(outliers, records, strict=True)]
    errors = [structure.errors(theta, r.u, r.y, len(r) if own_states else 0) for r in plain]
    judged = errors
    if outliers:
        judged = [bounded_errors(*pair) for pair in zip(errors, outliers, strict=True)]
    criteria = information_criteria(judged, n_estimated)
    first = records[0]
    names = [p.name for p in parameters]
    window = initial_state_window(structure, theta)
    return Model(
        structure=structure,
        theta=theta,
        covariance=outcome.covariance,
        determined=outcome.determined,
        parameters=parameters,
        dt=first.dt,
        inputs=first.inputs,
        outputs=first.outputs,
        detrend=detrend,
        operating_point=operating_point,
        noise_covariance=_noise_covariance(errors, plain),
        n_estimated=n_estimated,
        criteria=criteria,
        termination=outcome.termination,
        initial_states=tuple(
            structure.fitted_state(theta, r.u, r.y, window) for r in map(detrend.remove, records)
        ),
        ranges=_ranges(records),
        at_bound=outcome.at_bound,
        null_directions=tuple(
            {names[k]: float(v) for k, v in enumerate(column) if abs(v) > 1e-3}
            for column in outcome.null.T
        ),
        starts=outcome.starts,
        warnings=outcome.warnings,
        provenance=_provenance(outcome, records, options),
    )


def _noise_covariance(errors: Sequence[Array], records: Sequence[Record]) -> Array:
    """EᵀE/N of the errors that count fully and are finite, (ny, ny)."""
    whole = [
        e if r.weights is None else e[r.ordinary] for e, r in zip(errors, records, strict=True)
    ]
    joint = complete_rows(whole)
    total = joint.T @ joint
    if not np.all(np.isfinite(total)):
        joint = joint[np.all(np.isfinite(joint), axis=1)]
        total = joint.T @ joint
    return np.asarray(total / len(joint))


def _provenance(outcome: FitOutcome, records: Sequence[Record], options: FitOptions) -> Provenance:
    return Provenance(
        tuple(Source(r.name, r.sha256, r.t0, len(r)) for r in records),
        {
            "focus": options.focus.value,
            "initial": options.initial.value,
            "loss": "huber" if options.robust else "quadratic",
            "stable": options.stable,
            "method": options.method.value,
            "left_out": int(sum(np.sum(o.found) for o in outcome.outliers)),
            "initial_states_estimated": outcome.n_states,
            **options.extra,
        },
        __version__,
    )
