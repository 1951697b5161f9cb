"""The picture of a tuning: the front, and responses with the proposed and present gains."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sysid.data.record import Array
from sysid.report.missions.panels import GREY, through
from sysid.report.panels import Curve, Panel, draw_panels, panel
from sysid.robot.mission.contracts import Controller
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tuning.tuned import Tuning
from sysid.structures.model import Model

Criteria = Mapping[str, float | None]

_RULES = {
    "ziegler-nichols": "ZN",
    "ziegler-nichols-edge": "ZN edge",
    "cohen-coon": "CC",
    "lambda": "λ",
    "simc": "SIMC",
}
"""Short names of rules; others keep theirs."""

ROOM = 0.35
"""Room around the front, in parts of its span: what lies farther away is no choice."""

PARTS = 3
"""Of the front by effort, each of a colour."""

RULE, PRESENT, PROPOSED = 3, 4, 5
"""Colours of sets with names."""


def draw_tuning(path: Path, name: str, given: Mission, tuning: Tuning, model: Model) -> None:
    """Draw the choice.

    Args:
        given: the mission with its present gains.
    """
    rise, overshoot = ("rise of V and ψ [s]", "rise"), ("overshoot [%]", "overshoot")
    panels = [
        _trade(tuning, "the steps", rise, overshoot),
        _trade(tuning, "the mission", ("time [s]", "time"), ("effort [s]", "effort")),
    ]
    if tuning.best.criteria["min_clearance_m"] is not None:
        across, up = ("time [s]", "time"), ("nearest obstacle [m]", "clearance")
        panels.append(_trade(tuning, "its obstacles", across, up))
    gains = ", ".join(f"{name} {value:g}" for name, value in tuning.best.gains.items())
    plants = f", worst of {tuning.plants} plants" if tuning.plants > 1 else ""
    title = f"{name}: {len(tuning.front)} sets of gains to choose from"
    words = f"proposed: {gains}; {tuning.trials} tried{plants}"
    panels += _answers(given, tuning, model)
    draw_panels(path, title, words, tuple(panels))


def _axis(criteria: Criteria, what: str) -> float:
    """One criterion of a set, of both axes together."""
    c = {name: float("inf") if v is None else v for name, v in criteria.items()}
    if what == "rise":
        return c["rise_speed_s"] + c["rise_yaw_s"]
    if what == "overshoot":
        return max(c["overshoot_speed"], c["overshoot_yaw"])
    return c[{"time": "time_s", "effort": "effort", "clearance": "min_clearance_m"}[what]]


def _trade(tuning: Tuning, title: str, across: tuple[str, str], up: tuple[str, str]) -> Panel:
    """Two criteria against each other, of every set that was driven and of those to choose from."""

    def both(sets: Sequence[Criteria]) -> Array:
        return np.array([[_axis(c, across[1]), _axis(c, up[1])] for c in sets])

    front = both([s.criteria for s in tuning.front])
    low, high = _window(front)

    def near(points: Array) -> Array:
        return points[np.all((points >= low) & (points <= high), axis=1)]

    curves = [through("tried", near(both(tuning.tried)), kind="dots", colour=GREY)]
    effort = np.array([_axis(s.criteria, "effort") for s in tuning.front])
    for k, part in enumerate(np.array_split(np.argsort(effort), min(PARTS, len(effort)))):
        label = f"effort to {effort[part].max():.3g} s"
        curves.append(through(label, front[part], kind="dots", colour=k))
    best = front[[tuning.proposed]]
    curves.append(through("proposed", best, kind="marks", colour=PROPOSED))
    for s in (tuning.present, *tuning.rules):
        if s.arrives and len(at := near(both([s.criteria]))):
            colour = PRESENT if s is tuning.present else RULE
            curves.append(through("", at, kind="marks", colour=colour))
            curves.append(through(_RULES.get(s.name, s.name), at, kind="words"))
    return Panel(up[1], title, across[0], up[0], tuple(curves))


def _window(front: Array) -> tuple[Array, Array]:
    """Lowest and highest values that are shown: the front with room around it."""
    low, high = front.min(axis=0), front.max(axis=0)
    span = np.where(high > low, high - low, np.maximum(1e-3, 0.05 * np.abs(high)))
    lowest = np.where(low >= 0.0, -0.05 * high, -np.inf)  # none of the criteria is below 0
    return np.maximum(low - ROOM * span, lowest), high + ROOM * span


def _answers(given: Mission, tuning: Tuning, model: Model) -> tuple[Panel, ...]:
    """Steps of speed and yaw with the estimated plant, and the path of the mission."""
    robot, _ = as_robot(model.plant(), given)
    steps = tuning.test.mission(given)

    def log(mission: Mission, control: Controller) -> dict[str, Array]:
        return dict(simulate(mission.model_copy(update={"control": control}), robot).log)

    controllers = {"proposed": tuning.mission.control, "present": given.control}
    logs = {name: log(steps, control) for name, control in controllers.items()}
    speed, yaw = [], []
    for name, run in logs.items():
        first, turning = (
            run["t"] < tuning.test.yaw_at,
            run["t"] >= tuning.test.yaw_at - steps.control.period,
        )
        psi = np.degrees(np.unwrap(run["psi"]))
        speed.append(Curve(name, run["t"][first], run["v"][first]))
        yaw.append(Curve(name, run["t"][turning], psi[turning]))
    v_ref, psi_ref = run["v_ref"][first], np.degrees(run["psi_ref"][turning])
    speed.append(Curve("reference", run["t"][first], v_ref, colour=-1))
    yaw.append(Curve("reference", run["t"][turning], psi_ref, colour=-1))
    return (
        panel("step of the speed", "time [s]", "V [m/s]", speed),
        panel("step of the yaw and back", "time [s]", "ψ [°]", yaw),
    )
