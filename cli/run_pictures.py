"""From simulated runs to the pictures of the report layer."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sysid.mission.result import MissionResult
    from sysid.mission.spec import Mission
    from sysid.plant.replay import Replay


def draw_mission(path: Path, name: str, mission: "Mission", result: "MissionResult") -> None:
    """Draw the path among the obstacles with its references and commands."""
    import numpy as np

    from sysid.report.plots import MissionPicture, Obstacle, plot_mission

    log = result.log
    picture = MissionPicture(
        name=name,
        outcome=result.outcome.value,
        t=log["t"],
        pose=np.column_stack([log["x"], log["y"], log["psi"]]),
        speed=log["v"],
        pwm=np.column_stack([log["pwm_l"], log["pwm_r"]]),
        goal=mission.goal,
        tolerance=mission.tolerance,
        obstacles=tuple(Obstacle(o.x, o.y, o.radius) for o in mission.obstacles),
        influence=mission.guidance.reach,
        speed_reference=log["v_ref"],
        heading_reference=log["psi_ref"],
        min_clearance=result.min_clearance_m,
    )
    plot_mission(path, picture)


def draw_replay(path: Path, result: "Replay") -> None:
    """Draw the measured outputs of a log beside the plant's."""
    from sysid.report.plots import FitPicture, FitSegment, plot_fit

    record = result.record
    segment = FitSegment(record.t, record.y, result.simulated, record.u, "validation", record.name)
    picture = FitPicture(
        title=f"The exported plant on {record.name}",
        outputs=record.outputs,
        inputs=record.inputs,
        segments=(segment,),
        initial_state="rest",
        validation_fit=tuple(result.summary()["fit_percent"].values()),
    )
    plot_fit(path, picture)
