"""The plant as a unit: inputs, outputs and initial states."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from sysid.data.record import Array
from sysid.export.base import Source
from sysid.export.c.parameters import Tunable
from sysid.export.c.source import c_sources
from sysid.export.c.step import tunable_parameters
from sysid.export.c.writing import listed
from sysid.export.fmu.description import Role, Unit, Variable, named_apart
from sysid.structures.model import Model
from sysid.structures.plant import Plant

_CODE = """
typedef plant_state fmu_state;

/* where the parameters of the start stand among the variables, and the states after them */
enum {{
    START = PLANT_INPUTS + PLANT_OUTPUTS,
    START_SETTLED = START + PLANT_STATES,
    STATE = START_SETTLED + 1
}};

static void parameters_of(const double *r, plant_parameters *p)
{{
{parameters}
}}

/* after so many samples under one input every mode of the plant has died away */
#define SETTLING_SAMPLES {samples}
static const double settled_scale[PLANT_OUTPUTS] = {{{scale}}};

static const char *fmu_begin(fmu_state *state, const double *r)
{{
    double before[PLANT_OUTPUTS], y[PLANT_OUTPUTS];
    plant_parameters p;
    int k;
    parameters_of(r, &p);
    plant_init(state, &p);
    if (r[START_SETTLED] > 0.5) {{
        for (k = 0; k < PLANT_OUTPUTS; k++)
            y[k] = 0.0;
        for (k = 0; k < SETTLING_SAMPLES; k++) {{
            memcpy(before, y, sizeof y);
            plant_step(state, &p, r, y);
        }}
        for (k = 0; k < PLANT_OUTPUTS; k++)
            if (!(fabs(y[k] - before[k]) <= 1e-9 * settled_scale[k]))
                return "the plant does not settle under the first inputs: leave start_settled off";
    }}
    for (k = 0; k < PLANT_STATES; k++)
        state->x[k] += r[START + k];
    return NULL;
}}

static void fmu_outputs(const fmu_state *state, double *r)
{{
    fmu_state copy = *state;
    fmu_state rest;
    plant_parameters p;
    int k;
    parameters_of(r, &p);
    plant_step(&copy, &p, r, r + PLANT_INPUTS);
    plant_init(&rest, &p);
    for (k = 0; k < PLANT_STATES; k++)
        r[STATE + k] = state->x[k] - rest.x[k];
}}

static void fmu_advance(fmu_state *state, double *r)
{{
    plant_parameters p;
    parameters_of(r, &p);
    plant_step(state, &p, r, r + PLANT_INPUTS);
}}
"""

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
        _CODE.format(
            parameters="\n".join(_assigned(tunable, first)),
            samples=_settling_samples(model),
            scale=listed(source.selftest.scale()),
        ),
        f"{source.name}, by sysid",
    )


def _assigned(tunable: Sequence[Tunable], first: int) -> Iterator[str]:
    """Lines that put values of variables into the struct of the plant's parameters."""
    for k, t in enumerate(tunable, first):
        yield f"    p->{t.name} = r[{k}];"
    if not tunable:
        yield "    (void)r;"
        yield "    plant_defaults(p);"


def _settling_samples(model: Model) -> int:
    """Samples after which nothing moves any more under one input, where anything comes to rest."""
    modes = model.structure.time_constants(model.theta)
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
