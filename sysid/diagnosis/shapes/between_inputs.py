"""Shapes between signals: an input that acts later than the others, and one whose effect goes with
another signal."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Channel
from sysid.diagnosis.shapes.shape import Curve, Shape, ShapePlace, Terms
from sysid.diagnosis.shapes.smoother import Fit
from sysid.diagnosis.shapes.track import Signal, Track

LAGS, DELAYS = 10, 12
"""Time constants and dead times of one input that are tried."""

LONGEST = 5.0
"""They last up to so many time constants of the base, …"""

MOST_SHARE = 0.05
"""… and up to this share of the log."""

ALONE = -1
"""For an input: the other signal acts by itself."""

COMMANDED = 0.5
"""Share of a column's power from which the inputs command it."""

SETTLED = 0.6
"""Share of a switch's power that is a curve over the output from which that settles it."""

MOST_BINS, CELLS_OF_BIN = 100, 20
"""Bins of the output that such a curve is read off, and the rows in each at least."""

IN_PROPORTION = 0.2
"""Share of its effect that an input has left where the other signal is zero: below, it is in
proportion to it."""


def _samples(track: Track, tried: int) -> Array:
    """Times that are tried [samples]."""
    slow = LONGEST / max(-np.log(max(track.pole, 1e-300)), 1e-3)
    return np.geomspace(1.0, float(np.clip(slow, 4.0, max(MOST_SHARE * len(track.t), 4.0))), tried)


def _lagged(track: Track, signal: Array, samples: float) -> Array:
    """A signal behind a lag of first order, each record from where it begins."""
    pole = np.exp(-1.0 / samples)
    first = signal[track.first]
    late = track.filtered(np.array([1.0 - pole]), np.array([1.0, -pole]), signal - first)[:, 0]
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
            columns.append(_lagged(track, d, n) - d)
        for k in np.unique(np.rint(_samples(track, DELAYS)).astype(int)).tolist():
            ways.append((channel, "later than the others, by", k * track.dt))
            columns.append(track.past(d, k) - d)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        channel, way, seconds = ways[k]
        return f"{channel.name} acts on {track.output.name} {way} of about {seconds:.2g} s", None

    moved = track.through(track.gain * np.column_stack(columns))
    return Terms(moved.T[:, :, None], says, np.zeros(len(ways)))


def with_another(track: Track) -> Terms | None:
    """G(q) K d_i c: the effect of an input goes with another signal, lagged or not; scanned."""
    return _with(track, track.others)


def with_unused(track: Track) -> Terms | None:
    """The same with a column that is not used, which may also act by itself: G(q) c.

    Only those that go their own way: what the inputs command, an acceleration for instance, or
    a switch that the output settles, such as one that is on at standstill, is rather a consequence.
    """
    commanded = np.column_stack([track.inputs, track.through(track.inputs)])
    commanded -= commanded.mean(axis=0)
    own = [
        c
        for c in track.unused
        if _share_of(c.values - c.values.mean(), commanded) < COMMANDED
        and not _is_settled(c.values, track.measured)
    ]
    return _with(track, own, acts=True)


def _share_of(signal: Array, columns: Array) -> float:
    """Share of a signal's power that columns predict."""
    left = signal - columns @ np.linalg.lstsq(columns, signal, rcond=None)[0]
    return 1.0 - float(left @ left) / max(float(signal @ signal), 1e-300)


def _is_settled(column: Array, output: Array) -> bool:
    """Whether a column of two values follows the output at the same instant: the means of its bins
    over the output, their number counted, predict it. A cause acts through the machine's lag."""
    bins = min(MOST_BINS, len(column) // CELLS_OF_BIN)
    if bins < 2 or np.any((column != column.min()) & (column != column.max())):
        return False
    parts = np.array_split(column[np.argsort(output, kind="stable")], bins)
    left = sum(float(np.sum((part - part.mean()) ** 2)) for part in parts)
    whole = float(np.sum((column - column.mean()) ** 2))
    return left * len(column) / (len(column) - bins) < (1.0 - SETTLED) * whole


def _with(track: Track, others: Sequence[Signal], acts: bool = False) -> Terms | None:
    own = track.inputs.shape[1] if track.adds_inputs else 1
    ways: list[tuple[int, str]] = []
    columns = []
    for name, signal in others:
        size = float(np.max(np.abs(signal), initial=0.0))
        if size == 0.0:
            continue
        late = [signal, *(_lagged(track, signal, n) for n in _samples(track, LAGS))]
        for i in (*range(own), *([ALONE] if acts else [])):
            if i != ALONE and track.channels[i].name == name:
                continue
            ways += [(i, name)] * len(late)
            drive = 1.0 if i == ALONE else track.inputs[:, i]
            columns += [drive * c / size for c in late]
    if not ways:
        return None

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        i, name = ways[k]
        called = f"{name}, which is not used here" if acts else name
        if i == ALONE:
            return f"{track.output.name} also follows {called}", None
        n = 0 if track.fixed else len(track.f)
        alone = 1.0 + float(np.sum(fit.own[i * n : (i + 1) * n])) / track.gain
        more = float(fit.coefficients[0])
        words = f"the effect of {track.channels[i].name} on {track.output.name} "
        if abs(alone) < IN_PROPORTION * abs(more):
            return f"{words}is in proportion to {called}", None
        times = f"{1.0 + more / alone:.2g} times that at 0"
        return f"{words}goes with {called}: where that is largest it is {times}", None

    moved = track.through(track.gain * np.column_stack(columns))
    return Terms(moved.T[:, :, None], says, np.zeros(len(ways)))


SHAPES = (
    Shape("input-later", ShapePlace.COMMAND, later),
    Shape("input-product", ShapePlace.COMMAND, with_another),
    Shape("unused-column", ShapePlace.UNUSED, with_unused),
)
