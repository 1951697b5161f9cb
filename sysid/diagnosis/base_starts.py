"""Where the search for a baseline starts."""

from collections.abc import Sequence

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record
from sysid.diagnosis.search.full_model import FullModel
from sysid.structures.linear.families import OE
from sysid.structures.model import Model


def core_of(linear: Model, model: FullModel, scales: Array) -> Array:
    """The cores that run as a linear model does, (1, parameters); no row where a core cannot.

    From real poles alone no search finds a lightly damped swing: B(q)/F(q) = K b(q)/F(q) with
    b(1) = F(1).
    """
    q = model.null.copy()
    if not isinstance(linear.structure, OE) or model.inputs != model.tracks:
        return np.empty((0, len(q)))
    polynomials = linear.structure.polynomials(linear.theta)
    for i in range(model.tracks):
        top, bottom = np.trim_zeros(polynomials.B[i][i], "f"), polynomials.F[i][i]
        gain = float(np.sum(top) / np.sum(bottom)) if len(top) else 0.0
        if not np.isfinite(gain) or gain == 0.0 or max(len(top), len(bottom) - 1) > model.order:
            return np.empty((0, len(q)))
        model.set_core(q, i, gain * scales[i], bottom[1:], top[1:] / gain)
    return q[None]


def starts(model: FullModel, records: Sequence[Record], scales: Array) -> Array:
    """Several gains and time constants; the static gain from the largest measurements."""
    drive = np.concatenate([r.u for r in records]) / scales
    y = np.concatenate([r.y for r in records])
    if drive.shape[1] > y.shape[1]:
        return _of_sum(model, drive, y[:, 0])
    drive = np.broadcast_to(drive, y.shape)
    gain = np.array(
        [float(d @ v) / max(float(d @ d), 1e-12) for d, v in zip(drive.T, y.T, strict=True)]
    )
    size = np.quantile(np.abs(y), 0.95, axis=0) / np.maximum(
        np.quantile(np.abs(drive), 0.95, axis=0), 1e-9
    )
    rows = []
    for pole in (0.5, 0.8, 0.95):
        for k in (gain, size):
            q = model.null.copy()
            for i in range(model.tracks):
                poles = [pole * 0.6**j for j in range(model.order)]
                f = np.asarray(np.poly(poles)[1:], dtype=np.float64)
                model.set_core(q, i, k[i] if abs(k[i]) > 1e-9 else size[i], f)
            rows.append(q)
    return np.array(rows)


def _of_sum(model: FullModel, drive: Array, y: Array) -> Array:
    """The same for several inputs of one output: gains beside a pole that is tried."""
    rows = []
    for pole in (0.5, 0.8, 0.95, 0.99):
        seen = lfilter(np.array([0.0, 1.0 - pole]), np.array([1.0, -pole]), drive, axis=0)
        gains = np.linalg.lstsq(np.column_stack([seen, np.ones(len(y))]), y, rcond=None)[0]
        q = model.null.copy()
        poles = [pole * 0.6**j for j in range(model.order)]
        model.set_core(q, 0, gains[0], np.asarray(np.poly(poles)[1:], dtype=np.float64))
        q[[model.index["core", "gain", i] for i in range(model.inputs)]] = gains[:-1]
        rows.append(q)
    return np.array(rows)
