"""Step response of a model: gain, time constants, dead time, settling time.

These are the numbers by which a person knows their machine. Each comes with a standard error by
the delta method.
"""

from dataclasses import dataclass

import numpy as np

from sysid.data.level_crossing import first_crossing
from sysid.data.record import Array, Channel
from sysid.data.unit_words import bracketed, ratio
from sysid.estimation.assessment.delta_method import Estimate, Number, StandardError, estimates
from sysid.estimation.assessment.own_motion import Poles, mode_numbers, modes_of
from sysid.structures.linear.base import LinearStructure
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.model import Model
from sysid.structures.motion import dead_time_entry

SETTLED = 0.02
"""A step has settled when it stays within this share of its final change (the usual 2 %)."""

LEVELS = (0.25, 0.5, 1.0)
"""Steps that a nonlinear model is asked for, as shares of the largest input it has seen."""

STARTING_LENGTH, LONGEST = 256, 16_384
"""Samples of a first run, and of the longest: doubled until the run has settled."""

QUIET = 1e-3
"""A run has settled when its last quarter moves by less than this share of the whole change."""

RAMP = 0.15
"""The last quarter of a ramp is a quarter of it; a slow mode that still creeps moves by less."""

VISIBLE_MODE = 0.02
"""A mode that carries less than this share of the final value is not seen in a step."""

RESOLVED = np.pi / 2.0
"""Largest angle of an oscillating pole, a quarter of the sampling rate: with fewer than four
samples a period a pair of poles is noise or a delay, not a motion that anybody saw."""

MOVES = 1e-6
"""Share of the final change from which a response has begun."""


@dataclass(frozen=True)
class StepResponse:
    """The response of one output to a step of one input, the other inputs at their base.

    Attributes:
        start, level: the input before and after the step, in its unit.
        share: the level as a share of the largest input seen; None for a linear model, whose
            gain and times are the same at every level.
        gain: final change of the output per unit of input; of its rate [1/s] when it integrates.
        file_factor: gain in the units of the file = file_factor × gain; its sign stays.
        file_unit: unit of the gain in the file's units; empty where nothing was converted.
        time_constants: of the modes that a step shows, the slowest first [s].
        oscillation: natural frequency [rad/s] and damping of the slowest oscillating mode.
        dead_time: time before the output responds [s].
        dead_error: its standard error, 0 where it is not estimated [s].
        rise: time from the first response to 63 % of the change [s].
        settling: time after which the output stays within 2 % of its final change [s].
        integrates: whether the output runs away at a constant rate.
        settles: whether it comes to rest, or to a constant rate, at all.
        span: range of the input that the model has seen, in its unit; the step where unknown.
    """

    input: str
    output: str
    start: Number
    level: Number
    share: float | None
    gain: Estimate
    unit: str
    file_factor: float
    file_unit: str
    time_constants: tuple[Estimate, ...]
    oscillation: tuple[Estimate, Estimate] | None
    dead_time: Number
    dead_error: StandardError
    rise: Estimate
    settling: Estimate
    integrates: bool
    settles: bool
    span: float = 1.0

    @property
    def moves(self) -> float:
        """What the input does to the output, NaN where it does not settle.

        Gains of inputs in different units are compared by this: |gain| times the range seen, or
        the step of a nonlinear model.
        """
        return abs(self.gain.value) * (
            self.span if self.share is None else abs(self.level - self.start)
        )


def step_responses(model: Model) -> tuple[StepResponse, ...]:
    """What every input does to every output, with standard errors.

    A linear model is asked once for each pair; a nonlinear one at a small, a half and the full
    input seen, from zero, or from the smallest input seen where zero was not.

    Returns:
        Output by output, input by input, the small steps first; nothing for a model without
        inputs, and no pair whose input cannot reach the output.
    """
    linear = model.structure.traits.linear
    responses = [
        step
        for j in range(len(model.inputs))
        for share in ((None,) if linear else LEVELS)
        for step in _steps_of(model, j, share)
    ]
    names = [c.name for c in model.outputs]
    return tuple(sorted(responses, key=lambda r: names.index(r.output)))


@dataclass(frozen=True)
class _Run:
    """Numbers read off one step: what the delta method differentiates."""

    gain: float
    dead: float
    rise: float
    settling: float
    integrates: bool
    settles: bool


def _steps_of(model: Model, j: int, share: float | None) -> list[StepResponse]:
    start, level = step_levels(model, j, share)
    if level == start:
        return []
    reached = [i for i in range(len(model.outputs)) if _reaches(model, i, j)]
    poles = {i: _visible_poles(model, i, j) for i in reached}
    slowest = max((_slowest(p) for p in poles.values()), default=0.0)
    runs, length = _settled_runs(model, j, start, level, slowest)

    def numbers(theta: Array) -> Array:
        with np.errstate(all="ignore"):
            y = response_to_step(model, theta, j, start, level, length)
            values: list[float] = []
            for i in reached:
                run = _read(y[:, i], model.dt, level - start)
                values += [run.gain, run.rise, run.settling]
                values += mode_numbers(_poles(model, theta, i, j), poles[i], model.dt)
        return np.array(values)

    rest = estimates(model, numbers)
    steps = []
    for i in reached:
        u, y, run = model.inputs[j], model.outputs[i], runs[i]
        gain, rise, settling = next(rest), next(rest), next(rest)
        modes = modes_of(poles[i], rest)
        unit, file_unit = _gain_units(u, y, run.integrates)
        dead = _dead_time(model, i, j, run)
        steps.append(
            StepResponse(
                input=u.name,
                output=y.name,
                start=start,
                level=level,
                share=share,
                gain=gain,
                unit=unit,
                file_factor=abs(u.scale / y.scale),
                file_unit=file_unit,
                time_constants=tuple(m.time_constant for m in modes if m.time_constant),
                oscillation=next(
                    ((m.frequency, m.damping) for m in modes if m.frequency and m.damping), None
                ),
                dead_time=dead[0],
                dead_error=dead[1],
                rise=rise,
                settling=settling,
                integrates=run.integrates,
                settles=run.settles,
                span=float(np.ptp(model.ranges[j])) if len(model.ranges) else 1.0,
            )
        )
    return steps


def step_levels(model: Model, j: int, share: float | None) -> tuple[float, float]:
    """Input j before and after the step: from 0 to 1, or to a share of the largest seen."""
    low, high = model.ranges[j] if len(model.ranges) else (0.0, 1.0)
    if share is None:
        return 0.0, 1.0
    if low <= 0.0 <= high:
        return 0.0, float(share * (high if high > 0.0 else low))
    return float(low), float(low + share * (high - low))


def response_to_step(
    model: Model, theta: Array, j: int, start: float, level: float, length: int
) -> Array:
    """All outputs after a step of input j, less what they were before, (length, ny)."""
    structure = model.structure
    if structure.traits.linear:  # superposition: a step from rest
        u = np.zeros((length, structure.nu))
        u[:, j] = level - start
        return structure.simulate(theta, u)
    u = np.zeros((2 * length, structure.nu))
    u[:, j] = start
    u[length:, j] = level
    y = structure.simulate(theta, model.detrend.remove_input(u, np.zeros(len(u))))
    return np.asarray(y[length:] - y[length - 1])


def settled_length(model: Model, j: int, start: float, level: float) -> tuple[float, int]:
    """Time in which outputs settle after a step of input j [s], and the length of a run in which
    that is seen [samples]; infinite where none does. A side path that never does keeps nobody."""
    slowest = max(_slowest(_poles(model, model.theta, i, j)) for i in range(len(model.outputs)))
    runs, length = _settled_runs(model, j, start, level, slowest)
    times = [run.dead + run.settling for run in runs if run.settles]
    return max((t for t in times if np.isfinite(t)), default=np.inf), length


def _settled_runs(
    model: Model, j: int, start: float, level: float, slowest: float
) -> tuple[list[_Run], int]:
    """The numbers of a run long enough for every output to settle, and its length in samples."""
    length = STARTING_LENGTH
    while length < min(6.0 * slowest, LONGEST):
        length *= 2
    while True:
        with np.errstate(all="ignore"):
            y = response_to_step(model, model.theta, j, start, level, length)
            runs = [_read(column, model.dt, level - start) for column in y.T]
        if length >= LONGEST or all(run.settles for run in runs):
            return runs, length
        length *= 2


def _read(y: Array, dt: float, step: float) -> _Run:
    """Gain and times of one response; y[0] is the sample of the step itself."""
    tail = y[-len(y) // 4 :]
    whole = float(np.max(np.abs(y)))
    if not np.isfinite(whole):
        return _Run(np.nan, np.nan, np.nan, np.nan, False, False)
    if whole == 0.0:
        return _Run(0.0, np.nan, np.nan, np.nan, False, True)
    rates = np.diff(tail) / dt
    spread = float(np.ptp(tail))
    if spread <= QUIET * whole:
        change, shape, integrates = float(tail[-1]), y, False
        gain = change / step
    elif spread > RAMP * whole and np.ptp(rates) <= QUIET * float(np.max(np.abs(np.diff(y)))) / dt:
        shape = np.diff(y, prepend=y[:1]) / dt  # the rate of an integrating output
        change, integrates = float(rates[-1]), True
        gain = change / step
    else:
        return _Run(float(y[-1]) / step, np.nan, np.nan, np.nan, False, False)
    if abs(change) < MOVES * whole:  # comes back to where it was: a washout has no gain
        return _Run(gain, np.nan, np.nan, np.nan, integrates, True)
    share = shape / change
    first = int(np.argmax(np.abs(share) > MOVES))
    begun = max(first - 1, 0)
    dead = begun * dt
    k = np.arange(float(len(share) - begun))
    rise = dt * float(first_crossing(k, share[begun:], 1.0 - np.exp(-1.0)))
    outside = np.flatnonzero(np.abs(share - 1.0) > SETTLED)
    settling = 0.0 if not len(outside) else _return(share, int(outside[-1])) * dt
    return _Run(gain, dead, rise, settling, integrates, True)


def _return(share: Array, k: int) -> float:
    """Sample, with its fraction, after which a response stays inside the band; k is outside."""
    if k + 1 >= len(share):
        return float(k)
    outside, inside = abs(share[k] - 1.0), abs(share[k + 1] - 1.0)
    return k + float((outside - SETTLED) / max(outside - inside, 1e-300))


# Modes of a linear model


def _reaches(model: Model, i: int, j: int) -> bool:
    """Whether an input has a path to an output at all; of a nonlinear model nobody knows."""
    entry = entry_of(model, model.theta, i, j)
    return entry is None or bool(np.any(entry[0]))


def entry_of(model: Model, theta: Array, i: int, j: int) -> tuple[Array, Array] | None:
    """Numerator and denominator from input j to output i in powers of q⁻¹."""
    structure = model.structure
    if not isinstance(structure, LinearStructure):
        return None
    for g in structure.transfer(theta).groups:
        if g.output == i and j in g.inputs:
            return g.num[g.inputs.index(j)], g.den
    return np.zeros(1), np.ones(1)


def _poles(model: Model, theta: Array, i: int, j: int) -> Poles:
    """Poles from input j to output i, none of them at the origin; of a nonlinear model none."""
    entry = entry_of(model, theta, i, j)
    roots = np.zeros(0) if entry is None else np.roots(np.trim_zeros(entry[1], "b"))
    return roots.astype(np.complex128)


def _visible_poles(model: Model, i: int, j: int) -> Poles:
    """Poles that a step shows, the slowest first, one of each complex pair.

    The k-th mode of Σ rₖ/(1 − pₖ q⁻¹) carries rₖ/(1 − pₖ) of the final value.
    """
    entry, poles = entry_of(model, model.theta, i, j), _poles(model, model.theta, i, j)
    if entry is None:
        return poles
    num, den = entry
    poles = poles[np.abs(poles) > 0.0]
    carried = []
    for k, p in enumerate(poles):
        others = np.prod(1.0 - np.delete(poles, k) / p)
        top = np.polyval(num[::-1], 1.0 / p)
        with np.errstate(all="ignore"):
            carried.append(abs(top / others / (1.0 - p)) if others else np.inf)
    total = float(np.sum(num)) / float(np.sum(den)) if float(np.sum(den)) else np.inf
    kept = [
        p
        for p, share in zip(poles, carried, strict=True)
        if p.imag >= 0.0
        and (p.real > 0.0 if p.imag == 0.0 else np.angle(p) <= RESOLVED)
        and not share < VISIBLE_MODE * (abs(total) if np.isfinite(total) else 0.0)
    ]
    return np.array(sorted(kept, key=lambda p: -abs(p)))


def _slowest(poles: Poles) -> float:
    slow = float(np.min(-np.log(np.abs(poles)), initial=np.inf))
    return 1.0 / slow if slow > 0.0 else 0.0


def _dead_time(model: Model, i: int, j: int, run: _Run) -> tuple[float, float]:
    """Time before the output responds and its standard error [s].

    Delays whose coefficients are noise count as waiting.
    """
    structure = model.structure
    entry = dead_time_entry(structure, i, j)
    if entry is not None:
        error = float(np.sqrt(max(model.covariance[entry, entry], 0.0)))
        return float(model.theta[entry]), error
    # coefficients that stand for single lags are those of B alone
    if not isinstance(structure, PolynomialStructure) or structure.orders.coupled:
        return run.dead, 0.0
    first = structure.orders.nk[i][j]
    name = f"b{{}}[{model.outputs[i].name},{model.inputs[j].name}]"
    if structure.nu == structure.ny == 1:
        name = "b{}"
    table = {p.name: p for p in model.parameter_table()}
    for lag in range(first, first + structure.orders.nb[i][j]):
        p = table[name.format(lag)]
        if (p.fixed and p.value) or abs(p.value) > 2.0 * p.std_error:
            return max(lag - 1, 0) * model.dt, 0.0
    return run.dead, 0.0


# Units


def _gain_units(u: Channel, y: Channel, integrates: bool) -> tuple[str, str]:
    """Unit of the gain in the model's units and, where something was converted, in the file's."""
    top, bottom = y.unit or y.name, u.unit or u.name
    of_file = (y.file_words or top, u.file_words or bottom)
    if integrates:
        top, of_file = f"{bracketed(top)}/s", (f"{bracketed(of_file[0])}/s", of_file[1])
    same = abs(u.scale) == abs(y.scale) == 1.0
    return ratio(top, bottom), "" if same else ratio(*of_file)
