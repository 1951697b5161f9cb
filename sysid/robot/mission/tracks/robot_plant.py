"""RobotPlant: any plant wired and scaled to take PWM [µs] and return rad/s per track."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.effects.compensation import Identified
from sysid.effects.ground import Ground, slipping
from sysid.robot.mission.contracts import (
    ROBOT_INPUTS,
    ROBOT_OUTPUTS,
    Readout,
    SteppablePlant,
    readout_of,
)
from sysid.vehicle.kinematics import Real


class TrackChannels:
    """What goes in and out of every plant of two tracks: PWM either way, no drive at 0."""

    inputs = ROBOT_INPUTS
    outputs = ROBOT_OUTPUTS
    input_range = ((-PWM_FULL_SCALE, PWM_FULL_SCALE),) * 2
    u_offset = np.zeros(2)


@dataclass(frozen=True, eq=False)
class RobotPlant(TrackChannels):
    """A plant wired and scaled as a robot; satisfies ``SteppablePlant``.

    Track i is driven by u = centre + span·(PWM_i / 20000) on input ``driven[i]`` (the other inputs
    stay at ``centre``) and turns at ω_i = scale_i·(y[read[i]] − zero_i).

    Attributes:
        twins: whether each track has its own copy of the plant; otherwise one plant has both.
        driven, read: index of the input and of the output of the left and the right track.
        centre: value of every input of ``plant`` at zero drive, shape (nu,).
        span: change of the driven inputs from zero to full drive, shape (2,).
        zero: outputs at zero drive, shape (2,).
        scale: wheel speed per unit of output [rad/s], shape (2,).
        rest: state at rest at zero drive; with twins shape (2, …).
        slip: share of its way that it loses where it turns on the spot, beside what the plant says
            of the ground; None for nothing.
    """

    plant: SteppablePlant
    twins: bool
    driven: tuple[int, int]
    read: tuple[int, int]
    centre: Array
    span: Array
    zero: Array
    scale: Array
    rest: Array
    slip: Real | None = None

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return self.plant.dt

    @cached_property
    def ground(self) -> Ground:
        """What stands between tracks and ground; copies of one plant bring no such thing."""
        ground = self.plant.ground
        ordered = ground.ordered(self.read) if ground and not self.twins else Ground()
        return ordered if self.slip is None else slipping(ordered, self.slip)

    @cached_property
    def identified(self) -> Identified:
        """What acts between commands and torques, left and right, in the plant's own units."""
        known = getattr(self.plant, "identified", Identified())
        # An effect belongs to the input and the output of one track.
        applies = known.effects and self.driven == self.read
        return known.on(self.driven) if applies else Identified()

    def initial_state(self) -> Array:
        return self.rest.copy()

    @cached_property
    def _spread(self) -> Array:
        """Change of every input at the full drive of either track, (nu, 2)."""
        spread = np.zeros((len(self.centre), 2))
        spread[self.driven, (0, 1)] = self.span
        return spread

    @cached_property
    def _tracks(self) -> Array:
        return np.array(self.read)

    @cached_property
    def _readout(self) -> Readout:
        return readout_of(self.plant)

    def _speeds(self, y: Array) -> Array:
        return self.scale * (y - self.zero)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """Advance one sample: PWM [µs] of both tracks in, wheel speeds [rad/s] out."""
        if not self.twins:
            state, y = self.plant.step(state, self.centre + self._spread @ u / PWM_FULL_SCALE)
            return state, self._speeds(y[self._tracks])
        left, right = self.centre + (self._spread * u).T / PWM_FULL_SCALE
        state_l, y_l = self.plant.step(state[0], left)
        state_r, y_r = self.plant.step(state[1], right)
        y = _pair(y_l[self.read[0]], y_r[self.read[1]])
        return _pair(state_l, state_r), self._speeds(y)

    def readout(self, state: Array, u: Array) -> Array:
        """Wheel speeds [rad/s] alone, as ``step`` gives them."""
        if not self.twins:
            y = self._readout(state, self.centre + self._spread @ u / PWM_FULL_SCALE)
            return self._speeds(y[self._tracks])
        left, right = self.centre + (self._spread * u).T / PWM_FULL_SCALE
        y_l, y_r = self._readout(state[0], left), self._readout(state[1], right)
        return self._speeds(_pair(y_l[self.read[0]], y_r[self.read[1]]))


def _pair(left: Any, right: Any) -> Any:
    """Both along a first axis, in their own namespace."""
    if isinstance(left, np.ndarray | np.generic):
        return np.array((left, right))
    return left.__array_namespace__().stack((left, right))


def identified_effects(plant: SteppablePlant) -> tuple[str, ...]:
    """Effects that a robot plant was identified with."""
    return plant.identified.effects if isinstance(plant, RobotPlant) else ()
