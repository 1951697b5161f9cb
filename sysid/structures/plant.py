"""Plant: the model that the mission simulator and every exported runtime run."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel
from sysid.effects.compensation import Identified
from sysid.effects.ground import Ground
from sysid.structures import physics, special_runs
from sysid.structures.base import Structure
from sysid.vehicle.motors import TorqueSource

Step = Callable[[Array, Array], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class Plant:
    """A core model stepped sample by sample, physical units in and out.

    y(k) is the output at the instant u(k) is applied; with an input delay of one sample it does
    not depend on u(k).

    Attributes:
        dt: sample time [s].
        core: (x, u) → (x⁺, y) about the operating point.
        core_readout: (x, u) → y, for whoever needs y before u is settled; core's own when None.
        u_offset, y_offset: the operating point, shapes (nu,) and (ny,).
        input_range: lowest and highest value of each input seen in the data: inside it the
            plant was identified, outside it extrapolates.
        rest_state: state of the core in which nothing moves at the operating point.
        ground: effects between tracks and ground, for whoever moves a vehicle by the outputs.
        identified: effects between commands and torques, for whoever makes up for them.
        torque: its motors as sources of torque, for whoever lets the ground answer them; None where
            the core gives speeds only.
    """

    dt: float
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    n_states: int
    core: Step
    u_offset: Array
    y_offset: Array
    input_range: tuple[tuple[float, float], ...] = ()
    rest_state: Array = field(default_factory=lambda: np.zeros(0))
    ground: Ground = field(default_factory=Ground)
    identified: Identified = field(default_factory=Identified)
    core_readout: Callable[[Array, Array], Array] | None = None
    torque: TorqueSource | None = None

    @staticmethod
    def of_structure(
        structure: Structure,
        theta: Array,
        dt: float,
        inputs: tuple[Channel, ...],
        outputs: tuple[Channel, ...],
        detrend: Detrend,
        ranges: Array,
    ) -> "Plant":
        """The plant of dynamics with their parameters; trends in time are not part of it."""
        rest = special_runs.rest(structure, theta)
        return Plant(
            dt=dt,
            inputs=inputs,
            outputs=outputs,
            n_states=len(rest),
            core=structure.step(theta),
            u_offset=np.asarray(detrend.u_offset, dtype=np.float64),
            y_offset=np.asarray(detrend.y_offset, dtype=np.float64),
            input_range=tuple((float(a), float(b)) for a, b in ranges[: len(inputs)]),
            rest_state=rest,
            ground=physics.ground_effects(structure, theta),
            identified=physics.identified_effects(structure, theta),
            core_readout=special_runs.readout(structure, theta),
            torque=physics.torques(structure, theta),
        )

    def initial_state(self) -> Array:
        """The state of rest at the operating point."""
        return self.rest_state.copy()

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """Advance one sample: (state, u (nu,)) → (next state, y (ny,))."""
        state, y = self.core(state, u - self.u_offset)
        return state, y + self.y_offset

    def readout(self, state: Array, u: Array) -> Array:
        """y (ny,) alone, as ``step`` gives it."""
        if self.core_readout is None:
            return self.step(state, u)[1]
        return self.core_readout(state, u - self.u_offset) + self.y_offset
