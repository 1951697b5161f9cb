"""Pictures of the test bench, from its results."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sysid.testbench.pendulum.study import PendulumStudy
    from sysid.testbench.power.study import PowerBench


def draw_swing(path: Path, study: "PendulumStudy") -> None:
    """Draw the swings with their fit, what the fit leaves, and each period at its amplitude."""
    import numpy as np

    from sysid.report.plots import Line, Panel, ResponsePicture, write_picture
    from sysid.testbench.pendulum.inertia import small_swing_period

    first = study.logs[0]
    o, degrees = first.oscillation, 180.0 / np.pi
    panels = [
        Panel(
            f"swing, {first.swing.name}",
            "time [s]",
            "angle [°]",
            (
                Line("measured", o.t, degrees * o.angle),
                Line("fitted", o.t, degrees * o.fitted, reference=True),
            ),
        ),
        Panel(
            "what the fit leaves",
            "time [s]",
            "angle [°]",
            (Line("measured less fitted", o.t, degrees * (o.angle - o.fitted), dots=True),),
        ),
    ]
    lines, most = [], 0.0
    for log in study.logs[:5]:
        free = log.free
        sizes = log.oscillation.scale * degrees * np.abs(free.swings)
        whole = free.numbers[2:] - free.numbers[:-2] == 2
        at = 0.5 * (sizes[1:] + sizes[:-1])[whole]
        each = (free.passages[2:] - free.passages[:-2])[whole]
        lines.append(Line(log.swing.name, at, each, dots=True))
        most = max(most, float(at.max()))
    shown = np.linspace(0.0, most, 60)
    law = np.array([study.small_period / small_swing_period(1.0, a / degrees) for a in shown])
    lines.append(Line("pendulum with T₀", shown, law, reference=True))
    panels.append(Panel("each period", "amplitude [°]", "period [s]", tuple(lines)))
    write_picture(
        path,
        ResponsePicture(
            f"Inertia {study.corrected:.4f} ± {study.corrected_std_error:.2g} kg m²",
            f"T₀ = {study.small_period:.5f} ± {study.small_std_error:.2g} s, mean period "
            f"{study.period:.5f} s at {degrees * study.amplitude:.3g}°",
            tuple(panels),
        ),
    )


def draw_power(path: Path, bench: "PowerBench") -> None:
    """Draw each battery's voltage with its fit, and each staircase with its lines."""
    import numpy as np

    from sysid.report.plots import Line, Panel, ResponsePicture, write_picture

    panels = [
        Panel(
            f"battery, {b.name}",
            "time [s]" if b.charge is not None else "row",
            "voltage [V]",
            (Line("measured", b.t, b.voltage), Line("fitted", b.t, b.fitted, reference=True)),
        )
        for b in bench.batteries[:3]
    ]
    for bridge in bench.bridges[:3]:
        lines = []
        for name, d in bridge.directions().items():
            sign = 1.0 if name == "forward" else -1.0
            lines.append(Line(name, d.drive, d.answer, dots=True))
            shown = np.linspace(0.0, 1.0, 400)
            lines.append(Line("_", sign * shown, sign * d.line(shown), reference=True))
        title = f"bridge, {bridge.name} {bridge.side}".rstrip()
        panels.append(Panel(title, "drive", f"{bridge.quantity} [{bridge.unit}]", tuple(lines)))
    columns = min(len(panels), 2)
    measured = ", ".join(f"{k} {m.value:.3g}" for k, m in bench.supply().items())
    write_picture(path, ResponsePicture("Power supply", measured, tuple(panels), columns))
