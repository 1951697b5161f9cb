"""Pictures of vehicles: fitted to logs, and on a soil."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.report.panels import Curve, Panel, draw_panels, panel
from sysid.robot.calibration.slip_model import Kinematic, Motion
from sysid.robot.calibration.trajectory import Part, Trajectory
from sysid.robot.calibration.vehicle_fit import VehicleFit
from sysid.vehicle.ground.assessment import SoilAssessment
from sysid.vehicle.ground.drawbar import Traction
from sysid.vehicle.ground.resistance import lateral_at_radius
from sysid.vehicle.ground.skid_steer import steady_turn
from sysid.vehicle.shear import shear_stress
from sysid.vehicle.soil import Shear

PIECE = 10.0
"""Length of the pieces [s] after which a drawn path starts again from the measured pose."""

PIECES = 6
"""Pieces that are drawn: more would lie on top of each other."""


def draw_vehicle_fit(path: Path, name: str, fitted: VehicleFit) -> None:
    """Draw held-out paths as measured, before and after, errors after two seconds, and slip."""
    part = max(fitted.holdout, key=lambda p: len(p.windows))
    models: dict[str, Motion] = {"before": Kinematic(fitted.known), "after": fitted.model}
    starts = _pieces(part)
    paths = [
        Curve(k, *_path(part.trajectory, m.predicted_pose(part.trajectory), starts))
        for k, m in models.items()
    ]
    measured = Curve("measured", *_path(part.trajectory, part.trajectory.pose, starts), colour=-1)
    at = part.trajectory.at[part.windows[:, 0]]
    errors = {k: m.errors([part]) for k, m in models.items()}
    away = [Curve(k, at, (e[:, 0] ** 2 + e[:, 1] ** 2) ** 0.5) for k, e in errors.items()]
    turned = [Curve(k, at, e[:, 2]) for k, e in errors.items()]
    held_out = f"held-out paths of {PIECE:g} s"
    panels = (
        panel(held_out, "x [m]", "y [m]", (*paths, measured), equal=True),
        panel("position after two seconds", "time [s]", "error [m]", away),
        panel("heading after two seconds", "time [s]", "error [rad]", turned),
        *_slip_panels(fitted),
    )
    acting = fitted.acting
    title = f"{name}: r = {acting.r:.4g} m, B = {acting.B:.4g} m as it turns"
    subtitle = (
        "mean error after two seconds on held-out paths: "
        f"{fitted.before.path:.3g} → {fitted.after.path:.3g} m, "
        f"{fitted.before.heading:.3g} → {fitted.after.heading:.3g} rad"
    )
    draw_panels(path, title, subtitle, panels)


def _pieces(part: Part) -> list[tuple[int, int]]:
    """First and last measurement of the pieces that are drawn."""
    d = part.trajectory
    pieces: list[tuple[int, int]] = []
    i, end = int(part.windows[0, 0]), int(part.windows[-1, 1])
    while i < end and len(pieces) < PIECES:
        j = i
        while j < end and d.at[j] - d.at[i] < PIECE and d.joins[j + 1] == d.joins[i]:
            j += 1
        if j > i + 1:
            pieces.append((i, j))
        i = max(j, i + 1)
    return pieces


def _path(
    trajectory: Trajectory, measurements: Array, pieces: list[tuple[int, int]]
) -> tuple[Array, Array]:
    """x and y of the measurements, each piece from the measured pose at its start."""
    x, y = [], []
    for i, j in pieces:
        a, b = measurements[i], trajectory.pose[i]
        turn = np.exp(1j * (b[2] - a[2]))
        moved = (measurements[i : j + 1, 0] - a[0]) + 1j * (measurements[i : j + 1, 1] - a[1])
        there = moved * turn + complex(b[0], b[1])
        x += [there.real, [np.nan]]
        y += [there.imag, [np.nan]]
    return np.concatenate(x), np.concatenate(y)


def _slip_panels(fitted: VehicleFit) -> list[Panel]:
    """The share of the way and of the turn that is lost, with bands of one standard error."""
    across = {
        "turning": ("turning", "turning |ω_R − ω_L| / (|ω_R| + |ω_L|)"),
        "speed": ("speed", "speed of the wheels [m/s]"),
        "acceleration": ("acceleration", "acceleration of the wheels [m/s²]"),
    }
    panels = []
    for key, (words, label) in across.items():
        shown = {"of the way": fitted.curves[key]}
        if key == "turning":
            shown["of the turn"] = fitted.curves["turn"]
        lines = []
        for name, points in shown.items():
            if points:
                at, slip, error = np.array([(p.at, p.slip, p.std_error) for p in points]).T
                lines.append(Curve(name, at, slip, slip - error, slip + error))
        if lines:
            panels.append(panel(f"lost against {words}", label, "share", lines))
    return panels


_RESIDUAL = 0.6
"""K_r of the law with a residual where the soil has none: for its shape beside the others."""
_FARTHEST = 3.0
"""Largest radius that is drawn [m]: beyond it turning takes little."""


def draw_soil(path: Path, name: str, assessment: SoilAssessment) -> None:
    """Draw what a soil does to a vehicle."""
    traction = assessment.traction
    even = () if traction.spread().distribution == "uniform" else (_pressure(traction),)
    draw_panels(
        path,
        f"{name} under a tracked vehicle of {traction.vehicle.mass:.3g} kg",
        "bands: 95 %" if traction.soil.std else "",
        (_shear(traction), *even, _pull(assessment), _turning(assessment)),
    )


def _shear(traction: Traction) -> Panel:
    soil, v = traction.soil, traction.vehicle
    mean = float(traction.load()) / (v.contact_length * v.track_width)
    j = np.linspace(0.0, 6.0 * soil.shear_modulus, 200)
    words = {
        Shear.JANOSI: "sand, clay, snow (2.28)",
        Shear.HUMP: "muskeg (2.29)",
        Shear.RESIDUAL: "compact sand, loam (2.30)",
    }
    lines = []
    for law, said in words.items():
        residual = soil.residual if soil.shear is law else _RESIDUAL
        ground = replace(soil, shear=law, residual=residual)
        label = "this: " if soil.shear is law else ""
        lines.append(Curve(label + said, 1e3 * j, shear_stress(ground, mean, j) / 1e3))
    title = f"Shear stress under the mean pressure, {mean / 1e3:.2g} kPa"
    return panel(title, "shear displacement [mm]", "shear stress [kPa]", lines)


def _pressure(traction: Traction) -> Panel:
    v = traction.vehicle
    x = np.linspace(0.0, v.contact_length, 400)
    p = traction.spread().at(x, traction.load(), v.contact_length, v.track_width)
    x, p = np.pad(x, 1, "edge"), np.pad(p, 1)  # from nothing to nothing: the axis begins at 0
    mean = float(traction.load()) / (v.contact_length * v.track_width)
    return panel(
        "Normal pressure along a track",
        "from the front [mm]",
        "pressure [kPa]",
        (
            Curve(str(traction.spread().distribution), 1e3 * x, p / 1e3),
            Curve("mean", 1e3 * x, np.full(len(x), mean / 1e3), colour=-1),
        ),
    )


def _pull(assessment: SoilAssessment) -> Panel:
    slips = np.linspace(0.0, 1.0, 101)
    traction = assessment.traction
    pull = traction.drawbar_pull(slips)
    at = np.array([0.0, *(p.slip for p in assessment.pulls)])
    spread = np.array([0.0, *(p.pull.std_error or 0.0 for p in assessment.pulls)])
    band = NORMAL * np.interp(slips, at, spread)
    return panel(
        "Drawbar pull against slip",
        "slip [1]",
        "force [N]",
        (
            Curve("drawbar pull", slips, pull, pull - band, pull + band),
            Curve("thrust", slips, traction.thrust(slips)),
        ),
    )


def _turning(assessment: SoilAssessment) -> Panel:
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
    m = np.array(moments)
    band = NORMAL * np.interp(radii, at[:, 0], at[:, 2]) if len(at) > 1 else np.zeros(len(m))
    return panel(
        "Moment against turning",
        "radius of the turn [m]",
        "moment [N m]",
        (
            Curve("shared shear strength", radii, m, m - band, m + band),
            Curve("μl, less on wide turns", radii, level * share),
            Curve("μl alone (2.36)", radii, np.full(len(radii), level), colour=-1),
        ),
    )
