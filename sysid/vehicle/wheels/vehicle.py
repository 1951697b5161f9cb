"""A described vehicle: its wheels, body, mobility and kinematics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sysid.errors import ModelError, UsageError
from sysid.vehicle.wheels import constraints as matrices
from sysid.vehicle.wheels import mobility, twists
from sysid.vehicle.wheels.body import (
    Body,
    MassProperties,
    box_inertia,
    combined,
    cylinder_inertia,
)
from sysid.vehicle.wheels.constraints import Angles, Constraints, Scale
from sysid.vehicle.wheels.mobility import Degrees, Icr
from sysid.vehicle.wheels.twists import ForwardKinematics, InverseKinematics
from sysid.vehicle.wheels.wheel import Wheel

AXES: Mapping[str, tuple[float, float, float]] = {
    "vx": (1.0, 0.0, 0.0),
    "vy": (0.0, 1.0, 0.0),
    "wz": (0.0, 0.0, 1.0),
}
"""The unit twists: 1 m/s forward, 1 m/s to the left, 1 rad/s counter-clockwise."""

FORK = 0.01
"""Share of a steered wheel's mass that its fork takes: simulators refuse parts without a mass."""

MASS_TOLERANCE = 1e-3
"""Share by which masses of parts may miss that of the whole: kitchen scales and rounding."""


@dataclass(frozen=True)
class Tracks:
    """What makes two wheels stand for tracks.

    Attributes:
        width: B, distance of the centre lines [m].
        effective_width: distance at which two wheels turn the body as the tracks do [m].
        contact_length: L of a track on the ground [m].
    """

    width: float
    effective_width: float
    contact_length: float


@dataclass(frozen=True)
class Vehicle:
    """Wheels under a body. A tracked vehicle is two fixed wheels at its effective width.

    Attributes:
        wheels: at least one, each with a name of its own.
        mass: of the whole, wheels included [kg]; None where only the parts' are known, or none.
        yaw_inertia: measured, of the whole about its centre of mass [kg m²].
        friction: coefficient of the wheels on the ground.

    Raises:
        ModelError: there is no wheel, two have one name, or masses contradict each other.
    """

    wheels: tuple[Wheel, ...]
    name: str = "vehicle"
    body: Body = field(default_factory=Body)
    mass: float | None = None
    yaw_inertia: float | None = None
    friction: float | None = None
    tracks: Tracks | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.wheels:
            raise ModelError(f"{self.name} has no wheel: describe at least one")
        taken = {w.name for w in self.wheels}
        named = tuple(
            w if w.name else w.model_copy(update={"name": _free_name(k, taken)})
            for k, w in enumerate(_on_one_ground(self.wheels), 1)
        )
        object.__setattr__(self, "wheels", named)
        names = [w.name for w in named]
        double = next((n for n in names if names.count(n) > 1), None)
        if double is not None:
            raise ModelError(f"two wheels are called {double!r}: give each a name of its own")
        self.with_masses()

    # Kinematics -----------------------------------------------------------------------------------

    @cached_property
    def degrees(self) -> Degrees:
        """Mobility, steerability and manoeuvrability."""
        return mobility.degrees(self.wheels)

    @property
    def mobility(self) -> int:
        """Δm: degrees of freedom that wheel speeds alone give."""
        return self.degrees.mobility

    @property
    def steerability(self) -> int:
        """Δs: degrees of freedom that steering gives."""
        return self.degrees.steerability

    @property
    def manoeuvrability(self) -> int:
        """ΔM = δm + δs."""
        return self.degrees.manoeuvrability

    def constraints(self, angles: Angles | None = None) -> Constraints:
        """J1, J2, C1 and the rank of C1 at steering angles [rad] by name, else the present ones."""
        return matrices.constraints(self.wheels, self._steered(angles))

    def icr(self, angles: Angles | None = None, speeds: Mapping[str, float] | None = None) -> Icr:
        """Where the body turns about, at steering angles [rad] and wheel speeds [rad/s]."""
        if speeds is None:
            return mobility.icr(self.wheels, self._steered(angles))
        twist = self.forward(speeds, angles).twist
        return mobility.icr_of_twist(twist, Scale.of(self.wheels))

    def misalignment(self, angles: Angles | None = None) -> dict[str, float]:
        """How far wheels point off a common motion [rad], by name; zeros where they agree."""
        return mobility.misalignment(self.wheels, self._steered(angles))

    def inverse(self, twist: Sequence[float], angles: Angles | None = None) -> InverseKinematics:
        """Wheel speeds and steering angles for a twist (Vx, Vy [m/s], ψ̇ [rad/s])."""
        return twists.inverse(self.wheels, twist, self._steered(angles))

    def forward(
        self, speeds: Mapping[str, float], angles: Angles | None = None
    ) -> ForwardKinematics:
        """The twist from wheel speeds [rad/s] by name, and its residual."""
        self._known(speeds)
        return twists.forward(self.wheels, speeds, self._steered(angles))

    def limits(self) -> dict[str, float | None]:
        """Largest speed along each axis alone [m/s, m/s, rad/s]: 0 if impossible, None if open."""
        return {name: twists.largest_speed(self.wheels, axis) for name, axis in AXES.items()}

    # Mass -----------------------------------------------------------------------------------------

    def with_masses(self) -> "Vehicle":
        """The vehicle with the mass of the whole shared out: known parts first, equal shares after.

        Raises:
            ModelError: the parts weigh more than the whole, or all are known and it is another.
        """
        if self.mass is None:
            return self
        of_wheels = [w.mass for w in self.wheels]
        open_wheels = of_wheels.count(None)
        rest = self.mass - sum(m for m in of_wheels if m is not None) - (self.body.mass or 0.0)
        settled = self.body.mass is not None and not open_wheels
        if settled and abs(rest) > MASS_TOLERANCE * self.mass:
            raise ModelError(
                f"body and wheels weigh {self.mass - rest:.4g} kg, the whole {self.mass:.4g} kg: "
                "correct one of the masses"
            )
        if settled:
            return self
        if rest <= 0:
            raise ModelError(
                f"body and wheels weigh {self.mass - rest:.4g} kg, so that of the "
                f"{self.mass:.4g} kg of the whole nothing is left for the others: correct a mass"
            )
        if self.body.mass is None:
            return replace(self, body=self.body.model_copy(update={"mass": rest}), mass=None)
        share = {"mass": rest / open_wheels}
        wheels = (w if w.mass is not None else w.model_copy(update=share) for w in self.wheels)
        return replace(self, wheels=tuple(wheels), mass=None)

    def mass_properties(self) -> MassProperties | None:
        """Mass, centre and inertia of all parts; None where a mass or a shape is not known."""
        parts = self.with_masses()
        body = parts.body_properties()
        wheels = [p for w in parts.wheels if w.mass and (p := wheel_properties(w))]
        return combined([body, *wheels]) if body is not None else None

    def body_properties(self) -> MassProperties | None:
        """Of the body alone: its own inertia, else that of a solid box."""
        body = self.body
        if body.mass is None:
            return None
        tensor = body.inertia.tensor if body.inertia else None
        if tensor is None:
            if body.size is None:
                return None
            tensor = box_inertia(body.mass, body.size)
        return MassProperties(body.mass, np.array(body.mass_centre or body.at), tensor)

    def _steered(self, angles: Angles | None) -> Angles | None:
        """Angles by name, once every name is that of a wheel that has one."""
        self._known(angles)
        for wheel in self.wheels:
            if wheel.name in (angles or {}) and wheel.kind not in ("steerable", "caster"):
                raise UsageError(f"{wheel.name} is not steered: leave its angle out")
        return angles

    def _known(self, given: Mapping[str, float] | None) -> None:
        names = [w.name for w in self.wheels]
        for name in given or {}:
            if name not in names:
                raise UsageError(f"there is no wheel {name!r}: the wheels are {', '.join(names)}")


def wheel_properties(wheel: Wheel) -> MassProperties | None:
    """Of a wheel as a solid cylinder; None where its mass is not known."""
    if wheel.mass is None:
        return None
    phi = wheel.direction()
    axle = np.array([-np.sin(phi), np.cos(phi), 0.0])
    place = np.array([*wheel.contact(), wheel.height])
    tensor = cylinder_inertia(wheel.mass, wheel.r, wheel_width(wheel), axle)
    return MassProperties(wheel.mass, place, tensor)


def wheel_width(wheel: Wheel) -> float:
    """Its width [m]; half its radius where it is not known, to draw it and to give it a volume."""
    return 0.5 * wheel.r if wheel.width is None else wheel.width


def _on_one_ground(wheels: Sequence[Wheel]) -> list[Wheel]:
    """Wheels of unknown height, on the ground of the others, else of the largest at z = 0."""
    given = [w.at[2] - w.r for w in wheels if w.at[2] is not None]
    ground = min(given) if given else -max(w.r for w in wheels)
    return [
        w if w.at[2] is not None else w.model_copy(update={"at": (*w.position, ground + w.r)})
        for w in wheels
    ]


def _free_name(k: int, taken: set[str]) -> str:
    name = f"wheel_{k}"
    return name if name not in taken else _free_name(k + len(taken), taken)
