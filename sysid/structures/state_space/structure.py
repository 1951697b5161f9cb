"""Linear structures whose θ is turned into state-space matrices: runs, errors, slopes and steps."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Channel, Index, Record
from sysid.fitting.normal_equations import scaled_lstsq
from sysid.fitting.problem import Data, Focus, Initial, Parameter, Problem
from sysid.fitting.run_errors import RunErrors
from sysid.fitting.searchable import Searchable
from sysid.structures.linear.base import LinearStructure
from sysid.structures.linear.polynomial import pole_words
from sysid.structures.linear.transfer import TransferMatrix
from sysid.structures.motion import poles
from sysid.structures.state_space.realization import Realization, run

AT_ONCE = 1 << 20
"""Numbers of the drives of slopes that are held at a time."""

INTEGRATES = 1e-9
"""A pole so near to 1 is an integrator's."""


@dataclass(frozen=True)
class RealizedStructure(LinearStructure, Searchable):
    """A linear structure given by A(θ), B(θ), C(θ), D(θ) and, with a noise model, K(θ).

    One step ahead x(t+1) = A x + B u + K e, y = C x + D u + e; states are stacked as
    ``Realization.whole`` has them.

    Attributes:
        levels: by output, whether the last input is the constant, whose coefficients end θ.
        inputs, outputs: how many, the constant not counted.
    """

    levels: tuple[bool, ...]
    inputs: int
    outputs: int

    @abstractmethod
    def plain(self, theta: Any) -> Realization:
        """The matrices without the constant; θ (without its coefficients) may be complex."""

    @property
    def nu(self) -> int:
        return self.inputs + bool(self.levels)

    @property
    def ny(self) -> int:
        return self.outputs

    @abstractmethod
    def plain_parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names, units and bounds of θ without the constant's coefficients."""

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        levels = [
            Parameter(f"offset[{c.name}]", c.unit)
            for c, has in zip(outputs, self.levels, strict=False)
            if has
        ]
        return (*self.plain_parameters(inputs[: self.inputs], outputs), *levels)

    def realization(self, theta: Any) -> Realization:
        """The matrices of θ."""
        outputs = np.flatnonzero(self.levels)
        if not self.levels:
            return self.plain(theta)
        r = self.plain(theta[: len(theta) - len(outputs)])
        column = np.zeros((len(r.C), 1), dtype=np.asarray(theta).dtype)
        column[outputs, 0] = theta[len(theta) - len(outputs) :]
        return replace(
            r,
            B=np.hstack([r.B, np.zeros((r.core, 1))]),
            D=np.hstack([r.D, column]),
            source=(*r.source, r.nu),
            lag=(*r.lag, 0),
            nu=r.nu + 1,
        )

    @abstractmethod
    def matrix_slopes(self, theta: Array, ahead: bool) -> tuple[Array, Array, Array, Array]:
        """∂(A, B, C, D)/∂θ_k of what is run, each with k first."""

    def parts(self) -> tuple[tuple[slice, slice], ...]:
        """Entries of θ, and the states that these and no others move."""
        return ((slice(0, None), slice(0, None)),)

    def with_constant(self, outputs: Sequence[bool]) -> Self:
        return replace(self, levels=tuple(bool(o) for o in outputs))

    def without_constant(self) -> Self:
        return replace(self, levels=())

    def constant_places(self) -> tuple[Index, Index]:
        outputs = np.flatnonzero(self.levels)
        return self.n_plain + np.arange(len(outputs)), outputs

    @property
    @abstractmethod
    def core_states(self) -> int:
        """States besides what waits in delays, whatever θ is."""

    def in_order(self, theta: Array, parameters: Sequence[Parameter]) -> Index:
        """Where each entry of θ stands now, of the same model written as it always is."""
        return np.arange(len(theta))

    def for_fit(self, records: Sequence[Record], focus: Focus) -> Self:
        """The structure as it is fitted to such records with this focus."""
        return self

    @property
    @abstractmethod
    def n_plain(self) -> int:
        """Length of θ without the constant's coefficients."""

    def steady(self, theta: Array) -> tuple[Array, Array]:
        with np.errstate(all="ignore"):
            return np.eye(self.ny), self.transfer(theta).static_gain()

    def transfer(self, theta: Array) -> TransferMatrix:
        return self.realization(np.asarray(theta)).transfer()

    def matrices(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        return self.realization(np.asarray(theta)).whole()

    def first_sample(self) -> int:
        return 0

    def n_states(self, theta: Array) -> int:
        r = self.realization(np.asarray(theta))
        return r.core + sum(r.waiting)

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        r = self.realization(np.asarray(theta))
        x0 = np.zeros(r.core + sum(r.waiting)) if x0 is None else np.asarray(x0)
        with np.errstate(all="ignore"):
            return np.asarray(r.run(r.delayed(u, x0[r.core :]), x0[: r.core]))

    def stable(self, theta: Array) -> bool:
        """Whether all poles lie inside the unit circle, or are a single integrator's."""
        if not np.all(np.isfinite(theta)):
            return False
        size = np.abs(poles(self, theta))
        at_one = np.abs(size - 1.0) < INTEGRATES
        return bool(np.all(size[~at_one] < 1.0)) and bool(at_one.sum() <= self.ny)

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """Least squares; each input is taken as held before its first sample."""
        r = self.realization(np.asarray(theta))
        k = min(samples, len(y))
        waiting = [np.full(n, u[0, j] if len(u) else 0.0) for j, n in enumerate(r.waiting)]
        x = _fitted_core(r, r.delayed(u[:k]), y[:k]) if k else np.zeros(r.core)
        return np.concatenate([x, *waiting])

    def errors(self, theta: Array, u: Array, y: Array, window: int) -> Array:
        return np.asarray(y - self._predicted(np.asarray(theta), u, y, window))

    def _predicted(self, theta: Array, u: Array, y: Array, window: int) -> Array:
        r, inputs = _one_step(self.realization(theta), u, y)
        x0 = _fitted_core(r, inputs[:window], y[:window]) if window else None
        with np.errstate(all="ignore"):
            return np.asarray(r.run(inputs, x0))

    def predict(self, theta: Array, u: Array, y: Array, horizon: int, window: int) -> Array:
        """ŷ(t|t−k) = y(t) − Σ_{l<k} h(l) e(t−l), h(0) = I, h(l) = C A^{l−1} K."""
        r = self.realization(np.asarray(theta))
        predicted = self._predicted(np.asarray(theta), u, y, window)
        if r.K is None:
            return predicted
        e = y - predicted
        out, power = predicted.copy(), np.asarray(r.K)
        for lag in range(1, min(horizon, len(y))):
            out[lag:] -= e[:-lag] @ (r.C @ power).T
            power = r.A @ power
        out[: horizon - 1] = np.nan
        return out

    def gradients(self, theta: Array, u: Array, y: Array) -> Array:
        theta = np.asarray(theta, dtype=np.float64)
        r, inputs = _one_step(self.realization(theta), u, y)
        window = min(len(y), max(3 * r.core, 1))
        x0 = _fitted_core(r, inputs[:window], y[:window])
        return _slopes(self, theta, inputs, x0, ahead=True).T

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        g = self.transfer(theta)
        return {
            "stable": self.stable(theta),
            "poles": [pole_words(complex(z), dt) for z in poles(self, theta)],
            "static_gain": g.static_gain().tolist(),
        }

    def problems(
        self, records: Sequence[Record], focus: Focus, initial: Initial, stable: bool
    ) -> tuple[Problem, ...]:
        data = [(r.u, r.y) for r in records]
        ahead = focus is Focus.PREDICTION and self.traits.has_noise_model
        return (RealizedErrors(self, data, initial is not Initial.ZERO, ahead, stable),)

    def offset_entries(self) -> Index:
        return self.constant_places()[0]


@poles.register
def _(s: RealizedStructure, theta: Array) -> NDArray[np.complex128]:
    return np.linalg.eigvals(s.realization(np.asarray(theta)).A).astype(np.complex128)


def _one_step(r: Realization, u: Array, y: Array) -> tuple[Realization, Array]:
    """What predicts one step ahead, and its inputs."""
    if r.K is None:
        return r, r.delayed(u)
    return r.predictor(), np.hstack([r.delayed(u), y])


def _fitted_core(r: Realization, inputs: Array, y: Array) -> Array:
    """x0 (core,) with which the run meets y best."""
    if not r.core or not len(y):
        return np.zeros(r.core)
    with np.errstate(all="ignore"):
        target = (y - r.run(inputs)).ravel()
        basis = r.free_responses(len(y)).reshape(-1, r.core)
    keep = np.isfinite(target) & np.all(np.isfinite(basis), axis=1)
    return scaled_lstsq(basis[keep], target[keep]) if keep.any() else np.zeros(r.core)


class RealizedErrors(RunErrors):
    """Errors one step ahead, or of free runs, of all outputs together.

    Args:
        states: whether the initial states of each record are estimated.
        ahead: whether errors are those one step ahead.
        stable: whether free runs must be bounded. Those of the predictor always are (Ljung 1999,
            §4.3): outside, the first state alone fits a record, and nothing else.
    """

    def __init__(
        self,
        structure: RealizedStructure,
        data: Data,
        states: bool,
        ahead: bool,
        stable: bool = False,
    ) -> None:
        self.structure, self.ahead, self.stable = structure, ahead, stable
        self.most = 1.0 + 1.0 / max(len(y) for _, y in data)  # an integrator grows by e at most
        self.n_theta = structure.n_plain + sum(structure.levels)
        core = structure.core_states
        super().__init__(self.n_theta, data, core if states else 0)

    def _at(self, theta: Any, u: Array, y: Array) -> tuple[Realization, Array]:
        r = self.structure.realization(theta)
        return _one_step(r, u, y) if self.ahead else (r, r.delayed(u))

    def runs(self, p: Array) -> Sequence[Array] | None:
        theta, states = p[: self.n_theta], self.states(p)
        if not self._bounded(theta):
            return None
        out = []
        for k, (u, y) in enumerate(self.data):
            r, inputs = self._at(theta, u, y)
            out.append(r.run(inputs, states[k] if self.states_each else None))
        return out

    def _bounded(self, theta: Array) -> bool:
        if not np.all(np.isfinite(theta)) or (self.stable and not self.structure.stable(theta)):
            return False
        r = self.structure.realization(theta)
        A = r.A if r.K is None or not self.ahead else r.predictor().A
        if not np.isfinite(A).all():
            return False
        return not len(A) or bool(np.max(np.abs(np.linalg.eigvals(A))) <= self.most)

    def tangents(self, p: Array) -> Iterator[Array]:
        theta, states = p[: self.n_theta], self.states(p)
        for k, (u, y) in enumerate(self.data):
            r, inputs = self._at(theta, u, y)
            x0 = states[k] if self.states_each else None
            slopes = np.moveaxis(_slopes(self.structure, theta, inputs, x0, self.ahead), 2, 0)
            if self.states_each:
                free = np.moveaxis(r.free_responses(len(y)), (0, 1, 2), (2, 0, 1))
                slopes = np.concatenate([slopes, free], axis=1)
            yield slopes


def _slopes(
    structure: RealizedStructure, theta: Array, inputs: Array, x0: Array | None, ahead: bool
) -> Array:
    """∂ŷ/∂θ of a run with known inputs from a known state, (len(θ), N, ny).

    With x of the run, ∂x(t+1) = A ∂x + (∂A x + ∂B u) and ∂y = C ∂x + (∂C x + ∂D u): one system that
    all entries of θ drive.
    """
    theta = np.asarray(theta, dtype=np.float64)
    r = structure.realization(theta)
    r = r.predictor() if ahead and r.K is not None else r
    dA, dB, dC, dD = structure.matrix_slopes(theta, ahead)
    n, (samples, columns) = r.core, inputs.shape
    x = run((r.A, r.B, np.eye(n), np.zeros((n, columns))), inputs, x0)
    shown = np.concatenate([dC, dD], axis=2)
    out = np.zeros((len(theta), samples, len(r.C)))
    for entries, s in structure.parts():
        driven = np.concatenate([dA[entries, s, s], dB[entries, s]], axis=2)
        signals = np.hstack([x[:, s], inputs])
        seen = np.flatnonzero(np.any(r.C[:, s], axis=1))
        size = driven.shape[1]
        of_state = (r.A[s, s], np.eye(size), r.C[seen, s], np.zeros((len(seen), size)))
        part = max(1, AT_ONCE // max(samples * size, 1))
        for k in range(0, len(driven), part):
            drive = signals @ driven[k : k + part].reshape(-1, signals.shape[1]).T
            drive = drive.reshape(samples, -1, size).swapaxes(0, 1)
            out[entries][k : k + part, :, seen] = run(of_state, drive)
    for entry in np.flatnonzero(np.any(shown, axis=(1, 2))):
        out[entry] += np.hstack([x, inputs]) @ shown[entry].T
    return out
