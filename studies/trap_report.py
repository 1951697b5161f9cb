"""``traps.md``: every law of guidance in the traps of the potential field (thesis 4.5)."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from studies.mission_report import best_by_aic, called, identified, run
from sysid.report.markdown import table
from sysid.report.missions.panels import GREEN, disc
from sysid.report.panels import Curve, Panel, PanelPicture, panel
from sysid.report.plots import write_picture
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.spec import Mission
from sysid.structures.model import Model

GOAL = (4.0, 0.0)

SHIFTS = tuple(product((0.0, -0.1, 0.1), repeat=2))
"""What is in the way is moved by these [m]: a trap that holds only from the very axis is none."""

Place = tuple[float, float]


@dataclass(frozen=True)
class Trap:
    """What stands between (0, 0) and (4, 0).

    Attributes:
        name: in the table.
        obstacles: x, y, radius, and velocity in x and y [m, m/s].
        walls: from point to point [m].
    """

    name: str
    obstacles: tuple[tuple[float, float, float, float, float], ...] = ()
    walls: tuple[tuple[Place, ...], ...] = ()

    def mission(self, guidance: Mapping[str, Any], dx: float, dy: float) -> Mission:
        """The mission with everything that is in the way moved by (dx, dy)."""
        return Mission.model_validate(
            {
                "goal": GOAL,
                "guidance": guidance,
                "obstacles": [
                    {"at": (x + dx, y + dy), "radius": r, "velocity": (vx, vy)}
                    for x, y, r, vx, vy in self.obstacles
                ],
                "walls": [[(x + dx, y + dy) for x, y in wall] for wall in self.walls],
            }
        )


def _u(depth: float) -> tuple[tuple[Place, ...], ...]:
    return (((2.5 - depth, 0.7), (2.5, 0.7), (2.5, -0.7), (2.5 - depth, -0.7)),)


TRAPS = (
    Trap("U, 1 m deep", walls=_u(1.0)),
    Trap("U, 2 m deep", walls=_u(2.0)),
    Trap("two close obstacles", ((2.0, 0.25, 0.15, 0.0, 0.0), (2.0, -0.25, 0.15, 0.0, 0.0))),
    Trap("narrow passage, 0.6 m", walls=(((2.0, 2.0), (2.0, 0.3)), ((2.0, -0.3), (2.0, -2.0)))),
    Trap("goal behind an obstacle", ((2.0, 0.0, 0.4, 0.0, 0.0),)),
    Trap("obstacle at the goal", ((4.35, 0.0, 0.15, 0.0, 0.0),)),
    Trap("obstacle that crosses", ((2.0, -1.6, 0.15, 0.0, 0.2),)),
    Trap(
        "goal walled off",
        walls=(((3.2, -0.8), (4.8, -0.8), (4.8, 0.8), (3.2, 0.8), (3.2, -0.8)),),
    ),
)

LAWS: Mapping[str, Mapping[str, Any]] = {
    "`field`": {"kind": "field"},
    "`field`, virtual obstacle": {"kind": "field", "escape": "virtual-obstacle"},
    "`field`, wall": {"kind": "field", "escape": "wall"},
    "`harmonic`": {"kind": "harmonic"},
    "`pure-pursuit`": {"kind": "pure-pursuit"},
}

HEAD = """# Laws of guidance in the traps of the potential field

The plant is the one of the [missions](missions.md), `{plant}`; every law has its
default keys. The way is from (0, 0) to (4, 0). Each trap is driven nine times, moved by 0 and
±0.1 m along and across. A cell has how many of the nine arrive, and of the trap in the middle the
outcome with its time and the clearance of the robot's centre; a mission that is stuck has its
reason. What the laws do stands in [guidance](../docs/guidance.md).

"""

PICTURE = """
![paths in the traps](traps.svg)

- Pure pursuit knows no obstacles and is here to show what the straight line meets.
- The field acts from an obstacle's point: at the surface of one of radius 0.4 m it pushes with
  0.33, hardly more than the goal pulls (0.30); a robot that drives at it until both are equal
  does not stop in time. Raise `rho0` and `eta` for obstacles of that size.
- Virtual obstacles fill shallow traps; they do not fill a U in the time that they are given.
- A goal that is walled off cannot be reached: there the right answer is `no-way-through`.
"""


def write(folder: Path) -> Mapping[str, str]:
    """The table; the picture goes into the folder."""
    model = best_by_aic(identified("prbs"))
    rows, panels = [], []
    for trap in TRAPS:
        found = {law: driven(model, trap, keys) for law, keys in LAWS.items()}
        rows.append([trap.name, *(_cell(results) for results in found.values())])
        panels.append(_panel(trap, {law: results[0] for law, results in found.items()}))
    write_picture(
        folder / "traps.svg",
        PanelPicture(
            "Laws of guidance in the traps of the field",
            "from (0, 0) to (4, 0), the identified robot; "
            "grey: walls and obstacles where they begin",
            tuple(panels),
            2,
        ),
    )
    text = HEAD.format(plant=called(model)) + table(["trap", *LAWS], rows, "l" * (1 + len(LAWS)))
    return {"traps.md": text + PICTURE}


def driven(model: Model, trap: Trap, keys: Mapping[str, Any]) -> list[MissionResult]:
    """The missions of one trap by one law, that in the middle first."""
    return [run(model, trap.mission(keys, dx, dy)) for dx, dy in SHIFTS]


def _cell(results: list[MissionResult]) -> str:
    arrived = sum(r.outcome is Outcome.ARRIVED for r in results)
    first = results[0]
    what = f"{first.outcome}" if first.stuck is None else f"stuck: {first.stuck.reason}"
    clear = "" if first.min_clearance_m is None else f", {max(first.min_clearance_m, 0.0):.2f} m"
    return f"{arrived} of 9; {what}, {first.time_s:.0f} s{clear}"


def _panel(trap: Trap, results: Mapping[str, MissionResult]) -> Panel:
    import numpy as np

    lines = [Curve(law.replace("`", ""), r.log["x"], r.log["y"]) for law, r in results.items()]
    lines += [Curve("", *np.array(wall).T, colour=-1) for wall in trap.walls]
    discs = [disc(x, y, r) for x, y, r, _, _ in trap.obstacles]
    discs.append(disc(*GOAL, 0.1, GREEN))
    return panel(trap.name, "x [m]", "y [m]", tuple(lines), equal=True, around=discs)
