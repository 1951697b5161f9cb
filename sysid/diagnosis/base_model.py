"""The base model of a diagnosis: a linear baseline, or a given model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sysid.data.checks.integral import POSITIONS, integrates
from sysid.data.column_words import may_move
from sysid.data.facts import LogFacts
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.diagnosis.base_starts import core_of, starts
from sysid.diagnosis.integrating import rates, step_of
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.samples import SampleEffects, inspect_rates, inspect_samples, with_steps_of
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.motion_equations import servo_delay
from sysid.diagnosis.search.prepared import logs_of
from sysid.diagnosis.search.selection import CandidateModel
from sysid.effects.base import Effect, is_of_servo, of_motor, of_servo
from sysid.effects.by_log import for_logs
from sysid.effects.catalogue import in_chain
from sysid.effects.sensor import SAMPLING
from sysid.errors import DataError, ModelError
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.selection.delays import chosen_delay
from sysid.estimation.selection.select_structure import select_structure
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions
from sysid.structures.augmented.given_base import GivenBase, begins_at_rest
from sysid.structures.model import Model

LARGEST_ORDER = 3
LEAST_OF_SERVO = 2
"""A loop around a motor's position; friction may hide the second pole."""

FULL_DRIVE = 20000.0
"""Pulse width of full drive of a robot log [µs]."""


@dataclass(frozen=True, eq=False)
class Parts:
    """Estimation and held-out part of the logs.

    Attributes:
        facts, holdout_facts: what is known of both; the same where blocks are held out.
        weights: weight of each sample of both, (N, ny) a record.
    """

    facts: LogFacts
    holdout_facts: LogFacts
    weights: tuple[tuple[Array, ...], tuple[Array, ...]]
    words: str
    samples: SampleEffects
    whole: LogFacts

    @property
    def estimation(self) -> tuple[Record, ...]:
        """The estimation records."""
        return self.facts.records

    @property
    def holdout(self) -> tuple[Record, ...]:
        """The held-out records; the estimation records where blocks of them are held out."""
        return self.holdout_facts.records

    def facts_of(self, records: Sequence[Record]) -> LogFacts:
        """What is known of some of the records: of a whole part it is known already."""
        same = [id(r) for r in records]
        parts = (self.facts, self.holdout_facts)
        known = (f for f in parts if [id(r) for r in f.records] == same)
        return next(known, LogFacts(tuple(records)))


Inspection = Callable[[LogFacts], SampleEffects]
"""What the measurements of records show by themselves."""


def divided(
    estimation: Sequence[Record] | LogFacts,
    holdout: Sequence[Record] | LogFacts | None,
    inspect: Inspection = inspect_samples,
) -> Parts:
    """Validation logs as the held-out part; else interleaved blocks of the estimation logs.

    Both parts are then scored on free runs from the beginning of each record. Lost measurements do
    not count in either.
    """
    facts = LogFacts.of(estimation)
    seen = inspect(facts)
    weights = seen.weights
    if holdout:
        holdout_facts = LogFacts.of(holdout)
        whole = LogFacts((*facts.records, *holdout_facts.records))
        judging = inspect(holdout_facts).weights
        if inspect is inspect_samples:
            seen = with_steps_of(seen, whole)
        return Parts(facts, holdout_facts, (weights, judging), "the validation data", seen, whole)
    cut = hold_out(facts.records)
    masks = [m[:, None].astype(np.float64) for m in cut.counted]
    judging = tuple(w * m for w, m in zip(weights, masks, strict=True))
    weights = tuple(w * (1.0 - m) for w, m in zip(weights, masks, strict=True))
    return Parts(facts, facts, (weights, judging), cut.words, seen, facts)


def _divided_rates(
    positions: Sequence[Record] | LogFacts, judging: Sequence[Record] | LogFacts | None
) -> Parts:
    """``divided`` of the rates of an output that integrates."""
    read = [LogFacts.of(part).records for part in (positions, judging) if part]
    step = step_of(read[0])
    speeds = [LogFacts(tuple(rates(records, step))) for records in read]
    behind = {
        id(rate): position
        for part, records in zip(speeds, read, strict=True)
        for rate, position in zip(part.records, records, strict=True)
    }

    def inspect(some: LogFacts) -> SampleEffects:
        return inspect_rates(some, [behind[id(r)] for r in some.records], step)

    return divided(speeds[0], speeds[1] if len(speeds) > 1 else None, inspect)


@dataclass(frozen=True, eq=False)
class Base:
    """The base of a diagnosis.

    Attributes:
        on_rate: whether the rate of an output that integrates stands in its place.
        given: the model that was given, as the chain sees it; None for the plain base.
        sampled: whether measurements come a part of a sample late in it: how the log was made.
        driven: a record as the search takes it: behind a given model, with its drive as the input.
    """

    parts: Parts
    search: ForwardSelection
    model: CandidateModel
    words: str
    in_loop: bool = False
    on_rate: bool = False
    given: GivenBase | None = None
    sampled: bool = False
    driven: Callable[[Record], Record] = lambda record: record

    @property
    def poles(self) -> Array:
        """Discrete poles of all its cores."""
        model = self.search.model
        cores = (model.core(self.model.q, i) for i in range(model.tracks))
        return np.concatenate([np.roots([1.0, *f]) for _, f, _ in cores])

    def with_sampling(self, like: CandidateModel) -> "Base":
        """The base with a sampling lag, fitted from the shares of a candidate."""
        search = self.search.holding(SAMPLING.id)
        q, indices = self.model.q.copy(), list(search.model.of(SAMPLING.id))
        q[indices] = like.q[indices]
        candidate = search.base(q[None])
        shares = " and ".join(f"{v:.2f}" for v in candidate.q[indices])
        words = f"{self.words}; measurements {shares} of a sample late (a speed counted over a "
        words += "sample is half a sample late)"
        return replace(self, search=search, model=candidate, words=words, sampled=True)


def fit_baseline(
    data: Sequence[Record] | LogFacts,
    judging: Sequence[Record] | LogFacts | None,
    effects: Sequence[Effect],
    highest: int = LARGEST_ORDER,
    least_delay: int | None = None,
    offset: bool = False,
) -> Base:
    """Robot logs: per track its own command, first order, nk = 1, no offset. Others: OE up to
    third order with dead time and level chosen on the estimation part.

    Args:
        judging: validation logs; None holds blocks out.
        least_delay: the delay that is not estimated [samples]; as the log shows it unless given.
        offset: whether robot logs have one, too.
    """
    on_rate = integrates(LogFacts.of(data).records)
    parts = _divided_rates(data, judging) if on_rate else divided(data, judging)
    first = _require_tracks(parts.estimation)
    least, *other = (1,) if on_rate or _is_servo(first) else _least_delays(parts.facts)
    if least_delay is not None:
        least, other = least_delay, []
    base = _baseline(parts, effects, highest, on_rate, least, offset)
    if other and base.search.model.order == 1:
        rival = _baseline(parts, effects, highest, on_rate, other[0], offset)
        base = min(base, rival, key=_left)
    return base


def _left(base: Base) -> float:
    """Log of the squared error that a base leaves, whatever part of a sample readings are late."""
    sampled = base.with_sampling(base.model) if base.search.model.order == 1 else base
    return float(np.sum(np.log(sampled.model.errors.mean_squares()[0])))


def _baseline(
    parts: Parts,
    effects: Sequence[Effect],
    highest: int,
    on_rate: bool,
    least: int,
    offset: bool,
) -> Base:
    """The baseline with a delay of at least so many samples."""
    estimation, linear = parts.estimation, None
    later: tuple[int, ...] = ()
    first = estimation[0]
    scales = full_drive(estimation)
    if first.is_robot_log:
        order, delay, level = 1, least, offset
        words = f"its own command, first order, {_late(delay)}, {'an' if level else 'no'} offset"
        words = f"per track {words}" if first.ny > 1 else words
    else:
        # a body that a force moves: friction would otherwise hide in a higher order
        order, delay = 1, 1
        if not on_rate:
            linear, delays = _linear(parts.facts.without_repeats, least)
            delay = min(delays)
            later = tuple(d - delay for d in delays) if len(set(delays)) > 1 else ()
            order = int(np.max(linear.structure.order_values()["nf"]))
            if _is_servo(first):
                order = max(order, LEAST_OF_SERVO)
                delay = servo_delay(estimation, parts.facts.noise, delay)
        level = not may_lack_sign(estimation)
        order = min(order if level else LARGEST_ORDER, highest)
        words = f"output error of order {order} with {_process_words(first, delay, later, level)}"
        words += f" for the rate of the output, which integrates, every {first.dt:.3g} s" * on_rate
    effects = _with_logs(_possible(effects, first), parts, level)
    if order == 1:  # a numerator of a higher order holds it
        effects = (*effects, SAMPLING)
    speed = typical_speed(estimation)
    lag = _typical_lag(estimation, speed) if _is_servo(first) else None
    model = FullModel(effects, order, first.ny, speed, first.dt, first.nu, lag)
    in_loop = parts.facts.at_own_rate.surely_closed_loop
    search = ForwardSelection(
        model,
        parts.facts,
        parts.holdout_facts,
        scales,
        delay,
        level,
        parts.weights,
        RULE.in_loop if in_loop else RULE.held_out,
        later=later,
    )
    begun = starts(model, estimation, scales)
    if linear is not None:
        begun = np.vstack([begun, core_of(linear, model, scales)])
    candidate = search.base(begun)
    if not np.isfinite(candidate.holdout_rmse):
        raise ModelError("the baseline cannot be simulated on this log; run sysid inspect")
    return Base(parts, search, candidate, words, in_loop, on_rate)


def _process_words(first: Record, delay: int, later: Sequence[int], level: bool) -> str:
    """Delays, offset and inputs of a baseline that is no robot's."""
    pairs = zip(first.inputs, later, strict=bool(later))
    more = "".join(f", {d} more from {c.name}" for c, d in pairs if d)
    offset = " and an offset" if level else ""
    return _late(delay) + more + offset + f", the sum of {first.nu} inputs" * (first.nu > first.ny)


def given_base(
    model: Model,
    data: Sequence[Record] | LogFacts,
    judging: Sequence[Record] | LogFacts | None,
    effects: Sequence[Effect],
) -> Base:
    """A model of any structure as the base, unchanged.

    Its free run is taken apart into a first-order core per track and the drive that makes this
    core run like the model; effects act on that drive and core, so that without effects the
    chain is the model.
    """
    parts = divided(data, judging)
    estimation = parts.estimation
    for r in (*estimation, *parts.holdout):
        model.check(r)
    first = _require_tracks(estimation)
    if first.nu != first.ny:
        raise DataError(
            f"{first.name} has {first.nu} inputs and {first.ny} outputs; around a given model a "
            "diagnosis needs one input for each output: choose them with `inputs` and `outputs`, "
            "or leave the model out"
        )
    scales = full_drive(estimation)
    every = (*parts.estimation, *parts.holdout)
    runs = {id(r): outputs(model, r, None, start_of(model, r)) for r in every}
    if not all(np.isfinite(v).all() for v in runs.values()):
        raise ModelError("the model is unstable on this log; run sysid compare")
    effects = _with_logs(_possible(effects, first), parts, level=False)
    plain = FullModel(effects, 1, first.ny, typical_speed(estimation), first.dt)
    copies = [replace(r, y=runs[id(r)]) for r in parts.estimation]
    core_search = ForwardSelection(plain, copies, copies, scales, 1)
    core = core_search.base(starts(plain, copies, scales)).q
    gain = np.array([plain.core(core, i)[0] for i in range(first.ny)])
    pole = np.clip([plain.core(core, i)[1][0] for i in range(first.ny)], -0.999, -0.01)
    given = GivenBase.of(model, gain, pole)

    def driven(r: Record) -> Record:
        run = runs.get(id(r))
        run = outputs(model, r, None, start_of(model, r)) if run is None else run
        return replace(r, u=given.drive(run))

    in_loop = parts.facts.at_own_rate.surely_closed_loop
    search = ForwardSelection(
        plain,
        [driven(r) for r in parts.estimation],
        [driven(r) for r in parts.holdout],
        np.ones(first.nu),
        1,
        False,
        parts.weights,
        RULE.in_loop if in_loop else RULE.held_out,
        fixed_core=True,
    )
    q = plain.null
    for i in range(first.ny):
        plain.set_core(q, i, gain[i], pole[[i]])
    candidate = search.evaluate((), q, ())
    words = f"the {model.structure.name} model, as it is"
    return Base(parts, search, candidate, words, in_loop, given=given, driven=driven)


def _possible(effects: Sequence[Effect], first: Record) -> tuple[Effect, ...]:
    """Effects, and laws of them, that what is read can have.

    A heater has no friction, no gear and no armature, nor has a position on a spring; the
    position of a rudder comes from no battery. Of a servo, whose command is the position to be
    reached, nothing in the log is a torque or speed, and its loop has lags of its own.
    """
    servo = _is_servo(first)
    if first.nu > first.ny:
        effects = [e for e in effects if not e.couples]
    effects = [
        of_servo(e) if servo else of_motor(e) for e in effects if servo or not is_of_servo(e)
    ]
    if servo:
        effects = [
            e
            for e in effects
            if is_of_servo(e) or e.hints.level or not (e.of_motion or e.hints.exchanges)
        ]
    if any(c.unit in POSITIONS for c in first.inputs):
        effects = [e for e in effects if not e.hints.electric]
    if shows_motion(first):
        return tuple(effects)
    return tuple(e for e in effects if e.hints.level or not e.of_motion)


def shows_motion(first: Record) -> bool:
    """Whether an output may be the speed of something that turns or moves, or is a servo's.

    A position that integrates is diagnosed by its rate; one that does not is held by a spring or a
    weight, and what would be drag or friction of a speed would be a stiffness of it.
    """
    moving = (may_move(c.name, c.unit) and c.unit not in POSITIONS for c in first.outputs)
    return _is_servo(first) or any(moving)


def _is_servo(first: Record) -> bool:
    """Whether each command is a set point of the position that is read: both in one such unit."""
    if first.nu != first.ny:
        return False
    pairs = zip(first.inputs, first.outputs, strict=True)
    return all(u.unit == y.unit and y.unit in POSITIONS for u, y in pairs)


def _with_logs(effects: Sequence[Effect], parts: Parts, level: bool) -> tuple[Effect, ...]:
    """Effects, and what may differ between logs where they are searched on several."""
    logs = logs_of(parts.estimation, parts.holdout)
    by_log = for_logs(len(logs.names), level) if len(set(logs.estimation)) > 1 else ()
    return in_chain((*effects, *by_log))


def start_of(model: Model, record: Record) -> Start:
    """Where a given model begins to run on a record."""
    offsets = model.detrend.u_offset, model.detrend.y_offset
    return Start.ZERO if begins_at_rest(*offsets, record.y) else Start.ESTIMATED


def full_drive(records: Sequence[Record]) -> Array:
    """Full drive of each input: 20000 µs of a robot, else the largest command of the log."""
    first = records[0]
    if first.full_drive_is_known:
        return np.full(first.nu, FULL_DRIVE)
    everything = np.concatenate([r.u for r in records])
    return np.asarray(np.maximum(np.max(np.abs(everything), axis=0), 1e-12))


def typical_speed(records: Sequence[Record]) -> Array:
    """Size of the fast measurements of each output."""
    speed = np.quantile(np.abs(np.concatenate([r.y for r in records])), 0.95, axis=0)
    return np.asarray(np.maximum(speed, 1e-9))


def _typical_lag(records: Sequence[Record], speed: Array) -> Array:
    """RMS distance of servos from their set points, (ny,); no more than they travel."""
    distance = np.concatenate([r.y - r.u for r in records])
    return np.asarray(np.clip(np.sqrt(np.nanmean(distance**2, axis=0)), 1e-6 * speed, speed))


def may_lack_sign(records: Sequence[Record]) -> bool:
    """Whether commands of both signs meet measurements of one: the sensor may not see the
    direction.

    Effects are then compared at the largest order, because an order chosen on such measurements
    says nothing; zero is taken for a physical zero. That of a temperature or pressure is not.
    """
    if not shows_motion(records[0]):
        return False
    u = np.concatenate([r.u for r in records])
    y = np.concatenate([r.y for r in records])
    if u.shape[1] > y.shape[1]:
        return False  # which of the inputs drives it the other way is not known
    both = np.all((u.min(axis=0) < -0.2 * u.max(axis=0)) & (u.max(axis=0) > 0.0))
    size = np.quantile(np.abs(y), 0.95, axis=0)
    return bool(both and np.all(y.min(axis=0) > -0.05 * size))


def _require_tracks(records: Sequence[Record]) -> Record:
    first = records[0]
    if first.nu != first.ny and min(first.nu, first.ny) > 1:
        raise DataError(
            f"{first.name} has {first.nu} inputs and {first.ny} outputs; a diagnosis needs one "
            "input for each output, or one of either: choose them with `inputs` and `outputs`"
        )
    return first


def _least_delays(facts: LogFacts) -> tuple[int, ...]:
    """0 where the command of a row acts on its reading: the log is written behind both; else 1.

    Both where a nonlinearity leaves it open. In closed loop it is the controller that links them;
    readings without a sign show no delay.
    """
    seen = [d for d in facts.delays or () if d.delay is not None]
    if not seen or any(d.low for d in seen) or may_lack_sign(facts.records):
        return (1,)
    if facts.at_own_rate.surely_closed_loop:
        return (1,)
    return (0,) if all(d.certain for d in seen) else (1, 0)


def _late(delay: int) -> str:
    """The delay in words."""
    if delay == 0:
        return "no delay (a row's command acts before its reading)"
    return "one sample of delay" if delay == 1 else f"{delay} samples of delay"


def _linear(facts: LogFacts, least: int) -> tuple[Model, tuple[int, ...]]:
    """The output-error model whose order the log asks for, and its delay in samples: of each input
    where several act on one output.

    A delay that is read off a log that no linear model follows may be anything: one sample
    competes.
    """
    first, nk = facts.records[0], chosen_delay(facts).nk
    several = first.nu > first.ny == 1
    every = np.broadcast_to(nk, (first.ny, first.nu))
    delays = every[0] if several else np.max(every, keepdims=True)[0]
    delays = np.maximum(delays, 1) if least else np.zeros_like(delays)
    each = delays.tolist() if several else delays[:1].tolist()
    # what is read off is a sample short at times, and a numerator that all share cannot mend it
    beyond = 1 if several else 0
    tried = sorted(set(product(*({least, d, d + beyond * (d > least)} for d in each))))
    grid = [
        {"nb": n, "nf": n, "nk": [list(d)] if several else d[0]}
        for d in tried
        for n in range(1, LARGEST_ORDER + 1)
    ]
    detrend = Detrend.means(facts.records)
    ranking = select_structure(("oe",), facts, FitOptions(stable=True), detrend, grid=grid)
    model = ranking.entries[0].model
    found = np.ravel(model.structure.order_values()["nk"]).astype(int).tolist()
    return model, tuple(found if len(found) == len(delays) else found[:1] * len(delays))
