"""Chapter 5.7: the inertia by the composite pendulum."""

import numpy as np

from sysid.report.panels import PanelPicture, panel
from sysid.testbench.pendulum.study import inertia_of_period
from thesis.entries import DRAWN, MISPRINT, Row, Sheet, compared, line, number

PERIOD = 1.735
AMPLITUDE = np.radians(10.0)
SECONDS = 35.0


def _bar_length() -> float:
    """Length of a bar of the printed mass and inertia, √(12 I₁/m₁) [m]."""
    return float(np.sqrt(12.0 * 0.0078 / 0.146))


def swing() -> Sheet:
    """5.27, Table 5.2 and the inertia."""
    study = inertia_of_period(PERIOD)
    low, high = study.interval
    worst, share = next(iter(study.contributions.items()))
    assert study.box is not None
    rows = (
        Row("5.27", "swings in the 35 s that were recorded", DRAWN,
            number(SECONDS / PERIOD, ".1f"), "–",
            "from the printed period and 10°; the damping is not printed, the curve has none"),
        Row("Table 5.2", "m, m₁ [kg], l, l₁ [m], I₁ [kg m²]", "1.592, 0.146, 0.7, 0.455, 0.0078",
            "taken as printed", "none",
            f"I₁ is a bar's of {_bar_length():.2f} m; from the hinge with its middle at l₁ it has "
            f"0.91 m and {0.146 * 0.91**2 / 12:.4f} kg m²: its length is not printed"),
        compared("Table 5.2", "J of (5.7) [kg m²]", 0.0652, study.inertia, ".4f"),
        Row("§5.7", "J for a period 5 ms shorter and longer [kg m²]", "one value",
            f"{number(low, '.4f')} to {number(high, '.4f')}", "± 8 %",
            "one interval between two peaks at 200 Hz is known to 5 ms"),
        Row("§5.7", "J with the amplitude of 10° corrected [kg m²]", "not corrected",
            number(study.corrected, ".4f"),
            number(100 * (study.corrected / study.inertia - 1), "+.1f") + " %",
            "T₀ = T/(1 + θ²/16): (2.49) is for small swings"),
        Row("§5.7", "J of a box of that mass and the size of §7.2 [kg m²]", "–",
            number(study.box, ".4f"), f"a {number(study.inertia / study.box, '.0f')}th",
            "a body of 0.19 × 0.134 m cannot have the printed J; "
            f"{worst} alone means ± {number(share, '.3f')} kg m²"),
        Row("(2.48)", "sign of the restoring moment", "−", "+", MISPRINT,
            "with the printed sign the pendulum falls away"),
    )  # fmt: skip
    t = np.linspace(0.0, SECONDS, 141 * 5)
    angle = np.degrees(AMPLITUDE * np.cos(2 * np.pi * t / PERIOD))
    periods = np.linspace(1.70, 1.77, 71)
    panels = (
        panel("5.27: oscillation", "time [s]", "θ [°]", (line("θ", t[:200], angle[:200]),)),
        panel("§5.7: inertia against the period", "T [s]", "J [kg m²]",
              (line("(5.7)", periods,
                    np.array([study.hanging.inertia(float(p)) for p in periods])),
               line("printed", periods, np.full(len(periods), 0.0652), True))),
    )  # fmt: skip
    picture = PanelPicture("The pendulum", "T = 1.735 s, 10 s of 35", panels, columns=2)
    return Sheet(rows, "chapter5/pendulum.svg", picture)
