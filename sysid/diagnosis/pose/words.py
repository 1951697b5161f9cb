"""Sentences of a pose diagnosis: effects with their parameters, and what competes with them."""

from collections.abc import Sequence

from sysid.diagnosis.policies import POSE
from sysid.effects.base import Length
from sysid.effects.catalogue import effect
from sysid.robot.calibration.ground_fit import (
    BOTH_RADII,
    HEADING_LAG,
    POSE_FILTER,
    POSE_LAG,
    SPEED_OFFSET,
    Candidate,
    Fitted,
    PoseSearch,
    every_slot,
    geometry_of,
    radius_slot,
)


def sentence_of(c: Candidate, value: float, error: float, side: int) -> str:
    """An effect with its parameter, in plain words."""
    e = effect(c.id)
    if in_numbers := c.law.in_numbers or e.on_ground.in_numbers:
        return in_numbers(value, error, side)
    p = e.parameters[0]
    where = "" if side < 0 else f" on the {('left', 'right')[side]}"
    unit = f" {p.unit.replace('speed', 'rad/s')}" if p.unit else ""
    return f"{e.texts.sentence} Here {p.name} {value:.4g} ± {error:.2g}{unit}{where}."


def warnings_of(
    search: PoseSearch, final: Fitted, steps: Sequence[tuple[Candidate, Sequence[Candidate]]]
) -> tuple[str, ...]:
    """What is said beside the effects: what competes with them, and what they cannot be
    distinguished from.
    """
    keys = {c.key for c, _ in steps}
    sentences = []
    if BOTH_RADII in keys:
        r = geometry_of(final.q, search.estimation.geometry).r
        sentences.append(
            f"Both sides roll as if their radius were {r:.5g} m, not "
            f"{search.estimation.geometry.r:g} m: set vehicle.r in the mission."
            + ("" if search.radius_known else _or_slip(float(final.q[radius_slot()])))
        )
    sentences += _late_readings(final, keys, search.estimation.tracks[0].dt)
    if SPEED_OFFSET in keys:
        left_offset, right_offset = (
            v for s, v in zip(every_slot(), final.q, strict=True) if s.owner == SPEED_OFFSET
        )
        sentences.append(
            "By the pose, the speed sensors read "
            f"{left_offset:.3g} and {right_offset:.3g} rad/s (left, right) at standstill: "
            "subtract these offsets."
        )
    if sum(bool(c.id) and c.length is Length.RADIUS for c, _ in steps) == 2:
        sentences.append("Neither side has the radius given: check vehicle.r.")
    for c, ties in steps:
        unnamed = [t.key for t in ties if not t.id]
        if c.id and unnamed:
            sentences.append(
                f"These logs cannot distinguish {c.id} from "
                + " or ".join(_UNNAMED[k] for k in unnamed)
                + "."
            )
    return tuple(sentences)


_UNNAMED = {
    BOTH_RADII: "another radius on both sides",
    SPEED_OFFSET: "an offset of the speeds",
    POSE_LAG: "a pose that comes late",
    HEADING_LAG: "a heading that comes late",
    POSE_FILTER: "a pose that is smoothed",
}


def _or_slip(scale: float) -> str:
    """What else may make both sides carry the vehicle less far."""
    if scale >= 1.0:
        return ""
    return (
        f" Or they slip and lose {100 * (1.0 - scale):.3g} % of the distance in straight drive: "
        "one ground cannot distinguish the two. Give a measured radius (`geometry`), or drive on "
        "another ground: slip changes with it, a radius does not."
    )


def _late_readings(final: Fitted, keys: set[str], dt: float) -> list[str]:
    """What of the pose comes later than the speeds say, which is no effect."""
    late = {
        slot.owner: float(v)
        for slot, v in zip(every_slot(), final.q, strict=True)
        if slot.owner in keys and abs(v) > POSE.min_lag_samples * dt
    }
    said = []
    for key, what, beside in _LATE:
        if key in late:
            when = "later" if late[key] > 0.0 else "earlier"
            said.append(f"The {what} comes {abs(late[key]):.3g} s {when} than the {beside}.")
    if late.get(HEADING_LAG, 0.0) > 0.0:
        said[-1] += (
            " These logs cannot distinguish late measurements from a vehicle that turns late: "
            "turns that start and stop while driving would."
        )
    if POSE_FILTER in late:
        said.append(
            f"The pose follows the wheel speeds with a lag of {late[POSE_FILTER]:.3g} s, in "
            "distance and turn alike: its measurements are smoothed, or the vehicle moves later."
        )
    return said


_LATE = ((POSE_LAG, "pose", "wheel speeds say"), (HEADING_LAG, "heading", "position does"))
