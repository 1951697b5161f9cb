"""The plant as a unit: inputs, outputs and initial states."""

import math

import numpy as np

from sysid.data.record import Array
from sysid.export.base import Source
from sysid.export.c.source import c_sources
from sysid.export.c.step import tunable_parameters
from sysid.export.fmu.description import Role, Unit, Variable, named_apart
from sysid.export.templates import fill
from sysid.structures.model import Model
from sysid.structures.motion import time_constants
from sysid.structures.plant import Plant

_DEAD_AFTER = 40.0
"""Time constants after which a mode has died away: e^-40 is less than a rounding."""

_MOST_SETTLING = 200_000
"""Samples that a start may take: a tenth of a second."""


def plant_unit(source: Source) -> Unit:
    """The plant of a model as a unit.

    Raises:
        ModelError: it cannot be written as C.
    """
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
                    direct[:, j] |= _differs(plant.readout(state, _with(u, j, other)), y)
            state, _ = plant.step(state, u)
    return tuple(tuple(map(int, np.flatnonzero(row))) for row in direct)


def _with(u: Array, j: int, value: float) -> Array:
    changed = u.copy()
    changed[j] = value
    return changed


def _differs(one: Array, other: Array) -> Array:
    differs: Array = (one != other) & ~(np.isnan(one) & np.isnan(other))
    return differs
