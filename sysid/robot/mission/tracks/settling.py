"""What a plant answers to constant inputs, by simulation: where it rests, gain, lag and limits."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.errors import ModelError
from sysid.robot.mission.axis import FirstOrder, Nominal
from sysid.robot.mission.contracts import Command, Limits, SteppablePlant
from sysid.vehicle.kinematics import Geometry, body_velocity


@dataclass(frozen=True)
class SettlingRule:
    """When a plant counts as settled.

    Attributes:
        first_block: samples of the first block; each following one is twice as long. Shorter than
            the lag of most robots, so that a quick plant costs little.
        most_steps: samples after which a plant that still moves is given up: a time constant of
            a tenth of that has passed its settling by far.
        still: ripple over the second half of a block, as a part of the change so far, of a plant at
            rest: a tenth of the last digit of the figures that are printed.
        agree: difference of two successive means, as a part of the change so far, of a plant that
            rings about its rest: what it does to a scale is below what a model's gain is known to.
        runaway: outputs beyond this are no physical quantity any more.
    """

    first_block: int = 256
    most_steps: int = 2**16
    still: float = 1e-4
    agree: float = 1e-2
    runaway: float = 1e12


RULE = SettlingRule()


class Ending(StrEnum):
    """How holding the inputs ended; each is a sentence for a plant that needs to rest."""

    RESTS = "the plant's output rests"
    RUNS_AWAY = (
        "the plant's output runs away: the model is unstable; fit it with stability "
        "enforced or with lower orders"
    )
    KEEPS_MOVING = (
        "the plant's output keeps moving under a constant input, like a position under a "
        "constant speed: identify a plant whose output settles"
    )


@dataclass(frozen=True, eq=False)
class Settling:
    """What became of a plant whose inputs were held.

    Attributes:
        y: the outputs it rests at, (ny,); the last ones where it does not rest.
        response: the outputs at every sample until then, (N, ny).
    """

    ending: Ending
    state: Array
    y: Array
    response: Array

    @property
    def swing(self) -> Array:
        """The largest excursion of each output from its first value, (ny,)."""
        return np.asarray(np.max(np.abs(self.response - self.response[0]), axis=0))


def settle(plant: SteppablePlant, state: Array, u: Array) -> Settling:
    """Hold the inputs until the outputs rest.

    The plant is stepped in blocks of growing length. It rests once no output moved by more than
    1e-4 of its change so far during the second half of a block; a lightly damped plant that
    still rings at the last block is given the mean of the ringing, if that mean stands still.

    Args:
        plant: the plant; simulation serves nonlinear ones as well as linear ones.
        u: the inputs to hold, shape (nu,).
    """
    previous: Array | None = None
    block, blocks = RULE.first_block, list[Array]()

    def ended(ending: Ending, y: Array) -> Settling:
        return Settling(ending, state, y, np.concatenate(blocks))

    while True:
        values = np.empty((block, len(plant.outputs)))
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(block):
                after, values[k] = plant.step(state, u)
                if np.array_equal(after, state):  # a step is pure: the others change nothing
                    values[k:] = values[k]
                    break
                state = after
        last = values[-1].copy()
        blocks.append(values)
        if not np.all(np.abs(values) < RULE.runaway):
            return ended(Ending.RUNS_AWAY, last)
        half, swing = values[block // 2 :], ended(Ending.KEEPS_MOVING, last).swing
        mean = half.mean(axis=0)
        floor = 1e-12 * np.max(np.abs(values), axis=0)
        if np.all(np.ptp(half, axis=0) <= RULE.still * swing + floor):
            return ended(Ending.RESTS, last)
        if sum(map(len, blocks)) + 2 * block > RULE.most_steps and previous is not None:
            change = np.abs(mean - blocks[0][0])
            rings = bool(np.all(np.abs(mean - previous) <= RULE.agree * change + floor))
            return ended(Ending.RESTS, mean) if rings else ended(Ending.KEEPS_MOVING, last)
        previous = mean
        block *= 2


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
