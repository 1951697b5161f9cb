"""Which column of a log is what: time, inputs, outputs and pose, by option or by name."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from sysid.errors import DataError, UsageError

ROBOT_INPUTS = ("pwm_l", "pwm_r")
ROBOT_OUTPUTS = ("omega_l", "omega_r")
POSE = ("x", "y", "psi")
TIME_COLUMNS: dict[str, float] = {
    "t": 1.0,
    "time": 1.0,
    "t_s": 1.0,
    "time_s": 1.0,
    "timestamp": 1.0,
    "timestamp_s": 1.0,
    "t_ms": 1e-3,
    "time_ms": 1e-3,
    "timestamp_ms": 1e-3,
    "t_us": 1e-6,
    "time_us": 1e-6,
    "timestamp_us": 1e-6,
    "t_ns": 1e-9,
    "time_ns": 1e-9,
    "timestamp_ns": 1e-9,
}
"""Names of a time column -> its unit [s]."""
COUNTERS = ("sample", "samples", "index", "k", "n")

_INPUT = re.compile(r"u|u\d+|u\d*_.+|in|in\d+|in\d*_.+|input.*|pwm.*|cmd.*|command.*|volt.*", re.I)
_OUTPUT = re.compile(
    r"y|y\d+|y\d*_.+|out|out\d+|out\d*_.+|output.*|omega.*|w|w\d+|w_.+|speed.*|vel.*|tacho.*", re.I
)
_NOT_MEASURED = re.compile(r"(^|_)(ref|reference|setpoint|sp|desired|des|target|hat|sim)\d*(_|$)")


@dataclass(frozen=True)
class Choice:
    """The columns of one file by what they are.

    Attributes:
        inputs, outputs: column names, in the order of the record.
        pose: names of x, y, ψ, or empty.
        time: name of the time column, or None.
        unit: unit of the time column [s]; None when it only counts samples.
        ignored: the other columns.
        rule: how inputs and outputs were found: "option", "robot" or "prefix".
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    pose: tuple[str, ...]
    time: str | None
    unit: float | None
    ignored: tuple[str, ...]
    rule: str


def choose_columns(
    names: Sequence[str],
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    time: str | None = None,
    where: str = "log",
) -> Choice:
    """Say which column is what.

    Inputs and outputs given by name win. Otherwise the robot's convention holds (pwm_l, pwm_r,
    omega_l, omega_r, optionally x, y, psi), then prefixes: ``u…``, ``in…``, ``pwm…``, ``cmd…``,
    ``volt…`` are inputs, ``y…``, ``out…``, ``omega…``, ``w_…``, ``speed…``, ``vel…`` are outputs.
    References (``…_ref``, ``…_hat``) are never taken for outputs.

    Args:
        names: the file's column names.
        inputs, outputs: names asked for; empty to go by convention.
        time: the time column asked for; None to go by name.
        where: what to call the file in messages.

    Raises:
        UsageError: a name asked for is not there, is asked for twice, or is both input and output.
        DataError: inputs or outputs cannot be told from the names.
    """
    asked_u = tuple(_find(n, names, "--input", where) for n in inputs)
    asked_y = tuple(_find(n, names, "--output", where) for n in outputs)
    _no_repeats(asked_u, asked_y, where)
    clock, unit = _time_column(names, (*asked_u, *asked_y), time, where)
    free = [n for n in names if n not in (*asked_u, *asked_y, clock)]
    lower = {n.lower(): n for n in free}
    pose = tuple(lower[p] for p in POSE) if all(p in lower for p in POSE) else ()

    robot_u = tuple(lower[n] for n in ROBOT_INPUTS if n in lower)
    robot_y = tuple(lower[n] for n in ROBOT_OUTPUTS if n in lower)
    rule = "prefix"
    if asked_u and asked_y:
        found_u, found_y, rule = asked_u, asked_y, "option"
    elif len(robot_u) == 2 and len(robot_y) == 2 and not asked_u and not asked_y:
        found_u, found_y, rule = robot_u, robot_y, "robot"
    else:
        found_u = asked_u or tuple(n for n in free if _INPUT.fullmatch(n))
        measured = [n for n in free if _OUTPUT.fullmatch(n) and not _NOT_MEASURED.search(n.lower())]
        if pose and any(n not in pose for n in measured):
            measured = [n for n in measured if n not in pose]
        found_y = asked_y or tuple(n for n in measured if n not in found_u)
    if not found_u or not found_y:
        raise DataError(_unclear(names, found_u, found_y, clock, where))
    used = {*found_u, *found_y, clock}
    if any(p in used for p in pose):
        pose = ()
    ignored = tuple(n for n in names if n not in used and n not in pose)
    return Choice(found_u, found_y, pose, clock, unit, ignored, rule)


def _find(name: str, names: Sequence[str], option: str, where: str) -> str:
    wanted = name.strip()
    if wanted in names:
        return wanted
    near = [n for n in names if n.lower() == wanted.lower()]
    if wanted and len(near) == 1:
        return near[0]
    shown = repr(wanted) if wanted else "an empty name"
    raise UsageError(
        f"{option} asks for {shown}, which is no column of {where}; "
        f"its columns are {_listed(names)}"
    )


def _no_repeats(inputs: tuple[str, ...], outputs: tuple[str, ...], where: str) -> None:
    for option, chosen in (("--input", inputs), ("--output", outputs)):
        twice = {n for n in chosen if chosen.count(n) > 1}
        if twice:
            raise UsageError(f"{option} names column {min(twice)} of {where} twice; name it once")
    both = set(inputs) & set(outputs)
    if both:
        raise UsageError(
            f"column {min(both)} of {where} cannot be both input and output; take it out of one"
        )


def _time_column(
    names: Sequence[str], taken: tuple[str, ...], asked: str | None, where: str
) -> tuple[str | None, float | None]:
    if asked is not None:
        name = _find(asked, names, "--time", where)
        if name in taken:
            raise UsageError(f"column {name} of {where} is the time; it cannot be a signal too")
        key = name.lower()
        return name, None if key in COUNTERS else TIME_COLUMNS.get(key, _unit_of_suffix(key))
    lower = {n.lower(): n for n in names if n not in taken}
    for key, unit in TIME_COLUMNS.items():
        if key in lower:
            return lower[key], unit
    for key in COUNTERS:
        if key in lower:
            return lower[key], None
    return None, None


def _unit_of_suffix(name: str) -> float:
    return {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}.get(name.rsplit("_", 1)[-1], 1.0)


def _unclear(
    names: Sequence[str],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    clock: str | None,
    where: str,
) -> str:
    missing = "input and which output"
    if inputs or outputs:
        missing = "the input" if outputs else "the output"
    free = [n for n in names if n not in (*inputs, *outputs, clock)]
    if not free:
        return (
            f"{where} has no column left for {missing}: its columns are {_listed(names)}; "
            "a log needs at least one input and one output"
        )
    return (
        f"{where}: cannot tell which column is {missing} among {_listed(names)}; "
        "say so with --input NAME and --output NAME, or name the columns u… and y…"
    )


def _listed(names: Sequence[str], most: int = 15) -> str:
    """The names, cut short where they would fill the screen."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")
