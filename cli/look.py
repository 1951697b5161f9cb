"""``sysid look``: what a log shows before any model."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import reading, render, targets
from .options import command, group, option
from .read_as import decided, show_decisions

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.estimation.look.distortion import Distortions
    from sysid.estimation.look.summary import Look
    from sysid.estimation.look.summary import Path as Response


@command
def look(
    logs: list[Path] = reading.LOGS,
    kernel: str | None = option(
        "TC|DC|SS", "Prior of the impulse response [the likeliest].", "--kernel"
    ),
    output: Path | None = targets.picture_target("Picture: .svg, .png or .pdf.", "-o"),
    save: Path | None = targets.target(
        "DATA.csv", "Also write the curves, with 95 % bands.", "--save", suffixes=(".csv",)
    ),
    steps: "Preparation" = group(reading.Preparing),
    read: "ReadOptions" = group(reading.Reading, hidden=True),
    json: bool = reading.JSON,
) -> None:
    """Show responses, delays, noise and distortions of a log, before any model."""
    from sysid.data.files import write_atomic
    from sysid.data.preparation import read_prepared
    from sysid.errors import UsageError
    from sysid.estimation.look.impulse import KERNELS
    from sysid.estimation.look.summary import look as looked
    from sysid.report.look_panels import look_panels
    from sysid.report.panels import PanelPicture, table
    from sysid.report.plots import write_picture

    if kernel is not None and kernel.upper() not in KERNELS:
        raise UsageError(f"--kernel {kernel!r} is none of {', '.join(KERNELS)}")
    records, _ = read_prepared(logs, read, steps)
    found = looked(records, kernel and kernel.upper())
    panels = look_panels(found) if output or save else ()
    names = ", ".join(dict.fromkeys(r.name for r in records))
    if output is not None:
        write_picture(output, PanelPicture(f"look: {names}", "bands: 95 %", panels))
    if save is not None:
        write_atomic(save, table(panels))
    if json:
        render.document(_document(found) | {"picture": output, "data": save})
        return
    show_decisions(decided(records))
    _show(found)
    render.files({"picture": output, "data": save}, picture="Picture", data="Numbers")


def _show(found: "Look") -> None:
    rows = [
        (f"{p.input} → {p.output}", _gain(p), _rise(p), _delay(p, found), _trusted(p))
        for p in found.paths
    ]
    render.table(("response", "gain", "63 % after", "delay [samples]", "clear up to"), rows)
    first = found.records[0]
    for i, name in enumerate(first.output_names):
        response = found.impulses[i]
        said = f"{name}: {100.0 * found.noise_share[i]:.1f} % of it is noise"
        said += f" (kernel {response.kernel}, {len(response.g)} samples)."
        if any(p.output == name and not p.settles for p in found.paths):
            said += " It has not settled by then: an integrator, or slow beside the sample time."
        render.say(said)
        d = found.distortions[i]
        if d is not None:
            render.say(_linearity(name, d))
    if not any(found.distortions):
        render.say(
            "Linear or not: drive it with whole periods of `sysid excite multisine --odd`.", "dim"
        )


def _gain(p: "Response") -> str:
    clear = abs(p.gain) > 1.96 * p.gain_error
    return f"{p.gain:.4g} ± {1.96 * p.gain_error:.2g}" if clear else "none seen"


def _rise(p: "Response") -> str:
    return f"{p.rise_s:.3g} s" if p.rise_s == p.rise_s else "–"


def _delay(p: "Response", found: "Look") -> str:
    d = p.delay
    if d.delay is None or abs(p.gain) <= 1.96 * p.gain_error:
        return "–"
    return f"{d.delay}" if d.certain else f"{d.delay} ({d.low}–{d.high})"


def _trusted(p: "Response") -> str:
    return f"{p.trusted_hz:.3g} Hz" if p.trusted_hz else "nowhere"


def _linearity(name: str, d: "Distortions") -> str:
    import math

    parts = [f"noise {d.noise:.0f} dB"]
    parts += [f"even {d.even:.0f} dB"] if math.isfinite(d.even) else []
    parts += [f"odd {d.odd:.0f} dB"] if math.isfinite(d.odd) else []
    parts += [f"between realisations {d.nonlinear:.0f} dB"] if math.isfinite(d.nonlinear) else []
    return f"{name}, of its excited lines: {', '.join(parts)} (period {d.period} samples)."


def _document(found: "Look") -> dict[str, Any]:
    from sysid.data.documents import by_field

    return {
        "paths": [by_field(p) for p in found.paths],
        "noise_share": list(found.noise_share),
        "kernels": [r.kernel for r in found.impulses],
        "distortions": [None if d is None else by_field(d) for d in found.distortions],
    }
