"""Roles of a log's columns: time, inputs, outputs and pose, by option or by name."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sysid.data.column_words import meaning, words
from sysid.data.decision import listed
from sysid.data.reading.pose import PoseColumns, find_pose
from sysid.data.reading.roles import Roles, roles
from sysid.data.reading.table import Table
from sysid.data.reading.text_layout import no_table
from sysid.data.reading.time_column import (
    TimeColumn,
    counts_rows,
    find_time,
    is_clock,
    is_counter,
    is_time,
    tells_time,
)
from sysid.errors import UnclearColumnsError, UsageError, argument

MOST_COLUMNS = 15
"""Names of columns that a message has room for."""

NO_INPUT = "none"
"""Asked for as the input of a log that has none: a signal on its own."""


@dataclass(frozen=True)
class Choice:
    """The columns of one file by what they are.

    Attributes:
        inputs, outputs: column names, in the order of the record.
        pose: names of x, y, ψ, or empty.
        ignored: the other columns.
        last: inputs or outputs whose names say nothing: no other column was left for them.
        clock: the time column with how it was found, or None.
        alike: columns that look like parts of a pose but are none here, and why.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    pose: tuple[str, ...]
    ignored: tuple[str, ...]
    last: tuple[str, ...] = ()
    clock: TimeColumn | None = None
    alike: PoseColumns = field(default_factory=PoseColumns)

    @property
    def time(self) -> str | None:
        return self.clock.name if self.clock else None


def choose_columns(
    source: Table | Mapping[str, str] | Sequence[str],
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    time: str | None = None,
    timed: bool = False,
) -> Choice:
    """Say which column is what.

    Inputs and outputs given by name, or by a part of one that no other has, win. Otherwise the
    columns are taken that alone can be the input and the output by their names (``roles``).

    Args:
        source: the log; or its columns alone, with the units that stand behind them in the file
            where these are known, to go by names alone.
        inputs, outputs: names asked for; empty to go by convention.
        time: the time column asked for; None to go by name.
        timed: whether the sample time is known from elsewhere, so that no column need state it.

    Raises:
        DataError: no columns hold numbers.
        UsageError: a name asked for is not there, is asked for twice, is both input and output,
            or is the time.
        UnclearColumnsError: several columns can be an input or output by their names, or none can.
    """
    table = source if isinstance(source, Table) else None
    columns = source.brackets if isinstance(source, Table) else source
    where, signal = ("log", None) if table is None else (table.where, table.signal)
    units = dict(columns) if isinstance(columns, Mapping) else dict.fromkeys(columns, "")
    names = tuple(units)
    has_inputs = tuple(inputs) != (NO_INPUT,) or NO_INPUT in names
    given_u = tuple(whole_name(n, names, "`inputs`", where) for n in inputs) if has_inputs else ()
    given_y = tuple(whole_name(n, names, "`outputs`", where) for n in outputs)
    _no_repeats(given_u, given_y, where)
    clock = _clock(units, given_u, given_y, time, table, timed)
    taken = () if clock is None else clock.columns
    free = [n for n in names if n not in (*given_u, *given_y, *taken)]
    free = [n for n in free if not counts_rows(n, table)]
    pose_columns = find_pose(free)
    signals = [n for n in free if not is_clock(table, n)]
    in_pose = (*pose_columns.names, *pose_columns.alike)
    both = roles({n: units[n] for n in signals}, given_u, given_y, in_pose, signal)
    if not (both.outputs or inputs) and len(signals) == 1:
        both = Roles((), (tuple(signals),))
    by_itself = len(both.outputs) == 1 and {*signals} <= {*both.outputs[0]} and not inputs
    if not has_inputs or by_itself:  # a time series
        both = Roles(((),), both.outputs)
    able = both.clear and not by_itself  # what is clear by its name need not be read
    numbers = [n for n in free if able or signal is None or signal(n) is not None]
    if not (numbers or given_u or given_y):
        raise no_table(where)
    if not both.clear:
        sentence = _unclear(names, numbers, both, where, bool(inputs))
        raise UnclearColumnsError(sentence, both.inputs, both.outputs)
    (input_names,), (output_names,) = both.inputs, both.outputs
    silent = [
        side
        for side, given in ((input_names, given_u), (output_names, given_y))
        if side and not given and all(meaning(n, units[n]).quantity == "other" for n in side)
    ]
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
        ignored,
        silent[0] if silent and not by_itself else (),
        clock,
        PoseColumns(pose, alike if len(alike) > 1 or pose else (), pose_columns.why),
    )


def _clock(
    units: Mapping[str, str],
    given_u: tuple[str, ...],
    given_y: tuple[str, ...],
    time: str | None,
    table: Table | None,
    timed: bool,
) -> TimeColumn | None:
    """The time column; a signal asked for that is the time is refused."""
    names = tuple(units)
    where, read = ("log", None) if table is None else (table.where, table.read)
    given = (*given_u, *given_y)
    if time is not None:
        name = whole_name(time, names, "`time`", where)
        if name in given:
            raise UsageError(f"column {name} of {where} is the time; it cannot be a signal too")
        return TimeColumn(name, counts=is_counter(name))
    by_itself = find_time(names, table, (), not timed)
    for name in given:
        named = is_time(name) or is_counter(name)
        if (
            is_clock(table, name)
            or (named and tells_time(table, name))
            or (by_itself is not None and by_itself.name == name and not named)
        ):
            side = "input" if name in given_u else "output"
            others = [n for n in names if n not in given and not is_clock(table, n)]
            others = [n for n in others if not (is_time(n) or is_counter(n))]
            able = roles({n: units[n] for n in others}, (), (), (), read)
            likely = able.inputs if side == "input" else able.outputs
            others = [n for f in likely for n in f] or others
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
    return find_time(names, table, given, not timed)


def whole_name(name: str, names: Sequence[str], which: str, where: str) -> str:
    """The column that a name or a part of it means."""
    near = matching(name, names)
    if len(near) == 1:
        return near[0]
    shown = repr(name.strip()) if name.strip() else "an empty name"
    if near:
        meant = listed(near, MOST_COLUMNS, " or ")
        raise UsageError(
            f"{which} names {shown}, which can be {meant} in {where}; write more of it"
        )
    columns = listed(names, MOST_COLUMNS)
    raise UsageError(
        f"{which} names {shown}, which is not a column of {where}; its columns are {columns}"
    )


def matching(name: str, names: Sequence[str]) -> list[str]:
    """The columns that a name can mean: itself, else in any case, else those that contain it.

    A part is one or more whole words of a column's name, or at least three of its letters; a unit
    in brackets behind it, as the header may have it, does no harm.
    """
    wanted = name.strip()
    if wanted in names or not wanted:
        return [wanted] * bool(wanted)
    low, parts = wanted.lower(), " ".join(words(wanted))
    bare = re.sub(r"\s*[\[(][^\[\]()]*[\])]$", "", wanted)
    return (
        [n for n in names if n.lower() == low]
        or [n for n in names if parts and f" {parts} " in f" {' '.join(words(n))} "]
        or [n for n in names if len(low) >= 3 and low in n.lower()]
        or (matching(bare, names) if bare != wanted else [])
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


MOST_IN_AN_EXAMPLE = 4
"""Inputs and outputs each: a reader needs the form, not every column of a wide file."""


def _unclear(
    names: Sequence[str], numbers: Sequence[str], families: Roles, where: str, given_u: bool
) -> str:
    """What can be the input and what the output, and the options with one choice of them."""
    sides = {"input": families.inputs, "output": families.outputs}
    missing = [side for side, of_side in sides.items() if not of_side]
    used = {n for of_side in sides.values() for f in of_side for n in f}
    if len(missing) == 1 and used >= {n for n in numbers if not (is_time(n) or is_counter(n))}:
        columns = listed(names, MOST_COLUMNS)
        return (
            f"{where} has no column left for the {missing[0]}: its columns are {columns}; "
            "a log needs at least one input and one output"
        )
    alone = "" if given_u or len(families.outputs) != 1 else " (or none: `inputs='none'`)"
    asked = {
        f"the {side}": [listed(f, MOST_IN_AN_EXAMPLE, " with ") for f in of_side] or [*numbers]
        for side, of_side in sides.items()
        if len(of_side) != 1
    }
    if len({*map(tuple, asked.values())}) == 1:
        asked = {" and ".join(asked): next(iter(asked.values()))}
    parts = (
        f"{side} can be {listed(every, 8, ' or ')}{alone if 'input' in side else ''}"
        for side, every in asked.items()
    )
    return f"{where}: {'; '.join(parts)}; name the columns, one or several{_example(families)}"


def _example(families: Roles) -> str:
    """The options filled in with the first families that go together."""
    for u in families.inputs:
        for y in families.outputs:
            if not set(u) & set(y):
                shown_u, shown_y = (_plain(side[:MOST_IN_AN_EXAMPLE]) for side in (u, y))
                return f", for example {argument(inputs=shown_u, outputs=shown_y)}"
    return ""


def _plain(names: Sequence[str]) -> str | list[str]:
    return names[0] if len(names) == 1 else [*names]
