"""Which columns of a log can be its inputs and outputs, by the words of their names and by units.

A name allows a column a role or not; no role is picked by a score. Columns of one family
(``pump_1``, ``pump_2``) go together. Where exactly one family can be the input and one the output
these are taken, else a person is asked.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.column_words import (
    ACTUATOR,
    Meaning,
    ends_in_speed,
    family,
    has_result_unit,
    is_actuator,
    is_ambient,
    is_battery,
    is_set_point,
    leaves_a_source,
    may_drive,
    may_move,
    meaning,
    names_speed,
    releases,
    turns_an_actuator,
)
from sysid.data.reading.released import is_switch
from sysid.data.reading.time_column import Numbers
from sysid.data.record import Array
from sysid.errors import Columns

_INPUT = re.compile(r"u|u\d+|u\d*_.+|in|in\d+|in\d*_.+|input.*", re.I)
_OUTPUT = re.compile(r"y|y\d+|y\d*_.+|out|out\d+|out\d*_.+|output.*", re.I)

HELD = 0.3
"""Share of rows up to which what changes in them is held between."""


@dataclass(frozen=True)
class Roles:
    """The families that can be the inputs and the outputs; one of each where it is clear."""

    inputs: tuple[Columns, ...]
    outputs: tuple[Columns, ...]

    @property
    def clear(self) -> bool:
        """Whether there is one choice only."""
        return len(self.inputs) == len(self.outputs) == 1


def roles(
    free: Mapping[str, str],
    given_u: Columns,
    given_y: Columns,
    pose: Collection[str],
    read: Numbers | None,
) -> Roles:
    """The families that can be the inputs and the outputs of a log.

    Inputs, the first of these that there are: columns called so (``u…``, ``in…``); commands to an
    actuator; voltages and other words that are measured as often as commanded, and columns whose
    name says nothing; torques, currents and frequencies beside what they move, and set points;
    measurements; a power supply. Outputs: columns called so (``y…``, ``out…``); measurements that
    drive nothing; columns in a unit that a sensor reads; the columns that are left. Beside a
    command such a unit says as much as a word for what is measured, save a word for a speed.

    Args:
        free: the columns that can be a signal, in the order of the file, with the units that
            stand behind their names.
        given_u, given_y: what a person named; empty for nothing.
        pose: columns that are part of a pose, outputs only where nothing else is one.
        read: reads a column, None for what is no signal: text. A column that never changes is no
            choice where there are others.
    """
    names = [n for n in free if n not in pose and n not in (*given_u, *given_y)]
    switches = {
        n
        for n in names
        if read is not None and releases(n) and (c := read(n)) is not None and is_switch(c)
    }
    if any(meaning(n).quantity == "command" for n in (*names, *given_u) if n not in switches):
        names = [n for n in names if n not in switches]
        free = {n: unit for n, unit in free.items() if n not in switches}
    found = _of(names, free, names, given_u, given_y)
    if found.clear or read is None:
        return found
    columns = {n: c for n in names if (c := read(n)) is not None}
    found = _of([*columns], free, names, given_u, given_y)
    moving = [n for n, c in columns.items() if _moves(c)]
    narrower = _of(moving, free, names, given_u, given_y)
    found = narrower if narrower.inputs and narrower.outputs else found
    if {*found.inputs} != {*found.outputs}:
        return found
    steps = {n: np.diff(c[np.isfinite(c)]) for n, c in columns.items()}
    resting = {n for n, d in steps.items() if np.count_nonzero(d) < HELD * len(d)}
    held = tuple(sorted(found.inputs, key=lambda f: not resting.issuperset(f)))  # as commands are
    return Roles(held, held)


def _of(
    kept: Sequence[str], free: Mapping[str, str], names: Sequence[str], u: Columns, y: Columns
) -> Roles:
    """The families among the kept ``names``, with a pose where nothing else is an output."""
    found = _roles({n: free[n] for n in kept}, u, y)
    if found.outputs:
        return found
    return _roles({n: unit for n, unit in free.items() if n in kept or n not in names}, u, y)


def _roles(units: dict[str, str], given_u: Columns, given_y: Columns) -> Roles:
    meant = _meanings(units)
    pairs = [_pairs(meant, quantity) for quantity in ("command", "speed")]
    if not (given_u or given_y) and all(len(p) == 1 for p in pairs):
        return Roles(tuple(pairs[0]), tuple(pairs[1]))  # a robot, whatever else it logs
    signals = [n for n, m in meant.items() if m.quantity not in ("reference", "supply")]
    called_u = [n for n in signals if _INPUT.fullmatch(n)]
    called_y = [n for n in signals if _OUTPUT.fullmatch(n)]
    commands = [n for n, m in meant.items() if m.quantity == "command"]
    actuators = [n for n in commands if is_actuator(meant[n])]
    if actuators:  # input_voltage is the supply of what a duty cycle drives
        aside = [n for n in commands if n.lower().startswith("input")]
        called_u = [n for n in called_u if n in actuators or n not in aside]
    drives = [n for n in meant if may_drive(n, units[n])]
    measured = [n for n, m in meant.items() if m.quantity in ("speed", "measurement")]
    effects = sorted((n for n in measured if n not in (*drives, *called_u)), key=is_ambient)
    unknown = [n for n, m in meant.items() if m.quantity == "other" and n not in drives]
    read = [n for n in unknown if has_result_unit(n, units[n])]
    unread = [n for n in unknown if n not in read]
    set_points = [n for n in meant if is_set_point(n)]
    if given_y or called_y:
        outputs = [given_y or tuple(called_y)]
    else:
        turns = any(names_speed(n) for n in effects)
        named = effects if turns or not (commands or set_points) else [*effects, *read]
        outputs = _families(named) or _families(read) or _families([*unknown, *drives])
    driving = [*(drives if effects or read or given_y or called_y else ()), *set_points]
    ways = [
        [given_u] if given_u else [],
        [tuple(called_u)] if called_u else [],
        _families(actuators),
        _families([*commands, *unread]) if commands else [],
        _families([*driving, *unread]) if driving else [],
        _families([*(unread or unknown), *(effects if len(outputs) > 1 else ())]),
        _families(effects),
        _families([n for n, m in meant.items() if m.quantity == "supply" and not is_battery(n)]),
    ]
    for inputs in ways:
        able = [(u, y) for u in inputs for y in outputs if not set(u) & set(y)]
        if able:
            break
    else:
        if outputs and not (given_u or given_y or called_y or effects):
            single = tuple((n,) for n in (*unknown, *drives))
            return Roles(single if len(single) > 1 else (), single)  # as a scope's channels
        left = [u for u in next(filter(None, ways), []) if u not in outputs]
        return Roles(tuple(left), tuple(outputs))
    either = [n for family in (*inputs, *outputs) for n in family]
    if not (given_u or given_y or called_y or commands or driving) and {*inputs[0]} <= {*unknown}:
        speeds = [n for n in either if meant[n].quantity == "speed"]
        if speeds and len(either) == 2:  # a roller's speed and what it does: either way round
            single = tuple((n,) for n in either)
            return Roles(single, single)
    # a pair of sides goes with a pair of sides, whatever else is measured
    sided = [(u, y) for u, y in able if [u] == _both_sides(u) and [y] == _both_sides(y)]
    able = sided if len(sided) == 1 and len({u for u, _ in able}) == 1 else able
    us, ys = zip(*able, strict=True)
    return Roles(tuple(f for f in inputs if f in us), tuple(f for f in outputs if f in ys))


def _meanings(units: Mapping[str, str]) -> dict[str, Meaning]:
    """What each column holds: of commands alone, an actuator's speed is what another one makes.

    Beside what a process does, and no command, it is what drives the process; so is the voltage
    that a source puts out, beside what a sensor reads in other units.
    """
    meant = {n: meaning(n, unit) for n, unit in units.items()}
    sources = [n for n, unit in units.items() if leaves_a_source(n, unit)]
    if any(has_result_unit(n, unit) for n, unit in units.items()):
        meant |= {n: Meaning("other", 0, meant[n].side) for n in sources}
    driven = [n for n, m in meant.items() if m.quantity in ("speed", "measurement")]
    parts = [n for n in driven if turns_an_actuator(n, units[n])]
    rest = [n for n in driven if n not in parts]
    commanded = any(m.quantity == "command" for m in meant.values())
    if rest and not commanded and not any(may_move(n, units[n]) for n in rest):
        meant |= {n: Meaning("command", ACTUATOR, meant[n].side) for n in parts}
    turned = {n for n, m in meant.items() if ends_in_speed(n, m)}
    others = {m.quantity for n, m in meant.items() if n not in turned} - {"reference", "supply"}
    if others == {"command"}:
        meant |= {n: Meaning("speed", 1, meant[n].side) for n in turned}
    return meant


def _families(names: Sequence[str]) -> list[Columns]:
    by_family: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        by_family.setdefault(family(name), []).append(name)
    return [tuple(members) for members in by_family.values()]


def _pairs(meant: dict[str, Meaning], quantity: str) -> list[Columns]:
    """The left and the right column of each family of a quantity that has both and no more.

    ``true_omega_l`` is another view of ``omega_l``, and no other choice.
    """
    of = [n for n, m in meant.items() if m.quantity == quantity]
    strong = [n for n in of if is_actuator(meant[n])]
    pairs = [pair for f in _families(strong or of) for pair in _both_sides(f)]
    stems = [set(family(left)) for left, _ in pairs]
    return [p for p, s in zip(pairs, stems, strict=True) if not any(o < s for o in stems)]


def _both_sides(names: Columns) -> list[Columns]:
    sides = [[n for n in names if meaning(n).side == side] for side in ("left", "right")]
    return [(sides[0][0], sides[1][0])] if [*map(len, sides)] == [1, 1] else []


def _moves(column: Array) -> bool:
    return len(np.unique(column[np.isfinite(column)])) > 1
