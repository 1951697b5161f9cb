"""The picture of a tuning: the front, and responses with the proposed and present gains."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sysid.data.record import Array
from sysid.report.missions.front_drawing import FrontPicture, Mark, Trade
from sysid.report.panels import Curve, Panel, panel
from sysid.report.plots import write_picture
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


def draw_tuning(path: Path, name: str, given: Mission, tuning: Tuning, model: Model) -> None:
    """Draw the choice.

    Args:
        given: the mission with its present gains.
    """
    trades = [
        _trade(
            tuning, "the steps", ("rise of V and ψ [s]", "rise"), ("overshoot [%]", "overshoot")
        ),
        _trade(tuning, "the mission", ("time [s]", "time"), ("effort [s]", "effort")),
    ]
    if tuning.best.criteria["min_clearance_m"] is not None:
        across, up = ("time [s]", "time"), ("nearest obstacle [m]", "clearance")
        trades.append(_trade(tuning, "its obstacles", across, up))
    gains = ", ".join(f"{name} {value:g}" for name, value in tuning.best.gains.items())
    plants = f", worst of {tuning.plants} plants" if tuning.plants > 1 else ""
    write_picture(
        path,
        FrontPicture(
            title=f"{name}: {len(tuning.front)} sets of gains to choose from",
            subtitle=f"proposed: {gains}; {tuning.trials} tried{plants}",
            trades=tuple(trades),
            shade=np.array([_axis(s.criteria, "effort") for s in tuning.front]),
            shade_name="effort [s]",
            proposed=tuning.proposed,
            answers=_answers(given, tuning, model),
        ),
    )


def _axis(criteria: Criteria, what: str) -> float:
    """One criterion of a set, of both axes together."""
    c = {name: float("inf") if v is None else v for name, v in criteria.items()}
    if what == "rise":
        return c["rise_speed_s"] + c["rise_yaw_s"]
    if what == "overshoot":
        return max(c["overshoot_speed"], c["overshoot_yaw"])
    return c[{"time": "time_s", "effort": "effort", "clearance": "min_clearance_m"}[what]]


def _trade(tuning: Tuning, title: str, across: tuple[str, str], up: tuple[str, str]) -> Trade:
    def both(sets: Sequence[Criteria]) -> Array:
        return np.array([[_axis(c, across[1]), _axis(c, up[1])] for c in sets])

    named = [("present", tuning.present), *((_RULES.get(r.name, r.name), r) for r in tuning.rules)]
    marks = tuple(Mark(name, *both([s.criteria])[0].tolist()) for name, s in named if s.arrives)
    front = both([s.criteria for s in tuning.front])
    return Trade(title, across[0], up[0], both(tuning.tried), front, marks)


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
