"""The step response of a model in sentences and in cells; ± is half of a 95 % interval."""

import math
from collections.abc import Sequence

from sysid.estimation.assessment.delta_method import Estimate
from sysid.estimation.assessment.own_motion import OwnMode
from sysid.estimation.assessment.step_response import StepResponse

UNSURE = "?"
"""Marks a number whose 95 % interval holds zero."""

PASSES_LITTLE = 0.02
"""A side path that moves an output by less than this share of the strongest path is left out."""


def with_error(value: float, error: float) -> str:
    """``150.00 ± 0.31``: as many digits as the error leaves meaning to; ``(8.882 ± 0.009)e-4``."""
    if not math.isfinite(value):
        return "not determined"
    if math.isinf(error):
        return f"{value:.3g} (not determined by these data)"
    if not error > 0.0:
        return f"{value:.5g}"
    size = max(abs(value), error)
    exponent = math.floor(math.log10(size))
    if -3 <= exponent <= 5:
        exponent = 0
    scaled, spread = value / 10.0**exponent, error / 10.0**exponent
    digits = min(max(1 - math.floor(math.log10(spread)), 0), 10)
    digits -= f"{spread:.{digits}f}".startswith("0.") and spread >= 1.0
    text = f"{scaled:.{digits}f} ± {spread:.{digits}f}"
    return text if exponent == 0 else f"({text})e{exponent}"


def with_interval(estimate: Estimate) -> str:
    """A number with half its 95 % interval; ``not determined`` where the data say nothing."""
    if math.isinf(estimate.std_error):
        return "not determined"
    return with_error(float(estimate.value), estimate.reach)


def strong_paths(responses: Sequence[StepResponse]) -> tuple[list[StepResponse], str]:
    """The paths that matter, and a sentence on the others.

    Paths beside the strongest one of an output that pass on next to nothing are counted only.
    """
    strongest: dict[str, float] = {}
    for r in responses:
        if math.isfinite(r.moves):
            strongest[r.output] = max(strongest.get(r.output, 0.0), r.moves)
    kept, small = [], set()
    for r in responses:
        side = r.moves < PASSES_LITTLE * strongest.get(r.output, 0.0) and r.settles
        if side and r.share is None:
            small.add(f"{r.input} → {r.output}")
        elif not (side and _elsewhere(r, responses, strongest)):
            kept.append(r)
    few = f"{', '.join(sorted(small))}: below {100 * PASSES_LITTLE:g} % of the strongest path"
    return kept, few if small else ""


def step_sentences(responses: Sequence[StepResponse]) -> tuple[str, ...]:
    """One sentence for each path from an input to an output and each size of step."""
    kept, small = strong_paths(responses)
    return (*map(sentence, kept), *([f"{small}, over the ranges of the inputs."] if small else []))


def response_table(
    responses: Sequence[StepResponse],
) -> tuple[tuple[str, str, str], list[tuple[str, str, str, str]]]:
    """Headings of gain, times and settling, and a row for each response; units that all rows share
    stand in the headings."""
    units = {r.file_unit or r.unit for r in responses}
    unit = f" [{units.pop()}]" if len(units) == 1 and "" not in units else ""
    plain = not any(r.share is not None or r.oscillation for r in responses)
    heads = (f"gain{unit}", "time constants [s]" if plain else "dynamics", "2 % settling")
    return heads, [_cells(r, not unit, plain) for r in responses]


def _cells(r: StepResponse, with_unit: bool, plain: bool) -> tuple[str, str, str, str]:
    head = f"{r.input} → {r.output}"
    if r.share is not None:
        head += f", {r.start:.4g} → {r.level:.4g}"
    if not r.settles:
        return head, "does not settle", "", ""
    unit, factor = (r.file_unit, r.file_factor) if r.file_unit else (r.unit, 1.0)
    gain = Estimate(factor * r.gain.value, factor * r.gain.std_error)
    word = f"{_marked(gain)}{f' {unit}' if with_unit else ''}"
    second = "" if plain else " s"
    if math.isinf(gain.std_error):
        return head, "not determined", "", ""
    if r.share is not None and math.isfinite(r.rise.value):
        times = f"63 % after {_seconds(r.rise)}"
    elif r.oscillation is not None:
        frequency, damping = map(with_interval, r.oscillation)
        times = f"{frequency} rad/s, damping {damping}"
    else:
        shown = list(dict.fromkeys(map(_marked, r.time_constants)))
        times = f"{', '.join(shown)}{second}" if shown else ""
    if math.isfinite(r.dead_time) and r.dead_time > 0.0:
        times = f"{times}; dead time {_dead(r)}{second}".lstrip("; ")
    known = math.isfinite(r.settling.value) and gain.clear
    settling = f"{r.settling.value:.3g} s" if known else "–"
    return head, f"integrates: {word}" if r.integrates else word, times, settling


def _marked(estimate: Estimate) -> str:
    """A number with its interval, and the mark of one whose interval holds zero."""
    unsure = not estimate.clear and math.isfinite(estimate.std_error)
    return f"{with_interval(estimate)}{UNSURE if unsure else ''}"


def _dead(r: StepResponse) -> str:
    """The dead time, with its interval where it is estimated; counted in whole samples else."""
    if not r.dead_error:
        return f"about {r.dead_time:.3g}"
    return with_interval(Estimate(r.dead_time, r.dead_error))


def mode_sentences(modes: Sequence[OwnMode]) -> tuple[str, ...]:
    """What a signal without inputs does by itself, a sentence a mode."""
    sentences = []
    for m in modes:
        if m.frequency is not None and m.damping is not None:
            hertz = with_error(m.frequency.value / math.tau, m.frequency.reach / math.tau)
            damping = with_interval(m.damping)
            sentences.append(f"It oscillates at {hertz} Hz with damping {damping}.")
        elif m.time_constant is not None:
            sentences.append(f"It decays with a time constant of {_seconds(m.time_constant)}.")
    return tuple(sentences)


def sentence(r: StepResponse) -> str:
    """``u → y: gain 150 ± 0.3 rpm/V; time constants 0.12 and 0.03 s; settles in 0.5 s.``"""
    head = f"{r.input} → {r.output}"
    if r.share is not None:
        head += f", step {r.start:.6g} → {r.level:.6g}"
    if not r.settles:
        return f"{head}: does not settle; the model is unstable, or too slow to simulate."
    if r.gain.value == 0.0:
        return f"{head}: nothing moves."
    if math.isinf(r.gain.std_error):
        return f"{head}: not determined by these data."
    parts = [_gain(r)]
    parts += _times(r)
    if math.isfinite(r.dead_time) and r.dead_time > 0.0:
        parts.append(f"dead time {_dead(r)} s")
    if math.isfinite(r.settling.value) and r.gain.clear:
        parts.append(f"settles in {r.settling.value:.3g} s")
    return f"{head}: {'; '.join(parts)}."


def _gain(r: StepResponse) -> str:
    unit = f" {r.unit}" if r.unit else ""
    text = f"{with_interval(r.gain)}{unit}"
    if r.file_unit:
        factor = r.file_factor
        shown = with_error(factor * r.gain.value, factor * r.gain.reach)
        text = f"{shown} {r.file_unit} ({text})"
    text = f"it integrates: gain {text}" if r.integrates else f"gain {text}"
    if not r.gain.clear and math.isfinite(r.gain.std_error):
        text += " (not significant)"
    return text


def _times(r: StepResponse) -> list[str]:
    parts = []
    if r.share is not None and math.isfinite(r.rise.value):
        parts.append(f"63 % of it after {_seconds(r.rise)}")
    if r.time_constants:
        word = "time constant" if len(r.time_constants) == 1 else "time constants"
        parts.append(f"{word} {_listed([_seconds(t) for t in r.time_constants])}")
    if r.oscillation is not None:
        frequency, damping = r.oscillation
        parts.append(
            f"oscillates at {with_interval(frequency)} rad/s with damping {with_interval(damping)}"
        )
    return parts


def _listed(words: Sequence[str]) -> str:
    """``a, b and c``."""
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _seconds(time: Estimate) -> str:
    return f"{with_interval(time)}{'' if time.clear else UNSURE} s"


def _elsewhere(
    r: StepResponse, responses: Sequence[StepResponse], strongest: dict[str, float]
) -> bool:
    """Whether every step along this path moves next to nothing, so that it needs no line."""
    return all(
        o.moves < PASSES_LITTLE * strongest[o.output]
        for o in responses
        if (o.input, o.output) == (r.input, r.output)
    )
