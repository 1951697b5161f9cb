"""Guidance by a harmonic potential: a field without local minima, solved on a grid at the start."""

from typing import Annotated, Any

from pydantic import Field

from sysid.errors import ModelError
from sysid.robot.mission.contracts import GuidanceInputs, Pose, References, Scene
from sysid.robot.mission.guidance.field import moves, moving_force
from sysid.robot.mission.guidance.harmonic_grid import HarmonicGrid, solved
from sysid.robot.mission.guidance.pure_pursuit import paced
from sysid.robot.mission.settings import Gain, GuidanceSettings, Positive
from sysid.robot.mission.traits import GuidanceAdvice, GuidanceTraits, Hold
from sysid.vehicle.kinematics import Real

PULL = 0.3
"""What the way counts against an obstacle that moves: the attraction K·d of the published field."""


class Harmonic(GuidanceSettings):
    """Leads along the steepest ascent of w with ∇²w = 0, w = 1 at the goal and 0 at every surface.

    A function with ∇²w = 0 has no maximum but on its boundary, so that every way up ends at the
    goal; where w = 0 there is no way at all, and the mission ends at once. Surfaces count from
    ``margin`` on; an obstacle that moves is no part of w and repels as in the improved field. The
    grid is solved before the first step: goal, walls and obstacles must be plain numbers, the same
    for all runs of a compiled batch.

    Attributes:
        margin: distance that the robot's centre keeps from every surface [m].
        cell: side of a cell of the grid [m].
        v_max: largest speed reference [m/s].
        slow_within: distance before the goal within which it slows down [m].
        rho0, eta: range [m] and strength of the repulsion of obstacles that move.

    Source: Connolly, Burns and Weiss (1990), Path planning using Laplace's equation.
    """

    margin: Annotated[float, Field(ge=0, le=1e3)] = 0.15
    cell: Annotated[float, Field(ge=1e-3, le=1e3)] = 0.05
    v_max: Positive = 0.3
    slow_within: Positive = 0.4
    rho0: Positive = 0.7
    eta: Gain = 0.05

    @property
    def advice(self) -> GuidanceAdvice:
        return GuidanceAdvice(
            faster="raise v_max",
            slower="lower v_max",
            wider="raise margin",
            closer=f"lower margin (now {self.margin:g} m)",
        )

    @property
    def traits(self) -> GuidanceTraits:
        """It knows all waypoints from the start, and what the plant can do."""
        return GuidanceTraits(passes_waypoints=True, feasible=True, top_speed=self.v_max)

    def start(self, scene: Scene, xp: Any) -> Real:
        """The first leg of the way; the grids are solved."""
        self._grid(scene)
        return 0

    def step(
        self, state: Real, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[Real, References]:
        scene, body = inputs.scene, inputs.estimate
        pose, grid = body.pose, self._grid(scene)
        gx, gy, goal_x, goal_y = grid.direction(state, pose.x, pose.y, xp)
        for o in scene.obstacles:
            if moves(o):
                rx, ry = moving_force(body, o.at(inputs.t), self.eta, self.rho0, xp)
                gx, gy = gx + rx / PULL, gy + ry / PULL
        psi = xp.where((gx == 0) & (gy == 0), pose.psi, xp.arctan2(gy, gx))
        near = xp.hypot(goal_x - pose.x, goal_y - pose.y) <= scene.tolerance
        last = state == len(scene.way)
        closed = xp.logical_not(grid.is_open(state, pose.x, pose.y, xp))
        to_go = xp.hypot(scene.goal[0] - pose.x, scene.goal[1] - pose.y)
        references = References(
            speed=paced(self.v_max, self.slow_within, pose.psi, psi, to_go, xp),
            psi=psi,
            arrived=near & last,
            hold=xp.where(closed, int(Hold.NO_WAY_THROUGH), int(Hold.NOTHING)),
            gives_up=closed & xp.logical_not(near),
        )
        return state + xp.where(near & xp.logical_not(last), 1, 0), references

    def to_go(self, state: Real, pose: Pose, scene: Scene, xp: Any) -> Real:
        """The way up the potential, from cell to cell [m]."""
        return self._grid(scene).way(state, pose.x, pose.y, xp)

    def potential(self, x: Real, y: Real, scene: Scene, xp: Any) -> Real:
        """−log w of the first leg: finite wherever a way leads to its end."""
        return self._grid(scene).height(0, x, y, xp)

    def _grid(self, scene: Scene) -> HarmonicGrid:
        still = tuple(o for o in scene.obstacles if not moves(o))
        try:
            return solved(
                scene.targets, still, scene.walls, self.margin, self.cell, scene.tolerance
            )
        except TypeError:  # traced numbers cannot be looked up
            raise ModelError(
                "the harmonic potential is solved before the run, so goal, walls and obstacles "
                "cannot vary in a compiled batch"
            ) from None
