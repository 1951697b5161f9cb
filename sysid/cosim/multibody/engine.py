"""MuJoCo as a function: a machine and its surroundings, from one state to the next."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from sysid.cosim.multibody.machine import Machine, cylinder, scene, wall
from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.robot.mission.contracts import Body, Disc, Pose, Wall
from sysid.vehicle.wheels.mjcf_parts import STEP

SETTLING = 0.3
"""Time for which it stands before the drive begins [s]: contacts sink in by micrometres."""

MISSING = (
    "a multibody simulation needs MuJoCo, which comes with the extra physics: pip install "
    "'sysid-workbench[physics]'"
)

OBSTACLE = 2
"""Bit of the shapes that only a vehicle touches (class ``obstacle``)."""


@dataclass(frozen=True, eq=False)
class Engine:
    """A compiled model of one machine and what stands around it.

    Its data are a scratch pad: what a run is, is in the vectors that go in and come out.

    Attributes:
        moving: obstacles that are moved along.
        turning: addresses of the speeds of both rows.
        outside: which shapes belong to what stands around, (geoms,).
    """

    model: Any
    data: Any
    moving: tuple[Disc, ...]
    turning: tuple[int, int]
    outside: Any

    @cached_property
    def start(self) -> Array:
        """The state of the machine that stands, settled."""
        import mujoco

        mujoco.mj_resetData(self.model, self.data)
        self._step(np.zeros((round(SETTLING / self.model.opt.timestep), 2)), 0.0)
        self.data.time = 0.0
        return self._taken()

    def advance(self, state: Array, controls: Array, t: float) -> tuple[Array, Body, int]:
        """Some steps on, one for each row of controls.

        Args:
            state: ``start``, or what a call of this gave.
            controls: for each step, what both actuators are given, (steps, 2).
            t: time at the end [s]; obstacles that move stand there.

        Returns:
            The state then, how the middle of the wheels stands and moves, and how many contacts
            the body or a wheel has with what stands around.
        """
        import mujoco

        mujoco.mj_setState(self.model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self._step(controls, t)
        return self._taken(), *self._moved(t)

    def _moved(self, t: float) -> tuple[Body, int]:
        """How the machine moves after the last step, and its contacts; ``t`` [s] is for the
        sentence."""
        x, y, _, w, i, j, k = self.data.qpos[:7].tolist()
        vx, vy, _, _, _, turn = self.data.qvel[:6].tolist()
        psi = math.atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))
        c, s = math.cos(psi), math.sin(psi)
        touching = int(np.sum(self.outside[self.data.contact.geom]))
        body = Body(Pose(x, y, psi), c * vx + s * vy, turn, c * vy - s * vx)
        figures = (*body.pose, *body[1:])
        if not all(map(math.isfinite, figures)) or max(map(abs, figures)) > LOST:
            raise ModelError(
                f"MuJoCo has lost the vehicle at t = {t:g} s: its mass, lengths or friction are "
                f"too extreme for steps of {self.model.opt.timestep:g} s; change them, or make "
                "motion.part smaller"
            )
        if 1.0 - 2.0 * (i * i + j * j) < UPRIGHT:
            raise ModelError(
                f"the vehicle has tipped over at t = {t:g} s: lower vehicle.height, bring "
                "vehicle.centre to the middle of the tracks, or let it speed up more slowly"
            )
        return body, touching

    @property
    def speeds(self) -> tuple[float, float]:
        """How fast the rows turn after the last step [rad/s]."""
        left, right = (float(self.data.qvel[k]) for k in self.turning)
        return left, right

    def _step(self, controls: Array, t: float) -> None:
        """Step on; what MuJoCo would print of a vehicle that it loses, ``_moved`` says."""
        import mujoco

        for k, disc in enumerate(self.moving):
            self.data.mocap_pos[k, :2] = disc.at(t)[:2]
        printed = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(lambda message: None)
        try:
            for pair in controls:
                self.data.ctrl[:] = pair
                mujoco.mj_step(self.model, self.data)
        finally:
            mujoco.set_mju_user_warning(printed)

    def _taken(self) -> Array:
        import mujoco

        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state


UPRIGHT = 0.5
"""Cosine of the angle to the vertical beyond which no vehicle comes back onto its wheels."""

LOST = 1e6
"""Nothing drives so far [m] or so fast [m/s]."""


@lru_cache(maxsize=4)
def engine(
    machine: Machine,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    discs: tuple[Disc, ...] = (),
    walls: tuple[Wall, ...] = (),
    step: float = STEP,
) -> Engine:
    """A machine that stands; the same one where it is asked for again.

    Args:
        start: x, y [m] and ψ [rad] of the middle of its wheels.
        discs, walls: what stands around it.
        step: of the engine [s].
    """
    try:
        import mujoco
    except ImportError:
        raise ModelError(MISSING) from None
    except AttributeError as error:  # a drawing library that MUJOCO_GL names and that is not there
        raise ModelError(
            f"MuJoCo does not load ({error}): unset the environment variable MUJOCO_GL"
        ) from None
    mu, moving = machine.friction, tuple(d for d in discs if d.vx != 0.0 or d.vy != 0.0)
    stand = [line for d in discs if d not in moving for line in cylinder(*d[:3], mu)]
    stand += [line for w in walls for line in wall(w.points, mu)]
    for k, disc in enumerate(moving):
        stand += cylinder(*disc[:3], mu, f"moving_{k}")
    try:
        model = mujoco.MjModel.from_xml_string(scene(machine, step, start, stand))
    except ValueError as error:
        first = str(error).partition("\n")[0]
        raise ModelError(f"MuJoCo cannot build the vehicle ({first})") from None
    left, right = (int(model.joint(row.joints[0]).dofadr[0]) for row in machine.rows)
    outside = np.asarray(model.geom_contype == OBSTACLE)
    return Engine(model, mujoco.MjData(model), moving, (left, right), outside)
