"""Pictures of a look at a log: step and frequency responses with bands, noise, distortions."""

import numpy as np

from sysid.estimation.look.distortion import Distortions
from sysid.estimation.look.summary import Look
from sysid.report.panels import RAD, Curve, Panel, Panels
from sysid.report.style import labelled

WIDE = 1.96
"""Standard errors of a 95 % band."""

KINDS = ("excited", "odd, not excited", "even, not excited")


def look_panels(found: Look) -> Panels:
    """Impulse, step and frequency responses of every output, coherence, and distortion lines."""
    first, panels = found.records[0], []
    for i, (channel, response) in enumerate(zip(first.outputs, found.impulses, strict=True)):
        t = response.dt * np.arange(len(response.g), dtype=np.float64)
        for what, values, errors in (
            ("impulse", response.g, response.error),
            ("step", response.step, response.step_error),
        ):
            curves = tuple(
                Curve(u, t, y, y - WIDE * e, y + WIDE * e, colour=j)
                for j, (u, y, e) in enumerate(
                    zip(first.input_names, values.T, errors.T, strict=True)
                )
            )
            axis = labelled(channel.name, channel.unit)
            title = f"{channel.name}: response to {'an impulse' if what == 'impulse' else 'a step'}"
            panels.append(Panel(f"{what}-{channel.name}", title, "time [s]", axis, curves))
        f = found.frequency
        gains, phases = [], []
        for j, u in enumerate(first.input_names):
            known = np.isfinite(f.error[:, i, j])
            w, g, error = f.w[known], f.value[known, i, j], f.band[known, i, j]
            size = np.abs(g)
            low = np.maximum(size - error, 0.03 * size)
            gains.append(Curve(u, w, size, low, size + error, colour=j))
            sure = error < size
            turn = np.degrees(np.unwrap(np.angle(g[sure])))
            reach = np.degrees(np.arcsin(error[sure] / size[sure]))
            phases.append(Curve(u, w[sure], turn, turn - reach, turn + reach, colour=j))
        noise = np.sqrt(f.noise[:, i])
        name, by = channel.name, f"By {f.method}."
        panels += [
            Panel(f"gain-{name}", f"{name}: gain", RAD, "|G|", tuple(gains), log_x=True, log_y=True,
                  note=by),
            Panel(f"phase-{name}", f"{name}: phase", RAD, "arg G [°]", tuple(phases), log_x=True,
                  note="Where the gain is beyond its band."),
        ]  # fmt: skip
        coherence = Curve("", f.w, f.coherence[:, i])
        panels.append(
            Panel(
                f"coherence-{channel.name}", f"{channel.name}: coherence", RAD, "γ²", (coherence,),
                log_x=True, limits=(0.0, 1.05),
            )
        )  # fmt: skip
        panels.append(
            Panel(
                f"noise-{channel.name}", f"{channel.name}: noise", RAD, "√PSD",
                (Curve("", f.w, noise),), log_x=True, log_y=True,
            )
        )  # fmt: skip
        distorted = found.distortions[i]
        if distorted is not None:
            panels.append(_lines(channel.name, distorted))
    return tuple(panels)


def _lines(name: str, d: Distortions) -> Panel:
    frequency, size, kind, noise = d.lines.T
    curves = tuple(
        Curve(words, frequency[kind == k], size[kind == k], kind="dots", colour=k)
        for k, words in enumerate(KINDS)
        if np.any(kind == k)
    )
    noises = Curve("noise", frequency, np.maximum(noise, 1e-300), colour=-1)
    title = f"{name}: lines of its period"
    return Panel(f"lines-{name}", title, "frequency [Hz]", "|Y|", (*curves, noises), log_y=True)
