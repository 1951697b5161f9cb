"""The nominal plant for laws: gain and lag of the response along each axis, and its limits."""

import math
from collections.abc import Callable

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.errors import ModelError
from sysid.robot.mission.axis import FirstOrder, Nominal
from sysid.robot.mission.contracts import Command, Limits, SteppablePlant
from sysid.robot.mission.tracks.settling import Ending, settle
from sysid.vehicle.kinematics import Geometry, body_velocity

AMID = Command(0.5, 0.3)
"""Commands at which a plant is asked [drive]: half speed, and the yaw command's default limit.

A nonlinear plant answers others a little differently; missions drive at about these.
"""

SETTLED = 1e-3
"""Share of a step's height below which what is left of it no longer counts for the lag."""

CommandMixer = Callable[[Command], tuple[float, float]]
"""Both commands → PWM of the left and the right track [µs]."""


def nominal_of(plant: SteppablePlant, geometry: Geometry, mixer: CommandMixer) -> Nominal:
    """Measure gain and lag of a robot plant by a step of either command from rest.

    g = Δv/Δd at rest after the step, τ = ∫ (v∞ − v)/(v∞ − v₀) dt: the area above the step response,
    which of a first-order lag is its time constant, and of others lag and dead time together.

    Args:
        mixer: what commands become on the tracks.

    Source: Åström and Hägglund, Advanced PID Control (2006), section 2.7 (average residence time).
    """
    speed = _answer(plant, geometry, mixer, Command(AMID.v_cmd, 0.0))
    yaw = _answer(plant, geometry, mixer, Command(0.0, AMID.psi_cmd))
    return Nominal(speed, yaw)


def _answer(
    plant: SteppablePlant, geometry: Geometry, mixer: CommandMixer, command: Command
) -> FirstOrder:
    """The step response to one command as a first-order lag."""
    axis, size = (0, command.v_cmd) if command.v_cmd else (1, command.psi_cmd)
    state = plant.initial_state()
    settled = settle(plant, state, np.array(mixer(command)))
    first = _motion(plant.step(state, np.zeros(2))[1], geometry, axis)
    rise = float(_motion(settled.y, geometry, axis) - first)
    if settled.ending is not Ending.RESTS or not rise > 0.0:
        why = "rises" if settled.ending is Ending.RESTS else "comes to rest"
        what = ("forward speed", "yaw rate")[axis]
        raise ModelError(
            f"the plant's {what} never {why} after a step of the command, so model-based "
            "controllers cannot be used; choose control of kind p, pi, pd or pid without "
            "feed_forward"
        )
    remaining = 1.0 - (_motion(settled.response, geometry, axis) - first) / rise
    count = int(np.argmax(np.append(np.abs(remaining) < SETTLED, True))) + 1
    # The first sample counts half: the response is read at the ends of its steps.
    area = float(remaining[:count].sum()) - 0.5
    return FirstOrder(rise / size, max(area, 0.5) * plant.dt)


def _motion(y: Array, geometry: Geometry, axis: int) -> Array:
    """Forward speed [m/s] or yaw rate [rad/s] of wheel speeds (…, 2)."""
    return np.asarray(body_velocity(y[..., 0], y[..., 1], geometry)[axis])


RISEN = 1.0 - math.exp(-1.0)
"""Share of its final value that a first-order lag reaches after its time constant."""


def limits_of(plant: SteppablePlant, geometry: Geometry) -> Limits:
    """What a robot plant can do at most: V∞ and V∞/τ at full drive, ψ̇∞ and ψ̇∞/τ at opposite ones.

    V∞/τ is the acceleration at which a first-order lag starts; τ is the time to 63 % of a step.

    Returns:
        The limits; infinite along an axis where the plant never comes to rest.
    """
    full = PWM_FULL_SCALE
    forward = _top(plant, geometry, np.array((full, full)), 0)
    turning = _top(plant, geometry, np.array((-full, full)), 1)
    return Limits(*forward, *turning)


def _top(plant: SteppablePlant, geometry: Geometry, u: Array, axis: int) -> tuple[float, float]:
    """The final motion along one axis after a step of the drive, and how fast it gets there."""
    settled = settle(plant, plant.initial_state(), u)
    top = abs(float(_motion(settled.y, geometry, axis)))
    if settled.ending is not Ending.RESTS or top == 0.0:
        return math.inf, math.inf
    risen = np.abs(_motion(settled.response, geometry, axis)) >= RISEN * top
    k = int(np.argmax(risen)) + 1
    return (top, top / (k * plant.dt)) if risen.any() else (top, math.inf)
