"""Roles of a log's columns: time, inputs, outputs and pose, by option or by name."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sysid.data.column_words import (
    SIDES,
    Meaning,
    family,
    is_effect,
    may_drive,
    meaning,
    words,
)
from sysid.data.reading.pose_columns import PoseColumns, find_pose
from sysid.data.reading.time_column import (
    Read,
    TimeColumn,
    counts_rows,
    find_time,
    is_counter,
    is_time,
    tells_time,
    unit_in_name,
)
from sysid.errors import DataError, UsageError, argument

NO_INPUT = "none"
"""Asked for as the input of a log that has none: a signal on its own."""

ROBOT_INPUTS = ("pwm_l", "pwm_r")
ROBOT_OUTPUTS = ("omega_l", "omega_r")
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
        rule: how inputs and outputs were found: "option", "robot", "prefix" or "last", where the
            only column left was taken, or the only ones, which differ by a number.
        clock: the time column with how it was found, or None.
        alike: columns that look like parts of a pose but are none here, and why.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    pose: tuple[str, ...]
    time: str | None
    unit: float | None
    ignored: tuple[str, ...]
    rule: str
    clock: TimeColumn | None = None
    alike: PoseColumns = field(default_factory=PoseColumns)


def choose_columns(
    names: Sequence[str],
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    time: str | None = None,
    where: str = "log",
    read: Read | None = None,
    timed: bool = False,
) -> Choice:
    """Say which column is what.

    Inputs and outputs given by name win. Otherwise left and right commands and speeds are looked
    for (``pwm_l``, ``pwmL``, ``left_pwm``, ``cmd_right``; ``omega_l``, ``rpmL``, ``v_left``), then
    prefixes: ``u…``, ``in…``, ``pwm…``, ``cmd…``, ``volt…`` are inputs, ``y…``, ``out…``,
    ``omega…``, ``w_…``, ``speed…``, ``vel…`` are outputs, then words (``duty``, ``Spannung``;
    ``rpm``, ``Drehzahl``, ``temperature``), then the only column that is left.
    References (``…_ref``, ``…_hat``) are never taken for outputs.

    Args:
        names: the file's column names.
        inputs, outputs: names asked for; empty to go by convention.
        time: the time column asked for; None to go by name.
        where: what to call the file in messages.
        read: reads a column as numbers, to see which one rises as a time does; None to go by
            names alone.
        timed: whether the sample time is known from elsewhere, so that no column need state it.

    Raises:
        UsageError: a name asked for is not there, is asked for twice, is both input and output,
            or is the time.
        DataError: inputs or outputs cannot be identified by the names.
    """
    has_inputs = tuple(inputs) != (NO_INPUT,) or NO_INPUT in names
    given_u = tuple(_find(n, names, "`inputs`", where) for n in inputs) if has_inputs else ()
    given_y = tuple(_find(n, names, "`outputs`", where) for n in outputs)
    _no_repeats(given_u, given_y, where)
    clock = _clock(names, given_u, given_y, time, where, read, timed)
    taken = () if clock is None else (clock.name, *((clock.fine,) if clock.fine else ()))
    free = [n for n in names if n not in (*given_u, *given_y, *taken)]
    free = [n for n in free if not counts_rows(n, read)]
    pose_columns = find_pose(free)
    if given_y and (given_u or not has_inputs):
        input_names, output_names, rule = given_u, given_y, "option"
    else:
        input_names, output_names, rule = _signals(free, given_u, given_y, pose_columns.names)
    if not has_inputs:
        input_names = ()
    elif not input_names and not inputs and set(free) <= {*output_names, *_only(free)}:
        output_names, has_inputs = (
            output_names or _only(free),
            False,
        )  # a signal on its own: a time series
    if (has_inputs and not input_names) or not output_names:
        raise DataError(
            _unclear(names, input_names, output_names, _signals_only(free, read), where)
        )
    used = {*input_names, *output_names, *taken}
    pose = pose_columns.names
    if any(p in used for p in pose):
        pose, pose_columns = (), PoseColumns((), pose, "one of them is an input or output")
    alike = tuple(n for n in pose_columns.alike if n not in used)
    ignored = tuple(n for n in names if n not in used and n not in pose)
    return Choice(
        input_names,
        output_names,
        pose,
        clock.name if clock else None,
        None if clock is None or clock.counts else unit_in_name(clock.name) or 1.0,
        ignored,
        rule,
        clock,
        PoseColumns(pose, alike if len(alike) > 1 or pose else (), pose_columns.why),
    )


def _only(free: Sequence[str]) -> tuple[str, ...]:
    """The one column that is left, where there is just one and it is a signal."""
    alone = len(free) == 1 and not (is_time(free[0]) or is_counter(free[0]))
    return tuple(free) if alone else ()


def _clock(
    names: Sequence[str],
    given_u: tuple[str, ...],
    given_y: tuple[str, ...],
    time: str | None,
    where: str,
    read: Read | None,
    timed: bool,
) -> TimeColumn | None:
    """The time column; a signal asked for that is the time is refused."""
    given = (*given_u, *given_y)
    if time is not None:
        name = _find(time, names, "`time`", where)
        if name in given:
            raise UsageError(f"column {name} of {where} is the time; it cannot be a signal too")
        return TimeColumn(name, counts=is_counter(name))
    by_itself = find_time(names, read, (), not timed)
    for name in given:
        named = is_time(name) or is_counter(name)
        if (named and tells_time(read, name)) or (
            by_itself is not None and by_itself.name == name and not named
        ):
            side = "input" if name in given_u else "output"
            fits = _is_input if side == "input" else _is_output
            others = [n for n in names if n not in given and not (is_time(n) or is_counter(n))]
            others = [n for n in others if fits(n)] or others
            what = (
                "counts rows"
                if is_counter(name)
                else "is the time"
                if named
                else "increases like a time"
            )
            instead = "or record one"
            if others:
                options = {
                    "input": argument(inputs=others[0]),
                    "output": argument(outputs=others[0]),
                }
                instead = f"such as {options[side]}"
            raise UsageError(
                f"column {name} of {where} {what} and cannot be the {side}; name another column, "
                f"{instead}"
            )
    return find_time(names, read, given, not timed)


def _signals(
    free: Sequence[str],
    given_u: tuple[str, ...],
    given_y: tuple[str, ...],
    pose: tuple[str, ...],
) -> tuple[tuple[str, ...], tuple[str, ...], str]:
    """Inputs and outputs by name, and the rule that found them."""
    meant = {n: meaning(n) for n in free if n not in pose}
    both_u, both_y = _sides(meant, "command"), _sides(meant, "speed")
    if both_u and both_y and not given_u and not given_y:
        return both_u, both_y, "robot"
    input_names = given_u or tuple(n for n in free if _is_input(n))
    output_names = given_y
    if not output_names:
        measured = [n for n in free if _is_output(n) and n not in input_names]
        if pose and any(n not in pose for n in measured):
            measured = [n for n in measured if n not in pose]
        output_names = tuple(measured)
    unassigned = {n: m for n, m in meant.items() if n not in (*input_names, *output_names)}
    input_names = (
        input_names
        or both_u
        or _clearest(unassigned, ("command",))
        or _one_drive(unassigned, output_names)
    )
    unassigned = {n: m for n, m in unassigned.items() if n not in input_names}
    output_names = (
        output_names
        or both_y
        or _clearest(unassigned, ("speed", "measurement"))
        or _sides(unassigned, "measurement")
    )
    unnamed = [n for n, m in unassigned.items() if m.quantity == "other" and n not in output_names]
    unnamed = [
        n for n in unnamed if not set(words(n)) <= set(SIDES)
    ]  # "left" states nothing but a side
    if bool(input_names) != bool(output_names) and len(unnamed) == 1 and len(unassigned) == 1:
        last = (unnamed[0],)
        return input_names or last, output_names or last, "last"
    if (
        input_names
        and not output_names
        and unnamed
        and len(unnamed) == len(unassigned)
        and _numbered(unnamed)
    ):
        return input_names, tuple(unnamed), "last"  # zone_1, zone_2 beside heater_1, heater_2
    return input_names, output_names, "prefix"


def _numbered(names: Sequence[str]) -> bool:
    """Whether the names differ by a number only."""
    return len({re.sub(r"\d+", "", n) for n in names}) == 1


def _one_drive(unassigned: Mapping[str, Meaning], output_names: Sequence[str]) -> tuple[str, ...]:
    """The one torque, force, current or frequency beside measurements of what it moves, or none."""
    drives = tuple(n for n in unassigned if may_drive(n))
    commanded = any(m.quantity == "command" for m in unassigned.values())
    effects = any(is_effect(n) for n in (*unassigned, *output_names))
    return drives if len(drives) == 1 and effects and not commanded else ()


def _is_input(name: str) -> bool:
    return bool(_INPUT.fullmatch(name)) and meaning(name).quantity != "supply"


def _is_output(name: str) -> bool:
    """By its prefix, unless a word says that it is a set point, or commanded (``speed_cmd``)."""
    if not _OUTPUT.fullmatch(name) or _NOT_MEASURED.search(name.lower()):
        return False
    meant = meaning(name)
    plain = name.lower().startswith(("y", "out"))
    return plain or meant.quantity not in ("reference", "command")


def _sides(meant: Mapping[str, Meaning], quantity: str) -> tuple[str, ...]:
    """The left and the right column of a quantity, of the clearest words that have both."""
    ranks = sorted({m.rank for m in meant.values() if m.quantity == quantity})
    for rank in ranks:
        of = {n: m for n, m in meant.items() if m.quantity == quantity and m.rank == rank}
        sides = [[n for n, m in of.items() if m.side == side] for side in ("left", "right")]
        if all(len(names) == 1 for names in sides):
            return sides[0][0], sides[1][0]
    return ()


def _clearest(meant: Mapping[str, Meaning], quantities: Sequence[str]) -> tuple[str, ...]:
    """The one column of the clearest words, or those that differ by a number only, or none."""
    for quantity in quantities:
        of = {n: m.rank for n, m in meant.items() if m.quantity == quantity}
        if of:
            best = tuple(n for n, rank in of.items() if rank == min(of.values()))
            return best if len({family(n) for n in best}) == 1 else ()
    return ()


def _find(name: str, names: Sequence[str], which: str, where: str) -> str:
    wanted = name.strip()
    if wanted in names:
        return wanted
    near = [n for n in names if n.lower() == wanted.lower()]
    if wanted and len(near) == 1:
        return near[0]
    shown = repr(wanted) if wanted else "an empty name"
    raise UsageError(
        f"{which} names {shown}, which is not a column of {where}; its columns are {_listed(names)}"
    )


def _no_repeats(inputs: tuple[str, ...], outputs: tuple[str, ...], where: str) -> None:
    for which, chosen in (("`inputs`", inputs), ("`outputs`", outputs)):
        twice = {n for n in chosen if chosen.count(n) > 1}
        if twice:
            raise UsageError(f"{which} names column {min(twice)} of {where} twice; name it once")
    both = set(inputs) & set(outputs)
    if both:
        raise UsageError(
            f"column {min(both)} of {where} cannot be both input and output; take it out of one"
        )


def _unclear(
    names: Sequence[str],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    signals: Sequence[str],
    where: str,
) -> str:
    missing = "the input and output"
    if inputs or outputs:
        missing = "the input" if outputs else "the output"
    free = [n for n in signals if n not in (*inputs, *outputs)]
    if not free:
        return (
            f"{where} has no column left for {missing}: its columns are {_listed(names)}; "
            "a log needs at least one input and one output"
        )
    alone = "" if inputs else " (`inputs='none'` for a log without inputs)"
    return (
        f"{where}: {missing} cannot be identified among {_listed(names)}; "
        f"give `inputs=NAME`{alone} and `outputs=NAME`, or name the columns u… and y…"
        f"{_example(free, inputs, outputs)}"
    )


MOST_IN_AN_EXAMPLE = 4
"""Inputs and outputs each: a reader needs the form, not every column of a wide file."""


def _example(free: Sequence[str], inputs: tuple[str, ...], outputs: tuple[str, ...]) -> str:
    """The options filled in with the file's own columns, as likely as their names allow."""
    pose = find_pose(free).names
    meant = {n: meaning(n) for n in free if n not in pose} or {n: meaning(n) for n in free}
    free = list(meant)
    commands = [n for n in free if meant[n].quantity == "command"]
    drives = [n for n in free if may_drive(n)]
    effects = [n for n in free if is_effect(n)]
    plain = [n for n in free if meant[n].quantity == "other" and n not in drives]
    references = [n for n in free if meant[n].quantity == "reference"]
    u = inputs or _with_partners(commands or drives or plain or references or effects)
    every = dict.fromkeys((*effects, *plain, *drives, *free))
    if not (inputs or outputs) and set(every) == set(u):
        u = u[:1]  # all of one kind, as a scope's channels: one drives
    y = outputs or _with_partners([n for n in every if n not in u])
    if not u or not y:
        return ""
    u, y = u[:MOST_IN_AN_EXAMPLE], y[:MOST_IN_AN_EXAMPLE]
    return f" (for example {argument(inputs=_plain(u), outputs=_plain(y))})"


def _with_partners(likely: Sequence[str]) -> tuple[str, ...]:
    """The first column with those of its kind, such as the other of a pair."""
    return tuple(n for n in likely if family(n) == family(likely[0]))


def _is_switch(name: str, read: Read) -> bool:
    """Whether a column of unknown meaning takes two values, as a light barrier does."""
    column = read(name)
    return meaning(name).quantity == "other" and column is not None and len(set(column)) <= 2


def _signals_only(free: Sequence[str], read: Read | None) -> list[str]:
    """The columns that can be a signal: no second clock, no text, no switch if others are left."""
    kept = [n for n in free if not (is_time(n) and tells_time(read, n))]
    if read is None:
        return kept
    kept = [n for n in kept if read(n) is not None]
    moving = [n for n in kept if not _is_switch(n, read)]
    return moving if len(moving) > 1 else kept


def _plain(names: Sequence[str]) -> str | list[str]:
    return names[0] if len(names) == 1 else [*names]


def _listed(names: Sequence[str], most: int = 15) -> str:
    """The names, cut short where they would fill the screen."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")
