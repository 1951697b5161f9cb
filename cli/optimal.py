"""``sysid excite optimal``: the input that shows a model's parameters best."""

from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from . import render

if TYPE_CHECKING:
    from sysid.data.excitation import Schedule, with_rests
    from sysid.data.record import Array
    from sysid.estimation.information.optimal_input import Limits
    from sysid.estimation.information.subject import Subject
    from sysid.workspace.store import StoredModel

OPTIONS = ("duration", "amplitude", "offset", "seed")
LONGEST = 20_000
"""Samples of a design: the search runs the plant some two thousand times."""


def designed(stored: "StoredModel", options: dict[str, Any]) -> "tuple[Schedule, dict[str, Any]]":
    """The schedule, and which errors it promises beside those of the model's log."""
    import numpy as np

    from sysid.data.excitation import Schedule
    from sysid.estimation.information.optimal_input import optimal_input
    from sysid.estimation.information.sensitivity import sensitivity
    from sysid.estimation.information.subject import subject_of_model
    from sysid.workspace.logs import StoredData

    given = {k: v for k, v in options.items() if k in OPTIONS}
    if unknown := [k for k in options if k not in (*OPTIONS, "dt")]:
        has = ", ".join(f"--{k}" for k in OPTIONS)
        raise UsageError(f"sysid excite optimal has no --{unknown[0]}; it has {has}")
    model = stored.model
    records = StoredData().estimation(stored)
    if not records:
        raise UsageError(f"the log of {stored.id} is not where it was; fit the model again")
    subject = subject_of_model(model)
    plain = tuple(model.detrend.remove(r) for r in records)
    before = {p.name: p.std_error for p in sensitivity(subject, plain).parameters}
    samples = round(given.get("duration", sum(map(len, records)) * model.dt) / model.dt)
    if not 20 <= samples <= LONGEST:
        raise UsageError(
            f"--duration makes {samples} samples of {model.dt:g} s; choose 20 to {LONGEST}"
        )
    limits = _limits(subject, np.asarray(model.detrend.u_offset), given)
    with render.stages("Designing") as shown:
        found = optimal_input(
            *(subject, samples, limits, given.get("seed", 0)),
            progress=lambda share: shown("Designing", share),
        )
    u = found.u + np.asarray(model.detrend.u_offset)
    t = np.round(np.arange(samples) * model.dt, 12)
    schedule = Schedule(t, u, model.inputs, (0, samples))
    if all(c.unit == "µs" for c in model.inputs):  # a robot stands before and after
        schedule = with_rests(u, model.dt, [c.name for c in model.inputs])
    errors = zip(subject.names, found.errors.tolist(), strict=True)
    promised = [
        {"name": n, "error_of_log": before[n], "error_promised": e, "factor": before[n] / e}
        for n, e in errors
    ]
    return schedule, {"model": stored.id, "family": found.words, "parameters": promised}


def _limits(subject: "Subject", offset: "Array", given: dict[str, Any]) -> "Limits":
    """Those of the log, or what was given, about the operating point."""
    import numpy as np

    from sysid.data.record import PWM_FULL_SCALE
    from sysid.estimation.information.optimal_input import Limits

    u = subject.u_range
    middle = u.mean(axis=1) + offset if "offset" not in given else np.full(len(u), given["offset"])
    reach = (u[:, 1] - u[:, 0]) / 2.0
    if "amplitude" in given:
        reach = np.full(len(u), given["amplitude"])
    if np.any(reach <= 0.0):
        raise UsageError(f"the amplitude must be positive, got {reach.min():g}")
    ends = np.stack([middle - reach, middle + reach], axis=1)
    for channel, (low, high) in zip(subject.inputs, ends, strict=True):
        if channel.unit == "µs" and max(abs(low), abs(high)) > PWM_FULL_SCALE:
            raise UsageError(
                f"PWM of {low:g} to {high:g} µs exceeds full drive, ±{PWM_FULL_SCALE:g} µs; lower "
                "--amplitude"
            )
    return Limits(ends - offset[:, None], subject.y_range)


def show(facts: dict[str, Any]) -> None:
    """What it promises."""
    rows = [
        (
            p["name"],
            f"{1.96 * p['error_of_log']:.3g}",
            f"{1.96 * p['error_promised']:.3g}",
            f"{p['factor']:.2g}",
        )
        for p in facts["parameters"]
    ]
    heading = (
        f"{facts['family']} for {facts['model']}: {facts['samples']} samples, "
        f"{facts['duration_s']:g} s"
    )
    heads = ("parameter", "± 95 % of its log", "± 95 % promised", "times smaller")
    render.table(heads, rows, heading)
    for c in facts["inputs"]:
        unit = f" {c['unit']}" if c["unit"] else ""
        render.say(f"{c['name']}: {c['lowest']:g} to {c['highest']:g}{unit}")
    render.say(f"Written to {facts['schedule']}")
