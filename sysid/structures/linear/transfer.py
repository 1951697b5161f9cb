"""Transfer matrices in q⁻¹: the deterministic part of every linear model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import lfilter
from sysid.data.frequency_response import python_control
from sysid.data.record import Array
from sysid.fitting.normal_equations import scaled_lstsq
from sysid.structures.linear.polynomials import Matrix


@dataclass(frozen=True, eq=False)
class Group:
    """Inputs that reach one output through one common denominator.

    y_i = Σ_j num_j(q)/den(q) u_j, all polynomials padded to one length n + 1, den[0] = 1.
    Its state is that of the transposed direct form II, shape (n,).
    """

    output: int
    inputs: tuple[int, ...]
    num: Array
    den: Array

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.den) - 1


@dataclass(frozen=True, eq=False)
class TransferMatrix:
    """y = G(q) u as a sum of groups; states are stacked group after group."""

    groups: tuple[Group, ...]
    nu: int
    ny: int

    @staticmethod
    def build(num: Matrix, den: Matrix) -> "TransferMatrix":
        """From numerators and denominators [i][j]; equal denominators of a row share states."""
        num, den = ([[np.asarray(p) for p in row] for row in matrix] for matrix in (num, den))
        groups = []
        ny, nu = len(num), len(num[0]) if num else 0
        for i in range(ny):
            members: dict[bytes, list[int]] = {}
            for j in range(nu):
                if np.any(num[i][j]):
                    members.setdefault(_trimmed(den[i][j]).tobytes(), []).append(j)
            for inputs in members.values():
                polynomial = _trimmed(den[i][inputs[0]])
                width = max(len(polynomial), *(len(num[i][j]) for j in inputs))
                groups.append(
                    Group(
                        output=i,
                        inputs=tuple(inputs),
                        num=np.array([_padded(num[i][j], width) for j in inputs]),
                        den=_padded(polynomial, width),
                    )
                )
        return TransferMatrix(tuple(groups), nu, ny)

    @property
    def n_states(self) -> int:
        """Total number of states."""
        return sum(g.order for g in self.groups)

    def simulate(self, u: Array, x0: Array | None = None) -> Array:
        """Response to ``u`` (N, nu) from state ``x0`` (n_states,) or rest, shape (N, ny)."""
        y = np.zeros((len(u), self.ny))
        if not len(u):
            return y
        at = 0
        for g in self.groups:
            state = None if x0 is None else x0[at : at + g.order]
            y[:, g.output] += _respond(g, u, state)
            at += g.order
        return y

    def free_responses(self, n: int) -> Array:
        """Free responses to the unit states, shape (n, ny, n_states).

        In the transposed direct form II the k-th state acts like a unit impulse at sample k
        through 1/den, which is what makes the columns shifts of one another.
        """
        basis = np.zeros((n, self.ny, self.n_states))
        impulse = np.zeros(n)
        if n:
            impulse[0] = 1.0
        at = 0
        for g in self.groups:
            h = lfilter([1.0], g.den, impulse)
            for k in range(min(g.order, n)):
                basis[k:, g.output, at + k] = h[: n - k]
            at += g.order
        return basis

    def fitted_state(self, u: Array, y: Array, samples: int) -> Array:
        """The x0 with which the first ``samples`` of ``y`` are met best (least squares).

        Samples of y that are NaN are left out. With as many samples as states this starts the
        simulation from the measured outputs; with fewer the shortest such state is taken.
        """
        samples = min(samples, len(y))
        if samples == 0 or self.n_states == 0:
            return np.zeros(self.n_states)
        with np.errstate(over="ignore", invalid="ignore"):
            target = (y[:samples] - self.simulate(u[:samples])).ravel()
            basis = self.free_responses(samples).reshape(-1, self.n_states)
        keep = np.isfinite(target) & np.all(np.isfinite(basis), axis=1)
        if not keep.any():
            return np.zeros(self.n_states)
        return scaled_lstsq(basis[keep], target[keep])

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D) of x⁺ = A x + B u, y = C x + D u with the same states."""
        n = self.n_states
        A, B = np.zeros((n, n)), np.zeros((n, self.nu))
        C, D = np.zeros((self.ny, n)), np.zeros((self.ny, self.nu))
        at = 0
        for g in self.groups:
            s = slice(at, at + g.order)
            A[s, s] = np.eye(g.order, k=1)
            if g.order:
                A[s, at] -= g.den[1:]
                C[g.output, at] = 1.0
            for j, num in zip(g.inputs, g.num, strict=True):
                B[s, j] += num[1:] - g.den[1:] * num[0]
                D[g.output, j] += num[0]
            at += g.order
        return A, B, C, D

    def response(self, w: Array) -> NDArray[np.complex128]:
        """G(e^{jw}) at frequencies w [rad a sample], (len(w), ny, nu)."""
        response = np.zeros((len(w), self.ny, self.nu), dtype=np.complex128)
        for g in self.groups:
            powers = np.exp(-1j * np.outer(w, np.arange(len(g.den))))
            for j, num in zip(g.inputs, g.num, strict=True):
                response[:, g.output, j] += (powers @ num) / (powers @ g.den)
        return response

    def poles(self) -> NDArray[np.complex128]:
        """Poles, groups stacked; poles at the origin (pure delays) are left out."""
        return self._poles

    @cached_property
    def _poles(self) -> NDArray[np.complex128]:
        poles = [np.roots(_trimmed(g.den)) for g in self.groups]
        return np.concatenate([np.zeros(0), *poles]).astype(np.complex128)

    def zeros(self, i: int, j: int) -> NDArray[np.complex128]:
        """Zeros of the entry from input ``j`` to output ``i`` as it was parametrised."""
        zeros = [
            np.roots(np.trim_zeros(g.num[g.inputs.index(j)]))
            for g in self.groups
            if g.output == i and j in g.inputs
        ]
        return np.concatenate([np.zeros(0), *zeros]).astype(np.complex128)

    def static_gain(self) -> Array:
        """G(1), shape (ny, nu); infinite with a pole at 1."""
        gain = np.zeros((self.ny, self.nu))
        for g in self.groups:
            bottom = float(g.den.sum())
            for j, num in zip(g.inputs, g.num, strict=True):
                top = float(num.sum())
                gain[g.output, j] += top / bottom if bottom else np.copysign(np.inf, top)
        return gain


def control_model(
    matrices: tuple[Array, Array, Array, Array],
    dt: float,
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> Any:
    """``control.StateSpace`` of these matrices; dt is 0 in continuous time."""
    return python_control().StateSpace(*matrices, dt, inputs=list(inputs), outputs=list(outputs))


def _respond(g: Group, u: Array, state: Array | None) -> Array:
    if len(g.inputs) == 1:
        zi = np.zeros(g.order) if state is None else state
        y: Array = lfilter(g.num[0], g.den, u[:, g.inputs[0]], zi=zi)[0]
        return y
    drive = np.zeros(len(u))
    for j, num in zip(g.inputs, g.num, strict=True):
        drive += lfilter(np.trim_zeros(num, "b"), [1.0], u[:, j])
    forced: Array = lfilter([1.0], g.den, drive)
    if state is not None and np.any(state):
        nothing = np.zeros(g.order + 1)
        forced = forced + lfilter(nothing, g.den, np.zeros(len(u)), zi=state)[0]
    return forced


def _trimmed(polynomial: Array) -> Array:
    last = np.flatnonzero(polynomial)[-1:]
    return polynomial[: int(last[0]) + 1] if len(last) else np.zeros(1)


def _padded(polynomial: Array, width: int) -> Array:
    out = np.zeros(width)
    out[: len(polynomial)] = polynomial[:width]
    return out
