"""Expected outputs of the controller and vehicle units, from one run of the mission in Python."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.export.c.loop.laws_of_mission import ESTIMATE, flat
from sysid.export.c.loop.recorded_run import CLOSED, record_run
from sysid.export.fmu.description import Role, Unit
from sysid.export.fmu.loop_units import OF_THE_UNIT, LoopUnits
from sysid.export.fmu.replay import Replay, reach
from sysid.export.fmu.wiring import Wiring
from sysid.robot.mission.loop import Loop, LoopState, Tick, on_ground, ticks

MOST_ROWS = 400
"""Samples that a unit is compared in: a mission of 40 s at the thesis's period."""

WHEELS = ("omega_l", "omega_r")

Values = dict[str, float]


@dataclass(frozen=True, eq=False)
class _Part:
    """What a unit does of a loop.

    Attributes:
        unit: it.
        advance: to a sample with these measurements.
        shown: outputs after it, as the unit orders them.
    """

    unit: Unit
    advance: Callable[[LoopState, Tick, Values], LoopState]
    shown: Callable[[LoopState], list[Any]]


def loop_replays(loop: Loop, units: LoopUnits) -> dict[str, Replay]:
    """The rows of ``controller`` and ``vehicle``."""
    run = record_run(loop)
    seen = run.rows["navigation"]
    read = {n: v for n, v in seen.items() if n not in (*OF_THE_UNIT, *ESTIMATE)}
    rolled = {n: run.closed[:, CLOSED.index(n)] for n in WHEELS}

    def moved(state: LoopState, tick: Tick, row: Values) -> LoopState:
        omega = row[WHEELS[0]], row[WHEELS[1]]
        at = tick.t, tick.dt
        ground, inputs = on_ground(loop.plant.ground, state.ground, omega, at, loop.scene)
        motion, body = loop.motion.step(state.motion, inputs, tick.dt, loop.xp)
        return state._replace(ground=ground, motion=motion, body=body)

    def decided(state: LoopState) -> list[Any]:
        thought = (*state.references[:2], *state.command)
        return [*_commands(state, units.wiring), *thought, *flat(state.estimate).values()]

    controller = _Part(units.controller, loop.steered, decided)
    vehicle = _Part(units.vehicle, moved, lambda state: list(flat(state.body).values()))
    return {
        part.unit.name: _replay(loop, part, columns, units.wiring)
        for part, columns in ((controller, read), (vehicle, rolled))
    }


def _commands(state: LoopState, wiring: Wiring) -> list[float]:
    """PWM as the plant's inputs."""
    return [
        port.offset + port.slope * pwm / PWM_FULL_SCALE
        for port, pwm in zip(wiring.commands, state.pwm, strict=True)
    ]


def _replay(loop: Loop, part: _Part, read: dict[str, Array], wiring: Wiring) -> Replay:
    """A part of the loop through rows of what it reads, and what it shows after each."""
    ports = dict(zip(WHEELS, wiring.speeds, strict=True))
    names = [ports[n].name if n in ports else n for n in read]
    given = [v / ports[n].slope + ports[n].offset if n in ports else v for n, v in read.items()]
    rows = np.column_stack([*read.values()])[:MOST_ROWS]
    state, now, late = loop.start(), [], []
    clock = pairwise(ticks(loop.plant.dt, loop.control.period))
    for row, (tick, following) in zip(rows.tolist(), clock, strict=False):
        values = dict(zip(read, row, strict=True))
        state = part.advance(state, tick, values)
        now.append([float(v) for v in part.shown(state)])
        late.append([float(v) for v in part.shown(part.advance(state, following, values))])
    outputs = [v.name for v in part.unit.variables if v.role is Role.OUTPUT and not v.boolean]
    u, y = np.column_stack(given)[:MOST_ROWS], np.array(now)
    return Replay(tuple(names), tuple(outputs), u, y, np.array(late), reach(y))
