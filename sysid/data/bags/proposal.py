"""Propose which fields of a bag are inputs and outputs of a plant: by type, name and causality.

Types and names make candidates: a Twist on a topic that commands, an Odometry, the speeds of
joints. Among these the pair is proposed in which one responds to the other: its measurements are
explained by the other's values, held and behind a lag with a dead time that is not negative, better
than the other way round.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.bags.contents import Contents, Field, Topic
from sysid.data.bags.latency import DeadTime, dead_time
from sysid.data.column_words import SIDES, words
from sysid.data.reading.columns import choose_columns
from sysid.data.unit_words import word_set
from sysid.errors import DataError, UsageError

COMMAND_WORDS = word_set(
    "cmd command commands control controls ctrl reference references pwm duty effort voltage "
    "setpoint drive target desired input u motor motors throttle actuator actuators torque"
)
"""Words of a topic that commands."""
MEASUREMENT_WORDS = word_set(
    "odom odometry state states wheel wheels encoder encoders measured feedback speed speeds "
    "velocity imu gyro output y pose sensor"
)
"""Words of a topic that measures."""
COMMANDS = word_set("Twist TwistStamped AckermannDrive AckermannDriveStamped")
NO_COMMANDS = word_set("Odometry Imu Clock TFMessage Pose PoseStamped NavSatFix Time")
NO_OUTPUTS = word_set("Clock TFMessage Time Pose PoseStamped PoseWithCovarianceStamped")
"""Types of messages that command, that never do, and that no plant puts out."""
MOST_FIELDS = 4
"""Inputs, and outputs, that are proposed at most."""
MOST_PAIRS = 3
"""Topics of each kind that are tried on each other."""
EARLY = -0.02
"""A measurement that comes so much before [s] does not respond."""
NAMED, TYPED, LED = 3.0, 3.0, 4.0
"""What a word of the topic, the type of its messages and a full response count."""


@dataclass(frozen=True)
class Proposal:
    """A mapping that likely serves.

    Attributes:
        map: column → field.
        inputs, outputs: their columns; empty where the names identify them.
        why: what speaks for it, as a sentence.
    """

    map: dict[str, str]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    why: str

    def summary(self) -> dict[str, Any]:
        sides = {"inputs": list(self.inputs), "outputs": list(self.outputs)}
        return {"map": self.map, **sides, "why": self.why}


@dataclass(frozen=True, eq=False)
class _Candidate:
    topic: Topic
    fields: tuple[Field, ...]
    score: float


def propose(contents: Contents) -> Proposal | None:
    """The most likely mapping of a bag's topics; None where none of them measures anything."""
    moving = [t for t in contents.topics if t.moving]
    inputs = _best(_as_input(t) for t in moving)
    outputs = _best(_as_output(t) for t in moving)
    best: tuple[float, _Candidate, _Candidate, DeadTime | None] | None = None
    for u in inputs:
        for y in (y for y in outputs if y.topic is not u.topic):
            led = _answers(u.fields, y.fields)
            back = _answers(y.fields, u.fields) if led is not None else None
            share = 0.0 if led is None else led.share
            if back is not None and back.share > share:
                share = -back.share
            # a Twist goes with a body, an array with its wheels
            kin = ("Twist" in u.topic.kind) == ("Odometry" in y.topic.kind)
            score = u.score + y.score + LED * share + float(kin)
            if best is None or score > best[0]:
                best = score, u, y, led
    if best is None:
        return None
    _, u, y, led = best
    names = {**_named(u, "input"), **_named(y, "output")}
    if len(names) < len(u.fields) + len(y.fields):
        return None
    pose = next((t for t in moving if _has_pose(t)), None)
    mapping = dict(names) if pose is None else {**names, "pose": f"{pose.name}"}
    why = f"By name and type {u.topic.name} commands and {y.topic.name} measures"
    if led is not None:
        why += f"; a lag of the command explains {100 * led.share:.0f} % of the measurement"
    return Proposal(mapping, *_needed(names, len(u.fields)), why)


def _best(candidates: Any) -> list[_Candidate]:
    kept = [c for c in candidates if c is not None and c.fields]
    return sorted(kept, key=lambda c: -c.score)[:MOST_PAIRS]


def _as_input(topic: Topic) -> _Candidate | None:
    kind = topic.kind.rpartition("/")[2]
    name_words = set(words(topic.name))
    commands = bool(COMMAND_WORDS & name_words)
    if kind in NO_COMMANDS or (kind == "JointState" and not commands):
        return None
    score = TYPED * (kind in COMMANDS) - NAMED * bool(MEASUREMENT_WORDS & name_words)
    return _Candidate(topic, _main(topic, kind), NAMED if commands else score)


def _as_output(topic: Topic) -> _Candidate | None:
    kind = topic.kind.rpartition("/")[2]
    name_words = set(words(topic.name))
    if COMMAND_WORDS & name_words and not MEASUREMENT_WORDS & name_words:
        return None
    if kind in NO_OUTPUTS:
        return None
    score = NAMED * bool(MEASUREMENT_WORDS & name_words)
    score += {"JointState": TYPED, "Odometry": TYPED, "Imu": 0.5 * TYPED}.get(kind, 0.0)
    return _Candidate(topic, _main(topic, kind), score)


def _main(topic: Topic, kind: str) -> tuple[Field, ...]:
    """The fields of a topic that a plant has: speeds before positions, few before many."""
    moving = topic.moving
    patterns = {
        "JointState": (r"velocity\[.*", r"position\[.*"),
        "Odometry": (r"twist\.twist\.(linear\.x|angular\.z)",),
        "Imu": (r"angular_velocity\.z",),
        "Twist": (r"(linear\.x|angular\.z)", r".*"),
        "TwistStamped": (r"twist\.(linear\.x|angular\.z)", r".*"),
    }.get(kind, (r".*",))
    for pattern in patterns:
        fields = [f for f in moving if re.fullmatch(pattern, f.path)]
        if fields:
            return tuple(fields[:MOST_FIELDS])
    return ()


def _has_pose(topic: Topic) -> bool:
    kind = topic.kind.rpartition("/")[2]
    paths = {f.path.rpartition(".")[2] for f in topic.moving}
    return kind in ("Odometry", "PoseStamped", "PoseWithCovarianceStamped", "Pose2D") and (
        {"x", "y"} <= paths
    )


def _answers(u: Sequence[Field], y: Sequence[Field]) -> DeadTime | None:
    """Mean over the measurements of how they respond to commands; None where they do not."""
    shared = [f for f in u if len(f.t) == len(u[0].t)]
    order = np.flatnonzero(np.diff(u[0].t, prepend=-np.inf) > 0.0)
    block = np.column_stack([f.values for f in shared])[order]
    dead_times = []
    for f in y:
        keep = np.isfinite(f.values) & (np.diff(f.t, prepend=-np.inf) > 0.0)
        if np.count_nonzero(keep) < 20 or not np.isfinite(block).all() or len(block) < 20:
            continue
        one = dead_time(f.t[keep], f.values[keep], [(u[0].t[order], block)])
        if one is not None and one.seconds > EARLY - 3.0 * one.std_error:
            dead_times.append(one)
    if not dead_times:
        return None
    share = sum(one.share for one in dead_times) / len(y)
    seconds = float(np.mean([one.seconds for one in dead_times]))
    return DeadTime(seconds, max(one.std_error for one in dead_times), share)


def _named(one: _Candidate, role: str) -> dict[str, str]:
    """Columns of a candidate by names that say what they are."""
    columns: dict[str, str] = {}
    for f in sorted(one.fields, key=lambda f: _side_of(f.path)):
        name = _column(one.topic, f.path, role)
        while name in columns:
            name += "_"
        columns[name] = f"{one.topic.name}.{f.path}" if f.path else one.topic.name
    return columns


def _column(topic: Topic, path: str, role: str) -> str:
    kind = topic.kind.rpartition("/")[2]
    inside = re.search(r"\[(.+)\]$", path)
    label = inside[1] if inside else path.rpartition(".")[2] or words(topic.name)[-1]
    label = re.sub(r"\W+", "_", _side_of(label)[:1] or label)
    if path.endswith("linear.x") and "Twist" in kind + path.title():
        label = "v"
    if path.endswith(("angular.z", "angular_velocity.z")):
        label = "yaw_rate"
    if role == "input":
        return f"{'pwm' if 'pwm' in words(topic.name) else 'cmd'}_{label}"
    if kind == "JointState":
        return f"{'omega' if path.startswith('velocity') else 'angle'}_{label}"
    return label if label in ("v", "yaw_rate") else f"y_{label}"


def _side_of(path: str) -> str:
    """``left`` or ``right`` where a path says so, else nothing."""
    return next((SIDES[w] for w in words(path) if w in SIDES), "")


def _needed(names: dict[str, str], inputs: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Inputs and outputs by name, where the columns' names do not identify them."""
    u, y = tuple(names)[:inputs], tuple(names)[inputs:]
    with suppress(DataError, UsageError):
        chosen = choose_columns(tuple(names), timed=True)
        if (chosen.inputs, chosen.outputs) == (u, y):
            return (), ()
    return u, y
