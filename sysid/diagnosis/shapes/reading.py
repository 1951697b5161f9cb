"""What coefficients say of a track: gain, time constant, bands, sizes in the log's own units."""

import numpy as np

from sysid.data.record import Array, Channel
from sysid.diagnosis.shapes.smoother import Fit
from sysid.diagnosis.shapes.track import Track
from sysid.fitting.profile import NORMAL

GRID = 80
"""Points of a curve."""


def own_feedback(track: Track, fit: Fit) -> float:
    """What the fit adds to the speed's own part of the torque."""
    n = 0 if track.fixed else len(track.f)
    first = n * (track.inputs.shape[1] if track.adds_inputs else 1)
    return float(np.sum(fit.own[first : first + n]))


def command_gain(track: Track, fit: Fit) -> float:
    """What the fit has beside the terms as the torque of one unit of the command, at rest."""
    n = 0 if track.fixed else len(track.f)
    return float(track.gain + np.sum(fit.own[:n]))


def static_gain(track: Track, fit: Fit, more: float = 0.0, feedback: float = 0.0) -> float:
    """The static gain of the base as the fit has it beside the terms, or with some of them.

    With a command's gain K and a feedback φ of the speed it is K/(1 − φ), and K + φ K₀ where that
    speed is the base's run, whose gain is K₀.

    Args:
        more, feedback: what terms add to K and to φ.
    """
    gain, own = command_gain(track, fit) + more, own_feedback(track, fit) + feedback
    return gain + own * track.gain if fit.on_base else gain / max(1.0 - own, 1e-6)


def time_constant(track: Track, feedback: float) -> float:
    """The time constant [s] of a first-order core with a feedback of the speed; 0 where none is."""
    if len(track.f) != 1:
        return 0.0
    p = -float(track.f[0])
    p += (1.0 - p) * feedback
    return -track.dt / float(np.log(p)) if 0.0 < p < 1.0 else 0.0


def half_band(B: Array, covariance: Array, noise: float) -> Array:
    """Half of the 95 % band of B b, (n,)."""
    return np.asarray(NORMAL * noise * np.sqrt(np.maximum(np.sum((B @ covariance) * B, axis=1), 0)))


def amount(channel: Channel, value: float, digits: int = 3) -> str:
    """The size of a value in the unit of the file."""
    factor, unit = channel.to_file
    return f"{abs(value) * factor:.{digits}g} {unit}".strip()


def plain(value: float, digits: int = 3) -> str:
    """A number rounded to so many digits, without a power of ten where there is room: 86400."""
    return f"{float(f'{value:.{digits}g}'):.9g}"


def axis(channel: Channel, before: str = "", after: str = "") -> str:
    """The label of an axis: what it is, and the unit of the file."""
    _, unit = channel.to_file
    words = f"{before} {channel.name}".strip()
    inside = f"{unit} {after}".strip()
    return f"{words} [{inside}]" if inside else words


def in_log(track: Track, drive: Array) -> Array:
    """Commands in the unit of the file."""
    return np.asarray(drive * track.scale * track.command.to_file[0])
