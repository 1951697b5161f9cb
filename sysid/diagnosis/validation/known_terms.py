"""Regressors for simulation errors: functions of past commands and simulated speeds.

Measured outputs enter only as past values, in the angle that they count up to, and a command only
after it was given: so measurement noise enters only through feedback and that angle.

A missing torque z shows behind the motor's lag: F(q) z is z through the lag of the simulation,
z_F(t) = a z_F(t−1) + (1 − a) z(t−1), whose pole a is estimated from the simulation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record

WARM = (20.0, 60.0)
"""Thermal times of the heat terms [s]."""


CLOCK = "·t"
"""How the name of a term ends that depends on the time since the log's start."""


@dataclass(frozen=True)
class Drives:
    """What all terms of one output are made of.

    Attributes:
        own, other: names of the commands, ``other`` empty with one track.
        pole: of the simulation's lag at its sample time.
        top: largest simulated speed, in the output's unit.
    """

    own: str
    other: str
    speed: str
    pole: float
    top: float


@dataclass(frozen=True, eq=False)
class Terms:
    """Named columns over all records.

    Attributes:
        columns: one array a record, (N, n), each column with RMS one over all records.
        sizes: RMS of each column before, (n,).
    """

    names: tuple[str, ...]
    columns: tuple[Array, ...]
    sizes: Array


def drives_of(
    records: Sequence[Record], simulated: Sequence[Array], i: int, scales: Array
) -> Drives:
    """Names and time constants of output ``i``; the pole by least squares on the simulation."""
    input_ = min(i, records[0].nu - 1)
    past = np.concatenate([s[:-1, i] for s in simulated])
    now = np.concatenate([s[1:, i] for s in simulated])
    drive = np.concatenate([r.u[:-1, input_] / scales[input_] for r in records])
    X = np.column_stack([past, drive])
    pole = float(np.linalg.lstsq(X, now, rcond=None)[0][0])
    names = [n.replace("pwm", "d") for n in records[0].input_names]
    other = names[1 - input_] if records[0].nu == 2 else ""
    top = float(np.max(np.abs(past), initial=0.0)) or 1.0
    return Drives(
        names[input_], other, records[0].output_names[i], float(np.clip(pole, 0.0, 0.995)), top
    )


def known_terms(
    records: Sequence[Record], simulated: Sequence[Array], i: int, scales: Array
) -> Terms:
    """Terms for the errors of output ``i``; those that are nothing on these records are left out.

    Args:
        simulated: its measurements, (N, ny) a record.
    """
    about = drives_of(records, simulated, i, scales)
    parts = [
        _terms(r.u / scales, s[:, i], a, r.dt, min(i, r.nu - 1), about)
        for r, s, a in zip(records, simulated, angles(records, simulated, i), strict=True)
    ]
    names = tuple(parts[0])
    whole = np.concatenate([np.column_stack([p[n] for n in names]) for p in parts])
    sizes = np.sqrt(np.mean(whole**2, axis=0))
    keep = np.flatnonzero(sizes > 1e-9 * max(1.0, float(sizes.max())))
    ends = np.cumsum([len(r) for r in records])[:-1]
    columns = np.split(whole[:, keep] / sizes[keep], ends)
    return Terms(tuple(names[k] for k in keep), tuple(columns), sizes[keep])


def angles(records: Sequence[Record], simulated: Sequence[Array], i: int) -> list[Array]:
    """Angle of output ``i``: measurements before each, and half a sample of the simulated speed."""
    return [
        (np.cumsum(r.y[:, i]) - r.y[:, i] + 0.5 * s[:, i]) * r.dt
        for r, s in zip(records, simulated, strict=True)
    ]


def _terms(
    d: Array, w: Array, angle: Array, dt: float, input_: int, about: Drives
) -> dict[str, Array]:
    """Columns (N,) of one record by name."""
    a, top = about.pole, about.top

    def through(z: Array) -> Array:
        return np.asarray(lfilter([0.0, 1.0 - a], [1.0, -a], z))

    x, o, v = d[:, input_], about.own, about.speed
    step = np.diff(x, prepend=x[:1])
    change, size = np.diff(w, prepend=w[:1]), np.abs(w)
    falls = np.diff(size, prepend=size[:1]) < 0.0
    turned = np.sign(w) * (np.abs(w) < 0.1 * top)
    t = dt * np.arange(len(w))
    terms = {
        "1": np.ones(len(w)),
        f"F({o})": through(x),
        f"F({o}·|{o}|)": through(x * np.abs(x)),
        f"F(|{o}|)": through(np.abs(x)),
        f"F(sign {o})": through(np.sign(x)),
        f"F(clip({o}, ±0.1))": through(np.clip(x, -0.1, 0.1)),
        f"F(clip({o}, ±0.3))": through(np.clip(x, -0.3, 0.3)),
        f"F(clip({o}, ±0.6))": through(np.clip(x, -0.6, 0.6)),
        f"F(Δ{o})": through(step),
        f"F(Δ{o}·|Δ{o}|)": through(step * np.abs(step)),
        f"F(sign {v})": through(np.sign(w)),
        f"F({v}·|{v}|)": through(w * size),
        f"F(|{v}|)": through(size),
        f"F({v} while it falls)": through(np.where(falls, w, 0.0)),
        f"F(sign {v} while {o} = 0)": through(np.where(np.abs(x) < 0.01, np.sign(w), 0.0)),
        f"F(sign {v} while it crawls)": through(turned),
        f"F(cos ∫{v})": through(np.cos(angle)),
        f"F(sin ∫{v})": through(np.sin(angle)),
        f"{v}": w,
        f"{v}·|{v}|": w * size,
        f"|{v}|": size,
        f"sign {v}": np.tanh(w / (0.02 * top)),
        f"clip({v}, ±{0.7 * top:.3g})": np.clip(w, -0.7 * top, 0.7 * top),
        f"Δ{v}": change,
        f"Δ{v} one sample before": np.concatenate([change[:1], change[:-1]]),
        f"Δ{v} two samples before": np.concatenate([change[:1], change[:1], change[:-2]]),
        f"Δ|{v}|": np.diff(size, prepend=size[:1]),
        f"{v}{CLOCK}": w * t,
    }
    for warm in WARM:
        share = 1.0 - np.exp(-dt / warm)
        heat = np.asarray(lfilter([0.0, share], [1.0, share - 1.0], x**2))
        terms[f"{v}·heat over {warm:.0f} s"] = w * heat
    if about.other:
        z, name = d[:, 1 - input_], about.other
        terms |= {
            f"F({name})": through(z),
            f"F({o}·|{name}|)": through(x * np.abs(z)),
            f"F({name}·|{o}|)": through(z * np.abs(x)),
            f"F(|{name}|)": through(np.abs(z)),
            f"F({o}·{name})": through(x * z),
        }
    return terms
