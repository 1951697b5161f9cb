"""Sentences and figures of a diagnosis, for the terminal and the page."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.base_model import full_drive
from sysid.diagnosis.diagnosis import OF_THE_LOG, Against, Diagnosis, NamedEffect, Trace, Value
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.shapes.grading import FoundShape
from sysid.diagnosis.validation.localise import Region, leading
from sysid.diagnosis.verdict import ASTRAY, Remaining, shape_known
from sysid.effects.catalogue import effect
from sysid.effects.samples import DROPOUTS, QUANTISATION
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.estimation.assessment.figures import Figures

CLEAR = 0.01
"""Residual tests are called failed below this p-value."""

OF_POSE = {"x": "m", "y": "m", "psi": "rad"}
"""Units of what a path is made of."""

DONE = 1.0
"""Per cent of the error beyond the noise below which nothing is left to be explained."""


@dataclass(frozen=True)
class ChannelLine:
    """One output on held-out data: errors and floor in the file's unit, fits and gap closed [%]."""

    name: str
    unit: str
    rmse_before: float
    rmse_after: float
    noise_floor: float
    fit_before: float
    fit_after: float
    closed_percent: float


@dataclass(frozen=True)
class Moved:
    """A parameter of the base before and after; ``steps`` is the move in standard errors."""

    name: str
    unit: str
    before: float
    after: float
    std_error: float
    steps: float


FAR_OFF = -100.0
"""A fit [%] below which a run has left the log altogether."""


def headline(result: Diagnosis, ties: bool = True) -> str:
    """The verdict in a few words, each name with those that the log cannot distinguish from it."""
    if result.unfollowed:
        return result.unfollowed.partition(":")[0]
    names = [e for e in result.effects if e.id not in OF_THE_LOG]
    missing = ", ".join(_with_ties(e) if ties else e.id for e in names)
    seen = "".join(f"; {OF_THE_LOG[e.id]}" for e in result.effects if e.id in OF_THE_LOG)
    if result.verdict == "effects-found" and missing:
        return f"Missing: {missing}{seen}"
    if result.verdict == "shape-found":
        places = ", ".join(dict.fromkeys(s.place for s in result.shapes))
        return f"{shape_known(result.shapes)}: {places}{seen}"
    if result.verdict != "unexplained" and result.undecided:
        return result.undecided.partition(":")[0] + seen
    if result.verdict != "unexplained":
        return f"Nothing is missing that this log could show{seen}"
    if missing:
        return f"Missing: {missing}, and more that has no name here"
    return "Something is missing, but no effect of the catalogue explains it"


def _with_ties(named: NamedEffect) -> str:
    """A name, with those that the log cannot distinguish from it."""
    ties = ", ".join(named.indistinguishable)
    return f"{named.id} (or {ties})" if ties else named.id


def held_out(result: Diagnosis) -> tuple[Trace, ...]:
    """Traces for validation: those on held-out data, or all where there are none."""
    return tuple(t for t in result.traces if t.role == "held-out") or result.traces


def channel_lines(result: Diagnosis) -> tuple[ChannelLine, ...]:
    """The figures of every output before and after."""
    traces = held_out(result)
    outputs = traces[0].record.outputs if traces else result.before.outputs
    units = {c.name: c.to_file for c in outputs}
    lines = []
    for name, c in result.gap.channels.items():
        at = [c.name for c in outputs].index(name) if name in units else -1
        factor, unit = units.get(name, (1.0, OF_POSE.get(name, "")))
        gap = c.rmse_before**2 - c.noise_floor**2
        remaining = c.rmse_after**2 - c.noise_floor**2
        closed = 100.0 * (1.0 - remaining / gap) if gap > 0.0 else math.nan
        lines.append(
            ChannelLine(
                name,
                unit,
                factor * c.rmse_before,
                factor * c.rmse_after,
                factor * c.noise_floor,
                _fit(traces, at, after=False),
                _fit(traces, at, after=True),
                min(closed, 100.0),
            )
        )
    return tuple(lines)


def counted(traces: Sequence[Trace], *, after: bool) -> tuple[Array, Array]:
    """Measurements and one model's free run over the samples that count, (N, ny) each."""
    measurements, runs = [], []
    for t in traces:
        run = t.after if after else t.before
        kept = (t.counted > 0) & np.isfinite(run).all(axis=1) & np.isfinite(t.record.y).all(axis=1)
        measurements.append(t.record.y[kept])
        runs.append(run[kept])
    return np.concatenate(measurements), np.concatenate(runs)


def _fit(traces: Sequence[Trace], i: int, *, after: bool) -> float:
    """100 (1 − RMS(y − ŷ) / σ) over the counted samples; NaN where undefined.

    σ is the standard deviation of the whole records: behind one step a held-out block stands still.
    """
    if i < 0 or not traces:
        return math.nan
    y, run = (part[:, i] for part in counted(traces, after=after))
    spread = float(np.nanstd(np.concatenate([t.record.y[:, i] for t in traces])))
    size = float(np.sqrt(np.mean((y - run) ** 2))) if len(y) else math.nan
    return 100.0 * (1.0 - size / spread) if spread > 0.0 else math.nan


_SIZES = {QUANTISATION.id: "speed", DROPOUTS.id: "of the readings"}
"""Units of what is no effect of the catalogue's chain."""


def detectable(result: Diagnosis) -> tuple[tuple[str, str], ...]:
    """(effect, the smallest size that the log would have shown, in the file's units) by name."""
    if not result.traces:
        return ()
    records = [t.record for t in result.traces]
    full = float(np.mean(full_drive(records) / [c.scale for c in records[0].inputs]))
    u, y = records[0].inputs[0], records[0].outputs[0]
    lines = []
    for id, size in sorted(result.detectable.items()):
        unit = _SIZES.get(id) or effect(id).parameters[0].unit
        if size is not None and "drive" in unit and not records[0].full_drive_is_known:
            size = size / full if unit.startswith("1/") else size * full
            unit = unit.replace("drive", u.file_words or u.unit or u.name)
        if size is not None and "speed" in unit:
            size *= y.to_file[0] ** (-1 if unit.startswith("1/") else 1)
        unit = unit.replace("speed", y.to_file[1] or y.name).replace("drive", "of full drive")
        lines.append((id, "–" if size is None else f"{size:.3g} {unit}".strip()))
    return tuple(lines)


def moved(result: Diagnosis) -> tuple[Moved, ...]:
    """Parameters that both models have, with how far the added effects moved them."""
    before = {p.name: p for p in result.before.parameter_table()}
    lines = []
    for p in result.after.parameter_table():
        old = before.get(p.name)
        if old is None or old.fixed or p.fixed:
            continue
        error = math.hypot(old.std_error, p.std_error)
        steps = abs(p.value - old.value) / error if 0.0 < error < math.inf else math.nan
        lines.append(Moved(p.name, p.unit, old.value, p.value, p.std_error, steps))
    return tuple(lines)


ALL = 99.9
"""Share of the excess error closed [%] beyond which its interval has nothing more to say."""


def closed_sentence(result: Diagnosis) -> str:
    """How much of the excess error, that beyond the noise, is closed, and on which data."""
    low, high = result.gap.interval
    data = ", ".join(dict.fromkeys(t.record.name for t in held_out(result)))
    digits = 1 if low >= 99.0 else 0
    ends = f"{low:.{digits}f}–{high:.{digits}f} %" if low < ALL else f"above {ALL:g} %"
    return (
        f"Closes {percent(result.gap.closed_percent)} of the excess error on {data} (95 %: {ends})"
    )


def fits_sentence(result: Diagnosis) -> str:
    """Fits in free run on held-out data, with the best that the noise allows."""
    fits, limits = [], []
    for c in channel_lines(result):
        if not math.isfinite(c.fit_before):
            continue
        after = f" → {_in_words(c.fit_after)}" if result.grown else ""
        fits.append(f"{c.name} {_in_words(c.fit_before)}{after} %")
        spread = c.rmse_before / max(1.0 - c.fit_before / 100.0, 1e-12)
        limits.append(f"{100.0 * (1.0 - c.noise_floor / spread):.1f}")
    limit = f" (noise {', '.join(limits)})" if limits else ""
    return f"Free-run fit: {', '.join(fits)}{limit}" if fits else ""


def _in_words(percent: float) -> str:
    """A fit; far below zero its size says nothing more."""
    return f"{percent:.1f}" if percent > FAR_OFF else f"< {FAR_OFF:g}"


def base_sentence(result: Diagnosis, before: str) -> str:
    """What the effects were added to."""
    other = result.against
    beside = f", not {other.name} (held-out error {_errors(other)})" if other else ""
    return f"Base: {result.base_words}{beside}"


def _errors(other: Against) -> str:
    return ", ".join(f"{v:.3g} on {name}" for name, v in other.rmse.items())


def worst_sentence(result: Diagnosis) -> str:
    """Where the original model erred most."""
    regions = leading_regions(result, 1)
    if not regions:
        return ""
    output, sign, where = regions[0].region.partition(": ")
    if not sign:
        return regions[0].sentence
    share, samples = 100 * regions[0].share_of_excess, 100 * regions[0].share_of_samples
    joint = "in" if where.endswith("of the log") else "where"
    return (
        f"Worst before: {output} {joint} {where}: {share:.0f} % of the error in {samples:.0f} % of "
        "the samples"
    )


def left_sentence(result: Diagnosis, marks: str = "") -> str:
    """What is left of the error beyond the noise; empty where nothing was added.

    Args:
        marks: the residual tests that the augmented model fails, as `compare` marks them.
    """
    if not result.grown:
        return ""
    rest = 100.0 - result.gap.closed_percent
    beyond = result.excess_error
    if rest < DONE and (beyond is None or not any(rms for _, _, rms, _ in beyond.outputs)):
        end = f"; residuals: {marks}" if marks else ": done"
        return f"Left: less than {DONE:g} % of the error beyond the noise{end}"
    if beyond is None:
        far = Remaining(None, result.gap).above_noise
        what = f"no input or output predicts ({far} the noise)" if far else "looks like noise"
        return f"Left: {percent(rest)} of the excess error, which {what}"
    outputs = beyond.outputs
    where = leading([*result.where_after], [name for name, *_ in outputs])
    place = where.removeprefix("it is ") if where.startswith("it is ") else f"where {where}"
    units = list(dict.fromkeys(unit for _, unit, *_ in outputs))
    sizes = ", ".join(
        f"{rms:.2g}{f' {unit}' if len(units) > 1 else ''}" for _, unit, rms, _ in outputs
    )
    unit = f" {units[0]}" if len(units) == 1 and units[0] else ""
    mostly = f", mostly {place}" if where else ""
    share = f"less than {DONE:g} %, but no noise" if rest < DONE else percent(rest)
    return f"Left: {share}{mostly}; {sizes}{unit} RMS"


def effect_table(result: Diagnosis) -> tuple[list[str], list[list[str]]]:
    """Headings and a row for each effect and output: its first numbers, and what it is worth."""
    rows = []
    for k, e in enumerate(result.effects, start=1):
        ratio = e.error_ratio_without
        worth = "–" if ratio is None else f"× {ratio:.3g}"
        for i, (output, values) in enumerate(_by_output(e).items()):
            first = i == 0
            name = f"{k} {e.id}" if first else ""
            rows.append([name, output, _estimates(values), worth if first else ""])
    return ["  effect", "", "estimate (95 % interval)", "RMSE without"], rows


def _by_output(e: NamedEffect) -> dict[str, list[Value]]:
    """The numbers of an effect by the output in their brackets; in the command's unit where known.

    A number that has none beside it, such as a choice between laws, is left out.
    """
    groups: dict[str, list[Value]] = {}
    for p in (v.in_log_units for v in e.parameters):
        name, _, output = p.name.partition("[")
        if p.words or len(e.parameters) == 1:
            groups.setdefault(output.rstrip("]"), []).append(replace(p, name=name))
    if not groups:
        return {", ".join(e.channels): []}
    for output, values in groups.items():
        commands = {v.name.removesuffix(COMMAND): v for v in values if v.name.endswith(COMMAND)}
        groups[output] = [
            replace(commands.get(v.name, v), name=v.name)
            for v in values
            if not v.name.endswith(COMMAND)
        ]
    return groups


COMMAND = "_command"
"""Ending of a number that is given as a command once more."""

WIDEST = 44
"""Letters of the estimates of a row: the second number is shown where it has room."""


def _estimates(values: Sequence[Value]) -> str:
    text = ""
    for v in values[:2]:
        more = f"{v.name} {estimate_words(v)}"
        if text and len(text) + len(more) + 2 > WIDEST:
            break
        text = f"{text}, {more}" if text else more
    return text or "–"


def estimate_words(v: Value) -> str:
    """``2077 (2032–2126) µs``: as many decimals as the interval leaves meaning to."""
    unit = f" {v.unit}" if v.unit else ""
    if not v.visited:
        return v.words
    ends = v.ends
    if ends is None or None in ends:
        known = f" ({v.words})" if v.words else ""
        return f"{v.value:.4g}{known}{unit}"
    low, high = (float(end) for end in ends if end is not None)
    half = max(high - low, 1e-300) / 2.0
    decimals = min(max(-math.floor(math.log10(half)), 0), 9)
    between = " to " if low < 0.0 else "–"
    return f"{v.value:.{decimals}f} ({low:.{decimals}f}{between}{high:.{decimals}f}){unit}"


def nothing_named(result: Diagnosis) -> str:
    """What is shown where no effect is reported."""
    if result.unfollowed and not result.unfollowed.startswith(ASTRAY):
        return "No effect is reported."
    if result.unfollowed:
        return "No effect is reported: the model must follow the log first."
    if result.verdict in ("unexplained", "shape-found"):
        return "No effect of the catalogue explains it."
    if result.undecided:
        return "No effect is significant; the errors remain unexplained."
    return "No effect is missing."


def evidence_sentence(effect: NamedEffect) -> str:
    """What an effect is worth, and why it was accepted."""
    evidence = effect.evidence
    if evidence is None:
        return "Visible in the samples themselves; the model is unchanged."
    p = evidence.p_value
    chance = p_words(p) if p < RULE.p else "too few blocks for a test"
    return f"{effect.fit_words} ΔBIC {_whole(evidence.delta_bic)}, {chance}.".lstrip()


def plain_sentence(effect: NamedEffect) -> str:
    """What an effect is; its numbers stand in the table of the page."""
    return re.sub(r" Here .*?\.(?= |$)", "", effect.sentence)


def equations(result: Diagnosis) -> tuple[str, ...]:
    """The augmented model's equations in one block, without the numbers of the effects."""
    lines = [re.sub(r" with [\w-]+(\[[^]]*\])? = .*", "", e) for e in result.after.equations()]
    return ("\n".join(lines),) if lines else ()


def story(result: Diagnosis) -> str:
    """The sentence below the headline, unless it says the same."""
    text, said = result.story, headline(result, ties=False).partition(";")[0]
    for beginning in (said, said.partition(":")[0]):
        if re.match(rf"{re.escape(beginning)}(?!\w)", text):
            text = text[len(beginning) :].lstrip(".:").strip()
            break
    column = not text.partition(" ")[0].isalpha()
    return text if column else f"{text[:1].upper()}{text[1:]}"


def score_words(score: float) -> str:
    """A score of a candidate."""
    return _whole(score) if abs(score) >= 100.0 else f"{score:.3g}"


def _whole(value: float) -> str:
    """A parameter without needless digits: whole where it is large."""
    return f"{value:.0f}" if math.isfinite(value) and abs(value) >= 100.0 else f"{value:.3g}"


def tie_sentence(effect: NamedEffect) -> str:
    """Effects that the log cannot distinguish from this one, or nothing."""
    if not effect.indistinguishable or "cannot distinguish" in effect.sentence:
        return ""
    others = ", ".join(effect.indistinguishable)
    return f"This log cannot distinguish it from {others}."


def leading_regions(result: Diagnosis, most: int = 6) -> tuple[Region, ...]:
    """Regimes that hold clearly more of the excess error than of the samples."""
    lifted = [r for r in result.where if r.share_of_excess > 1.15 * r.share_of_samples]
    return tuple((lifted or list(result.where))[:most])


def region_sentence(region: Region) -> str:
    """The finding in words, the output first."""
    output, sign, where = region.region.partition(": ")
    if not sign:
        return region.sentence
    low, high = (f"{100 * v:.0f}" for v in region.interval)
    joint = "in" if where.endswith("of the log") else "where"
    return (
        f"{100 * region.share_of_excess:.0f} % of the excess error of {output} lies in the "
        f"{100 * region.share_of_samples:.0f} % of samples {joint} {where} "
        f"(95 % interval {low} to {high} %)."
    )


def relative(value: Value) -> str:
    """Half of the 95 % interval in per cent of the value."""
    if value.std_error is None or not value.value or not math.isfinite(value.std_error):
        return "–"
    share = 100.0 * NORMAL * value.std_error / abs(value.value)
    return "> 100 %" if share > 100.0 else f"{share:.2g} %"


def steps_words(steps: float) -> str:
    """How far a parameter moved."""
    if not math.isfinite(steps):
        return "–"
    return "> 1000 s.e." if steps > 1000 else f"{steps:.1f} s.e."


def free_run_figures(traces: Sequence[Trace], *, after: bool) -> Figures:
    """Fit and RMSE of one of the models over the counted samples of some traces."""
    names = traces[0].record.output_names
    y, run = counted(traces, after=after)
    rms = np.sqrt(np.mean((y - run) ** 2, axis=0)) if len(y) else np.full(len(names), np.nan)
    return Figures(
        data=", ".join(dict.fromkeys(t.record.name for t in traces)),
        horizon=None,
        initial_state="as in the diagnosis",
        samples=len(y),
        fit_percent={n: _fit(traces, i, after=after) for i, n in enumerate(names)},
        rmse=dict(zip(names, rms.tolist(), strict=True)),
    )


def shape_sentence(shape: FoundShape) -> str:
    """A shape with its place and its share of the excess error."""
    said = f"{shape.sentence[:1].upper()}{shape.sentence[1:]}"
    share = f"{percent(100.0 * shape.share)} of the excess error of {shape.output}"
    return f"{said}: {share} (place: {shape.place})."


def p_words(p: float) -> str:
    """A p-value; tiny ones are only bounded."""
    return "p < 1e-6" if p < 1e-6 else f"p = {p:.2g}"


def percent(value: float) -> str:
    """A share in per cent, with the digits that matter; near 100 % more of them."""
    if not math.isfinite(value):
        return "–"
    digits = 2 if 99.0 <= value < 100.0 else 1 if abs(value) < 10.0 or 90.0 <= value < 99.0 else 0
    return f"{value:.{digits}f} %"
