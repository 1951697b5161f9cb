"""``sysid look``: what a log shows before any model."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import reading, render, targets
from .answer import Answer
from .options import command, group, option
from .read_as import decided, decisions_in_words

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.estimation.look.summary import Look
    from sysid.estimation.look.summary import Path as Response


class Kernel(StrEnum):
    """Priors of an impulse response."""

    TC = "TC"
    DC = "DC"
    SS = "SS"


@command
def look(
    logs: list[Path] = reading.LOGS,
    kernel: Kernel = option("TC|DC|SS", "Prior of the impulse response.", default=Kernel.DC),
    output: Path | None = targets.picture_target("Picture: .svg, .png or .pdf.", "-o"),
    save: Path | None = targets.data_target(
        "--save",
        "Also write the curves, with 95 % bands; X.frd.csv: the frequency response.",
    ),
    steps: "Preparation" = group(reading.Preparing),
    read: "ReadOptions" = group(reading.Reading, hidden=True),
    json: bool = reading.JSON,
) -> None:
    """Show responses, delay, noise and linearity of a log.

    It needs no model and no orders."""
    from sysid.data.facts import LogFacts
    from sysid.data.files import write_atomic
    from sysid.data.frequency_response import ENDING
    from sysid.data.preparation import read_prepared
    from sysid.errors import UsageError
    from sysid.estimation.look.summary import look as looked
    from sysid.report.look_panels import look_panels
    from sysid.report.panels import draw_panels, table

    if responses := [p for p in logs if p.name.lower().endswith(ENDING)]:
        raise UsageError(
            f"{responses[0].name} is a frequency response already; fit a model to it by `sysid fit`"
        )
    records, findings = read_prepared(logs, read, steps)
    found = looked(LogFacts(records, findings), kernel.value)
    panels = look_panels(found) if output or save else ()
    names = ", ".join(dict.fromkeys(r.name for r in records))
    if output is not None:
        draw_panels(output, f"look: {names}", "bands: 95 %", panels)
    if save is not None and save.name.endswith(ENDING):
        found.frequency.as_data(records[0]).write(save)
    elif save is not None:
        write_atomic(save, table(panels))
    if json:
        render.document(_document(found) | {"picture": output, "data": save})
        return
    _show(found, decisions_in_words(decided(records)), {"Picture": output, "Numbers": save})


def _show(found: "Look", read_as: str, files: "dict[str, Path | None]") -> None:
    answer = Answer.with_files(1, files)
    answer.note(read_as, 2)
    first = found.records[0]
    units = {p.unit for p in found.paths}
    common = f" [{units.pop()}]" if len(units) == 1 else ""
    rows = [
        (
            f"{p.input} → {p.output}",
            _gain(p) + (f" {p.unit}" if p.seen and not common else ""),
            f"{p.rise_s:.3g} s" if p.seen and p.rise_s == p.rise_s else "–",
            _delay(p),
            f"{p.trusted_hz:.3g} Hz" if p.trusted_hz else "nowhere",
        )
        for p in sorted(found.paths, key=lambda p: not p.seen)
    ]
    shown = answer.table(
        ("response", f"gain{common}", "63 % after", "delay [samples]", "clear up to"),
        rows,
        spare=1 + min(2 * first.ny, LINES_OF_OUTPUTS),
    )
    if shown < len(rows):
        answer.say(f"  {len(rows) - shown} more: --json", "", 1)
    for i, name in enumerate(first.output_names):
        if answer.room > 1:
            answer.say(_noise(name, found, i), "", 2)
        if answer.room > 1:
            answer.say(_linearity(name, found, i), "", 2)
    cautions = [
        f"{name} integrates its input, so its gain and noise mean nothing here: look at its speed "
        f"(--speed-of {name})."
        for name in found.integrals
    ]
    if found.closed_loop:
        cautions.append(
            "A controller was running: inputs answer to the noise, so the responses are biased "
            "towards the inverse of the controller. Fit a model with noise instead (`sysid fit`)."
        )
    answer.cautions(cautions, "--json")
    answer.print(f"Next: {_next(found)}")


LINES_OF_OUTPUTS = 10
"""Lines left for what is said of outputs."""


def _noise(name: str, found: "Look", i: int) -> str:
    response = found.impulses[i]
    said = (
        f"{name}: {_percent(found.noise_share[i])} % of it is noise"
        f"{' or nonlinear' if found.bent(i) else ''} (kernel {response.kernel}, "
        f"{len(response.g)} steps of {response.dt:.4g} s)."
    )
    if any(p.output == name and p.seen and not p.settles for p in found.paths):
        said += " It has not settled by then: an integrator, or slow beside the log."
    return said


def _next(found: "Look") -> str:
    outputs = range(found.records[0].ny)
    if not any(p.seen for p in found.paths):
        return "drive harder or longer (`sysid excite prbs`): no input moves an output"
    bent = [found.bent(i) for i in outputs]
    if None in bent and True not in bent:
        return "sysid fit, or see whether it is linear (`sysid excite multisine --odd`)"
    return (
        "sysid diagnose, or sysid fit with a nonlinear structure (sysid structures)"
        if True in bent
        else "sysid fit"
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f}" if share > 0.0995 else f"{100.0 * share:.2g}"


def _delay(p: "Response") -> str:
    d = p.delay
    if d is None or d.delay is None or not p.seen:
        return "–"
    return f"{d.delay}" if d.certain else f"{d.delay} ({d.low}–{d.high})"


def _linearity(name: str, found: "Look", i: int) -> str:
    """In one sentence: nonlinear or not, by periods where there are some, else by a test."""
    from math import isfinite

    d, test, bent = found.distortions[i], found.nonlinearity[i], found.bent(i)
    verdict = {None: "Linear or not: undecided", True: "Nonlinear", False: "Linear"}[bent]
    parts = []
    if d is not None:
        parts.append(f"noise {d.noise:.0f} dB")
        for word, level, seen in (("even", d.even, d.even_seen), ("odd", d.odd, d.odd_seen)):
            if isfinite(level):
                parts.append(f"{word} {'' if seen else 'below '}{level:.0f} dB")
        if isfinite(d.nonlinear):
            parts.append(f"among realisations {d.nonlinear:.0f} dB")
        parts[-1] += f" of the excited lines (period {d.period} samples)"
    elif test is not None:
        parts.append(
            f"{test.shape} predict {_percent(test.share)} % of what a linear one leaves"
            if bent
            else f"nothing nonlinear predicts its errors (p = {test.p_value:.2g})"
        )
    return f"  {verdict}{': ' if parts else ''}{', '.join(parts)}."


def _gain(p: "Response") -> str:
    return f"{p.gain:.4g} ± {1.96 * p.gain_error:.2g}" if p.seen else "none seen"


def _document(found: "Look") -> dict[str, Any]:
    from sysid.data.documents import by_field

    return {
        "paths": [by_field(p) for p in found.paths],
        "noise_share": list(found.noise_share),
        "frequency_response": found.frequency.method,
        "nonlinear": [found.bent(i) for i in range(len(found.impulses))],
        "integrals": found.integrals,
        "closed_loop": found.closed_loop,
        "kernels": [r.kernel for r in found.impulses],
        "distortions": [None if d is None else by_field(d) for d in found.distortions],
    }
