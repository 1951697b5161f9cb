"""Starting values of output-error rows y = Σ (B_j/F_j) u_j: refined instruments and a pole grid."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record
from sysid.fitting.normal_equations import scaled_solution
from sysid.structures.linear.predictor import RowLayout

POLE_LIMIT = 0.9995
"""Reflected poles are kept below this radius so that a start never rings for the whole record."""

SRIV_ITERATIONS = 12
SRIV_TOLERANCE = 1e-4
"""Relative change of the simulation error at which SRIV stops: the search refines the rest."""

REAL_POLES = (-0.5, 0.2, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995)
RADII = (0.8, 0.95, 0.99)
ANGLES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 2.4)
"""The grid: time constants of 0.6 … 200 samples, resonances of 2.6 … 126 samples a period."""

SWEEPS = 2


def reflected(polynomial: Array, limit: float = POLE_LIMIT) -> Array:
    """The polynomial with its roots moved inside the circle of radius ``limit``.

    A root z outside the unit circle becomes 1/z*, which leaves the magnitude response alike.
    """
    if len(polynomial) < 2:
        return polynomial
    roots = np.roots(polynomial)
    size = np.abs(roots)
    if np.all(size <= limit):
        return polynomial
    roots = np.where(size > 1.0, 1.0 / np.conj(np.where(size > 0, roots, 1.0)), roots)
    size = np.abs(roots)
    roots = roots * np.minimum(1.0, limit / np.maximum(size, limit))
    inside = np.real(np.poly(roots))
    return np.concatenate([inside, np.zeros(len(polynomial) - len(inside))])


def run_cost(records: Sequence[Record], lay: RowLayout, theta: Array) -> float:
    """Sum of squared simulation errors of a row with common poles, inf where it overflows."""
    return _cost(records, lay, _runs(records, lay, theta))


def sriv(records: Sequence[Record], lay: RowLayout, theta: Array) -> Array:
    """[a, b…] of a row with common poles by SRIV (Young 1985; Young & Jakeman 1979).

    Data and instruments are filtered by 1/A of the last iterate, the instruments being lags of its
    noise-free output; poles are reflected into the unit circle. Of all iterates the one with
    the smallest simulation error is returned.
    """
    n = lay.na[lay.output]
    if n == 0:
        return theta
    theta = _inside(theta, n)
    runs = _runs(records, lay, theta)
    best, best_cost = theta, _cost(records, lay, runs)
    last = best_cost
    for _ in range(SRIV_ITERATIONS):
        new = _instrumental(records, lay, theta, runs)
        if new is None:
            break
        theta = _inside(new, n)
        runs = _runs(records, lay, theta)
        cost = _cost(records, lay, runs)
        if cost < best_cost:
            best, best_cost = theta, cost
        if abs(cost - last) <= SRIV_TOLERANCE * last:
            break
        last = cost
    return best


def _instrumental(
    records: Sequence[Record], lay: RowLayout, theta: Array, runs: Sequence[Array]
) -> Array | None:
    """One instrumental-variable step, None when its sums overflow."""
    A = np.concatenate([[1.0], theta[: lay.na[lay.output]]])
    normal, right = np.zeros((lay.n, lay.n)), np.zeros(lay.n)
    sizes = np.zeros((2, lay.n))
    with np.errstate(over="ignore", invalid="ignore"):
        for r, run in zip(records, runs, strict=True):
            *inputs, y, model = lfilter([1.0], A, np.vstack([r.u.T, r.y[:, lay.output], run]))
            phi = _regressors(lay, y, inputs)
            z = _regressors(lay, model, inputs)
            normal += z @ phi.T
            right += z @ y[lay.start :]
            sizes += [np.einsum("ij,ij->i", z, z), np.einsum("ij,ij->i", phi, phi)]
    if not (np.all(np.isfinite(normal)) and np.all(np.isfinite(right))):
        return None
    rows, columns = np.where(sizes > 0.0, np.sqrt(sizes), 1.0)
    scaled = normal / np.outer(rows, columns)
    return np.asarray(np.linalg.lstsq(scaled, right / rows, rcond=1e-12)[0] / columns)


def pole_grid(records: Sequence[Record], lay: RowLayout) -> Array:
    """[a, b…] of a row with common poles: the best poles of a fixed grid, two at a time.

    For given poles the zeros are a linear least-squares problem (variable projection, Golub &
    Pereyra 1973), so every pair of the grid costs one filter run. Slower than ``sriv`` but
    independent of the noise: at signal-to-noise ratios below one SRIV and ARX end far off.
    """
    total = lay.na[lay.output]
    poles: NDArray[np.complex128] = np.zeros(0, dtype=np.complex128)
    best = np.zeros(lay.n)
    while len(poles) < total:
        tried: list[tuple[float, int, NDArray[np.complex128], Array]] = []
        for trial in _more_poles(total - len(poles)):
            A = np.real(np.poly(np.concatenate([poles, trial])))
            b, gain = _zeros_for(records, lay, A)
            tried.append((gain, len(tried), trial, np.concatenate([A[1:], b])))
        _, _, added, theta = max(tried, key=lambda item: (item[0], -item[1]))
        poles = np.concatenate([poles, added])
        best = np.concatenate(
            [theta[: len(poles)], np.zeros(total - len(poles)), theta[len(poles) :]]
        )
    return best


def _more_poles(missing: int) -> list[NDArray[np.complex128]]:
    if missing == 1:
        return [np.array([p], dtype=np.complex128) for p in REAL_POLES]
    real = [(p, q) for k, p in enumerate(REAL_POLES) for q in REAL_POLES[k:]]
    pairs = [(r * np.exp(1j * w), r * np.exp(-1j * w)) for r in RADII for w in ANGLES]
    return [np.array(p, dtype=np.complex128) for p in (*real, *pairs)]


def _zeros_for(records: Sequence[Record], lay: RowLayout, A: Array) -> tuple[Array, float]:
    """b… for given poles, and by how much they lower the sum of squares."""
    alone = replace(lay, na=(0,) * len(lay.na))
    gram, right = np.zeros((alone.n, alone.n)), np.zeros(alone.n)
    for r in records:
        x = _regressors(lay, None, lfilter([1.0], A, r.u.T))
        gram += x @ x.T
        right += x @ r.y[lay.start :, lay.output]
    b = scaled_solution(gram, right)
    return b, float(right @ b)


def own_poles(records: Sequence[Record], lay: RowLayout, theta: Array) -> Array:
    """[b…, f…] with poles of its own for each input, by refitting what the other inputs leave."""
    active = [j for j, (nb, nf) in enumerate(zip(lay.nb, lay.nf, strict=True)) if nb and nf]
    fed = [j for j, nb in enumerate(lay.nb) if nb]
    if len(fed) - lay.constant < 2 or not active:
        return theta
    _, b, _, _, f = replace(lay, nc=0, nd=0).slices()

    def part(theta: Array, j: int, u: Array) -> Array:
        top = np.concatenate([np.zeros(lay.nk[j]), theta[b[j]]])
        return np.asarray(lfilter(top, np.concatenate([[1.0], theta[f[j]]]), u[:, j]))

    def left(theta: Array, without: int | None) -> list[Array]:
        return [
            r.y[:, lay.output] - sum(part(theta, k, r.u) for k in fed if k != without)
            for r in records
        ]

    best, best_cost = theta, sum(float(e @ e) for e in left(theta, None))
    for _ in range(SWEEPS):
        for j in active:
            single = RowLayout(0, (lay.nf[j],), (lay.nb[j],), (lay.nk[j],), 0, 0, (0,))
            rest = [
                passing(r.u[:, [j]], e, r.dt) for r, e in zip(records, left(best, j), strict=True)
            ]
            fitted = sriv(rest, single, np.concatenate([best[f[j]], best[b[j]]]))
            trial = best.copy()
            trial[f[j]], trial[b[j]] = fitted[: lay.nf[j]], fitted[lay.nf[j] :]
            trial_cost = sum(float(e @ e) for e in left(trial, None))
            if trial_cost < best_cost:
                best, best_cost = trial, trial_cost
    return best


def passing(u: Array, y: Array, dt: float) -> Record:
    """A record that only lives inside the search for a start: its hash is never asked for."""
    return Record(u, y, dt, sha256="-")


def _runs(records: Sequence[Record], lay: RowLayout, theta: Array) -> list[Array]:
    """Free runs Σ_j (B_j/A) u_j from rest."""
    a, b, *_ = lay.slices()
    A = np.concatenate([[1.0], theta[a[lay.output]]])
    runs = []
    with np.errstate(over="ignore", invalid="ignore"):
        for r in records:
            drive = np.zeros(len(r))
            for j, s in enumerate(b):
                if s.stop > s.start:
                    B = np.concatenate([np.zeros(lay.nk[j]), theta[s]])
                    drive += lfilter(B, [1.0], r.u[:, j])
            runs.append(np.asarray(lfilter([1.0], A, drive)))
    return runs


def _cost(records: Sequence[Record], lay: RowLayout, runs: Sequence[Array]) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        errors = [
            (r.y[:, lay.output] - run)[lay.start :] for r, run in zip(records, runs, strict=True)
        ]
        cost = float(sum(e @ e for e in errors))
    return cost if np.isfinite(cost) else np.inf


def _inside(theta: Array, n: int) -> Array:
    return np.concatenate([reflected(np.concatenate([[1.0], theta[:n]]))[1:], theta[n:]])


def _regressors(lay: RowLayout, y: Array | None, inputs: Sequence[Array]) -> Array:
    """Rows −y(t−k) (none without y), then u_j(t−k), for t from the row's first sample on."""
    start, n = lay.start, len(inputs[0])
    rows = []
    if y is not None:
        rows += [-y[start - k : n - k] for k in range(1, lay.na[lay.output] + 1)]
    for j, (nb, nk) in enumerate(zip(lay.nb, lay.nk, strict=True)):
        rows += [inputs[j][start - k : n - k] for k in range(nk, nk + nb)]
    return np.array(rows)
