"""Spectra of a log: what its inputs and outputs hold by frequency, and how they are linearly tied.

With S the matrix of cross spectra (Welch: Hann windows, half overlapping), the frequency response
is Ĝ = S_yu S_uu⁻¹ and the multiple coherence γ² = S_yu S_uu⁻¹ S_uy / S_yy (Bendat and Piersol 2010,
ch. 7): the share of the output's power that depends linearly on the inputs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.errors import DataError

SEGMENTS = 8
"""Windows that a record is cut into at least: with fewer the coherence of noise is near 1."""

OVERLAP = 1.0 / 6.0
"""Correlation of two Hann windows that overlap by half (Welch 1967, IEEE Trans. AU 15, 70)."""

SHORTEST = 16
"""Samples of a window at least."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """Power by angular frequency w [rad/s], (n,).

    Attributes:
        inputs, outputs: power spectral densities, (n, nu) and (n, ny).
        response: Ĝ from inputs to outputs, (n, ny, nu).
        coherence: multiple coherence of each output, (n, ny).
        windows: as many independent windows would tell as much.
    """

    w: Array
    inputs: Array
    outputs: Array
    response: NDArray[np.complex128]
    coherence: Array
    windows: int

    @property
    def gain_error(self) -> Array:
        """Standard error of ln |Ĝ|: √((1 − γ²)/(2 K γ²)) of K windows, (n, ny)."""
        known = np.clip(self.coherence, 1e-6, 1.0)
        return np.sqrt((1.0 - known) / (2.0 * self.windows * known))


def spectra(records: Sequence[Record]) -> Spectra:
    """Spectra of records of one sample time, their means removed."""
    from scipy.signal import get_window

    longest = max(len(r) for r in records)
    size = longest // (SEGMENTS // 2 + 1)  # half overlapping
    if size < SHORTEST:
        raise DataError(
            f"{longest} samples are too few for a spectrum; at least "
            f"{SHORTEST * (SEGMENTS // 2 + 1)} are needed"
        )
    window = get_window("hann", size)
    parts = []
    for r in records:
        z = centred(r)
        parts += [z[at : at + size] for at in range(0, len(z) - size + 1, size // 2)]
    every = np.array(parts)
    every = every - every.mean(axis=1, keepdims=True)
    f = np.fft.rfft(every * window[:, None], axis=1)[:, 1:]
    dt, nu = records[0].dt, records[0].nu
    s = np.einsum("kfa,kfb->fab", f, f.conj()) / len(every)
    s *= 2.0 * dt / float(np.sum(window**2))
    uu, yu, yy = s[:, :nu, :nu], s[:, nu:, :nu], s[:, nu:, nu:]
    power = np.einsum("faa->fa", s).real
    response = np.zeros(yu.shape, dtype=np.complex128)
    coherence = np.zeros(yy.shape[:2])
    if nu:
        response = yu @ np.linalg.pinv(uu, rcond=1e-9, hermitian=True)
        explained = np.einsum("fij,fij->fi", response, yu.conj()).real
        coherence = np.clip(explained / np.maximum(power[:, nu:], 1e-300), 0.0, 1.0)
    w = 2.0 * np.pi * np.arange(1, f.shape[1] + 1) / (size * dt)
    windows = max(round(len(every) / (1.0 + 2.0 * OVERLAP**2)), 1)
    return Spectra(w, power[:, :nu], power[:, nu:], response, coherence, windows)


def centred(r: Record) -> Array:
    """Inputs and outputs about their means, 0 where one is missing, (N, nu + ny)."""
    z = np.column_stack([r.u, r.y])
    known = np.all(np.isfinite(z), axis=1)
    return np.asarray(np.where(known[:, None], z - z[known].mean(axis=0), 0.0))
