"""Chapter 4: the potential field."""

import sysid_datasets

from sysid.report.missions.plan_drawing import PlanPicture
from sysid.robot.mission.plan import plan
from sysid.robot.mission.spec import load_mission
from thesis.entries import DRAWN, MISPRINT, Row, Sheet, number, verdict

COARSE = 4
"""Every how many rows and columns of the map the surface has: as fine as 3 in show."""


def field() -> Sheet:
    """4.3 and what the limits of the method (4.5) come to in this scene."""
    mission = load_mission(sysid_datasets.path("obstacles_6_3"))
    found = plan(mission)
    assert found.potential is not None
    rows = (
        Row("4.3", "where the surface leads from the start", "to its lowest point, the goal",
            f"after {number(found.length_m, '.2f')} m", verdict(found.arrives),
            "the scene is not printed, ours is mission 2"),
        Row("§4.5", "places from which it leads elsewhere", "local minima “can arise”",
            f"{number(100 * (1 - found.arriving_share), '.0f')} % of those around, "
            "none in this scene" if not found.ends else f"{len(found.ends)} minima",
            "–", "the obstacles stand apart; scenes with traps: [traps.md](traps.md)"),
        Row("(4.22), (4.25)", "second case of the repulsion", "ρ ≤ ρ₀", "ρ > ρ₀", MISPRINT,
            "both cases are printed with the same condition"),
        Row("(4.3)", "heading from a magnetometer", "atan(−B_y/B_x)", "atan2(−B_y, B_x)", MISPRINT,
            "the quotient leaves out half of the circle"),
    )  # fmt: skip
    cut = (slice(None, None, COARSE), slice(None, None, COARSE))
    picture = PlanPicture(
        title="4.3: a potential field",
        subtitle=f"the scene of mission 2, {DRAWN} from its equations",
        x=found.x[::COARSE],
        y=found.y[::COARSE],
        psi=found.psi[cut],
        potential=found.potential[cut],
        way=found.way,
        goal=mission.goal,
        tolerance=mission.tolerance,
        discs=tuple((o.x, o.y, o.radius) for o in mission.obstacles),
        walls=(),
        ends=found.ends,
        panels=(),
    )
    return Sheet(rows, "chapter4/potential.svg", picture)


SHEETS = (field,)
