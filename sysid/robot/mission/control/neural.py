"""A small neural network as the law of one axis; its weights are in neural.json.

``studies/train_neural_control.py`` trains it on the best of the other laws, and says which.
"""

import json
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, ClassVar, NamedTuple

from sysid.robot.mission.axis import AxisInputs
from sysid.robot.mission.control.linear import conditional
from sysid.robot.mission.settings import AxisSettings, Gain, Search
from sysid.vehicle.kinematics import Real


class Network(NamedTuple):
    """d = w₀ + Σ w_j tanh(b_j + Σ v_ji x_i).

    Attributes:
        hidden: b_j and v_j1 … v_j5 of each hidden unit.
        output: w_0, w_1 … of the output.
    """

    hidden: tuple[tuple[float, ...], ...]
    output: tuple[float, ...]

    def __call__(self, inputs: Sequence[Real], xp: Any) -> Real:
        """The command for five inputs [drive]."""
        said: Real = self.output[0]
        for weight, (bias, *weights) in zip(self.output[1:], self.hidden, strict=True):
            heard: Real = bias
            for v, x in zip(weights, inputs, strict=True):
                heard = heard + v * x
            said = said + weight * xp.tanh(heard)
        return said


@cache
def trained(axis: str) -> Network:
    """The network of ``speed`` or ``yaw`` that comes with the package."""
    text = files("sysid.robot.mission.control").joinpath("neural.json").read_text(encoding="utf-8")
    raw = json.loads(text)[axis]
    return Network(tuple(tuple(row) for row in raw["hidden"]), tuple(raw["output"]))


def features(inputs: AxisInputs, integral: Real, strength: Real) -> tuple[Real, ...]:
    """What the network hears: e/g, z, v_ref/g, v/g and τ v̇_ref/g, error and integral amplified."""
    gain = inputs.plant.gain
    return (
        strength * inputs.error / gain,
        strength * integral,
        inputs.wanted / gain,
        inputs.motion / gain,
        inputs.wanted_rate * inputs.plant.lag / gain,
    )


class Neural(AxisSettings):
    """d = sat(N(K e/g, K z, v_ref/g, v/g, τ v̇_ref/g)), z ← z + e T/g, of a network N.

    Attributes:
        strength: K, by which error and integral are made to sound larger.
    """

    axis: ClassVar[str] = "speed"

    strength: Annotated[Gain, Search(0.5, 2.0)] = 1.0

    @property
    def uses_plant(self) -> bool:
        return True

    def start(self, scene: Any, xp: Any) -> Real:
        return 0.0

    def step(self, state: Real, inputs: AxisInputs, dt: Real, xp: Any) -> tuple[Real, Real]:
        """What the network says, within the limits; the integral stands while on one."""
        grown = state + inputs.error * dt / inputs.plant.gain
        command = trained(self.axis)(features(inputs, grown, self.strength), xp)
        kept = conditional(grown, state, command, (inputs.low, inputs.high), xp)
        return kept, xp.clip(command, inputs.low, inputs.high)


class YawNeural(Neural):
    """The network of the yaw."""

    axis: ClassVar[str] = "yaw"
