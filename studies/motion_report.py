"""``motions.md``: the thesis's motors under its vehicle, by every motion, on several soils."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import sysid_datasets

from sysid.data.preprocess import Detrend
from sysid.data.record import Channel
from sysid.report.markdown import table
from sysid.report.missions.panels import surroundings
from sysid.report.panels import Curve, PanelPicture, panel
from sysid.report.plots import write_picture
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tracks.torque import motors_of
from sysid.runners import floats
from sysid.structures.grey_box.dc_motor.structure import DCMotor, MotorPhysics
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.plant import Plant
from sysid.vehicle.dynamics import VehicleState, step
from sysid.vehicle.kinematics import Geometry

VOLTS = 7.5
"""At the H-bridge of the thesis's robot [V]."""

PRINTED = {"motor_friction": 2.9658e-5, "friction_torque": 0.0, "load_inertia": 0.0}
"""What of the motor is not the structure's default, which is what the thesis prints."""

CASES = (
    ("kinematic", ""),
    ("slip", "concrete"),
    ("slip", "carpet"),
    ("slip", "dry-sand"),
    ("dynamic", "concrete"),
    ("dynamic", "carpet"),
    ("dynamic", "dry-sand"),
)
"""Motion and soil."""

_DYNAMIC = tuple(f"dynamic, {soil}" for motion, soil in CASES if motion == "dynamic")

KP_YAW = 0.4
"""Gain of the thesis's P controller of the yaw; its command is an opposite drive of the tracks."""

COMPASS: Mapping[str, Any] = {
    "navigation": {"kind": "compass"},
    "control": {"kp_yaw": 3 * KP_YAW},
}
MEASURED = ", compass"

MISSIONS = ("goal_1m", "obstacles_6_3")

HEAD = """# Rolling, slipping, with mass: the missions by every motion

Two of the thesis's motors (constants as printed, 120:1, {volts} V at full drive, a copy for each
track) under its vehicle ({mass:g} kg, {inertia:g} kg m², r = {r:g} m, B = {B:g} m, L = {L:g} m).
Guidance, control and odometry are the thesis's. The motions stand in [motion](../docs/motion.md),
the soils in [terramechanics](../docs/terramechanics.md). Times in seconds, lengths in metres.

## How fast, how well it turns

*Top* is straight at full drive. *Kept* is the share of the turn told by the wheels that is driven,
on the spot at full drive and in a curve of full drive and half. *Least turn* is the smallest
opposite drive of both tracks that turns it at all.

"""

SPEED = """
The thesis gives about 0.43 m/s. Its constants and {volts} V predict {top:.2f} m/s without load and
{ground:.2f} m/s on concrete; 0.43 m/s on concrete takes {drop:.1f} V at the motors: {lost:.1f} V
less, which H-bridge, wires and battery may well lose.

## Missions

*Ends at* is where it truly is, *off* how far from the goal that is: navigation believes to be there
where the outcome is arrived. *Curve* is the largest distance from the straight line, *clear* the
smallest to a surface. The last rows have a compass for their heading, and a yaw gain three times
the thesis's.

"""

PICTURE = """
![paths by every motion](motions.svg)

- Straight ahead the motions differ by the slip that rolling resistance needs, some per cent at
  most, and by the lag that mass adds.
- Turning is another matter. A track has to slip before it overcomes what the ground takes sideways,
  so the wheels turn against each other and the vehicle does not: in a slow curve most of what
  odometry counts as turning is slip, on the spot little. No single effective width mends that; a
  heading that is measured does most of it.
- With mass, steering below the least turn does nothing: lateral friction holds the heading, and the
  P controller of the yaw has to collect {least:.2f} rad on concrete before the robot, standing,
  begins to turn. The wheels of the `slip` motion turn as freely as on the bench, so that a command
  always becomes a difference of speeds there, which is why it errs less.
"""


def motor() -> Plant:
    """One motor on the bench, voltage in, speed of the output shaft out."""
    given = {"input": "voltage", "friction": "coulomb", "parameters": "bench"}
    m = DCMotor(MotorPhysics.from_options(given, 1, 1), Sampling(0.1, 20))
    ranges = np.array([[-VOLTS, VOLTS], [-25.0, 25.0]])
    channels = (Channel("voltage", "V"),), (Channel("omega", "rad/s"),)
    return Plant.of_structure(
        m, m.physics.pack(PRINTED), 0.1, *channels, Detrend.none(1, 1), ranges
    )


def mission_of(name: str, motion: str, soil: str, **more: Any) -> Mission:
    """A bundled mission by a motion on a soil."""
    mission = load_mission(sysid_datasets.path(name))
    given = {"motion": motion, "lifted": True, "command_scale": VOLTS, "speed_scale": 1.0}
    vehicle = given | ({"soil": soil} if soil else {})
    return Mission.model_validate(
        {"goal": mission.goal, "obstacles": mission.obstacles, "vehicle": vehicle, **more}
    )


def steady(
    drive: tuple[float, float], soil: str, volts: float = VOLTS, seconds: float = 6.0
) -> VehicleState:
    """The vehicle after some time of one drive, from rest."""
    mission = mission_of("goal_1m", "dynamic", soil)
    motors = motors_of(as_robot(motor(), mission)[0])
    scene, state = mission.scene(), VehicleState()
    share = volts / VOLTS
    held = share * drive[0], share * drive[1]
    assert scene.car is not None
    assert scene.floor is not None
    for _ in range(round(10 * seconds)):
        state = step(state, held, 0.1, scene.car, motors, scene.floor, floats)
    return state


def kept(drive: tuple[float, float], soil: str) -> float:
    """ψ̇B/(r(ω_R − ω_L)): the share of the turn that the wheels tell which is driven [1]."""
    state, (r, B) = steady(drive, soil), (Geometry().r, Geometry().B)
    return float(state.yaw_rate * B / (r * (state.omega[1] - state.omega[0])))


def least_turn(soil: str) -> float:
    """The smallest opposite drive of the tracks that turns the vehicle [1], to a thousandth."""
    low, high = 0.0, 1.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        turns = steady((-middle, middle), soil, seconds=1.0).yaw_rate > 0.0
        low, high = (low, middle) if turns else (middle, high)
    return high


def bridge_volts(soil: str, speed: float = 0.43) -> float:
    """Voltage at the motors that drives the vehicle at a speed [V]."""
    low, high = 0.0, VOLTS
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        fast = steady((1.0, 1.0), soil, middle, 3.0).vx > speed
        low, high = (low, middle) if fast else (middle, high)
    return high


def _row(name: str, mission: Mission, said: str, result: MissionResult) -> list[str]:
    x, y, _ = result.final
    off = float(np.hypot(x - mission.goal[0], y - mission.goal[1]))
    clear = "–" if result.min_clearance_m is None else f"{result.min_clearance_m:.2f}"
    return [
        f"`{name}`",
        said,
        str(result.outcome),
        f"{result.time_s:.1f}",
        f"({x:.2f}, {y:.2f})",
        f"{off:.2f}",
        f"{result.max_deviation_m:.2f}",
        clear,
    ]


def write(folder: Path) -> Mapping[str, str]:
    """The tables; the picture goes into the folder."""
    soils = [soil for motion, soil in CASES if motion == "dynamic"]
    least = {soil: least_turn(soil) for soil in soils}
    tops = {soil: steady((1.0, 1.0), soil).vx for soil in soils}
    scene = mission_of("goal_1m", "dynamic", "concrete").scene()
    free = motors_of(as_robot(motor(), mission_of("goal_1m", "kinematic", ""))[0])[0]
    top = Geometry().r * (free.torque - free.friction) / free.damping
    turning = [
        [
            soil,
            f"{tops[soil]:.3f}",
            f"{100 * kept((-1.0, 1.0), soil):.0f} %",
            f"{100 * kept((0.5, 1.0), soil):.0f} %",
            f"{100 * least[soil]:.0f} %",
        ]
        for soil in soils
    ]
    rows, found = [], {}
    for name in MISSIONS:
        runs: list[tuple[str, str, Mapping[str, Any]]] = [(m, s, {}) for m, s in CASES]
        runs += [("dynamic", s, COMPASS) for s in soils]
        for motion, soil, more in runs:
            mission = mission_of(name, motion, soil, **more)
            result = simulate(mission, as_robot(motor(), mission)[0])
            said = f"`{motion}`" + (f", {soil}" if soil else "")
            said += MEASURED if more else ""
            rows.append(_row(name, mission, said, result))
            found[name, said.replace("`", "")] = mission, result
    _draw(folder / "motions.svg", found)
    car, volts = scene.car, bridge_volts("concrete")
    assert car is not None
    text = HEAD.format(
        volts=VOLTS,
        mass=car.mass,
        inertia=car.yaw_inertia,
        r=car.geometry.r,
        B=car.geometry.B,
        L=car.contact_length,
    )
    heads = ["soil", "top", "kept on the spot", "in the curve", "least turn"]
    text += table(heads, turning, "lrrrr")
    text += SPEED.format(
        volts=VOLTS, top=top, ground=tops["concrete"], drop=volts, lost=VOLTS - volts
    )
    heads = ["mission", "motion", "outcome", "time", "ends at", "off", "line", "clear"]
    text += table(heads, rows, "lllrrrrr")
    return {"motions.md": text + PICTURE.format(least=least["concrete"] / KP_YAW)}


DRAWN = (
    ("odometry, as published", ("kinematic", "slip, concrete", *_DYNAMIC)),
    ("compass, yaw gain 1.2", tuple(d + MEASURED for d in _DYNAMIC)),
)
"""Panels of the picture of the second mission, and what they show."""


def _draw(path: Path, found: Mapping[tuple[str, str], tuple[Mission, MissionResult]]) -> None:
    panels = []
    for title, shown in DRAWN:
        runs = {label: found[MISSIONS[1], label] for label in shown}
        mission = next(iter(runs.values()))[0]
        lines = [
            Curve(label.removesuffix(MEASURED), r.log["x"], r.log["y"])
            for label, (_, r) in runs.items()
        ]
        panels.append(
            panel(title, "x [m]", "y [m]", tuple(lines), equal=True, around=surroundings(mission))
        )
    note = "true paths from (0, 0) to (6, 3), green; obstacles grey"
    title = "Rolling, slipping, with mass: the second mission"
    write_picture(path, PanelPicture(title, note, tuple(panels), 2))
