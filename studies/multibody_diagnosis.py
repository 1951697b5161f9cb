"""What ``diagnose`` makes of a vehicle in MuJoCo, whose scrubbing no formula of ours put in.

On every floor the vehicle drives five missions to goals by chance, whose logs are diagnosed, and
four that are held out; paths by the wheel speeds of the held-out ones are compared with those
driven, before and after. Needs the extra ``physics``; real logs are those of
``records.data_folder``, and left out without them.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from studies.motion_report import VOLTS, motor
from studies.records import data_folder
from studies.runner import Study, finished, seeds
from sysid.data.preparation import Preparation
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.pose.diagnosis import diagnose_pose
from sysid.effects.ground import Ground
from sysid.report.markdown import table
from sysid.report.missions.panels import disc
from sysid.report.panels import Curve, PanelPicture, panel
from sysid.report.plots import write_picture
from sysid.robot.calibration.logs import read_vehicle_logs
from sysid.robot.calibration.windows import path_of
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.physics import ground_effects
from sysid.vehicle.kinematics import Geometry

STUDY = Study("multibody_diagnosis", "multibody_diagnosis.md", first=21)
FLOORS: Mapping[str, Mapping[str, Any]] = {
    "the thesis's, μ = 0.1": {},
    "ice, μ = 0.05": {"friction": 0.05},
    "μ = 0.3": {"friction": 0.3},
    "μ = 0.6": {"friction": 0.6},
    "μ = 0.2, 4 kg on 6 wheels a side": {"friction": 0.2, "mass": 4.0, "wheels": 6, "L": 0.12},
    "μ = 0.8, centre of mass 1 cm ahead": {"friction": 0.8, "centre": 0.01},
    "μ = 0.15, 2.5 kg, centre of mass 1.5 cm behind": {
        "friction": 0.15,
        "mass": 2.5,
        "centre": -0.015,
    },
    "μ = 0.45, 3 kg on 6 wheels a side": {"friction": 0.45, "mass": 3.0, "wheels": 6, "L": 0.12},
}
TRAINED, HELD = 5, 2
"""Missions to goals by chance that are diagnosed, and that are held out beside both missions of the
thesis."""

NOISE = (0.05, 0.001, 0.002)
"""Of speeds [rad/s], place [m] and heading [rad]."""

ROBOTS = (
    ("Husky, mixed ground", "husky_2023_longest.csv", Geometry(0.165, 0.55)),
    ("Warthog, asphalt", "warthog_asphalt_slow_2024_8_8_longest.csv", Geometry(0.30, 1.08)),
    ("Warthog, gravel", "warthog_gravel_2024_8_6_longest.csv", Geometry(0.30, 1.08)),
)
"""Measured drives (norlab-ulaval/DRIVE) and the lengths of their data sheets."""

SECOND: Mapping[str, Any] = {"goal": (6, 3), "obstacles": [(2, 3.5), (3, 1), (4, 2.5), (5, 3)]}
THESIS: Mapping[str, Mapping[str, Any]] = {"mission 1": {"goal": (1, 0)}, "mission 2": SECOND}

HEAD = f"""# Diagnosis of another physics

A vehicle in [MuJoCo](../docs/mujoco.md) on rows
of wheels that slide with Coulomb friction, so that what scrubbing does comes out of contacts and no
effect is put in. Two of the thesis's motors drive it; their dry friction is true, and a plain base
lacks it. `sysid diagnose` gets the logs of {TRAINED} missions to goals by chance (noise {NOISE[0]}
rad/s, {1000 * NOISE[1]:g} mm, {NOISE[2]} rad). *Off* is how far the path by the wheel speeds lies
from the one driven (RMS) on held-out missions: both of the thesis, mission 2 to where it touches an
obstacle if it does, and {HELD} to other goals.

The aim is 80 % less. The rules were made while looking at seeds 1 and 2 and at the first six
floors; goals and noise of the seeds below had not been looked at, nor had the last two floors.
The last floor was written anew twice before it gave a result: five wheels a side are refused, and
on eight the vehicle tipped over. `lateral-slip` is a centre of rotation off the middle, or a slide
outwards. The wheels also roll as if their radius were 0.4 % smaller; why was not examined.

"""


def driven(spec: Mapping[str, Any], floor: Mapping[str, Any], seed: int) -> Record:
    """The log of a mission, to where the vehicle touches an obstacle if it does."""
    vehicle = {"lifted": True, "command_scale": VOLTS, "speed_scale": 1.0}
    motion = {"kind": "multibody", **floor}
    mission = Mission.model_validate({**spec, "motion": motion, "vehicle": vehicle})
    log = dict(simulate(mission, as_robot(motor(), mission)[0]).log)
    free = np.cumsum(log["touching"]) == 0
    log = {name: column[free] for name, column in log.items()}
    rng = np.random.default_rng(seed)
    speed, place, angle = NOISE
    omega = np.column_stack([log["omega_l"], log["omega_r"]])
    pose = np.column_stack([log["x"], log["y"], np.unwrap(log["psi"])])
    return Record(
        np.column_stack([log["pwm_l"], log["pwm_r"]]),
        omega + speed * rng.standard_normal(omega.shape),
        float(log["t"][1] - log["t"][0]),
        (Channel("pwm_l", ""), Channel("pwm_r", "")),
        (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
        pose + np.array([place, place, angle]) * rng.standard_normal(pose.shape),
        name=f"mission to {tuple(spec['goal'])}",
    )


def goals(rng: np.random.Generator, count: int) -> list[dict[str, Any]]:
    """Missions to goals in all directions, 1.5 m to 3 m away."""
    far, at = rng.uniform(1.5, 3.0, count), rng.uniform(-math.pi, math.pi, count)
    return [
        {"goal": (round(float(d * math.cos(a)), 2), round(float(d * math.sin(a)), 2))}
        for d, a in zip(far, at, strict=True)
    ]


def _path(log: Record, ground: Ground) -> Array:
    assert log.pose is not None
    return path_of(log.y, log.dt, ground, Geometry(), log.pose[0])


def _off(log: Record, path: Array) -> float:
    assert log.pose is not None
    return float(np.sqrt(np.mean(np.sum((path - log.pose)[:, :2] ** 2, axis=1))))


def run(name: str, seed: int) -> dict[str, Any]:
    """One floor and one draw of goals: what is named, and paths before and after."""
    floor = FLOORS[name]
    rng = np.random.default_rng(seed)
    logs = [driven(s, floor, 100 * seed + k) for k, s in enumerate(goals(rng, TRAINED))]
    found = diagnose(logs, geometry=Geometry())
    ground = ground_effects(found.after.structure, found.after.theta)
    others = {f"goal {k + 1}": s for k, s in enumerate(goals(rng, HELD))}
    paths = {}
    for k, (goal, spec) in enumerate({**THESIS, **others}.items()):
        log = driven(spec, floor, 100 * seed + 50 + k)
        before, after = _path(log, Ground()), _path(log, ground)
        rows = [p[:, :2].round(4).tolist() for p in (log.pose, before, after)]
        paths[goal] = {"off": (_off(log, before), _off(log, after)), "rows": rows}
    return {
        "effects": [
            {"id": e.id, "numbers": {p.name: p.value for p in e.parameters}} for e in found.effects
        ],
        "verdict": found.verdict,
        "closed": found.gap.closed_percent,
        "said": list(found.warnings),
        "paths": paths,
    }


def _named(effect: Mapping[str, Any]) -> str:
    """An effect, and its number where it has one for both sides."""
    numbers = list(effect["numbers"].items())
    return effect["id"] + (f" ({numbers[0][0]} {numbers[0][1]:.3g})" if len(numbers) == 1 else "")


def _less(before: float, after: float) -> str:
    return f"{100.0 * (1.0 - after / before):.0f} %"


def _tables(runs: Mapping[tuple[str, int], Mapping[str, Any]]) -> str:
    first, second, share = [], [], []
    for (floor, seed), r in runs.items():
        named = "; ".join(map(_named, r["effects"])) or r["verdict"]
        total = [sum(p["off"][i] for p in r["paths"].values()) for i in (0, 1)]
        share.append(1.0 - total[1] / total[0])
        first.append([floor, str(seed), named, f"{r['closed']:.0f} %", _less(*total)])
        cells = [
            f"{1000 * p['off'][0]:.0f} → {1000 * p['off'][1]:.0f}" for p in r["paths"].values()
        ]
        second.append([floor, str(seed), *cells])
    names = list(next(iter(runs.values()))["paths"])
    worst, best = min(share), max(share)
    text = (
        f"Over all {len(runs)} the path error shrinks by {100 * np.median(share):.0f} % in the "
        f"median, from {100 * worst:.0f} % to {100 * best:.0f} %; by 80 % or more in "
        f"{sum(s >= 0.8 for s in share)}.\n\n"
    )
    headings = ["floor", "seed", "named", "gap closed", "path error less"]
    text += table(headings, first, "lllrr")
    text += "\n\nOff by [mm], before → after:\n\n"
    return text + table(["floor", "seed", *names], second, "ll" + "r" * len(names)) + "\n"


def _robots() -> str:
    folder = data_folder()
    text = "\n## Real robots\n\n"
    if folder is None:
        return text + "Their logs were not there when this page was made.\n"
    rows = []
    for name, file, geometry in ROBOTS:
        log = read_vehicle_logs([folder / "drive" / file], ReadOptions(), Preparation())[0][0]
        cut = round(0.7 * len(log))
        found = diagnose_pose([_rows(log, 0, cut)], [_rows(log, cut, len(log))], geometry)
        assert found is not None
        c = found.gap.channels
        place = [math.hypot(getattr(c["x"], w), getattr(c["y"], w)) for w in _WHEN]
        turn = [float(getattr(c["psi"], w)) for w in _WHEN]
        named = [
            _named({"id": e.id, "numbers": {p.name: p.value for p in e.parameters}})
            for e in found.effects
        ]
        cells = (f"{a:.3f} → {b:.3f} ({_less(a, b)} less)" for a, b in (turn, place))
        rows.append([name, "; ".join(named), " ".join(found.warnings) or "–", *cells])
    headings = ["log", "named", "said beside", "heading [rad]", "place [m]"]
    return (
        text + "The vehicle stage alone on lidar poses of norlab-ulaval/DRIVE with the lengths of "
        "the data sheets: numbers from the first 70 % of a log, RMS errors after two seconds over "
        "the last 30 %. `track-width` 0.55 is a width of 1.8 times the geometric one.\n\n"
        + table(headings, rows)
    )


_WHEN = ("rmse_before", "rmse_after")


def _rows(log: Record, first: int, last: int) -> Record:
    assert log.pose is not None
    at = slice(first, last)
    return replace(log, u=log.u[at], y=log.y[at], pose=log.pose[at])


def _draw(path: Path, runs: Mapping[tuple[str, int], Mapping[str, Any]]) -> None:
    panels = []
    for (floor, seed), r in runs.items():
        if seed != STUDY.first or len(panels) == 4:
            continue
        lines = [
            Curve(name, *np.array(rows).T)
            for name, rows in zip(
                ("driven", "wheels, before", "wheels, after"),
                r["paths"]["mission 2"]["rows"],
                strict=True,
            )
        ]
        discs = [disc(float(x), float(y), 0.1) for x, y in SECOND["obstacles"]]
        panels.append(panel(floor, "x [m]", "y [m]", tuple(lines), equal=True, around=discs))
    note = "mission 2, held out: driven in MuJoCo, and as the wheel speeds say"
    write_picture(path, PanelPicture("Paths before and after", note, tuple(panels), 2))


def main() -> None:
    """Run what is not there, and write the page."""
    asked = STUDY.asked(__doc__)
    wanted = {f"{name}/{seed}": (name, seed) for name in FLOORS for seed in seeds(asked)}
    runs = {wanted[key]: found for key, found in finished(run, wanted, asked).items()}
    _draw(asked.out.with_suffix(".svg"), runs)
    text = HEAD + _tables(runs) + f"\n![paths of mission 2]({asked.out.stem}.svg)\n"
    STUDY.write(asked, text + _robots())


if __name__ == "__main__":
    main()
