"""One wheel: position, rolling direction, and constraints of its kind.

A wheel is placed by its axis: the steering axis of a steerable wheel or a caster, the middle of
any other. It rolls along e = (cos φ, sin φ), φ = heading + angle; n = (−sin φ, cos φ) is to its
left, along its axle. A positive speed ω drives the body towards e.
"""

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from sysid.data.record import Array
from sysid.data.yaml_files.problems import sentence_at
from sysid.data.yaml_files.settings import Coordinate, Positive, Settings
from sysid.data.yaml_files.source import shown

Kind = Literal["fixed", "steerable", "caster", "swedish"]

FULL_TURN = 6.2832
"""Angles beyond ± this [rad] were meant in degrees."""

LEAST_GRIP = 0.05
"""cos γ below which a roller's axis lies along the axle and the wheel's speed no longer drives."""

Angle = Annotated[float, Field(ge=-1e6, le=1e6)]

WORDS: dict[str, str] = {
    "fixed": "fixed wheel",
    "steerable": "steerable wheel",
    "caster": "caster",
    "swedish": "Swedish wheel",
}
"""Kinds as sentences call them."""

_ONLY_FOR: dict[str, tuple[Kind, ...]] = {
    "angle": ("steerable", "caster"),
    "angle_limits": ("steerable",),
    "offset": ("caster",),
    "side": ("steerable", "caster"),
    "roller": ("swedish",),
}
"""Key → the kinds of wheel that have it."""


class Wheel(Settings):
    """One wheel of a vehicle.

    Attributes:
        kind: fixed; steerable (turned by a motor about its vertical axis); caster (turns by itself
            about an axis off its contact); swedish (rollers round its rim).
        at: x, y of its axis, and z of its middle, in the body frame [m]; z may be left out, and
            then puts it on one ground with the others.
        r: radius [m].
        heading: direction in which it rolls at steering angle 0 [rad], 0 along x.
        angle: present steering angle [rad], added to the heading.
        angle_limits: least and largest steering angle [rad]; None where it turns freely.
        offset: d, how far a caster's contact trails behind its axis [m].
        side: how far the contact of a steered wheel stands to the left of its axis [m].
        roller: γ, from the direction of rolling to the axis of the roller on the ground [rad]:
            0 for rollers across (omni wheel), ± π/4 for a Mecanum wheel.
        width: of the wheel [m], for pictures and files.
        mass: of the wheel [kg].
        max_speed: that its motor reaches [rad/s].
    """

    name: str = ""
    kind: Kind = "fixed"
    at: Annotated[tuple[Coordinate, Coordinate, Coordinate | None], Field(strict=False)]
    r: Positive
    heading: Angle = 0.0
    angle: Angle = 0.0
    angle_limits: Annotated[tuple[Angle, Angle], Field(strict=False)] | None = None
    offset: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    side: Coordinate = 0.0
    roller: Angle = 0.0
    width: Positive | None = None
    mass: Positive | None = None
    max_speed: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _place(cls, value: Any) -> Any:
        """Accept ``at: [x, y]`` as well, and say of a kind what kinds there are."""
        if not isinstance(value, dict):
            raise ValueError(
                f"{shown(value)} is not a wheel: write {{kind: fixed, at: [x, y], r: 0.05}}"
            )
        kind, kinds = value.get("kind", "fixed"), Kind.__args__  # type: ignore[attr-defined]
        if kind not in kinds:
            raise sentence_at(("kind",), f"kind is {shown(kind)}: write {', '.join(kinds)}")
        at = value.get("at")
        if at is None:
            return value
        if not isinstance(at, list | tuple) or len(at) not in (2, 3):
            raise sentence_at(("at",), f"at is {shown(at)}: write at: [x, y] in metres")
        return value | {"at": (*at, None)[:3]}

    @model_validator(mode="after")
    def _fits_kind(self) -> "Wheel":
        for key, kinds in _ONLY_FOR.items():
            if key in self.model_fields_set and self.kind not in kinds:
                one = " or ".join(f"a {WORDS[kind]}" for kind in kinds)
                raise sentence_at(
                    (key,),
                    f"{key} is given for a {WORDS[self.kind]}, but only {one} has it: "
                    "remove it or change kind",
                )
        if self.kind == "caster" and self.offset == 0:
            raise sentence_at(
                ("offset",),
                "a caster needs an offset between its axis and its contact: add "
                "offset: 0.03, or make it kind: steerable",
            )
        if abs(math.cos(self.roller)) < LEAST_GRIP:
            raise sentence_at(
                ("roller",),
                f"roller is {self.roller:g} rad, rollers along the axle, so that the "
                "wheel's speed drives nothing: give an angle well below a quarter turn",
            )
        return self

    @model_validator(mode="after")
    def _radians(self) -> "Wheel":
        for key in ("heading", "angle", "roller", "angle_limits"):
            given = getattr(self, key)
            for value in given if isinstance(given, tuple) else (given,):
                if value is not None and abs(value) > FULL_TURN:
                    raise sentence_at(
                        (key,),
                        f"{key} is {value:g}, more than a full turn: give it in radians, "
                        f"{math.radians(value):.4g} for {value:g} degrees",
                    )
        if self.angle_limits and not self.angle_limits[0] < self.angle_limits[1]:
            raise sentence_at(
                ("angle_limits",), "angle_limits do not rise: write angle_limits: [least, largest]"
            )
        return self

    @property
    def position(self) -> tuple[float, float]:
        """X, y of its axis in the body frame [m]."""
        return self.at[0], self.at[1]

    @property
    def height(self) -> float:
        """Z of its middle in the body frame [m]; 0 where nothing is known of it."""
        return self.at[2] or 0.0

    @property
    def constrains(self) -> bool:
        """Whether it keeps the body from moving along its axle."""
        return self.kind in ("fixed", "steerable")

    def direction(self, angle: float | None = None) -> float:
        """φ [rad], the direction in which it rolls at a steering angle (None: the present one)."""
        return self.heading + (self.angle if angle is None else angle)

    def contact(self, angle: float | None = None) -> tuple[float, float]:
        """X, y of its contact with the ground [m] at a steering angle."""
        c, s = math.cos(self.direction(angle)), math.sin(self.direction(angle))
        x, y = self.position
        return x - self.offset * c - self.side * s, y - self.offset * s + self.side * c

    def rolling_row(self, angle: float | None = None) -> list[float]:
        """The row of J1, (3,): J1 ξ = J2 ω with ξ = (Vx, Vy, ψ̇) in the body frame.

        [cos β, sin β, x sin β − y cos β] with β = φ + γ (γ = 0 but for Swedish wheels): the
        velocity of the contact along e, or along the roller's axis, where the ground can pull.
        For a track at (0, ±B/2) it is Vx ∓ ψ̇B/2 = rω (thesis 2.13, 2.15). A caster whose contact
        stands beside its axis rolls by its own turning, too: d (ψ̇ + φ̇) = n·v of the axis.
        """
        beta = self.direction(angle) + self.roller
        x, y = self.contact(angle) if self.kind == "steerable" else self.position
        c, s = math.cos(beta), math.sin(beta)
        beside = self.side / self.offset if self.kind == "caster" else 0.0
        c, s = c + beside * s, s - beside * c
        return [c, s, x * s - y * c]

    @property
    def rolling_radius(self) -> float:
        """The entry of J2: r cos γ [m]."""
        return self.r * math.cos(self.roller)

    def sliding_row(self, angle: float | None = None) -> list[float]:
        """The row of C1, (3,): the velocity of the contact along n, towards the wheel's left.

        [−sin φ, cos φ, x cos φ + y sin φ], with the contact's x, y. It is 0 for fixed and
        steerable wheels (thesis 2.16); for a caster it is d φ̇, which turns it.
        """
        phi = self.direction(angle)
        x, y = self.contact(angle)
        c, s = math.cos(phi), math.sin(phi)
        return [-s, c, x * c + y * s]


def velocity_at(place: tuple[float, float], twist: Array) -> tuple[float, float]:
    """Velocity [m/s] of the body's point (x, y) at a twist (Vx, Vy, ψ̇): v + ψ̇ × r (thesis 2.7)."""
    forward, sideways, yaw_rate = map(float, twist)
    x, y = place
    return forward - yaw_rate * y, sideways + yaw_rate * x
