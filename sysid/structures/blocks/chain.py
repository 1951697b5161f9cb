"""Chains of static and linear blocks: free run, states, and exact gradients by filtering.

Layers follow each other; every signal passes a static of its own in a static layer and the
transfer functions B_ij/F_ij in a linear one:

    w_i(t) = Σ_j B_ij(q)/F_ij(q) s_j(t)          s_j(t) = f_j(w_j(t)) − f_j(0)

A static before a linear block passes through the origin, so that a chain without input is at rest
with all its states zero; a last static is y_i = y0_i + g_i(w_i). Nothing feeds back through a
nonlinearity, so derivatives are filtered signals (Wills, Schön, Ljung & Ninness 2013, Automatica
49, do the same by adjoints):

    ∂w/∂b_k = s(t−k)/F     ∂w/∂f_k = −w(t−k)/F     ∂w/∂x_k = δ(t−k)/F     ∂w/∂p = (B/F) ∂s/∂p
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from sys import maxsize
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import lfilter, lfilter_zi
from sysid.data.record import Array, Index
from sysid.fitting.marquardt import Conditions, loss, marquardt
from sysid.runners import floats
from sysid.runners.filters import Filter, filter_step
from sysid.runners.single import Step, on_arrays
from sysid.structures.blocks.layers import Layer, LinearLayer, StaticLayer
from sysid.structures.linear.many_thetas import all_roots_inside

FORGOTTEN = 1e-24
"""Size to which an impulse decays before its further course is taken for zero. Left to itself it
ends in denormal numbers, which cost forty times as much as others in every product."""

STATE_STEPS = 15
"""Runs for an initial state; a start from the steady state needs three or four."""

STATE_TOLERANCE = 1e-12
"""What a state gains beyond this is rounding."""


@dataclass(frozen=True)
class BlockChain:
    """Layers in the order in which a signal passes them.

    θ stacks the layers' parameters, a state the states of the linear layers, entry after entry.
    """

    layers: tuple[Layer, ...]
    nu: int

    @cached_property
    def edges(self) -> tuple[int, ...]:
        """Where each layer's parameters begin and end."""
        return tuple(np.cumsum([0, *(layer.n for layer in self.layers)]).tolist())

    @property
    def n(self) -> int:
        return self.edges[-1]

    @cached_property
    def n_states(self) -> int:
        return sum(layer.n_states for layer in self.layers)

    def place(self, k: int) -> slice:
        """Where the parameters of layer k stand in θ."""
        return slice(self.edges[k], self.edges[k + 1])

    def signals(self, theta: Array, u: Array, x0: Array | None = None) -> list[Array]:
        """What enters each layer, and the outputs, each (channels, N)."""
        signals = [np.ascontiguousarray(u.T)]
        at = 0
        for k, layer in enumerate(self.layers):
            p, s = theta[self.place(k)], signals[-1]
            if isinstance(layer, StaticLayer):
                out = layer.values(s, p)
            else:
                out = np.zeros((layer.n_outputs, s.shape[1]))
                for i, j, order, _, B, F in layer.entries(p):
                    zi = np.zeros(order) if x0 is None else x0[at : at + order]
                    out[i] += lfilter(B, F, s[j], zi=zi)[0]
                    at += order
            signals.append(out)
        return signals

    def run(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run from x0 (rest when None), (N, ny)."""
        if not len(u):
            return np.zeros((0, self.n_outputs))
        return np.ascontiguousarray(self.signals(theta, u, x0)[-1].T)

    @property
    def n_outputs(self) -> int:
        last = self.layers[-1]
        return len(last.statics) if isinstance(last, StaticLayer) else last.n_outputs

    def tangents(
        self, theta: Array, u: Array, x0: Array | None, states: bool, parameters: bool = True
    ) -> tuple[Array, Array]:
        """Free run (ny, N) and its derivative (ny, n + n_states, N).

        Args:
            u: inputs (N, nu).
            x0: initial state, None for rest.
            states: whether rows for the initial state follow them.
            parameters: whether there are rows for θ.
        """
        if not states:
            return self._derived(theta, u, x0, parameters, 0)
        head = self._forgets_after(theta)
        if head >= len(u) or self.n_states == 0:
            return self._derived(theta, u, x0, parameters, self.n_states)
        signal, D = self._derived(theta, u, x0, parameters, 0, room=self.n_states)
        early = self._derived(theta, u[:head], x0, False, self.n_states)[1]
        D[:, -self.n_states :, :head] = early
        return signal, D

    def _forgets_after(self, theta: Array) -> int:
        """Samples after which nothing is left of a change of state."""
        total = 0.0
        for k, layer in enumerate(self.layers):
            if not isinstance(layer, LinearLayer):
                continue
            slowest = 0.0
            for _, _, order, _, _, F in layer.entries(theta[self.place(k)]):
                radius = float(np.max(np.abs(np.roots(F)), initial=0.0))
                if radius >= 1.0:
                    return maxsize
                decay = np.log(FORGOTTEN) / np.log(radius) if radius > 0.0 else 0.0
                slowest = max(slowest, order + decay)
            total += slowest
        return int(np.ceil(total)) + 1

    def _derived(
        self,
        theta: Array,
        u: Array,
        x0: Array | None,
        parameters: bool,
        states: int,
        room: int = 0,
    ) -> tuple[Array, Array]:
        """Free run and derivatives, with rows for so many states, or only zeros in their room."""
        n_samples = len(u)
        behind = self.n if parameters else 0
        total = behind + max(states, room)
        signal = np.ascontiguousarray(u.T)
        D = np.zeros((self.nu, total, n_samples))
        active = [np.zeros(0, dtype=np.intp) for _ in range(self.nu)]
        at = 0
        for k, layer in enumerate(self.layers):
            p, base = theta[self.place(k)], self.edges[k]
            if isinstance(layer, StaticLayer):
                signal = _through_statics(layer, p, signal, D, active, base if parameters else None)
                continue
            out = np.zeros((layer.n_outputs, n_samples))
            E = np.zeros((layer.n_outputs, total, n_samples))
            grown: list[set[int]] = [set() for _ in range(layer.n_outputs)]
            for i, j, order, s, B, F in layer.entries(p):
                zi = np.zeros(order) if x0 is None else x0[at : at + order]
                w = lfilter(B, F, signal[j], zi=zi)[0]
                out[i] += w
                rows = active[j]
                if len(rows):
                    E[i, rows] += lfilter(B, F, D[j, rows])
                    grown[i].update(rows.tolist())
                if parameters:
                    first, nb = base + s.start, layer.nb[i][j]
                    _delayed(E[i], first, lfilter([1.0], F, signal[j]), layer.nk[i][j], nb)
                    _delayed(E[i], first + nb, lfilter([-1.0], F, w), 1, layer.nf[i][j])
                    grown[i].update(range(first, base + s.stop))
                if states and order:
                    impulse = np.zeros(n_samples)
                    impulse[:1] = 1.0
                    _delayed(E[i], behind + at, lfilter([1.0], F, impulse), 0, order)
                    grown[i].update(range(behind + at, behind + at + order))
                at += order
            signal, D = out, E
            active = [np.array(sorted(g), dtype=np.intp) for g in grown]
        return signal, D

    def denominators(self, theta: Array) -> list[Array]:
        """F of every entry of every linear layer."""
        return [
            F
            for k, layer in enumerate(self.layers)
            if isinstance(layer, LinearLayer)
            for *_, F in layer.entries(theta[self.place(k)])
        ]

    def admissible(self, theta: Array) -> bool:
        """Whether all poles lie inside the unit circle and limits and points of statics rise."""
        return bool(self.admissible_each(theta[None])[0])

    def admissible_each(self, thetas: Array) -> NDArray[np.bool_]:
        """``admissible`` of every row of thetas (K, n), (K,)."""
        admissible: NDArray[np.bool_] = np.all(np.isfinite(thetas), axis=1)
        for k, layer in enumerate(self.layers):
            p = thetas[:, self.place(k)]
            if isinstance(layer, LinearLayer):
                for q, (i, j) in enumerate(layer.pairs):
                    tail = p[:, layer.edges[q] + layer.nb[i][j] : layer.edges[q + 1]]
                    admissible &= all_roots_inside([np.ones(len(p)), *tail.T])
                continue
            for static, a in zip(layer.statics, layer.edges[:-1], strict=True):
                admissible &= static.admissible_each(p[:, a : a + static.n])
        return admissible

    def steady_state(self, theta: Array, input_value: Array) -> Array:
        """State in which a constant input ``input_value`` (nu,) has held for ever.

        Entries with a pole at 1 are left at zero: they have no such state.
        """
        signal = np.array(input_value, dtype=np.float64)
        states = [np.zeros(0)]
        for k, layer in enumerate(self.layers):
            p = theta[self.place(k)]
            if isinstance(layer, StaticLayer):
                signal = layer.values(signal[:, None], p)[:, 0]
                continue
            out = np.zeros(layer.n_outputs)
            for i, j, order, _, B, F in layer.entries(p):
                bottom = float(F.sum())
                if abs(bottom) < 1e-9:
                    states.append(np.zeros(order))
                    continue
                out[i] += signal[j] * float(B.sum()) / bottom
                states.append(lfilter_zi(B, F) * signal[j] if order else np.zeros(0))
            signal = out
        return np.concatenate(states)

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """State with which the first ``samples`` of y are met best in free run.

        Levenberg-Marquardt from the steady state of the first input and from rest;
        for a sensor without sign also from the mirror image of what these give.
        """
        samples = min(samples, len(y))
        if samples == 0 or self.n_states == 0:
            return np.zeros(self.n_states)
        u, y = u[:samples], y[:samples]
        starts = [self.steady_state(theta, u[0]), np.zeros(self.n_states)]
        with np.errstate(all="ignore"):
            states = [self._descended(theta, u, y, x) for x in starts]
            best = min(states, key=lambda item: item[0])
            if self.signless:
                states = [best, self._descended(theta, u, y, -best[1])]
        return min(states, key=lambda item: item[0])[1]

    @cached_property
    def signless(self) -> bool:
        """Whether some static takes an absolute value."""
        statics = [s for x in self.layers if isinstance(x, StaticLayer) for s in x.statics]
        return any(stage.kind == "abs" for s in statics for stage in s.stages)

    def _descended(self, theta: Array, u: Array, y: Array, x: Array) -> tuple[float, Array]:
        """(sum of squares, state) of the best run from near x; NaN in y is left out."""
        target = y.T
        known = np.isfinite(target)

        def error(x: Array) -> Array:
            return np.asarray((self.run(theta, u, x).T - target)[known])

        def slopes(x: Array) -> Array:
            _, D = self.tangents(theta, u, x, states=True, parameters=False)
            return np.concatenate([d[:, k] for d, k in zip(D, known, strict=True)], axis=1).T

        if known.any():
            x, *_ = marquardt(error, x, slopes, Conditions(STATE_TOLERANCE, STATE_STEPS))
        total = 2.0 * loss(error(x))
        return total if np.isfinite(total) else np.inf, x

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y), over the namespace of x and u; in NumPy on plain numbers."""
        plans = [
            _linear_plan(layer, theta[self.place(k)])
            if isinstance(layer, LinearLayer)
            else _static_plan(layer, theta[self.place(k)])
            for k, layer in enumerate(self.layers)
        ]

        def advance(xp: Any, x: Any, u: Any) -> tuple[list[Any], list[Any]]:
            after: list[Any] = []
            for plan in plans:
                moved, u = plan(xp, x[len(after) :], u)
                after += moved
            return after, u

        return on_arrays(advance)


def _numbers(p: Any) -> list[Any]:
    return p.tolist() if isinstance(p, np.ndarray) else list(p)


def _static_plan(layer: StaticLayer, p: Array) -> Step:
    channels = []
    for c, (a, b) in enumerate(pairwise(layer.edges)):
        offset = _numbers(layer.offset(c, p[a:b])[None])[0]
        channels.append((layer.statics[c], p[a:b], _numbers(p[a:b]), offset))

    def step(xp: Any, x: Any, signal: Any) -> tuple[list[Any], list[Any]]:
        return [], [
            static.value(s, plain if xp is floats else xp.asarray(own), xp) + offset
            for s, (static, own, plain, offset) in zip(signal, channels, strict=True)
        ]

    return step


def _linear_plan(layer: LinearLayer, p: Array) -> Step:
    filters = []
    for q, (i, j) in enumerate(layer.pairs):
        numbers = _numbers(p[layer.edges[q] : layer.edges[q + 1]])
        nb, length = layer.nb[i][j], layer.orders[q] + 1
        B = [*[0.0] * layer.nk[i][j], *numbers[:nb], *[0.0] * length][:length]
        F = [1.0, *numbers[nb:], *[0.0] * length][:length]
        filters.append(Filter(i, [(j, B)], F))
    return filter_step(filters, layer.n_outputs)


def _delayed(rows: Array, first: int, x: Array, lag: int, count: int) -> None:
    """Rows first … first + count − 1 become x delayed by lag, lag + 1, … samples."""
    n = len(x)
    for k in range(count):
        shift = lag + k
        if shift < n:
            rows[first + k, shift:] = x[: n - shift]


def _through_statics(
    layer: StaticLayer,
    p: Array,
    signal: Array,
    D: Array,
    active: list[Index],
    base: int | None,
) -> Array:
    """A layer of static curves' outputs; carries D and its nonzero rows along, in place.

    Args:
        signal: what enters, (channels, N).
        D: its derivatives, (channels, rows, N).
        active: rows of D that are not zero, by channel.
        base: row of the layer's first parameter; None where there are no rows for parameters.
    """
    out = np.empty_like(signal)
    for c, row in enumerate(signal):
        low, high = layer.edges[c], layer.edges[c + 1]
        out[c], slope, partials = layer.evaluated(c, row, p[low:high])
        if slope is not None and len(active[c]):
            D[c, active[c]] *= slope
        if base is not None and high > low:
            D[c, base + low : base + high] = partials
            active[c] = np.append(active[c], np.arange(base + low, base + high))
    return out
