"""A diagnosis without a search, of a robot log made here: for tests of what shows a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from command_line import write_log

from sysid.criteria.information import information_criteria
from sysid.data.preprocess import Detrend
from sysid.data.record import PWM_FULL_SCALE, Array, Channel, Record
from sysid.data.same_kind import require_same_kind
from sysid.diagnosis.diagnose import require_apart
from sysid.diagnosis.diagnosis import Diagnosis, Experiment, NamedEffect, Trace, Value
from sysid.diagnosis.gap import measure_gap
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.validation.localise import localise
from sysid.diagnosis.validation.model_error import ResidualVerdict
from sysid.errors import Termination
from sysid.report.page import Page
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model, Provenance, Source

CREEP = ((0.0, 0.0, 0.0), (1.0, 2000.0, 2000.0), (2.0, 0.0, 0.0))
GAIN, POLE, ZONE, NOISE, DT = (20.0, 18.0), 0.85, 0.2, 0.1, 0.05


def dead_zone_log(path: Path, samples: int = 600, seed: int = 1) -> Path:
    """A log of two first-order tracks behind a dead zone of 0.2 of full drive."""
    rng = np.random.default_rng(seed)
    pwm = np.repeat(rng.integers(-16, 17, size=(samples // 15 + 1, 2)), 15, axis=0)[:samples]
    u: Array = 1000.0 * pwm.astype(np.float64)
    y = _model(("dead-zone",), u, GAIN).simulate(u) + NOISE * rng.standard_normal((samples, 2))
    names = ["pwm_l", "pwm_r", "omega_l", "omega_r"]
    return write_log(path, names, [*u.T, *y.T], DT)


def diagnose(
    estimation: Sequence[Record],
    held: Sequence[Record] | None,
    *,
    model: Model | None = None,
    mission: Path | None = None,
    geometry: Any = None,
    plant: Any = None,
    measured: Any = None,
    progress: Callable[[str, float], None] | None = None,
    seed: int = 0,
) -> Diagnosis:
    """What the engine would say of such a log: a dead zone, with its true numbers."""
    require_apart(estimation, held or ())
    require_same_kind((*estimation[1:], *(held or ())), estimation[0])
    if progress:
        progress("looking", 0.5)
    if held is None:
        estimation, held = (
            [r.rows(0, 2 * len(r) // 3) for r in estimation],
            [r.rows(2 * len(r) // 3, len(r)) for r in estimation],
        )
    first = estimation[0]
    u, y = first.u / PWM_FULL_SCALE, first.y
    plain = tuple(float(d @ w / (d @ d)) for d, w in zip(u.T, y.T, strict=True))
    before = model or _model((), first.u, plain, estimation)
    after = _model(("dead-zone",), first.u, GAIN, estimation)
    traces = [
        Trace(r, before.simulate(r.u), after.simulate(r.u), role, np.ones(len(r)))
        for role, records in (("estimation", estimation), ("held-out", held))
        for r in records
    ]
    proof = [t for t in traces if t.role == "held-out"]
    olds, news = [t.record.y - t.before for t in proof], [t.record.y - t.after for t in proof]
    floor, scales = np.full(2, NOISE), np.full(2, PWM_FULL_SCALE)
    records = [t.record for t in proof]
    return Diagnosis(
        verdict="effects-found",
        story="The error depends on the command, and one effect explains it.",
        base_words="per track its own command, first order, one sample of delay, no offset",
        effects=(_dead_zone(first.output_names),),
        minor=("sensor-lag",),
        candidates=(("dead-zone", 0.9), ("stiction", 0.89), ("concave-gain", 0.3)),
        where=localise(records, olds, floor, scales),
        where_after=localise(records, news, floor, scales),
        gap=measure_gap(olds, news, floor, np.ones(2), first.output_names),
        detectable={"dead-zone": 0.01, "backlash": None},
        next_experiments=_experiments(first.input_names),
        before=before,
        after=after,
        residuals=(ResidualVerdict("before", 1e-12, 0.8), ResidualVerdict("after", 0.4, 0.01)),
        warnings=("gain[omega_l] moved by 40 standard errors: it had absorbed the dead zone.",),
        traces=tuple(traces),
        seconds=1.0,
    )  # fmt: skip


def _dead_zone(outputs: tuple[str, ...]) -> NamedEffect:
    values = tuple(
        Value(f"{n}[{output}]", ZONE, 0.001, "drive")
        for n in ("plus", "minus")
        for output in outputs
    )
    return NamedEffect(
        "dead-zone", "actuator", outputs, values, Evidence(-900.0, 9.0, 1.0, 0.1, 1e-9),
        ("stiction",), "Below 20 % of full drive nothing moves.",
    )  # fmt: skip


def _experiments(inputs: Sequence[str]) -> tuple[Experiment, ...]:
    creep = "Rest, then creep up through the threshold."
    return (
        Experiment(creep, ("dead-zone", "stiction"), ("t", *inputs), CREEP),
        Experiment("Drive against a wall, by hand.", ("backlash",), (), ()),
    )


def nothing(estimation: Sequence[Record], held: Sequence[Record] | None, **facts: Any) -> Diagnosis:
    """What the engine would say of a log from which nothing is missing."""
    found = diagnose(estimation, held, **facts)
    same = tuple(replace(t, after=t.before) for t in found.traces)
    errors = [t.record.y - t.before for t in same if t.role == "held-out"]
    names = estimation[0].output_names
    return replace(
        found,
        verdict="no-missing-effect",
        story="The errors look like noise.",
        effects=(),
        minor=(),
        candidates=(),
        where=(),
        where_after=(),
        gap=measure_gap(errors, errors, np.full(2, NOISE), np.ones(2), names),
        next_experiments=(),
        after=found.before,
        residuals=(ResidualVerdict("before", 0.5, 0.0),),
        warnings=(),
        traces=same,
    )


def unexplained(
    estimation: Sequence[Record], held: Sequence[Record] | None, **facts: Any
) -> Diagnosis:
    """What the engine would say where no effect of the catalogue fits."""
    found = nothing(estimation, held, **facts)
    full = diagnose(estimation, held, **facts)
    return replace(
        found,
        verdict="unexplained",
        story="The error depends on the command, but no effect explains it.",
        where=full.where,
        candidates=full.candidates,
        description="residual = 0.3 sin(pwm_l) - 0.1 omega_l^2",
    )


def _model(
    effects: tuple[str, ...], u: Array, gains: Sequence[float], records: Sequence[Record] = ()
) -> Model:
    structure = Augmented(1, 1, (PWM_FULL_SCALE, PWM_FULL_SCALE), DT, effects)
    inputs = tuple(Channel(n, "µs") for n in ("pwm_l", "pwm_r"))
    outputs = tuple(Channel(n, "rad/s") for n in ("omega_l", "omega_r"))
    core = [v for g in gains for v in (g, -POLE)]
    theta = np.array([*core, *((ZONE, ZONE, 0.0) * 2 if effects else ())])
    sources = tuple(Source(r.name, r.sha256, r.t0, len(r)) for r in records)
    return Model(
        structure=structure,
        theta=theta,
        covariance=np.diag(np.full(len(theta), 1e-6)),
        parameters=structure.parameters(inputs, outputs),
        dt=DT,
        inputs=inputs,
        outputs=outputs,
        detrend=Detrend.none(2, 2),
        noise_covariance=NOISE**2 * np.eye(2),
        n_estimated=len(theta),
        criteria=information_criteria([np.full((100, 2), NOISE)], len(theta)),
        termination=Termination.CONVERGED_COST,
        ranges=np.array([(-16000.0, 16000.0)] * 2 + [(-20.0, 20.0)] * 2),
        provenance=Provenance(sources, {"made_by": "diagnose"}, "test"),
    )


def no_page(*_: object) -> Page:
    """An empty page, for tests that look at something else: pictures take a second."""
    return Page("", "", (), ())
