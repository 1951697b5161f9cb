"""The catalogue of effects that a log can hide, how strong each may be, and the robot it makes.

``RANGES`` below is the documented table: from noticeable to strong against the noise, for the robot
of ``effect_robot.py``. The same seed gives the same plain robot under every effect, and an effect
the same strength whatever else is hidden beside it.
"""

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING or __package__:
    from sysid_datasets.effect_robot import Robot, Track
    from sysid_datasets.outside_effects import OUTSIDE
else:  # run as a file, from a checkout in which nothing is installed
    from effect_robot import Robot, Track
    from outside_effects import OUTSIDE

Kind = Literal["scaled", "limit", "fixed", "whole", "either"]
Mirror = Literal["", "sign", "inverse"]
Per = Literal["", "sample", "log"]


@dataclass(frozen=True)
class Range:
    """Where a parameter is drawn from, evenly.

    Attributes:
        field: the number of ``Track`` or ``Robot`` that is set.
        low, high: ends of the range.
        unit: its unit, empty for a ratio.
        kind: what the strength X does to the drawn x: ``scaled``: null + X (x − null); ``limit``,
            whose null is infinite: x/X; ``fixed``: x; ``whole``: an integer, not scaled;
            ``either``: 0 or 1 with equal chance, not scaled.
        mirror: whether half of the draws are −x (``sign``) or 1/x (``inverse``).
        per: what multiplies the range: nothing, the ``sample`` time, 1/length of the ``log``.
    """

    field: str
    low: float = 0.0
    high: float = 1.0
    unit: str = ""
    kind: Kind = "scaled"
    mirror: Mirror = ""
    per: Per = ""


@dataclass(frozen=True)
class HiddenEffect:
    """One effect of the catalogue.

    Attributes:
        stage: actuator, motor, vehicle, sensor, any or outside.
        ranges: its parameters.
        where: ``any``: both tracks in three of five draws, else one; ``one`` track; ``both``;
            ``robot``: a number that the tracks share.
        pick_one: whether one parameter of several is drawn, not all.
    """

    stage: str
    ranges: tuple[Range, ...]
    where: Literal["any", "one", "both", "robot"] = "any"
    pick_one: bool = False


LAG = (0.12, 0.35, "s")
RANGES: dict[str, HiddenEffect] = {
    "dead-zone": HiddenEffect(
        "actuator",
        (Range("dead_forward", 0.12, 0.30), Range("dead_backward", 0.12, 0.30)),
    ),
    "input-saturation": HiddenEffect("actuator", (Range("saturation", 0.40, 0.70, kind="limit"),)),
    "concave-gain": HiddenEffect("actuator", (Range("concavity", 0.25, 0.50),)),
    "direction-asymmetry": HiddenEffect(
        "actuator", (Range("backward_gain", 0.60, 0.85, mirror="inverse"),)
    ),
    "input-delay": HiddenEffect("actuator", (Range("delay", 1.4, 4.0, "s", per="sample"),)),
    "rate-limit": HiddenEffect("actuator", (Range("rate_limit", 0.6, 1.8, "1/s", kind="limit"),)),
    "actuator-lag": HiddenEffect("actuator", (Range("actuator_lag", *LAG),)),
    "supply-sag": HiddenEffect("actuator", (Range("sag", 0.25, 0.50),), where="robot"),
    "dead-time": HiddenEffect("actuator", (Range("dead_time", 0.05, 0.15),)),
    "current-limit": HiddenEffect(
        "actuator", (Range("current_limit", 2.5, 7.0, "rad/s", kind="limit"),)
    ),
    "battery-discharge": HiddenEffect(
        "actuator", (Range("discharge", 0.18, 0.40, "1/s", per="log"),), where="robot"
    ),
    "backlash": HiddenEffect("motor", (Range("backlash", 0.5, 1.6, "rad"),)),
    "coulomb-friction": HiddenEffect("motor", (Range("coulomb", 1.5, 4.0, "rad/s"),)),
    "stiction": HiddenEffect(
        "motor",
        (
            Range("coulomb", 1.0, 2.5, "rad/s"),
            Range("breakaway", 1.5, 3.5, "rad/s"),
            Range("stribeck_speed", 0.8, 2.0, "rad/s", kind="fixed"),
        ),
    ),
    "quadratic-drag": HiddenEffect("motor", (Range("drag", 0.03, 0.09, "s/rad"),)),
    "load-bias": HiddenEffect("motor", (Range("load", 1.0, 3.0, "rad/s", mirror="sign"),)),
    "coast-asymmetry": HiddenEffect("motor", (Range("coast_ratio", 1.6, 2.8, mirror="inverse"),)),
    "freewheel": HiddenEffect(
        "motor",
        (
            Range("freewheel", 1.0, 1.0),
            Range("freewheel_decay", 6.0, 16.0, "rad/s²", kind="fixed"),
            Range("freewheel_overrun", kind="either"),
        ),
    ),
    "viscous-asymmetry": HiddenEffect(
        "motor", (Range("backward_viscous", 1.25, 1.80, mirror="inverse"),)
    ),
    "cross-coupling": HiddenEffect("motor", (Range("coupling", 0.12, 0.35, mirror="sign"),)),
    "inertial-coupling": HiddenEffect(
        "motor", (Range("inertia", 0.15, 0.40, mirror="sign"),), where="robot"
    ),
    "thermal-fade": HiddenEffect(
        "motor",
        (Range("fade", 0.20, 0.40), Range("fade_time", 12.0, 40.0, "s", kind="fixed")),
    ),
    "speed-ripple": HiddenEffect(
        "motor",
        (
            Range("ripple", 0.8, 2.0, "rad/s"),
            Range("ripple_lines", 1.0, 3.0, kind="whole"),
            Range("ripple_from_reading", kind="either"),
        ),
    ),
    "track-slip": HiddenEffect("vehicle", (Range("slip", 0.05, 0.35),), where="robot"),
    "radius-mismatch": HiddenEffect(
        "vehicle", (Range("radius_ratio", 0.90, 0.97, mirror="inverse"),), where="one"
    ),
    "track-width": HiddenEffect("vehicle", (Range("width_ratio", 1.06, 1.30),), where="robot"),
    "sensor-lag": HiddenEffect("sensor", (Range("sensor_lag", *LAG),)),
    "sensor-saturation": HiddenEffect(
        "sensor",
        (
            Range("sensor_limit", 8.0, 13.0, "rad/s", kind="limit"),
            Range("noise_last", kind="either"),
        ),
    ),
    "sensor-bias": HiddenEffect(
        "sensor", (Range("sensor_bias", 0.8, 2.0, "rad/s", mirror="sign"),)
    ),
    "unsigned-speed": HiddenEffect(
        "sensor", (Range("unsigned", 1.0, 1.0), Range("noise_last", kind="either")), where="both"
    ),
    "quantisation": HiddenEffect("sensor", (Range("quantum", 0.6, 1.5, "rad/s"),)),
    "dropouts": HiddenEffect(
        "sensor", (Range("dropout_share", 0.02, 0.06), Range("dropout_holds", kind="either"))
    ),
    "changed-parameter": HiddenEffect(
        "any",
        (
            Range("gain_factor", 0.60, 0.80, mirror="inverse"),
            Range("time_constant_factor", 0.50, 0.70, mirror="inverse"),
        ),
        pick_one=True,
    ),
}
"""Every effect of the catalogue and what it is drawn from."""

SIDES = ("omega_l", "omega_r")
POSE = ("x", "y", "psi")
KNOWN = ("none", *RANGES, *OUTSIDE)
"""What ``--effect`` understands."""

LATER = ("inertial-coupling", "dead-time", "current-limit")
"""Effects that came later: last in line for streams of chance, so that no other log changes."""

STREAMS = (*(e for e in KNOWN if e not in LATER), *LATER)
"""What is hidden, by the number of its stream of chance."""


def needs_pose(effects: tuple[str, ...]) -> bool:
    """Whether one of the effects shows in the pose alone."""
    return any(e in RANGES and RANGES[e].stage == "vehicle" for e in effects)


def generator(seed: int, *stream: int) -> np.random.Generator:
    """A source of randomness of its own for each purpose."""
    return np.random.Generator(np.random.PCG64([seed, *stream]))


def plain_robot(seed: int) -> Robot:
    """A robot without effects: K 18 … 24 rad/s, τ 0.16 … 0.32 s, the tracks 5 to 15 % apart."""
    rng = generator(seed, 0)
    gain, tau = rng.uniform(18.0, 24.0), rng.uniform(0.16, 0.32)
    apart = rng.uniform(1.05, 1.15, 2) ** rng.choice([-1.0, 1.0], 2)
    left = Track(gain=round(float(gain), 3), time_constant=round(float(tau), 4))
    right = Track(
        gain=round(float(gain * apart[0]), 3), time_constant=round(float(tau * apart[1]), 4)
    )
    return Robot((left, right))


def with_effect(
    robot: Robot, effect: str, seed: int, strength: float, sample_time: float, duration: float
) -> tuple[Robot, dict[str, object]]:
    """``robot`` with an effect of random strength, and what a truth file says of it.

    Args:
        robot: what the effect is added to.
        effect: an id of the catalogue or of an effect outside.
        seed: of the log.
        strength: factor on the random strength; 0 is no effect, 1 as drawn.
        sample_time: time between samples [s].
        duration: length of the estimation log [s].

    Raises:
        KeyError: there is no such effect.
    """
    rng = generator(seed, 1, STREAMS.index(effect))
    if effect in OUTSIDE:
        hidden = HiddenEffect("outside", (Range("outside", *OUTSIDE[effect][1]),))
    else:
        hidden = RANGES[effect]
    ranges = hidden.ranges
    if hidden.pick_one:
        ranges = (ranges[int(rng.integers(len(ranges)))],)
    base = {r.field: _drawn(r, rng, sample_time, duration) for r in ranges}
    numbers: dict[str, dict[str, float]] = {}
    if hidden.where == "robot":
        values = {r.field: _at_strength(r, base[r.field], Robot, strength) for r in ranges}
        robot = replace(robot, **values)  # type: ignore[arg-type]
        numbers["robot"] = values
        channels: tuple[str, ...] = POSE if hidden.stage == "vehicle" else SIDES
    else:
        chosen = _sides(hidden.where, rng)
        tracks = list(robot.tracks)
        for side in chosen:
            scatter = rng.uniform(0.92, 1.08)
            values = {}
            for r in ranges:
                drawn = base[r.field]
                if r.kind in ("scaled", "limit") and r.low != r.high:
                    drawn = _scattered(r, drawn, scatter)
                values[r.field] = _at_strength(r, drawn, Track, strength)
            numbers[SIDES[side]] = values
            tracks[side] = replace(tracks[side], **_as_fields(effect, values))  # type: ignore[arg-type]
        robot = replace(robot, tracks=(tracks[0], tracks[1]))
        channels = POSE if hidden.stage == "vehicle" else tuple(SIDES[s] for s in chosen)
    return robot, {
        "id": effect,
        "stage": hidden.stage,
        "channels": list(channels),
        "parameters": numbers,
        "units": {r.field: r.unit for r in ranges},
    }


def _drawn(r: Range, rng: np.random.Generator, sample_time: float, duration: float) -> float:
    if r.kind == "either":
        return float(rng.integers(2))
    if r.kind == "whole":
        return float(rng.integers(int(r.low), int(r.high) + 1))
    value = float(rng.uniform(r.low, r.high))
    if r.mirror and rng.random() < 0.5:
        value = -value if r.mirror == "sign" else 1.0 / value
    return value * {"": 1.0, "sample": sample_time, "log": 1.0 / duration}[r.per]


def _scattered(r: Range, drawn: float, scatter: float) -> float:
    """The tracks differ by some percent; a ratio by its distance from 1."""
    return 1.0 + (drawn - 1.0) * scatter if r.mirror == "inverse" else drawn * scatter


def _at_strength(r: Range, drawn: float, owner: type[Track | Robot], strength: float) -> float:
    if r.kind == "limit":
        return drawn / strength if strength > 0.0 else float("inf")
    if r.kind != "scaled":
        return drawn
    nulls = {f.name: f.default for f in fields(owner)}
    null = nulls[r.field] if r.field != "outside" else 0.0
    assert isinstance(null, float)
    return null + strength * (drawn - null)


def _as_fields(effect: str, values: dict[str, float]) -> dict[str, object]:
    if effect in OUTSIDE:
        return {"outside": OUTSIDE[effect][0](values["outside"])}
    return dict(values)


def _sides(where: str, rng: np.random.Generator) -> tuple[int, ...]:
    lot, side = rng.random(), int(rng.integers(2))
    if where == "both" or (where == "any" and lot < 0.6):
        return (0, 1)
    return (side,)
