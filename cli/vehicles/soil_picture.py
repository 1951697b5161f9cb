"""The picture of ``sysid soil``: shear, pressure, drawbar pull and turning."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sysid.report.missions.response_drawing import Panel
    from sysid.vehicle.ground.assessment import SoilAssessment
    from sysid.vehicle.ground.drawbar import Traction

_RESIDUAL = 0.6
"""K_r of the law with a residual where the soil has none: for its shape beside the others."""
_FARTHEST = 3.0
"""Largest radius that is drawn [m]: beyond it turning takes little."""


def draw_soil(path: Path, name: str, assessment: "SoilAssessment") -> None:
    """Draw what a soil does to a vehicle."""
    from sysid.report.plots import ResponsePicture, write_picture

    traction = assessment.traction
    write_picture(
        path,
        ResponsePicture(
            f"{name} under a tracked vehicle of {traction.vehicle.mass:.3g} kg",
            "bands: one standard deviation of the soil's numbers" if traction.soil.std else "",
            (_shear(traction), _pressure(traction), _pull(assessment), _turning(assessment)),
            columns=2,
        ),
    )


def _shear(traction: "Traction") -> "Panel":
    import numpy as np

    from sysid.report.plots import Line, Panel
    from sysid.vehicle.shear import shear_stress
    from sysid.vehicle.soil import Shear

    soil, v = traction.soil, traction.vehicle
    mean = float(traction.load()) / (v.contact_length * v.track_width)
    j = np.linspace(0.0, 6.0 * soil.shear_modulus, 200)
    words = {
        Shear.JANOSI: "loose sand, clay, snow (2.28)",
        Shear.HUMP: "muskeg (2.29)",
        Shear.RESIDUAL: "compact sand, loam (2.30)",
    }
    lines = []
    for law, said in words.items():
        residual = soil.residual if soil.shear is law else _RESIDUAL
        ground = replace(soil, shear=law, residual=residual)
        label = ": this soil" if soil.shear is law else ""
        lines.append(Line(said + label, 1e3 * j, shear_stress(ground, mean, j) / 1e3))
    title = f"Shear stress under the mean pressure, {mean / 1e3:.2g} kPa"
    return Panel(title, "shear displacement [mm]", "shear stress [kPa]", tuple(lines))


def _pressure(traction: "Traction") -> "Panel":
    import numpy as np

    from sysid.report.plots import Line, Panel

    v = traction.vehicle
    x = np.linspace(0.0, v.contact_length, 400)
    p = traction.spread().at(x, traction.load(), v.contact_length, v.track_width)
    x, p = np.pad(x, 1, "edge"), np.pad(p, 1)  # from nothing to nothing: the axis begins at 0
    mean = float(traction.load()) / (v.contact_length * v.track_width)
    return Panel(
        "Normal pressure along a track",
        "from the front [mm]",
        "pressure [kPa]",
        (
            Line(str(traction.spread().distribution), 1e3 * x, p / 1e3),
            Line("mean", 1e3 * x, np.full(len(x), mean / 1e3), reference=True),
        ),
    )


def _pull(assessment: "SoilAssessment") -> "Panel":
    import numpy as np

    from sysid.report.plots import Line, Panel

    slips = np.linspace(0.0, 1.0, 101)
    traction = assessment.traction
    pull = traction.drawbar_pull(slips)
    at = np.array([0.0, *(p.slip for p in assessment.pulls)])
    spread = np.array([0.0, *(p.pull.std_error or 0.0 for p in assessment.pulls)])
    band = np.interp(slips, at, spread)
    outline = (np.append(slips, slips[::-1]), np.append(pull - band, (pull + band)[::-1]))
    return Panel(
        "Drawbar pull against slip",
        "slip [1]",
        "force [N]",
        (Line("drawbar pull", slips, pull), Line("thrust", slips, traction.thrust(slips))),
        outlines=(outline,) if np.any(spread) else (),
    )


def _turning(assessment: "SoilAssessment") -> "Panel":
    import numpy as np

    from sysid.errors import ModelError
    from sysid.report.plots import Line, Panel
    from sysid.vehicle.ground.resistance import lateral_at_radius
    from sysid.vehicle.ground.skid_steer import steady_turn

    traction = assessment.traction
    level = assessment.moment_in_the_middle
    radii = _FARTHEST * np.linspace(0.0, 1.0, 41) ** 2  # finer where it is tight
    moments = []
    for radius in radii:
        try:
            moments.append(steady_turn(traction, float(radius)).moment)
        except ModelError:
            moments.append(float("nan"))
    share = lateral_at_radius(1.0, radii, traction.vehicle.geometry.B)
    known = [(t.radius, t.moment.value, t.moment.std_error) for t in assessment.turns]
    at = np.array([k for k in known if None not in k and k[0] <= _FARTHEST], dtype=np.float64)
    bands = []
    if len(at) > 1:
        band, m = np.interp(radii, at[:, 0], at[:, 2]), np.array(moments)
        r, low, high = (v[np.isfinite(m)] for v in (radii, m - band, m + band))
        bands.append((np.append(r, r[::-1]), np.append(low, high[::-1])))
    return Panel(
        "Moment against turning",
        "radius of the turn [m]",
        "moment [N m]",
        (
            Line("shared shear strength", radii, np.array(moments)),
            Line("μl, less on wide turns", radii, level * share),
            Line("μl alone (2.36)", radii, np.full(len(radii), level), reference=True),
        ),
        outlines=tuple(bands),
    )
