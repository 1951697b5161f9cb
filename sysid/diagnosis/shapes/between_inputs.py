"""Shapes between signals: an input that acts later than the others, and one whose effect goes with
another signal."""

from collections.abc import Mapping

import numpy as np

from sysid.data.checks.direction import acts_on
from sysid.data.record import Array, Channel
from sysid.diagnosis.shapes.reading import own_feedback
from sysid.diagnosis.shapes.shape import Curve, Shape, ShapePlace, Terms
from sysid.diagnosis.shapes.smoother import Fit
from sysid.diagnosis.shapes.track import Signal, Track
from sysid.errors import argument

LAGS, DELAYS = 10, 12
"""Time constants and dead times of one input that are tried."""

LONGEST = 5.0
"""They last up to so many time constants of the base, …"""

MOST_SHARE = 0.05
"""… and up to this share of the log."""

CLEAR = 0.05
"""A signal keeps clear of zero by this share of its largest value."""

OVER = "1/"
"""What the name of a signal's reciprocal begins with."""

CORES = 6
"""Lags of first order that stand for the core where it may be far off."""

ALONE = -1
"""For an input: the other signal acts by itself."""

LEAST_BLOCKS = 60
"""Blocks of a log by which it is seen whether a column acts."""

IN_PROPORTION = 0.2
"""Share of its effect that an input has left where the other signal is zero: below, it is in
proportion to it."""


SAME_SIZE = 0.9
"""Where an effect is as large as this share of its largest one all along, it is its time that goes
with the other signal."""


def _samples(track: Track, tried: int) -> Array:
    """Times that are tried [samples]."""
    slow = LONGEST / max(-np.log(max(track.pole, 1e-300)), 1e-3)
    return np.geomspace(1.0, float(np.clip(slow, 4.0, max(MOST_SHARE * len(track.t), 4.0))), tried)


def _lagged(track: Track, signals: Array, samples: float) -> Array:
    """Signals (N, n) behind a lag of first order, each record from where it begins."""
    pole = np.exp(-1.0 / samples)
    first = signals[track.first]
    late = track.filtered(np.array([1.0 - pole]), np.array([1.0, -pole]), signals - first)
    return np.asarray(first + late)


def later(track: Track) -> Terms | None:
    """G(q) K (d_j′ − d_j): one of several inputs behind a lag or dead time of its own, scanned."""
    if not track.adds_inputs:
        return None
    ways: list[tuple[Channel, str, float]] = []
    columns = []
    for j, channel in enumerate(track.channels):
        d = track.inputs[:, j]
        for n in _samples(track, LAGS):
            ways.append((channel, "behind a lag", n * track.dt))
            columns.append(_lagged(track, d[:, None], n)[:, 0] - d)
        for k in np.unique(np.rint(_samples(track, DELAYS)).astype(int)).tolist():
            ways.append((channel, "later than the others, by", k * track.dt))
            columns.append(track.past(d, k) - d)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        channel, way, seconds = ways[k]
        return f"{channel.name} acts on {track.output.name} {way} of about {seconds:.2g} s", None

    moved = track.through(track.gain * np.column_stack(columns))
    return Terms(moved.T[:, :, None], says)


def with_another(track: Track) -> Terms | None:
    """G(q) K d_i c or G(q) K d_i/c: the effect of an input goes with another signal or, as what
    heats or feeds a stream goes with the flow, with its reciprocal; lagged or not; scanned."""
    over = [reciprocal for s in track.others if (reciprocal := _reciprocal(s))]
    others = {s.name: s.values for s in (*track.others, *over)}
    ways, torque = _products(track, others)
    if not ways:
        return None
    of_core = 0 if track.fixed else len(track.f)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        i, name = ways[k]
        changed = float(np.sum(fit.own[i * of_core : (i + 1) * of_core])) / track.gain
        more = float(fit.coefficients[0])
        return _goes_with(track, i, name, others[name], 1.0 + changed, more), None

    return Terms(track.through(track.gain * torque).T[:, :, None], says)


def _reciprocal(signal: Signal) -> Signal | None:
    """One over a signal that keeps clear of zero."""
    least, most = float(np.min(signal.values)), float(np.max(signal.values))
    clear = min(abs(least), abs(most)) > CLEAR * max(abs(least), abs(most))
    one_sign = clear and least * most > 0.0
    return Signal(f"{OVER}{signal.name}", 1.0 / signal.values) if one_sign else None


def with_unused(track: Track) -> Terms | None:
    """Σ_m a_m G_m(q) c or G_m(q) d_i c, with a column c that is not used, lagged or not; scanned.

    Only columns that act: what the inputs command, an acceleration for instance, or what follows
    the output, such as a current, is rather a consequence. Lags G_m of first order of any length
    stand for the core, for the inputs, too: that of a log without the column may be far off.
    """
    acting = {c.name: c.values for c in track.unused if _acts(track, c.values)}
    if not acting:
        return None
    ways, torque = _products(track, acting)
    ways = [*((ALONE, name) for name in acting), *ways]
    alone = [c[:, None] / float(np.max(np.abs(c))) for c in acting.values()]
    every = np.hstack([*alone, track.gain * torque])
    own = track.inputs if track.adds_inputs else track.drive[:, None]
    lags = np.geomspace(1.0, max(len(track.t) * MOST_SHARE, 4.0), CORES)
    columns = np.stack([_lagged(track, every, n).T for n in lags], axis=2)
    beside = np.hstack([_lagged(track, track.gain * own, n) for n in lags])
    first = track.own.shape[1]

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        i, name = ways[k]
        called, too = f"{name}, which is not used here", ""
        if track.adds_inputs or len(track.channels) == 1:  # several outputs take an input each
            both = argument(inputs=[*(c.name for c in track.channels), name])
            too = f"; give it as an input, too: {both}"
        if i == ALONE:
            words = f"{track.output.name} also follows {called}"
        else:
            lagged = float(np.sum(fit.own[first + i :: own.shape[1]]))
            more = float(np.sum(fit.coefficients))
            words = _goes_with(track, i, called, acting[name], _alone(track, fit, i) + lagged, more)
        return f"{words}{too}", None

    return Terms(columns, says, None, beside)


def _products(track: Track, others: Mapping[str, Array]) -> tuple[list[tuple[int, str]], Array]:
    """(input, name) and d_i c of each input and each other signal, lagged or not, (N, V)."""
    own = track.inputs.shape[1] if track.adds_inputs else 1
    ways: list[tuple[int, str]] = []
    columns = [np.empty((len(track.t), 0))]
    for name, signal in others.items():
        size = float(np.max(np.abs(signal), initial=0.0))
        if size == 0.0:
            continue
        lags = _samples(track, LAGS)
        late = np.hstack([signal[:, None], *(_lagged(track, signal[:, None], n) for n in lags)])
        for i in range(own):
            if track.channels[i].name != name.removeprefix(OVER):
                ways += [(i, name)] * late.shape[1]
                columns.append(track.inputs[:, [i]] * late / size)
    return ways, np.hstack(columns)


def _alone(track: Track, fit: Fit, i: int) -> float:
    """What an input does in the end where the other signal is zero, in units of the base's gain:
    without what terms of its lags add."""
    of_core = 0 if track.fixed else len(track.f)
    changed = float(np.sum(fit.own[i * of_core : (i + 1) * of_core])) / track.gain
    return 1.0 + changed + (own_feedback(track, fit) if fit.on_base else 0.0)


def _goes_with(track: Track, i: int, called: str, signal: Array, alone: float, more: float) -> str:
    """How an input's effect goes with a signal: ``alone`` at 0, and ``more`` at its largest size;
    compared over the values that the log visits."""
    words = f"the effect of {track.channels[i].name} on {track.output.name} "
    if abs(alone) < IN_PROPORTION * abs(more):
        return f"{words}is in proportion to {called}"
    slope = more / float(np.max(np.abs(signal)))
    ends = [
        (alone + slope * float(np.min(signal)), "smallest"),
        (alone + slope * float(np.max(signal)), "largest"),
    ]
    (less, at), (most, other) = sorted(ends, key=lambda end: abs(end[0]))
    if abs(less) > SAME_SIZE * abs(most):
        pair = f"{track.channels[i].name} takes to act on {track.output.name}"
        return f"the time that {pair} goes with {called}"
    times = f"{less / most:.2g} times that where it is {other}"
    return f"{words}goes with {called}: where that is {at} it is {times}"


def _acts(track: Track, column: Array) -> bool:
    """Whether a column acts on the output, as blocks of a quarter of the time constant show it."""
    rows = int(
        np.clip(-0.25 / np.log(max(track.pole, 1e-300)), 1, max(len(track.t) // LEAST_BLOCKS, 1))
    )
    signals = np.column_stack([column, track.measured, track.inputs])
    parts = np.split(signals, track.starts[1:-1])
    return acts_on([(p[:, 0], p[:, 1], p[:, 2:]) for p in parts], rows)


SHAPES = (
    Shape("input-later", ShapePlace.COMMAND, later),
    Shape("input-product", ShapePlace.COMMAND, with_another),
    Shape("unused-column", ShapePlace.UNUSED, with_unused),
)
