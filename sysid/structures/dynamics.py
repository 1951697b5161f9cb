"""Dynamics: from parameters to free runs, poles, time constants and equations."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from sysid.data.documents import plain_object
from sysid.data.record import Array, Channel, Index
from sysid.effects.compensation import Identified
from sysid.effects.ground import Ground
from sysid.structures.c_step import CStep
from sysid.vehicle.motors import TorqueSource


@dataclass(frozen=True)
class Dynamics(ABC):
    """What runs: a difference equation whose numbers are one vector θ.

        x(t+1) = f(x(t), u(t); θ),  y(t) = g(x(t), u(t); θ)

    Everything is a pure function of θ. Whoever simulates, exports or judges a free run needs no
    more than this.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]

    @property
    @abstractmethod
    def nu(self) -> int:
        """Number of inputs."""

    @property
    @abstractmethod
    def ny(self) -> int:
        """Number of outputs."""

    @abstractmethod
    def n_states(self, theta: Array) -> int:
        """Number of states of the free run."""

    def rest(self, theta: Array) -> Array:
        """State in which nothing moves at the operating point, (n_states,)."""
        return np.zeros(self.n_states(theta))

    @abstractmethod
    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y): the free run sample by sample.

        Written over the namespace of its arrays, ``xp = x.__array_namespace__()``, it runs in
        NumPy and JAX, and an exporter can record it: C needs nothing else.
        """

    def readout(self, theta: Array) -> Callable[[Array, Array], Array]:
        """(x, u) → y alone, as ``step`` gives it; a step of its own unless y comes cheaper."""
        step = self.step(theta)
        return lambda x, u: step(x, u)[1]

    def traced_step(self, theta: Any, like: Array) -> Callable[[Any, Any], tuple[Any, Any]]:
        """``step`` of a θ whose numbers a compiler traces, for many θ in one compiled run.

        By default ``step`` itself: enough where it takes θ apart with functions of
        ``theta.__array_namespace__()``. What fails is run one after the other instead.

        Args:
            theta: traced, (n,).
            like: a θ of numbers; x has the states that it has.
        """
        return self.step(theta)

    def c_step(self, theta: Array) -> CStep | None:
        """C of its own for a step; None: it is recorded from ``step``."""
        return None

    @abstractmethod
    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run from x0 (rest when None): outputs (N, ny), as ``step`` gives them."""

    @abstractmethod
    def stable(self, theta: Array) -> bool:
        """Whether the free run is bounded for bounded inputs."""

    def stable_each(self, thetas: Array) -> NDArray[np.bool_]:
        """``stable`` of every row of thetas (K, n), (K,) of bool."""
        return np.array([self.stable(theta) for theta in thetas], dtype=bool)

    def stable_parts(self) -> tuple[Index, ...]:
        """Entries of θ of each part that is stable or not by itself, such as the path of an input;
        none where stability is a matter of the whole."""
        return ()

    def friction_entries(self) -> tuple[int, ...]:
        """Entries of θ that are dry friction: another floor or grease changes them together."""
        return ()

    def poles(self, theta: Array) -> NDArray[np.complex128]:
        """Poles of the linear motion in the z plane; none where there is no such motion."""
        return np.zeros(0, dtype=np.complex128)

    def time_constants(self, theta: Array) -> Array:
        """Samples in which each motion of its own falls to 1/e.

        τ = −1 / ln |p| of the poles p: infinite for an integrator, negative for a motion that
        grows. Empty where nothing is known.
        """
        radii = np.abs(self.poles(theta))
        growth = np.log(radii[radii > 0.0])
        constants = np.full(len(growth), np.inf)
        np.divide(-1.0, growth, out=constants, where=growth != 0.0)
        return constants

    @abstractmethod
    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The equations with their numbers, one line each, as a person would write them."""

    @abstractmethod
    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        """Poles, zeros, static gain …: JSON-able facts that follow from θ, to be shown."""

    def ground(self, theta: Array) -> Ground:
        """Effects between tracks and ground: they change the pose, no output; none by default."""
        return Ground()

    def torque(self, theta: Array) -> TorqueSource | None:
        """The motors as sources of torque; None where the dynamics give speeds only."""
        return None

    def identified(self, theta: Array) -> Identified:
        """Effects between commands and torques, for who makes up for them; none by default."""
        return Identified()

    @abstractmethod
    def order_values(self) -> dict[str, Any]:
        """Orders in their shortest form."""

    def settings(self) -> dict[str, Any]:
        """What besides orders makes the structure: options, and what was read off the data."""
        return {}

    def to_json(self) -> dict[str, Any]:
        """{structure, orders, settings, nu, ny}: what ``from_json`` needs."""
        return plain_object(
            {
                "structure": self.name,
                "orders": self.order_values(),
                "settings": self.settings(),
                "nu": self.nu,
                "ny": self.ny,
            }
        )

    @classmethod
    def upgraded(cls, raw: Mapping[str, Any]) -> Mapping[str, Any]:
        """What a file of an older version says, in the words of this one."""
        return raw

    @classmethod
    @abstractmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        """Undo ``to_json``."""
