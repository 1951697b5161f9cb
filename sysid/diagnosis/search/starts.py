"""Start values of the search for an effect: from the catalogue, or estimated from the data."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array
from sysid.diagnosis.over_angle import over_angle, strongest_lines
from sysid.diagnosis.search.full_model import NO_LIMIT, FullModel, ModelParameter
from sysid.diagnosis.search.motion_equations import friction_of_servo, weight_over_angle
from sysid.diagnosis.search.prepared import Data
from sysid.effects.base import NO_LAW, Effect, Place, StartsFrom, Wave, is_of_servo
from sysid.effects.catalogue import CHANGED
from sysid.structures.blocks.sign_recovery import LAGS, recovered

PILE_UP = 0.01
"""Share of the samples that must lie at the largest reading before it counts as a clip level."""

BELL_UP = 1.6
"""How many times more measurements lie in a bell at the top than below, for a clip behind noise."""

REPEATED = 0.004
"""Share of the samples that must be exactly the largest reading, for a clip without noise."""

SIZES = (0.6, 0.8, 1.0, 1.25, 1.6)
"""An effect is screened at each of its starts and at these multiples of it."""

RANKS = 2
"""Waves over the angle that a search starts from, the strongest first."""

RAMPS, STEEP = (4, 16, 64), 0.98
"""Samples over which slopes are taken, and their quantile: most of the time nothing ramps."""

QUICK = 6.0
"""By how much a lag shrinks where a ramp was taken for it."""


def starts_of(
    model: FullModel, e: Effect, q: Array, errors: Array, data: Data, fixed_core: bool = False
) -> list[Array]:
    """Starting values of all parameters for the search of one effect.

    Args:
        q: parameters of the model without it, (parameters,).
        errors: its free-run errors on the data, (M, tracks).
    """
    if e.id == CHANGED.id:
        return _other_cores(model, q)
    rows = _starts_of(model, e, q, errors, data)
    if not fixed_core:
        return rows
    for row in rows:
        row[list(model.of("core"))] = q[list(model.of("core"))]
    return list(np.unique(np.array(rows), axis=0)) if rows else []


def _starts_of(model: FullModel, e: Effect, q: Array, errors: Array, data: Data) -> list[Array]:
    match e.hints.starts_from:
        case StartsFrom.SIGNS:
            return _signless(model, e, q, data)
        case StartsFrom.CLIP_LEVEL:
            return _from_pile_up(model, e, q, data)
        case StartsFrom.WAVES:
            return _from_waves(model, e, q, errors, data)
    rows = []
    for values, size in product(model.starts(e), SIZES):
        row = q.copy()
        for k, value in values.items():
            p = model.parameters[k]
            sized = p.null + size * (value - p.null) if abs(p.null) < NO_LIMIT else size * value
            row[k] = value if p.of.choice else p.within(sized)
        rows.append(row)
    if is_of_servo(e):
        return [*rows, *friction_of_servo(model, e, q, data)]
    if e.hints.starts_from is StartsFrom.RAMPS:
        return [*rows, *_from_ramps(model, e, q, data)]
    return rows


def _from_ramps(model: FullModel, e: Effect, q: Array, data: Data) -> list[Array]:
    """The steepest slopes of the measurements over several spans, as rates of the drive.

    Of a law with two parameters the first is that of growing, the second that of falling sizes.
    The base takes ramps for a slow lag: each rate is also tried with a core that is quick.
    """
    rows = []
    for span, power, law in product(RAMPS, (1.0, QUICK), e.laws or (NO_LAW,)):
        row, rates = q.copy(), np.zeros((model.tracks, 2))
        for i in range(model.tracks):
            gain, f, _ = model.core(q, i)
            steepest = _steepest(data, i, span, len(law.parameters) > 1)
            rates[i] = np.array(steepest) / (model.dt * max(abs(gain), 1e-300))
            if power != 1.0:
                poles = np.abs(np.roots([1.0, *f])) ** power
                model.set_core(row, i, gain, np.asarray(np.poly(poles)[1:], dtype=np.float64))
        if not rates.all():
            continue
        searched = e.searched(law.choices)
        for k in model.of(e.id):
            p = model.parameters[k]
            if p.of.choice:
                row[k] = law.choices[p.name]
            elif p.name in searched:
                rate = rates[:, searched.index(p.name)]
                row[k] = p.within(rate.max() if p.track < 0 else rate[p.track])
        rows.append(row)
    return rows


def _steepest(data: Data, track: int, span: int, apart: bool) -> tuple[float, float]:
    """The steepest change a sample of a track's measurements over a span; 0 in shorter records.

    Args:
        apart: whether that of growing and that of falling sizes; else both are the same.
    """
    y = data.y[:, track]
    slopes = np.concatenate(
        [(part[span:] - part[:-span]) / span for part in data.split(np.abs(y) if apart else y)]
    )
    slopes = slopes[np.isfinite(slopes)]  # lost measurements have none
    if not len(slopes):
        return 0.0, 0.0
    if not apart:
        return (float(np.quantile(np.abs(slopes), STEEP)),) * 2
    rise, fall = np.quantile(slopes, STEEP), -np.quantile(slopes, 1.0 - STEEP)
    return max(float(rise), 0.0), max(float(fall), 0.0)


def _other_cores(model: FullModel, q: Array) -> list[Array]:
    """Larger and smaller gains, faster and slower time constants."""
    rows = []
    for factor, power in ((0.75, 1.0), (1.3, 1.0), (1.0, 0.6), (1.0, 1.6)):
        row = _stronger(model, q, factor)
        for i in range(model.tracks):
            f1 = model.index["core", "f1", i]
            row[f1] = -(abs(row[f1]) ** power)
        rows.append(row)
    return rows


def _stronger(model: FullModel, row: Array, factor: float = 1.3) -> Array:
    out = row.copy()
    gains = [k for k in model.of("core") if model.parameters[k].name == "gain"]
    out[gains] *= factor
    return out


def _signless(model: FullModel, e: Effect, q: Array, data: Data) -> list[Array]:
    """A base fitted to signless measurements is worth nothing: cores with the signs put back.

    One start for each first guess of the signs, track by track (see ``sign_recovery``).
    """
    rows, first = [], e.parameters[0]
    for lag in LAGS:
        row = q.copy()
        for i in range(model.tracks):
            A, B = _with_signs(data, i, model.order, lag)
            size = float(A.sum())
            gain = float(B.sum()) / size if abs(size) > 1e-9 else 0.0
            if np.isfinite(gain) and gain != 0.0:
                model.set_core(row, i, gain, A[1 : model.order + 1], B[1 : model.order] / gain)
                row[model.index[e.id, first.name, i]] = first.starts[0]
        rows.append(row)
    return rows + (_ringing(model, e, q, data) if model.order == 3 else [])


@lru_cache(32)  # the same whatever a model holds
def _with_signs(data: Data, track: int, order: int, lag: float) -> tuple[Array, Array]:
    """A and B of a track whose measurements got their signs back."""
    A, (B,), _ = recovered(
        data.split(data.drive[:, [track]]),
        [np.abs(y) for y in data.split(data.y[:, track])],
        [w > 0.0 for w in data.split(data.weight[:, track])],
        order,
        [(1, order)],
        lag,
    )
    return A, B


def _ringing(model: FullModel, e: Effect, q: Array, data: Data) -> list[Array]:
    """Third-order cores with a resonance, where signs that change fast cannot be put back."""
    rows, first = [], e.parameters[0]
    gains = np.mean(np.abs(data.y), axis=0) / np.maximum(
        np.mean(np.abs(data.drive[:, : model.tracks]), axis=0), 1e-9
    )
    for turn, radius, real in product((0.3, 0.6, 1.0), (0.9, 0.97), (0.85, 0.96)):
        row = q.copy()
        poles = [real, radius * np.exp(1j * turn), radius * np.exp(-1j * turn)]
        for i, gain in enumerate(gains.tolist()):
            model.set_core(row, i, gain, np.real(np.poly(poles))[1:])
            row[model.index[e.id, first.name, i]] = first.starts[0]
        rows.append(row)
    return rows


def _from_pile_up(model: FullModel, e: Effect, q: Array, data: Data) -> list[Array]:
    """The clip level is where measurements pile up, not what least squares would like it to be."""
    levels = np.array(
        [clip_level(data.y[data.weight[:, i] > 0.0, i], data.noise[i]) for i in range(model.tracks)]
    )
    if not np.isfinite(levels).any():
        return []
    row = q.copy()
    for i, level in enumerate(levels):
        p = model.index[e.id, e.parameters[0].name, i]
        if np.isfinite(level):
            row[p] = min(level, model.parameters[p].upper)
    return [row, _stronger(model, row), _stronger(model, row, 1.8)]


def clip_level(y: Array, noise: float = 0.0) -> float:
    """Size of the largest measurements when they pile up in a narrow band, else infinite.

    A clipped sensor shows a flat top: one largest value comes again and again, or, where noise
    enters behind the clip, many more measurements lie within the noise of the top than in the bands
    below it.

    Args:
        y: measurements, (N,).
        noise: their standard deviation beyond the clip.
    """
    size = np.abs(y)
    if repeats_at_top(size):
        return float(size.max())
    top = float(np.quantile(size, 0.995))
    if top <= 0.0:
        return np.inf
    width, ratio = 0.04 * top, 3.0
    if noise > 0.3 * width:
        # the pile is a bell as wide as the noise, and the top lies on its far slope
        width = 3.0 * noise
        bands = np.linspace(top - 2.0 * width, top, 81)
        counts = [int(np.sum(np.abs(size - b) < 0.5 * width)) for b in bands]
        top = float(bands[int(np.argmax(counts))]) + 0.5 * width
        ratio = BELL_UP
    high = float(np.mean(size > top - width))
    below = [
        float(np.mean((size > top - (k + 2) * width) & (size <= top - (k + 1) * width)))
        for k in range(4)
    ]
    usual = max(float(np.mean(below)), 1e-9)
    if high < PILE_UP or high < ratio * usual:
        return np.inf
    if (high - usual) * len(size) < 5.0 * np.sqrt(usual * len(size)):
        return np.inf
    return float(np.median(size[size > top - width]))


def repeats_at_top(y: Array) -> bool:
    """Whether one and the same largest reading comes again and again: a clip that is seen."""
    values, counts = np.unique(np.abs(y), return_counts=True)
    return bool(
        len(values) > 8
        and counts[-1] > REPEATED * len(y)
        and counts[-1] > 4.0 * np.mean(counts[-5:-1])
    )


def _from_waves(model: FullModel, e: Effect, q: Array, errors: Array, data: Data) -> list[Array]:
    """The strongest waves of the errors over the wheel's angle, for each law, track by track.

    The angle comes from the measurements, or from the model where the measurements drift at rest.
    """
    run = data.y - errors
    simulated = (np.cumsum(run, axis=0) - 0.5 * run) * model.dt
    starts = []
    for law in e.laws:
        (wave,) = (w for w in e.waves if w.cosine in law.parameters)
        for of_wheel, angle in ((0.0, data.counted + 0.5 * model.dt * run), (1.0, simulated)):
            rows = [q.copy() for _ in range(RANKS if wave.line in law.parameters else 1)]
            for i in range(model.tracks):
                seen = _Seen(model, wave, q, data, run[:, i], i)
                line = model.index[e.id, wave.line, i]
                free = wave.line in law.parameters
                lines = (
                    seen.lines(angle[:, i], errors[:, i], model.parameters[line])
                    if free
                    else [model.parameters[line].null]
                )
                for row, n in zip(rows, lines, strict=True):
                    cosine, sine = seen.fitted(n * angle[:, i], errors[:, i])
                    values = {wave.cosine: cosine, wave.sine: sine, wave.line: n}
                    values |= {wave.of_wheel: of_wheel, **law.choices}
                    for name, value in values.items():
                        row[model.index[e.id, name, i]] = value
            if e.place is Place.TORQUE:
                regressed = weight_over_angle(model, e, wave, q, data)
                rows += [] if regressed is None else [regressed]
                for i in range(model.tracks if regressed is not None else 0):
                    for name, value in {wave.of_wheel: of_wheel, **law.choices}.items():
                        rows[-1][model.index[e.id, name, i]] = value
            starts += rows
    return starts


class _Seen:
    """How a wave of an effect shows in the measurements of one track, to first order."""

    def __init__(
        self, model: FullModel, wave: Wave, q: Array, data: Data, run: Array, i: int
    ) -> None:
        _, f, tail = model.core(q, i)
        self.a = np.concatenate([[1.0], f])
        self.b = np.concatenate([[0.0, 1.0 + f.sum() - tail.sum()], tail])
        self.torque = wave.of_torque
        self.factor = run if wave.of_speed else np.ones_like(run)
        self.weight = data.weight[:, i]

    def lines(self, angle: Array, errors: Array, p: ModelParameter) -> list[float]:
        """The strongest waves a rad."""
        at = errors * self.weight
        if self.torque:  # the torque that the errors ask for, a sample before
            at = np.append(lfilter(self.a, [1.0], at)[1:], 0.0) * self.weight
        lines, whole = over_angle(angle, at * self.factor, p.upper)
        span = float(np.ptp(angle))
        return strongest_lines(lines, np.abs(whole), (p.lower, p.upper), span, RANKS)

    def fitted(self, phase: Array, errors: Array) -> tuple[float, float]:
        """Cosine and sine of a wave by least squares; none where the core's motion has no end."""
        both = np.column_stack([np.cos(phase), np.sin(phase)]) * self.factor[:, None]
        if self.torque:
            both = -lfilter(self.b, self.a, both, axis=0)
        if not np.isfinite(both).all():
            return 0.0, 0.0
        both = both * self.weight[:, None]
        cosine, sine = np.linalg.lstsq(both, errors * self.weight, rcond=None)[0]
        return float(cosine), float(sine)


def free_indices(model: FullModel, e: Effect, q: Array, tracks: Sequence[int]) -> tuple[int, ...]:
    """Slots of an effect that a search moves on some of the tracks, by the law that ``q`` chose."""
    # a changed parameter has none of its own: it moves the core's
    fixed = {p.name for p in e.parameters}.difference(e.searched(model.chosen(e, q)))
    return tuple(
        k
        for k in model.of(e.id)
        if model.parameters[k].name not in fixed
        and (model.parameters[k].track < 0 or model.parameters[k].track in tracks)
    )
