"""One-step prediction errors of one output of A y = Σ (B/F) u + (C/D) e, with exact gradients.

For measured data the outputs of a MIMO model decouple: the row of output i is a MISO model in
which the other outputs enter like inputs. With v = A y − Σ (B_j/F_j) u_j,

    ε = (D/C) v                      ∂ε/∂a_k =  (D/C) y(t−k)
    ∂ε/∂b_k = −(D/CF) u(t−k)         ∂ε/∂f_k =  (D/CF) w(t−k),  w = (B/F) u
    ∂ε/∂c_k = −(1/C) ε(t−k)          ∂ε/∂d_k =  (1/C) v(t−k)

(Ljung 1999, §10.3). Regressors are taken from the record from its sample ``start`` on, so that no
measured past is invented; the unknown past of w and of ε is either zero or a free response
(ζ(q)/F) δ(t−start), (ζ(q)/C) δ(t−start) whose coefficients are estimated: they enter linearly.
In a search only stable predictors are admissible (Ljung 1999, §3.2 and eq. 4.98): of C and its
mirror image, which shape the noise alike, the one with its roots inside the unit circle, and an F
whose free response does not grow by more than a factor e over the record.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Index
from sysid.fitting.problem import HUGE, Problem

_NoiseFilter = tuple[Array, Array, Array | None]
"""C, D and the impulse response of D/C, None where that is 1."""


@dataclass(frozen=True)
class RowLayout:
    """Orders of one row and where its coefficients stand in the row's θ."""

    output: int
    na: tuple[int, ...]
    nb: tuple[int, ...]
    nk: tuple[int, ...]
    nc: int
    nd: int
    nf: tuple[int, ...]
    constant: bool = False
    """Whether the last input is the constant 1: it has no other lags worth trying."""

    @cached_property
    def start(self) -> int:
        """First sample whose measured regressors lie inside the record."""
        lags = [nb + nk - 1 for nb, nk in zip(self.nb, self.nk, strict=True) if nb]
        return max(0, *self.na, *lags)

    @cached_property
    def edges(self) -> tuple[int, ...]:
        """Cumulative offsets of a_1…a_ny, b_1…b_nu, c, d, f_1…f_nu in θ."""
        lengths = (*self.na, *self.nb, self.nc, self.nd, *self.nf)
        return tuple(np.cumsum((0, *lengths)).tolist())

    def slices(self) -> tuple[list[slice], list[slice], slice, slice, list[slice]]:
        """Slices of a, b, c, d, f in the row's θ."""
        parts = [slice(i, j) for i, j in pairwise(self.edges)]
        ny, nu = len(self.na), len(self.nb)
        return (
            parts[:ny],
            parts[ny : ny + nu],
            parts[ny + nu],
            parts[ny + nu + 1],
            parts[ny + nu + 2 :],
        )

    @cached_property
    def n(self) -> int:
        """Number of coefficients."""
        return self.edges[-1]

    @cached_property
    def filtered(self) -> tuple[int, ...]:
        """Inputs with a denominator of their own."""
        return tuple(j for j, nf in enumerate(self.nf) if nf and self.nb[j])

    @cached_property
    def terms(self) -> tuple[tuple[int, int], ...]:
        """The regressors of A and B as (signal, lag), outputs numbered first, in θ's order."""
        past = [(j, k) for j, na in enumerate(self.na) for k in range(1, na + 1)]
        around = [
            (len(self.na) + j, k)
            for j, (nb, nk) in enumerate(zip(self.nb, self.nk, strict=True))
            for k in range(nk, nk + nb)
        ]
        return (*past, *around)

    @property
    def signs(self) -> Array:
        """What turns coefficients of these regressors into entries of θ: A stands on the left."""
        return np.where(np.array([s for s, _ in self.terms]) < len(self.na), -1.0, 1.0)

    def weighed(self, theta: Array) -> list[tuple[int, int, float]]:
        """(signal, lag, coefficient) of ŷ = Σ coefficient · signal(t − lag) of A and B."""
        weights = (self.signs * theta[: len(self.terms)]).tolist()
        return [(s, k, c) for (s, k), c in zip(self.terms, weights, strict=True)]

    @property
    def n_noise_states(self) -> int:
        """Unknown past of the noise filter."""
        return max(self.nc, self.nd) if self.nc or self.nd else 0

    @property
    def n_initial(self) -> int:
        """Unknown initial states of one experiment."""
        return sum(self.nf[j] for j in self.filtered) + self.n_noise_states


@dataclass(frozen=True, eq=False)
class _Experiment:
    """One record prepared for one row: arrays from ``start`` on, lag matrices transposed."""

    y: Array
    linear: Array  # (n_linear, M): +y lags and −u lags of the inputs without F
    inputs: tuple[Array, ...]  # full-length inputs with F


class RowErrors(Problem):
    """Prediction errors of one row over several experiments.

    Args:
        layout: orders of the row.
        index: where the row's coefficients stand in the structure's θ.
        data: (u (N, nu), y (N, ny)) of each experiment.
        estimate_initial: whether initial states are estimated or zero.
        search: whether parameters with an unstable predictor are inadmissible; to evaluate a
            given model they are not.
    """

    def __init__(
        self,
        layout: RowLayout,
        index: Index,
        data: Sequence[tuple[Array, Array]],
        estimate_initial: bool,
        search: bool = False,
    ) -> None:
        self.layout = layout
        self._radius = largest_radius([y for _, y in data]) if search else None
        self.index = index
        self.states_each = layout.n_initial if estimate_initial else 0
        self.n_initial = self.states_each * len(data)
        self._experiments = [self._prepare(u, y) for u, y in data]
        self.lengths = tuple(max(len(x.y) - layout.nd, 0) for x in self._experiments)
        self.channels = (layout.output,) * len(data)
        a, b, c, d, f = layout.slices()
        self._c, self._d, self._b, self._f = c, d, b, f
        plain = [b[j] for j in range(len(b)) if j not in layout.filtered]
        self._lagged = [s for s in (*a, *plain) if s.stop > s.start]
        self._linear = np.concatenate(
            [np.arange(s.start, s.stop) for s in self._lagged] or [np.zeros(0, dtype=int)]
        ).astype(int)
        self._cache: tuple[bytes, list[_Signals]] | None = None

    def _prepare(self, u: Array, y: Array) -> _Experiment:
        lay, start = self.layout, self.layout.start
        rows = [y[start - k : len(y) - k, j] for j, n in enumerate(lay.na) for k in lags(1, n)]
        for j, (nb, nk) in enumerate(zip(lay.nb, lay.nk, strict=True)):
            if j not in lay.filtered:
                rows += [-u[start - k : len(u) - k, j] for k in lags(nk, nb)]
        m = max(len(y) - start, 0)
        linear = np.array(rows) if rows else np.zeros((0, m))
        return _Experiment(
            np.ascontiguousarray(y[start:, lay.output]),
            linear,
            tuple(np.ascontiguousarray(u[:, j]) for j in lay.filtered),
        )

    @property
    def skipped(self) -> int:
        """Samples at the head of each record that are not part of the residual."""
        return self.layout.start + self.layout.nd

    def residual(self, p: Array) -> Array:
        """Prediction errors ε of all experiments, stacked."""
        if not self._admissible(p):
            return np.full(sum(self.lengths), HUGE)
        with np.errstate(all="ignore"):
            e = np.concatenate([s.e[self.layout.nd :] for s in self._signals(p)])
        if not np.all(np.isfinite(e)) or np.max(np.abs(e), initial=0.0) > HUGE:
            return np.full(len(e), HUGE)
        return e

    def _admissible(self, p: Array) -> bool:
        return self._radius is None or (
            roots_inside(p[self._c])
            and all(roots_inside(p[self._f[j]], self._radius) for j in self.layout.filtered)
        )

    def jacobian(self, p: Array) -> Array:
        """∂ε/∂p, exact for the stated treatment of the start."""
        return self._gradients(p, self.layout.n)

    def initial_columns(self, p: Array) -> Array:
        return self._gradients(p, 0)

    def regressors(self, p: Array) -> Array:
        """The Jacobian with y − Σ(other inputs) = w + ε for w, of rows without noise model."""
        out, at = self.jacobian(p), 0
        for s, x in zip(self._signals(p), self._experiments, strict=True):
            for j, F in zip(self.layout.filtered, s.fs, strict=True):
                by_f = shifted(lfilter([1.0], F, s.e), lags(1, self.layout.nf[j]), 0)
                out[at : at + len(x.y), self._f[j]] += by_f.T
            at += len(x.y)
        return out

    def _gradients(self, p: Array, shared: int) -> Array:
        """∂ε/∂(θ, initial states), or with ``shared`` = 0 of the states alone.

        Written row by row into one array: a copy of it costs as much as a filter run.
        """
        each, nd = self.states_each, self.layout.nd
        edges = np.cumsum([0, *(len(x.y) for x in self._experiments)]).tolist()
        longest = max((len(x.y) for x in self._experiments), default=0)
        out = np.zeros((shared + self.n_initial, edges[-1]))
        with np.errstate(all="ignore"):
            # impulse responses are those of every experiment, cut to its length
            noise = self._noise_filter(p, longest)
            free = self._state_columns(p, noise, longest)
            for k, (x, (a, b)) in enumerate(zip(self._experiments, pairwise(edges), strict=True)):
                first = shared + k * each
                if shared:
                    self._columns(p, self._signals(p)[k], x, noise, out[:shared, a:b])
                out[first : first + each, a:b] = free[:, : b - a]
        if nd:
            kept = [out[:, a + nd : b] for a, b in pairwise(edges)]
            out = kept[0] if len(kept) == 1 else np.concatenate(kept, axis=1)
        if not np.isfinite(out).all():
            out = np.nan_to_num(out, nan=0.0, posinf=HUGE, neginf=-HUGE)
        return out.T

    def _signals(self, p: Array) -> "list[_Signals]":
        key = p.tobytes()
        if self._cache is None or self._cache[0] != key:
            lay, signals = self.layout, []
            for k, x in enumerate(self._experiments):
                first = lay.n + k * self.states_each
                signals.append(self._filter(p, p[first : first + self.states_each], x))
            self._cache = (key, signals)
        return self._cache[1]

    def _filter(self, p: Array, states: Array, x: _Experiment) -> "_Signals":
        lay = self.layout
        v = x.y + p[self._linear] @ x.linear
        ws, fs, at = [], [], 0
        for j, u in zip(lay.filtered, x.inputs, strict=True):
            F = monic(p[self._f[j]])
            B = np.concatenate([np.zeros(lay.nk[j]), p[self._b[j]]])
            if self.states_each:
                # F w = B u + ζ δ(t − start): one pass gives forced and free response together
                drive = lfilter(B, [1.0], u)
                room = drive[lay.start : lay.start + lay.nf[j]]
                room += states[at : at + len(room)]
                at += lay.nf[j]
                w = lfilter([1.0], F, drive)
            else:
                w = lfilter(B, F, u)
            v = v - w[lay.start :]
            ws.append(w)
            fs.append(F)
        if not (lay.nc or lay.nd):
            return _Signals(v, v, ws, fs)
        C, D = monic(p[self._c]), monic(p[self._d])
        drive = lfilter(D, [1.0], v)
        if self.states_each:
            room = drive[: lay.n_noise_states]
            room += states[at : at + len(room)]
        return _Signals(lfilter([1.0], C, drive), v, ws, fs)

    def _columns(
        self, p: Array, s: "_Signals", x: _Experiment, noise: _NoiseFilter, out: Array
    ) -> None:
        """Gradients with respect to θ, one row a coefficient, (n, M)."""
        lay, start = self.layout, self.layout.start
        C, D, h = noise
        pairs, row = [], 0
        for place in self._lagged:
            count = place.stop - place.start
            pairs.append((x.linear[row : row + count], out[place]))
            row += count
        for j, u, w, F in zip(lay.filtered, x.inputs, s.ws, s.fs, strict=True):
            of_b, of_f = lfilter([1.0], F, np.array([-u, w]))
            pairs.append((shifted(of_b, lags(lay.nk[j], lay.nb[j]), start), out[self._b[j]]))
            pairs.append((shifted(of_f, lags(1, lay.nf[j]), start), out[self._f[j]]))
        through(D, C, h, pairs)
        if lay.nc and lay.nd:
            of_c, of_d = lfilter([1.0], C, np.array([-s.e, s.v]))
            shifted(of_c, lags(1, lay.nc), 0, out[self._c])
            shifted(of_d, lags(1, lay.nd), 0, out[self._d])
        elif lay.nc:
            shifted(lfilter([-1.0], C, s.e), lags(1, lay.nc), 0, out[self._c])
        elif lay.nd:
            shifted(s.v, lags(1, lay.nd), 0, out[self._d])

    def _state_columns(self, p: Array, noise: _NoiseFilter, m: int) -> Array:
        """Gradients with respect to one experiment's initial states, (states, m)."""
        lay, out = self.layout, np.zeros((self.states_each, m))
        if not len(out):
            return out
        C, D, h = noise
        pairs, at = [], 0
        for j in lay.filtered:
            free = lfilter([1.0], monic(p[self._f[j]]), -impulse(m))
            pairs.append((shifted(free, range(lay.nf[j]), 0), out[at : at + lay.nf[j]]))
            at += lay.nf[j]
        through(D, C, h, pairs)
        if lay.n_noise_states:
            shifted(lfilter([1.0], C, impulse(m)), range(lay.n_noise_states), 0, out[at:])
        return out

    def _noise_filter(self, p: Array, m: int) -> _NoiseFilter:
        """C, D and the impulse response of D/C, None where that is 1."""
        C, D = monic(p[self._c]), monic(p[self._d])
        return C, D, lfilter(D, C, impulse(m)) if self.layout.nc or self.layout.nd else None


@dataclass(frozen=True, eq=False)
class _Signals:
    """Intermediate signals of one experiment, shared by the residual and its Jacobian."""

    e: Array
    v: Array
    ws: list[Array]
    fs: list[Array]


def largest_radius(records: Sequence[Array]) -> float:
    """Radius of a pole whose free response grows by e over the longest record."""
    return 1.0 + 1.0 / max(1, *(len(y) for y in records))


def roots_inside(tail: Array, radius: float = 1.0) -> bool:
    """Whether 1 + c₁q⁻¹ + … has all roots within the radius (Schur-Cohn recursion)."""
    c = [1.0, *(tail / radius ** np.arange(1, len(tail) + 1)).tolist()]
    while len(c) > 1:
        k = c[-1]
        if not abs(k) < 1.0:
            return False
        c = [(x - k * y) / (1.0 - k * k) for x, y in zip(c[:-1], c[:0:-1], strict=True)]
    return True


# ----------------------------------------------------------------------------- lags of a signal


def through(D: Array, C: Array, h: Array | None, pairs: Sequence[tuple[Array, Array]]) -> None:
    """(D/C) of rows that are consecutive lags of a signal; h is the impulse response of D/C.

    Each row is the one before it a sample later, but for its first value: so is its response, but
    for that value times h, which may be longer. One filter run serves all lags. Without h the rows
    are copied.

    Args:
        D, C, h: the filter.
        pairs: of each signal its rows, and where their responses go.
    """
    pairs = [(rows, out) for rows, out in pairs if rows.size]
    if h is None or not pairs:
        for rows, out in pairs:
            out[:] = rows
        return
    firsts = lfilter(D, C, np.array([rows[0] for rows, _ in pairs]))
    h = h[: firsts.shape[1]]
    for first, (rows, out) in zip(firsts, pairs, strict=True):
        out[0] = first
        for k in range(1, len(rows)):
            np.multiply(h, rows[k, 0], out=out[k])
            out[k, 1:] += out[k - 1, :-1]


def lags(first: int, count: int) -> range:
    """``count`` lags from ``first`` on."""
    return range(first, first + count)


def monic(tail: Array) -> Array:
    """1 + Σ tail_k q⁻ᵏ as coefficients."""
    return np.concatenate([[1.0], tail])


def impulse(n: int) -> Array:
    """A unit impulse at the first of ``n`` samples."""
    out = np.zeros(n)
    out[:1] = 1.0
    return out


def shifted(x: Array, lags: range, start: int, out: Array | None = None) -> Array:
    """Rows x(t − k) for t ≥ ``start``, zero before the first sample, (len(lags), N − start).

    ``out``, if given, holds zeros and is filled.
    """
    m = len(x) - start
    if out is None:
        out = np.zeros((len(lags), max(m, 0)))
    for row, k in enumerate(lags):
        if k <= start:
            out[row] = x[start - k : len(x) - k]
        elif k - start < m:
            out[row, k - start :] = x[: len(x) - k]
    return out
