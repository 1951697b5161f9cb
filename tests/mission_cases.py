"""What tests of missions share: a robot, a mission, and what every law must fulfil."""

import math
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.robot.mission.axis import AxisInputs, FirstOrder
from sysid.robot.mission.contracts import (
    ROBOT_INPUTS,
    ROBOT_OUTPUTS,
    Body,
    ControlInputs,
    GuidanceInputs,
    MotionInputs,
    NavigationInputs,
    Pose,
    References,
    SensorInputs,
)
from sysid.robot.mission.spec import Mission
from sysid.runners import floats
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.motors import Bench


@dataclass(frozen=True)
class Robot:
    """First-order tracks, ω⁺ = aω + bu: 0.43 m/s at full drive on average, 20 % apart."""

    dt: float = 0.1
    lag: float = 0.2
    difference: float = 0.2
    top_speed: float = 0.43
    direct: float = 0.0
    inputs: tuple[Channel, ...] = ROBOT_INPUTS
    outputs: tuple[Channel, ...] = ROBOT_OUTPUTS
    input_range: tuple[tuple[float, float], ...] = ()
    u_offset: Array = field(default_factory=lambda: np.zeros(2))
    ground: Ground = field(default_factory=Ground)

    @property
    def a(self) -> float:
        return math.exp(-self.dt / self.lag)

    @property
    def b(self) -> Array:
        half = 0.5 * self.difference
        per_pulse = self.top_speed / Geometry().r / 20000.0
        return (1.0 - self.a) * per_pulse * np.array((1.0 - half, 1.0 + half))

    def initial_state(self) -> Array:
        return np.zeros(2)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        return self.a * state + self.b * u, state + self.direct * u


def goal(x: float, y: float, **more: object) -> Mission:
    return Mission.model_validate({"goal": (x, y), **more})


AROUND = goal(6, 3, obstacles=[(2, 3.5), (3, 1), (4, 2.5), (5, 3)])

SCENE = (
    goal(
        6,
        3,
        obstacles=[*AROUND.obstacles, {"at": (1.0, 1.0), "velocity": (0.1, -0.2)}],
        walls=[[(-1.5, 2.0), (1.0, 2.5), (1.5, 1.5)]],
        polygons=[[(-2.0, -1.0), (-1.0, -1.0), (-1.5, -2.0)]],
        waypoints=[(2.0, 1.0), (3.0, 2.0)],
    )
    .scene()
    ._replace(motors=(Bench().motor(7.5),) * 2)
)
"""One of everything that laws may have to do with."""


def _body(a: Array) -> Body:
    return Body(Pose(*a[:3].tolist()), float(a[3]), float(a[4]))


def _axis(a: Array) -> AxisInputs:
    v = [float(x) for x in a]
    return AxisInputs(0.3, *v, -0.3, 0.3, 0.1 * v[1], FirstOrder(0.43, 0.2))


EXAMPLE: dict[str, Any] = {
    "guidance": lambda a: GuidanceInputs(0.3, _body(a), SCENE),
    "control": lambda a: ControlInputs(0.3, References(0.1, float(a[0]), False), _body(a), SCENE),
    "control.speed": lambda a: _axis(a),
    "control.yaw": lambda a: _axis(a),
    "navigation": lambda a: NavigationInputs(
        0.3, {"omega_l": float(4 * a[0]), "omega_r": float(4 * a[1])}, SCENE
    ),
    "motion": lambda a: MotionInputs(0.3, float(4 * a[0]), float(4 * a[1]), SCENE),
    "sensors": lambda a: SensorInputs(
        0.3, _body(a), float(4 * a[0]), float(4 * a[1]), [float(n) for n in np.tile(a, 4)], SCENE
    ),
}
"""What a law of a role is given somewhere on the way, from five numbers."""


def leaves(tree: Any) -> list[float]:
    return [float(number) for leaf in jax.tree.leaves(tree) for number in np.ravel(leaf)]


def check_law(role: str, law: Any) -> None:
    """A law is pure; plain floats, NumPy and traced JAX numbers run one text; states keep shape."""
    jax.config.update("jax_enable_x64", True)

    @jax.jit
    def compiled(state: Any, numbers: dict[str, Any]) -> Any:
        return law.step(state, EXAMPLE[role](np.zeros(5))._replace(**numbers), 0.1, jnp)

    rng = np.random.default_rng(5)
    state = law.start(SCENE, floats)
    for _ in range(8):
        given = EXAMPLE[role](rng.uniform(-3, 3, 5))
        once, again = law.step(state, given, 0.1, floats), law.step(state, given, 0.1, floats)
        assert str(once) == str(again)  # NaN, a sensor's "nothing", equals nothing
        numbers = {k: v for k, v in given._asdict().items() if k != "scene"}
        traced = compiled(state, numbers)
        with np.errstate(divide="ignore"):
            on_arrays = law.step(state, given, 0.1, np)
        for other in (on_arrays, traced):
            # A few operations on numbers up to 10, each rounded to an ulp by another library.
            np.testing.assert_allclose(leaves(other), leaves(once), rtol=0, atol=1e-12)
        assert jax.tree.structure(traced[0]) == jax.tree.structure(state)
        state = once[0]
