"""The picture of ``sysid fit-vehicle``: held-out paths, errors over time, and slip."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sysid.data.record import Array
    from sysid.report.plots import Panel
    from sysid.robot.calibration.slip_curves import SlipPoint
    from sysid.robot.calibration.slip_model import Motion
    from sysid.robot.calibration.trajectory import Part, Trajectory
    from sysid.robot.calibration.vehicle_fit import VehicleFit

PIECE = 10.0
"""Length of the pieces [s] after which a drawn path starts again from the measured pose."""

PIECES = 6
"""Pieces that are drawn: more would lie on top of each other."""


def drawn(path: Path, name: str, fitted: "VehicleFit") -> None:
    """Draw held-out paths as measured, before and after, errors after two seconds, and slip."""
    from sysid.report.plots import Line, Panel, ResponsePicture, write_picture
    from sysid.robot.calibration.slip_model import Kinematic

    part = max(fitted.holdout, key=lambda p: len(p.windows))
    models: dict[str, Motion] = {"before": Kinematic(fitted.known), "after": fitted.model}
    starts = _pieces(part)
    paths = [
        Line(k, *_path(part.trajectory, m.predicted_pose(part.trajectory), starts))
        for k, m in models.items()
    ]
    measured = Line(
        "measured", *_path(part.trajectory, part.trajectory.pose, starts), reference=True
    )
    at = part.trajectory.at[part.windows[:, 0]]
    errors = {k: m.errors([part]) for k, m in models.items()}
    away = [Line(k, at, (e[:, 0] ** 2 + e[:, 1] ** 2) ** 0.5) for k, e in errors.items()]
    turned = [Line(k, at, e[:, 2]) for k, e in errors.items()]
    panels = (
        Panel(f"held-out paths of {PIECE:g} s", "x [m]", "y [m]", (*paths, measured), plane=True),
        Panel("position after two seconds", "time [s]", "error [m]", tuple(away)),
        Panel("heading after two seconds", "time [s]", "error [rad]", tuple(turned)),
        *_slip_panels(fitted),
    )
    acting = fitted.acting
    title = f"{name}: r = {acting.r:.4g} m, B = {acting.B:.4g} m as it turns"
    subtitle = (
        "mean error after two seconds on held-out paths: "
        f"{fitted.before.path:.3g} → {fitted.after.path:.3g} m, "
        f"{fitted.before.heading:.3g} → {fitted.after.heading:.3g} rad"
    )
    write_picture(path, ResponsePicture(title, subtitle, panels))


def _pieces(part: "Part") -> "list[tuple[int, int]]":
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
    trajectory: "Trajectory", measurements: "Array", pieces: "list[tuple[int, int]]"
) -> "tuple[Array, Array]":
    """x and y of the measurements, each piece from the measured pose at its start."""
    import numpy as np

    x, y = [], []
    for i, j in pieces:
        a, b = measurements[i], trajectory.pose[i]
        turn = np.exp(1j * (b[2] - a[2]))
        moved = (measurements[i : j + 1, 0] - a[0]) + 1j * (measurements[i : j + 1, 1] - a[1])
        there = moved * turn + complex(b[0], b[1])
        x += [there.real, [np.nan]]
        y += [there.imag, [np.nan]]
    return np.concatenate(x), np.concatenate(y)


def _slip_panels(fitted: "VehicleFit") -> "list[Panel]":
    """The share of the way and of the turn that is lost, with bands of one standard error."""
    from sysid.report.plots import Line, Panel

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
        curves = {name: points for name, points in shown.items() if points}
        if curves:
            lines = tuple(
                Line(name, _column(points, "at"), _column(points, "slip"))
                for name, points in curves.items()
            )
            bands = tuple(_band(points) for points in curves.values())
            panels.append(Panel(f"lost against {words}", label, "share", lines, outlines=bands))
    return panels


def _column(points: "tuple[SlipPoint, ...]", name: str) -> "Array":
    import numpy as np

    return np.array([getattr(p, name) for p in points], dtype=np.float64)


def _band(points: "tuple[SlipPoint, ...]") -> "tuple[Array, Array]":
    """The closed line around a curve, one standard error away."""
    import numpy as np

    at, slip, error = (_column(points, n) for n in ("at", "slip", "std_error"))
    return np.concatenate([at, at[::-1]]), np.concatenate([slip + error, (slip - error)[::-1]])
