"""Shapes of time: gain, load or the whole plant that steps, gain and load that drift.

The torque of the base is T = K d. Terms: K d·1[t ≥ t₁] (gain), 1[t ≥ t₁] (load), ω·1[t ≥ t₁]
(time constant, beside gain), and the same times a curve of time.
"""

import numpy as np

from sysid.data.operating_point import value_with_error
from sysid.data.record import Array
from sysid.diagnosis.shapes.reading import (
    GRID,
    amount,
    axis,
    command_gain,
    half_band,
    own_feedback,
    plain,
    static_gain,
    time_constant,
)
from sysid.diagnosis.shapes.shape import Curve, Shape, ShapePlace, Terms, best_of_scan
from sysid.diagnosis.shapes.smoother import Fit, bend, spline
from sysid.diagnosis.shapes.track import Track
from sysid.fitting.profile import NORMAL

TIMES = 48
"""Times of a change that are tried first; the best is then refined between its neighbours."""

EDGE = 0.04
"""No change is looked for in this share of a record at its ends: too few samples say it."""

PIECES_OF_DRIFT, PIECES_OF_LOAD = 6, 36
"""Pieces of the curve of a gain that drifts, and of a load that wanders."""


def constant(track: Track) -> Array:
    """What a constant load does, (N, 1)."""
    return track.through(np.ones_like(track.drive))


def _stepping(track: Track, torque: Array, beside: Array | None) -> tuple[Array, Array]:
    """(rows at which terms begin (V,), their columns (V, N, k)) around the best time.

    Args:
        torque: (N, k), each switched on at the time.
    """
    own = track.own if beside is None else np.column_stack([track.own, beside])
    rows = track.fitted_in_time & np.isfinite(track.error)

    def columns(at: Array) -> Array:
        index = np.arange(len(track.drive))
        ends = np.array(track.starts)[np.searchsorted(track.starts, at, side="right")]
        on = (index >= at[:, None]) & (index < ends[:, None])  # (V, N)
        whole = (on[:, :, None] * torque).transpose(1, 0, 2)
        moved = track.through(whole.reshape(len(index), -1))
        return moved.reshape(len(index), len(at), -1).transpose(1, 0, 2)

    parts = []
    for low, high in zip(track.starts[:-1], track.starts[1:], strict=True):
        count = max(round(TIMES * (high - low) / len(track.drive)), 4)
        margin = EDGE * (high - low)
        if rows[low:high].any():
            parts.append(np.linspace(low + margin, high - margin, count).astype(int))
    at = np.unique(np.concatenate(parts))
    best, _ = best_of_scan(track.error, own, columns(at), rows)
    low, high = at[max(best - 1, 0)], at[min(best + 1, len(at) - 1)]
    fine = np.unique(np.linspace(low + 1, high, 24).astype(int))
    return fine, columns(fine)


def _when(track: Track, row: int, at: Array) -> str:
    spacing = float(np.median(np.diff(at))) * track.dt if len(at) > 1 else track.dt
    return f"at {value_with_error(float(track.t[row]), spacing)} s"


def _said(track: Track, words: str, when: str, curve: Curve) -> tuple[str, Curve | None]:
    """Words and curve; of a base that does not settle, neither a gain nor its share is known."""
    if track.settles:
        return words, curve
    words = (
        f"the gain, load or time constant changes {when}; the base does not settle within the log, "
        "which therefore does not say which of them, or by how much"
    )
    return words, None


def _by(change: float) -> str:
    """A change of a gain as a share of before; one of its sign is no weaker drive."""
    if change < -1.0:
        return f"changes its sign, to {1.0 + change:.2g} times that before,"
    return f"{'falls' if change < 0.0 else 'rises'} by {abs(100.0 * change):.2g} %"


def gain_step(track: Track) -> Terms | None:
    """K d·1[t ≥ t₁]."""
    at, columns = _stepping(track, (track.gain * track.drive)[:, None], None)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        before = command_gain(track, fit)
        change = fit.coefficients[0] * track.gain / before
        error = noise * np.sqrt(fit.covariance[0, 0]) * abs(track.gain / before)
        cause = "a load engaged, or the supply changed" if change > -1.0 else "another plant"
        when = _when(track, at[k], at)
        words = f"the gain of the command {_by(change)} {when} ({cause})"
        label = "gain [% of before]"
        curve = _step_curve(track, at[k], 100.0 * change, 100.0 * error, label)
        return _said(track, words, when, curve)

    return Terms(columns, says)


def load_step(track: Track) -> Terms | None:
    """1[t ≥ t₁], beside a constant load."""
    beside = constant(track)
    at, columns = _stepping(track, np.ones((len(track.drive), 1)), beside)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        value, error = fit.coefficients[0], noise * np.sqrt(fit.covariance[0, 0])
        factor, _ = track.output.to_file
        words = (
            f"a constant load or offset of {amount(track.output, value)} of {track.output.name} "
            f"{'is added' if value > 0.0 else 'sets in against it'} {_when(track, at[k], at)}"
        )
        label = axis(track.output, "load, lost steady")
        curve = _step_curve(track, at[k], factor * value, factor * error, label, 0.0)
        return _said(track, words, _when(track, at[k], at), curve)

    return Terms(columns, says, None, beside)


def plant_step(track: Track) -> Terms | None:
    """Gain, load and time constant that change at one time."""
    torque = np.column_stack([track.gain * track.drive, track.speed, np.ones_like(track.drive)])
    beside = constant(track)
    at, columns = _stepping(track, torque, beside)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        g, c, _ = fit.coefficients
        before, own = static_gain(track, fit), own_feedback(track, fit)
        after = static_gain(track, fit, g * track.gain, c)
        change = after / before - 1.0
        old, new = (time_constant(track, a) for a in (own, own + c))
        times = f" and its time constant goes from {old:.3g} to {new:.3g} s" if old and new else ""
        when = _when(track, at[k], at)
        words = (
            f"the gain of the command {_by(change)}{times} {when} "
            "(a load engaged or let go, or another part)"
        )
        error = noise * np.sqrt(fit.covariance[0, 0]) * abs(track.gain / before)
        label = "gain [% of before]"
        curve = _step_curve(track, at[k], 100.0 * change, 100.0 * error, label)
        return _said(track, words, when, curve)

    return Terms(columns, says, None, beside)


def gain_drift(track: Track) -> Terms | None:
    """K d·g(t), g a curve."""
    return _drift(track, track.gain * track.drive, PIECES_OF_DRIFT, None, "gain")


def load_drift(track: Track) -> Terms | None:
    """A curve of time added to the torque, beside a constant load."""
    return _drift(track, np.ones_like(track.drive), PIECES_OF_LOAD, constant(track), "load")


def lag_drift(track: Track) -> Terms | None:
    """(ω − T)·h(t): the time constant follows a curve of time."""
    return _drift(track, track.unbalanced, PIECES_OF_DRIFT, None, "time constant")


def _drift(
    track: Track, torque: Array, pieces: int, beside: Array | None, what: str
) -> Terms | None:
    span = float(np.ptp(track.t))
    basis = spline(float(track.t.min()), float(track.t.max()), pieces)
    columns = track.through(basis(track.t) * torque[:, None])

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        x = np.linspace(track.t.min(), track.t.max(), GRID)
        B = basis(x) - basis(track.t[track.fitted_in_time]).mean(axis=0)
        y = B @ fit.coefficients
        half = half_band(B, fit.covariance, noise)
        if what == "load":
            factor, _ = track.output.to_file
            words = (
                f"a load or offset wanders by {amount(track.output, np.ptp(y))} of "
                f"{track.output.name} within {plain(span)} s, whatever the command does"
            )
            y, half = -factor * y, factor * half
            label = axis(track.output, "load, lost steady")
        elif what == "gain":
            share = 100.0 * track.gain / command_gain(track, fit)
            y, half = share * y, abs(share) * half
            by = f"by {plain(np.ptp(y), 2)} % within {plain(span)} s"
            words = f"the gain of the command {_way(y)} {by}"
            label = "gain [% from its mean]"
        else:
            y, half = 100.0 * y, 100.0 * half
            words = f"the time constant {_way(y)} by {plain(np.ptp(y), 2)} % within {plain(span)} s"
            label = "time constant [% from its mean]"
        curve = Curve("time [s]", label, x, y, y - half, y + half)
        return _said(track, words, f"within {plain(span)} s", curve)

    return Terms(columns[None], says, bend(columns.shape[1]), beside)


def _way(y: Array) -> str:
    rise = y[-1] - y[0]
    if abs(rise) < 0.7 * np.ptp(y):
        return "wanders"
    return "rises" if rise > 0.0 else "falls"


def _step_curve(
    track: Track, row: int, change: float, error: float, label: str, before: float = 100.0
) -> Curve:
    at, end = float(track.t[row]), float(track.t.max())
    x = np.array([float(track.t.min()), at, at, end])
    y = before + np.array([0.0, 0.0, change, change])
    half = NORMAL * error * np.array([0.0, 0.0, 1.0, 1.0])
    return Curve("time [s]", label, x, y, y - half, y + half, steps=True)


SHAPES = (
    Shape("gain-step", ShapePlace.TIME, gain_step),
    Shape("load-step", ShapePlace.TIME, load_step),
    Shape("plant-step", ShapePlace.TIME, plant_step, of_speed=True),
    Shape("gain-drift", ShapePlace.TIME, gain_drift),
    Shape("load-drift", ShapePlace.TIME, load_drift, of_level=True),
    Shape("lag-drift", ShapePlace.TIME, lag_drift, of_speed=True),
)
