"""What ``sysid vehicle`` shows: degrees, centre, wheels, matrices and answers."""

import math
from typing import Any

from .. import render

_MOTIONS = {"vx": "1 m/s forward", "vy": "1 m/s to the left", "wz": "1 rad/s turning"}
_UNITS = {"vx": "m/s", "vy": "m/s", "wz": "rad/s"}
_WORDS = {"vx": "forward", "vy": "to the left", "wz": "turning"}


def show(facts: dict[str, Any]) -> None:
    """Print everything that is known of a vehicle."""
    rows: list[tuple[str, object]] = [
        ("mobility δm", facts["mobility"]),
        ("steerability δs", facts["steerability"]),
        ("manoeuvrability δM", facts["manoeuvrability"]),
    ]
    rows += [
        (f"largest speed {_WORDS[axis]} [{unit}]", _limit(facts["limits"][key]))
        for axis, key, unit in (
            ("vx", "vx_m_s", "m/s"),
            ("vy", "vy_m_s", "m/s"),
            ("wz", "wz_rad_s", "rad/s"),
        )
    ]
    tracks = facts["tracks"]
    if tracks is not None:
        rows.append(
            (
                "tracks: width, effective width [m]",
                f"{tracks.width:.4g}, {tracks.effective_width:.4g}",
            )
        )
    for name, key in (("mass [kg]", "mass_kg"), ("yaw inertia [kg m²]", "yaw_inertia_kg_m2")):
        if facts[key] is not None:
            rows.append((name, render.number(facts[key], 4)))
    render.table((facts["name"], ""), rows)
    render.say(f"{facts['name']}: {facts['sentence']}.")
    render.say(f"Centre of rotation: {facts['icr']['sentence']}.")
    _show_wheels(facts["wheels"])
    _show_matrices(facts)
    for key, shown in (("inverse", _show_inverse), ("forward", _show_forward)):
        if key in facts:
            shown(facts[key])
    render.cautions(facts["notes"])
    render.files(facts, plot="Picture", urdf="URDF", mjcf="MuJoCo model")


def _show_wheels(wheels: list[dict[str, Any]]) -> None:
    rows = []
    for wheel in wheels:
        place = f"{wheel['x']:.4g}, {wheel['y']:.4g}"
        rows.append(
            [wheel["name"], wheel["kind"], place, _degrees(wheel["heading"]), wheel["r"]]
            + [_cell(wheel, axis) for axis in _MOTIONS]
        )
    headings = ("wheel", "kind", "x, y [m]", "heading", "r [m]", *_MOTIONS.values())
    render.table(
        headings,
        rows,
        caption="wheel speeds [rad/s] and steering angles; –: impossible without sliding",
    )


def _cell(wheel: dict[str, Any], axis: str) -> str:
    speed = wheel["speeds"][axis]
    if speed is None:
        return "–"
    angle = wheel.get("angles", {}).get(axis)
    at = f" at {_degrees(angle)}" if angle is not None else ""
    return f"{render.number(speed, 4)}{at}"


def _show_matrices(facts: dict[str, Any]) -> None:
    """J1 with the diagonal of J2, and C1, a row a wheel."""
    rows: list[tuple[str, ...]] = []
    names = [w["name"] for w in facts["wheels"]]
    for name, row, radius in zip(names, facts["J1"], facts["J2"].diagonal(), strict=True):
        rows.append((f"{name} rolls", *_entries(row), f"{radius:.4g} ω"))
    rigid = [w["name"] for w in facts["wheels"] if w["kind"] in ("fixed", "steerable")]
    rows += [
        (f"{name} does not slide", *_entries(row), "0")
        for name, row in zip(rigid, facts["C1"], strict=True)
    ]
    casters = [w["name"] for w in facts["wheels"] if w["kind"] == "caster"]
    offsets = facts["C2_casters"].diagonal()
    for name, row, offset in zip(casters, facts["C1_casters"], offsets, strict=True):
        rows.append((f"{name} swings", *_entries(row), f"{offset:.4g} dφ/dt"))
    render.table(
        ("constraint", "Vx", "Vy", "dψ/dt", "equals"),
        rows,
        caption=f"J1 ξ = J2 ω, C1 ξ = 0; rank of C1 at these angles: {facts['rank_C1']}",
    )


def _entries(row: Any) -> tuple[str, str, str]:
    vx, vy, wz = (f"{0.0 if abs(v) < 1e-12 else v:.4g}" for v in map(float, row))
    return vx, vy, wz


def _show_inverse(inverse: dict[str, Any]) -> None:
    rows = [
        (
            name,
            wheel["speed"],
            "–" if wheel["angle"] is None else _degrees(wheel["angle"]),
            wheel["share_of_max_speed"],
        )
        for name, wheel in inverse["wheels"].items()
    ]
    render.table(
        ("wheel", "speed [rad/s]", "steering angle", "share of largest speed"),
        rows,
        title=f"For {_motion(inverse['possible'])}",
    )
    render.say(inverse["sentence"])
    render.say(f"Centre of rotation: {inverse['icr']['sentence']}.")


def _show_forward(forward: dict[str, Any]) -> None:
    names = dict.fromkeys([*forward["rolling_slip_m_s"], *forward["sliding_m_s"]])
    rows = [
        (name, *(_slip(forward[key].get(name)) for key in ("rolling_slip_m_s", "sliding_m_s")))
        for name in names
    ]
    render.table(
        ("wheel", "rim faster than ground [m/s]", "slides to its left [m/s]"),
        rows,
        title=f"The speeds give {_motion(forward['twist'])}",
    )
    render.say(forward["sentence"])
    render.say(f"Centre of rotation: {forward['icr']['sentence']}.")


def _slip(value: float | None) -> str:
    return "–" if value is None else f"{0.0 if abs(value) < 1e-12 else value:.4g}"


def _motion(twist: dict[str, float]) -> str:
    parts = []
    for axis, value in twist.items():
        shown = 0.0 if abs(value) < 1e-12 else value
        parts.append(f"{shown:.4g} {_UNITS[axis]} {_WORDS[axis]}")
    return ", ".join(parts)


def _limit(value: float | None) -> str:
    if value is None:
        return "not known"
    return render.number(value, 4) if value else "0 (impossible without sliding)"


def _degrees(angle: float) -> str:
    shown = math.degrees(angle)
    return f"{0.0 if abs(shown) < 1e-9 else shown:.4g}°"
