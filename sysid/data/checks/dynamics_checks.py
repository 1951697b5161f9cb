"""Checks of the dynamics in a log: excitation, feedback, delay, sampling rate, nonlinearity."""

from collections.abc import Iterator, Sequence

import numpy as np

from sysid.data.checks.constancy import Change, Part
from sysid.data.checks.delay import Delay
from sysid.data.checks.feedback import FeedbackTest
from sysid.data.checks.nonlinearity import NONLINEAR, TRACE
from sysid.data.checks.relay_law import RelayLaw
from sysid.data.facts import LogFacts
from sysid.data.finding import Finding, Severity, ok_unless
from sysid.data.operating_point import value_with_error
from sysid.data.record import Array, Channel, Record
from sysid.errors import argument

CLEAR = 3.0
"""Standard errors from which on a dead time is seen."""

STOPS = 0.02
"""Share of rows at an end under push from which on it is a stop."""

EXCITED = 1e-8
"""Directions of the lagged input below this part of the strongest one's power are not excited."""


def excitation_order(records: Sequence[Record], limit: int) -> tuple[int, ...]:
    """To which order each input persistently excites, at most ``limit``.

    An input excites to order n if the covariance of (u(t), …, u(t−n+1)), means removed, is
    positive definite (Ljung 1999, definition 13.1); positive means above EXCITED of the largest
    eigenvalue.
    """
    orders = []
    for i in range(records[0].nu):
        covariance = _lagged_covariance([r.u[:, i] for r in records], limit)
        n = 0
        while n < len(covariance) and _smallest(covariance[: n + 1, : n + 1]) > EXCITED:
            n += 1
        orders.append(n)
    return tuple(orders)


def check_excitation(facts: LogFacts, order: int) -> list[Finding]:
    """Persistence of excitation against ``order``, and inputs that move together."""
    records, findings = facts.outliers.records, []
    names = records[0].input_names
    for name, reached in zip(names, excitation_order(records, order), strict=True):
        if 0 < reached < order:
            text = f"The input {name} excites the plant to order {reached} only; "
            text += f"{order} was asked for."
            advice = "Lower the orders, or record with a richer input: sysid excite prbs."
            findings.append(Finding("excitation", Severity.WARNING, text, advice, name))
    findings += _together(records)
    text = f"Each input excites the plant to order {order} or more, independently of the others."
    return findings or [Finding("excitation", Severity.OK, text)]


def _together(records: Sequence[Record]) -> Iterator[Finding]:
    """Inputs that are (nearly) a combination of the others."""
    u = np.concatenate([r.u - r.u.mean(axis=0) for r in records])
    norm = np.linalg.norm(u, axis=0)
    unit = u / np.where(norm > 0, norm, 1.0)
    named = set[int]()
    for i, name in enumerate(records[0].input_names):
        others = [k for k in range(len(norm)) if k != i and norm[k] > 0]
        if norm[i] == 0 or not others or i in named:
            continue
        fit = np.linalg.lstsq(unit[:, others], unit[:, i], rcond=None)[0]
        unexplained = float(np.sum((unit[:, i] - unit[:, others] @ fit) ** 2))
        if unexplained > 0.02:
            continue
        parts = [k for k, c in zip(others, fit, strict=True) if abs(c) > 0.1]
        named.update(parts)
        partner = " and ".join(records[0].input_names[k] for k in parts)
        c = unit[:, i] @ unit[:, parts[0]]
        how = f"correlation {c:.3f}" if len(parts) == 1 else "as a weighted sum"
        always = unexplained < 1e-3
        text = (
            f"The inputs {name} and {partner} {'' if always else 'nearly '}always move together "
            f"({how}): their effects cannot be distinguished."
        )
        severity = Severity.WARNING if always else Severity.NOTE
        yield Finding("collinear", severity, text, _HOW_TO_SEPARATE[records[0].is_robot_log], name)


@ok_unless("feedback", "No feedback from output to input was detected.")
def check_feedback(facts: LogFacts) -> Iterator[Finding]:
    """Whether the input depends on the output: data recorded in closed loop."""
    if facts.feedback is None:
        yield _too_short("feedback")
    advice = (
        "Prefer structures with a noise model (ARX, ARMAX, BJ) and one-step focus; OE is "
        "biased here unless its residuals are white."
    )
    for test in (t for t in facts.feedback or () if t.seen):
        text = (
            f"The input {test.input} responds to {_response(test)}: the data were recorded in "
            "closed loop."
        )
        how = advice
        if test.relay is not None:
            channels = {c.name: c for c in (*facts.records[0].inputs, *facts.records[0].outputs)}
            text = _switched(test, test.relay, channels[test.input], channels[test.output])
        if test.exchanged:
            share = f"share {100 * test.share:.2g} %"
            text = (
                f"{test.input} follows {test.output} ({share}), which follows nothing of "
                f"{test.input}: input and output may be exchanged, or only a controller moves the "
                "input."
            )
            how = f"If they are, give {argument(inputs=[test.output], outputs=[test.input])}."
        if (test.law is not None and not test.reference) or test in facts.laws_alone:
            text += (
                " No set point moves it within the log: gain and time constants of a model may be "
                "those of the disturbance and the controller, off by any amount."
            )
            how = "Step the set point, or add a test signal to the input, and record again."
        yield Finding("feedback", Severity.WARNING, text, how, test.output)


def _switched(test: FeedbackTest, relay: RelayLaw, u: Channel, y: Channel) -> str:
    """The thresholds that switch an input, as a thermostat does."""
    factor, unit = y.to_file
    up, down = (f"{factor * v:.4g} {unit}".strip() for v in (relay.up, relay.down))
    return (
        f"{y.name} switches the input {u.name}, to its higher level at {up} and to its lower one "
        f"at {down}, in {relay.switchings} switchings ({_chance(test.p_value)}): the data were "
        "recorded in closed loop."
    )


def _response(test: FeedbackTest) -> str:
    if test.law is not None:
        law = test.law
        kind, time = "law", f", {_chance(test.p_value)}"
        if law.integrates:
            kind, time = "proportional-integral law", f", integral time {law.integral_time:.3g} s"
        return (
            f"{test.output} within the sample by a {kind} (gain {law.gain:.3g} {test.input} for 1 "
            f"{test.output}{time})"
        )
    if test.reference:
        return f"{test.reference} - {test.column or test.output} ({_chance(test.p_value)})"
    share = f"share {100 * test.share:.2g} %"
    return f"innovations of {test.output} ({share}, {_chance(test.p_value)})"


def check_delay(facts: LogFacts) -> Iterator[Finding]:
    """The delay of every pair with its interval, output by output.

    A response within the sample is either feedthrough or a controller that reads y(t) before it
    writes u(t). Where feedback is detected it is the controller's; where none is, one record cannot
    distinguish the two for certain, so both are said.
    """
    delays = facts.delays
    set_points = [f.channel for f in facts.reading if f.code == "set-point" and f.channel]
    if delays is None:
        yield _too_short("delay")
    for output in dict.fromkeys(d.output for d in delays or ()):
        pairs = [d for d in delays or () if d.output == output]
        if all(d.delay is None for d in pairs):
            yield _no_effect(output, [d.input for d in pairs])
            continue
        text = (
            f"Delay to {output} in samples: {', '.join(map(_samples, pairs))}.{_dead_times(pairs)}"
        )
        unsure = not all(d.certain for d in pairs)
        advice = "Let the fit search the delay (give no nk)." * unsure
        yield Finding("delay", Severity.OK, text, advice, output)
        for d in (d for d in pairs if d.delay == 0):
            yield _at_once(output, d.input, set_points)


def _samples(d: Delay) -> str:
    if d.delay is None:
        return f"no visible effect of {d.input}"
    return f"{d.delay}{'' if d.certain else f' ({d.low} to {d.high})'} from {d.input}"


def _at_once(output: str, name: str, set_points: Sequence[str]) -> Finding:
    """What a response within the sample means: one log cannot show which of the two it is."""
    text = f"{output} moves in the very sample of {name}: the plant passes {name} on at once, or "
    if set_points:
        text = (
            f"{output} moves in the very sample of {name}, and {', '.join(set_points)} is a set "
            "point: closed loop, or the plant passes the input on at once. In closed loop "
        )
    text += f"a controller computes {name} from {output} and the model is the controller's inverse."
    advice = f"If there is a controller, record with a moving set point and give {_NEXT_SAMPLE}."
    return Finding("at-once", Severity.WARNING, text, advice, output)


_NEXT_SAMPLE = argument(orders="nk=1")


def _dead_times(pairs: Sequence[Delay]) -> str:
    """Dead times in seconds, where one is seen."""
    seen = [d for d in pairs if d.delay is not None and d.dead_s > CLEAR * d.error_s]
    words = [f"{value_with_error(d.dead_s, d.error_s)} s from {d.input}" for d in seen]
    return f" Dead time {', '.join(words)}." if words else ""


def _no_effect(output: str, inputs: Sequence[str]) -> Finding:
    who = "input {} explains" if len(inputs) == 1 else "inputs {} explain"
    text = f"The {who.format(', '.join(inputs))} no more of {output} than chance would."
    advice = "Check the columns, and whether the actuator was on: no model of these data is usable."
    return Finding("no-effect", Severity.WARNING, text, advice, output)


def check_sampling(facts: LogFacts) -> Iterator[Finding]:
    """Sample time against the time the outputs take to respond."""
    # the controller's speed is none of the plant, and an integrator never settles
    without = {t.output for t in facts.feedback or () if t.law}
    without |= {s.output for s in facts.integrals}
    # what an input reaches within the sample only seems slow
    immediate = {d.output for d in facts.delays or () if d.delay == 0}
    for speed in (s for s in facts.speeds if s.output not in without):
        if speed.time_constant is None:
            text = f"The time constant of {speed.output} cannot be estimated from these data."
            yield Finding("sampling", Severity.NOTE, text, "", speed.output)
            continue
        samples = speed.time_constant / facts.records[0].dt
        text = f"{speed.output} is near its final value within the first sample"
        if speed.time_constant:
            text = (
                f"{speed.output} takes {speed.time_constant:.3g} s to 63 % of its final value, "
                f"{samples:.2g} samples"
            )
        severity, tail, advice = Severity.OK, ".", ""
        if samples < 0.75:
            severity = Severity.NOTE if speed.output in immediate else Severity.WARNING
            tail = ": the sampling is too slow to see the transient."
            advice = "Sample several times faster."
        elif samples > 60:
            severity = Severity.WARNING if samples > 500 else Severity.NOTE
            tail = ": the sampling is much faster than the plant."
            advice = (
                f"Decimate it with {argument(decimate=max(2, round(samples / 15)))}: otherwise the "
                "poles lie near 1 and noise dominates the fit."
            )
        yield Finding("sampling", severity, text + tail, advice, speed.output)


def check_integrals(facts: LogFacts) -> Iterator[Finding]:
    """What an output that integrates is modelled by, and its end stops."""
    for s in facts.integrals:
        text = f"{s.output} integrates {s.input}: its speed follows, and it has no final value."
        advice = f"Model its speed with {argument(speed_of=s.output)}."
        yield Finding("integrates", Severity.NOTE, text, advice, s.output)
        if s.stopped > STOPS:
            text = (
                f"{s.output} stands at an end of its range in {100 * s.stopped:.2g} % of the rows "
                f"while {s.input} pushes on: an end stop or a clipping sensor."
            )
            advice = "Leave those stretches out: a linear model reads them as lower gain."
            yield Finding("saturation", Severity.WARNING, text, advice, s.output)


def check_nonlinearity(facts: LogFacts) -> list[Finding]:
    """Whether the log asks for a nonlinear model, output by output."""
    tests = facts.nonlinearity
    if tests is None:
        return [_too_short("nonlinearity")]
    if not tests:
        text = "Not tested for nonlinearity: the input is a function of the output."
        return [Finding("nonlinearity", Severity.NOTE, text)]
    findings = []
    for t in (t for t in tests if t.p_value < NONLINEAR / len(tests)):
        predicted = f"{100.0 * t.share:.2g} %" if t.share >= TRACE else "a trace"
        text = (
            f"Nonlinear response of {t.output} ({_chance(t.p_value)}): products of past signals, "
            f"mostly {t.shape}, predict {predicted} of the best linear predictor's errors."
        )
        advice = _STRUCTURES_TO_COMPARE.get(t.shape, _STRUCTURES_TO_COMPARE[_BOTH])
        findings.append(Finding("nonlinearity", Severity.NOTE, text, advice, t.output))
    least = min(t.p_value for t in tests)
    text = f"No nonlinearity was detected (p = {least:.2g}): linear structures may suffice."
    return findings or [Finding("nonlinearity", Severity.OK, text)]


_BOTH = "of both input and output"
_STRUCTURES_TO_COMPARE = {
    "even in the input": "Compare hammerstein-wiener and narmax with the linear structures.",
    "odd in the input": "Compare hammerstein-wiener (dead zone, saturation) and narx-wavelet with "
    "the linear structures.",
    "even in the output": "Compare narmax and narx-wavelet with the linear structures.",
    "odd in the output": "Compare narmax and narx-wavelet (springs, friction) with the linear "
    "structures; for a motor dc-motor.",
    _BOTH: "Compare narmax and narx-wavelet with the linear structures.",
}


def _chance(p_value: float) -> str:
    return f"p = {p_value:.1g}" if p_value >= 1e-12 else "p < 1e-12"


_HOW_TO_SEPARATE = {
    True: "Add a run in which they differ, such as turns on the spot, or one of sysid excite.",
    False: "Add a run in which they differ: move one of them while the others stand still.",
}
"""How to separate the effects of inputs, by whether they are a robot's."""


def _too_short(code: str) -> Finding:
    text = f"Too few samples to test for {'a delay' if code == 'delay' else code}."
    return Finding(code, Severity.NOTE, text, "Record longer.")


def _lagged_covariance(inputs: Sequence[Array], order: int) -> Array:
    total = np.zeros((order, order))
    mean = np.concatenate(inputs).mean()
    for u in inputs:
        if len(u) >= 2 * order:
            lagged = np.lib.stride_tricks.sliding_window_view(u - mean, order)
            total += lagged.T @ lagged
    return total


def _smallest(matrix: Array) -> float:
    """Smallest eigenvalue over the largest."""
    values = np.linalg.eigvalsh(matrix)
    return float(values[0] / values[-1]) if values[-1] > 0 else 0.0


def check_constancy(facts: LogFacts) -> Iterator[Finding]:
    """What changes within the log, and when; nothing where no process shows it."""
    record, changes = facts.records[0], facts.changes
    for c in changes:
        text = change_sentence(c, record)
        advice = _ADVICE[c.is_step]
        if c.column:
            too = argument(inputs=[*record.input_names, c.column[0]])
            of = f"A linear model is an average over {c.column[0]}; narmax takes it as an input"
            advice = f"{of if c.parts else 'Give it as an input, too'}: {too}."
        yield Finding("change", Severity.WARNING, text, advice, c.output)
    drifting = drift_sentences(record, changes, facts.drifts)
    for output, text in drifting.items():
        yield Finding("drift", Severity.WARNING, text, WITHOUT_DRIFT, output)
    for c in facts.changes_or_curves:
        text = f"{change_sentence(c, record).removesuffix('.')}, or the response is a curve."
        yield Finding("change", Severity.NOTE, text, "sysid diagnose compares both.", c.output)
    if any(facts.processes) and not (changes or drifting):
        text = "Gains, time constants and levels are constant."
        yield Finding("change", Severity.OK, text)


def drift_sentences(record: Record, changes: Sequence[Change], drifts: Array) -> dict[str, str]:
    """By output, by how much its level drifts, where nothing else changes."""
    changed = {c.output for c in changes}
    said = {}
    for channel, drift in zip(record.outputs, drifts.tolist(), strict=False):
        if drift and channel.name not in changed:
            unit = channel.file_words or channel.unit
            size = f"{drift / channel.scale:.2g} {unit}".strip()
            said[channel.name] = (
                f"The level of {channel.name} drifts by {size} within the log, whatever the inputs "
                "do."
            )
    return said


def change_sentence(change: Change, record: Record) -> str:
    """``speed: gain from volts falls by 24.0 ± 0.3 % (…) at 61.3 ± 0.4 s.``"""
    inputs = {c.name: c for c in record.inputs}
    output = next(c for c in record.outputs if c.name == change.output)
    rough = change.column is not None  # a product may act before the lag as well as behind it
    words = [_part(p, inputs[p.input], output, rough) for p in change.parts]
    words += [f"the level of {output.name} moves"] * change.level
    parts = " and ".join(words)
    if change.column:
        name, low, high = change.column
        return f"{change.record}: {parts} as {name}, not used, goes from {low:.4g} to {high:.4g}."
    when = (
        f"at {value_with_error(change.at, change.error)} s"
        if change.is_step
        else "from the first to the last sample"
    )
    return f"{change.record}: {parts} {when}."


def _part(part: Part, u: Channel, y: Channel, rough: bool) -> str:
    verb = "falls" if part.change < 0.0 else "rises"
    by = value_with_error(100.0 * abs(part.change), 100.0 * part.error)
    if not part.is_gain:
        numbers = f"{part.before:.3g} to {part.after:.3g} s"
        amount = f"from {numbers}" if rough else f"by {by} % ({numbers})"
        return f"the time constant of {y.name} {verb} {amount}"
    factor = u.scale / y.scale
    unit = f" {y.file_words or y.unit or y.name} per {u.file_words or u.unit or u.name}"
    if rough:
        amount = f"from {factor * part.before:.2g} to {factor * part.after:.2g}{unit}"
    else:
        numbers = f"{factor * part.before:.4g} to {factor * part.after:.4g}{unit}"
        amount = f"by {by} % ({numbers})"
    return f"the gain from {u.name} to {y.name} {verb} {amount}"


WITHOUT_DRIFT = "`remove_drift=True` takes it out, so that it biases no gain or time constant."
"""What to do about a level that drifts."""

_ADVICE = {
    True: "One model does not describe both parts: cut the log there (`trim`) and fit each.",
    False: "A model of the whole log is an average: warming, an emptying battery or wear?",
}
"""What to do, by whether it changes at one time."""
