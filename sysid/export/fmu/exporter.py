"""The formats ``fmu`` and ``fmu3``: units of FMI 2.0 and 3.0 for co-simulation."""

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.export.base import Exporter, Source
from sysid.export.c.loop.laws_of_mission import ESTIMATE, flat
from sysid.export.c.loop.recorded_run import CLOSED, record_run
from sysid.export.c.step import c_sources, tunable_parameters
from sysid.export.fmu.archive import FMI_2, FMI_3, Version, archive, headers
from sysid.export.fmu.description import Role, Unit, Variable, named_apart
from sysid.export.fmu.loop_units import OF_THE_UNIT, LoopUnits, Wiring, loop_units
from sysid.export.fmu.replay import Replay
from sysid.export.templates import fill
from sysid.plant.selftest import reach
from sysid.robot.mission.loop import Loop, LoopState, Tick, on_ground, ticks
from sysid.structures.model import Model
from sysid.structures.motion import time_constants
from sysid.structures.plant import Plant

MOST_ROWS = 400
"""Samples that a unit is compared in: a mission of 40 s at the thesis's period."""

WHEELS = ("omega_l", "omega_r")

Values = dict[str, float]


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
        commands = [
            port.offset + port.slope * pwm / PWM_FULL_SCALE
            for port, pwm in zip(units.wiring.commands, state.pwm, strict=True)
        ]
        thought = (*state.references[:2], *state.command)
        return [*commands, *thought, *flat(state.estimate).values()]

    def driven(state: LoopState) -> list[Any]:
        return [*flat(state.body).values()]

    wiring = units.wiring
    return {
        "controller": _replay(loop, units.controller, loop.steered, decided, read, wiring),
        "vehicle": _replay(loop, units.vehicle, moved, driven, rolled, wiring),
    }


def _replay(
    loop: Loop,
    unit: Unit,
    advance: Callable[[LoopState, Tick, Values], LoopState],
    shown: Callable[[LoopState], list[Any]],
    read: dict[str, Array],
    wiring: Wiring,
) -> Replay:
    """A unit through rows of what it reads, and what it shows after each."""
    ports = dict(zip(WHEELS, wiring.speeds, strict=True))
    names = [ports[n].name if n in ports else n for n in read]
    given = [v / ports[n].slope + ports[n].offset if n in ports else v for n, v in read.items()]
    rows = np.column_stack([*read.values()])[:MOST_ROWS]
    state, now, late = loop.start(), [], []
    clock = pairwise(ticks(loop.plant.dt, loop.control.period))
    for row, (tick, following) in zip(rows.tolist(), clock, strict=False):
        values = dict(zip(read, row, strict=True))
        state = advance(state, tick, values)
        now.append([float(v) for v in shown(state)])
        late.append([float(v) for v in shown(advance(state, following, values))])
    outputs = [v.name for v in unit.variables if v.role is Role.OUTPUT and not v.boolean]
    u, y = np.column_stack(given)[:MOST_ROWS], np.array(now)
    return Replay(tuple(names), tuple(outputs), u, y, np.array(late), reach(y))


_DEAD_AFTER = 40.0
"""Time constants after which a mode has died away: e^-40 is less than a rounding."""

_MOST_SETTLING = 200_000
"""Samples that a start may take: a tenth of a second."""


def plant_unit(source: Source) -> Unit:
    """The plant of a model as a unit."""
    model = source.model
    c = c_sources(model, source.selftest, source.name)
    rest = np.asarray(model.detrend.u_offset, dtype=float)
    states = model.structure.n_states(model.theta)
    reached = feedthrough(model.plant())
    tunable = tunable_parameters(model)
    first = len(model.inputs) + len(model.outputs) + 2 * states + 1
    variables = named_apart(
        (
            *(
                Variable(ch.name, Role.INPUT, ch.unit, "held until it is set again", float(u))
                for ch, u in zip(model.inputs, rest, strict=True)
            ),
            *(
                Variable(ch.name, Role.OUTPUT, ch.unit, "at this instant", depends=on)
                for ch, on in zip(model.outputs, reached, strict=True)
            ),
            *(
                Variable(f"start_{k}", Role.FIXED, "", "where this state begins, from rest")
                for k in range(states)
            ),
            Variable(
                "start_settled",
                Role.FIXED,
                "",
                "begin in steady state under the first inputs",
                boolean=True,
            ),
            *(
                Variable(f"state_{k}", Role.LOCAL, "", "this state, from rest; see start_*")
                for k in range(states)
            ),
            *(Variable(t.name, Role.TUNABLE, t.unit, t.words, t.value) for t in tunable),
            Variable("time", Role.TIME, "s", "of the simulation"),
        )
    )
    return Unit(
        "plant",
        model.dt,
        variables,
        {n: c[n] for n in ("plant.h", "plant.c")},
        fill(
            "fmu/plant_unit.c",
            tunable=tunable,
            first=first,
            samples=_settling_samples(model),
            scale=source.selftest.scale(),
        ),
        f"{source.name}, by sysid",
    )


def _settling_samples(model: Model) -> int:
    """Samples after which nothing moves any more under one input, where anything comes to rest."""
    modes = time_constants(model.structure, model.theta)
    slowest = max((float(t) for t in modes if math.isfinite(t)), default=0.0)
    delays = model.structure.n_states(model.theta) + 10  # a delay is a row of states
    return int(min(math.ceil(_DEAD_AFTER * slowest) + delays, _MOST_SETTLING))


def feedthrough(plant: Plant) -> tuple[tuple[int, ...], ...]:
    """Of every output the inputs of the same instant that it depends on, as indices.

    Each input is moved by as much as the data did, from several states, and turned into NaN once,
    which passes through what no number would.
    """
    rng = np.random.default_rng(0)
    low, high = (np.array(side, dtype=float) for side in zip(*plant.input_range, strict=True))
    direct = np.zeros((len(plant.outputs), len(plant.inputs)), dtype=bool)
    state = plant.initial_state()
    with np.errstate(all="ignore"):
        for _ in range(8):
            u = rng.uniform(low, high)
            y = plant.readout(state, u)
            for j in range(len(u)):
                for other in (rng.uniform(low[j], high[j]), np.nan):
                    changed = u.copy()
                    changed[j] = other
                    now = plant.readout(state, changed)
                    direct[:, j] |= (now != y) & ~(np.isnan(now) & np.isnan(y))
            state, _ = plant.step(state, u)
    return tuple(tuple(map(int, np.flatnonzero(row))) for row in direct)


def system_structure(units: LoopUnits, plant: Unit, loop: Loop) -> str:
    """The units of a loop, their connections, and where the plant starts.

    Tools take it as it lies beside the units, or zipped with them as ``.ssp``.
    """
    instances = [(name, plant) for name in units.wiring.plants]
    instances += [(u.name, u) for u in (units.controller, units.vehicle)]
    return fill(
        "fmu/SystemStructure.ssd",
        instances=instances,
        starts=units.wiring.starts,
        connections=_connections(units),
        timeout=loop.timeout,
        step=loop.plant.dt,
    )


def _connections(units: LoopUnits) -> Iterator[tuple[str, str, str, str]]:
    """(from unit, variable, to unit, variable)."""
    for p in units.wiring.commands:
        yield "controller", p.name, p.plant, p.at
    for p in units.wiring.speeds:
        known = {v.name for v in units.controller.variables}
        if p.name in known:
            yield p.plant, p.at, "controller", p.name
        yield p.plant, p.at, "vehicle", p.name


_USAGE = """For co-simulation (`{folder}/plant.fmu`, FMI {number}): inputs and outputs are those
above, a step is a multiple of the sample time. Parameters `start_0` … are where the states begin,
as changes from rest; with start_settled the plant begins in steady motion under its first inputs.
"""


class Fmu(Exporter):
    """``plant.fmu`` of FMI 2.0, and what drives it."""

    name: ClassVar[str] = "fmu"
    title: ClassVar[str] = "FMU"
    version: ClassVar[Version] = FMI_2

    def files(self, source: Source) -> Mapping[str, str | bytes]:
        headers()  # asked first: the sentence about what is missing must not wait
        units: list[Unit] = [plant_unit(source)]
        files: dict[str, str | bytes] = {}
        if source.loop is not None:
            made = loop_units(source.loop, source.name)
            units += [made.controller, made.vehicle]
            for name, rows in loop_replays(source.loop, made).items():
                files[f"{name}.csv"] = rows.text()
            files["SystemStructure.ssd"] = system_structure(made, units[0], source.loop)
        return files | {f"{u.name}.fmu": archive(u, self.version) for u in units}

    def usage(self) -> str:
        return _USAGE.format(folder=self.name, number=self.version.number)


class Fmu3(Fmu):
    """The same of FMI 3.0."""

    name: ClassVar[str] = "fmu3"
    title: ClassVar[str] = "FMU of FMI 3.0"
    version: ClassVar[Version] = FMI_3
