"""Continuous-time structures: a transfer function with dead time for every input and output.

Errors are those of the free run. The numbers are in seconds, whatever the sample time: a model from
one log is the plant itself, and another sample time needs no other fit.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Channel, Record
from sysid.data.schema import checked
from sysid.fitting.problem import Focus, Parameter
from sysid.fitting.searchable import InitialGuesses
from sysid.structures.continuous.channel import companion, discretised
from sysid.structures.continuous.instruments import Found, found_paths
from sysid.structures.motion import dead_time_entry
from sysid.structures.state_space.realization import Realization, moved
from sysid.structures.state_space.structure import RealizedStructure

PADE = 4
"""Order of the approximation of a dead time."""


@dataclass(frozen=True)
class ContinuousStructure(RealizedStructure):
    """y_i = Σ_j G_ij(s) u_j, each path with its own numbers, one after the other in θ.

    Attributes:
        dt: sample time of the records it was fitted to [s].
        delayed: whether paths have a dead time.
        lags: whole samples of every path's dead time, where they are held (``held_near``).
    """

    dt: float
    delayed: bool
    lags: tuple[int, ...] = field(default=(), kw_only=True)

    @abstractmethod
    def path(self, p: Any) -> tuple[Any, Any, Any]:
        """(b_0 … b_m), (a_0 … a_{n−1}) and τ [s] of a path's numbers; they may be complex."""

    @property
    @abstractmethod
    def degree(self) -> int:
        """n, the poles of a path."""

    @property
    @abstractmethod
    def zeros(self) -> int:
        """m, the zeros of a path."""

    @abstractmethod
    def path_parameters(self, u: Channel, y: Channel) -> tuple[Parameter, ...]:
        """Names, units and bounds of a path's numbers."""

    @abstractmethod
    def path_numbers(self, found: Found) -> Array:
        """A path's numbers near a transfer function that was found."""

    @property
    def core_states(self) -> int:
        return self.inputs * self.outputs * self.degree

    @property
    def n_plain(self) -> int:
        u = Channel("u")
        return self.inputs * self.outputs * len(self.path_parameters(u, u))

    def settings(self) -> dict[str, Any]:
        return {"dt": self.dt, "delayed": self.delayed}

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        made = cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]))
        settings = raw["settings"]
        return replace(
            made, dt=checked(float, settings["dt"]), delayed=checked(bool, settings["delayed"])
        )

    def held_near(self, theta: Array) -> Self:
        return replace(self, lags=self.realization(theta).lag[:: 2 if self.delayed else 1])

    def for_fit(self, records: Sequence[Record], focus: Focus) -> Self:
        return replace(self, dt=records[0].dt)

    def plain_parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        table = []
        single = self.inputs == self.outputs == 1
        for y in outputs:
            for u in inputs:
                tag = "" if single else f"[{y.name},{u.name}]"
                table += [replace(p, name=p.name + tag) for p in self.path_parameters(u, y)]
        return tuple(table)

    def paths(self, theta: Any) -> list[tuple[Any, Any, Any]]:
        count = self.inputs * self.outputs
        return [self.path(p) for p in np.asarray(theta)[: self.n_plain].reshape(count, -1)]

    def plain(self, theta: Any) -> Realization:
        theta = np.asarray(theta)
        n, size = self.degree, self.core_states
        columns = 2 * self.inputs * self.outputs
        kind = theta.dtype
        A, B = np.zeros((size, size), dtype=kind), np.zeros((size, columns), dtype=kind)
        C = np.zeros((self.outputs, size), dtype=kind)
        lag, source = [], []
        for k, (num, den, delay) in enumerate(self.paths(theta)):
            i, j = divmod(k, self.inputs)
            s = slice(k * n, (k + 1) * n)
            A[s, s], B[s, [2 * k]], B[s, [2 * k + 1]], C[[i], s], d = discretised(
                num, den, delay, self.dt, self.lags[k] if self.lags else None
            )
            lag += [d, d + 1]
            source += [j, j]
        used = range(0, columns, 1 if self.delayed else 2)
        return Realization(
            A,
            B[:, used],
            C,
            np.zeros((self.outputs, len(used))),
            None,
            tuple(source[c] for c in used),
            tuple(lag[c] for c in used),
            self.inputs,
        )

    def matrix_slopes(self, theta: Array, ahead: bool) -> tuple[Array, Array, Array, Array]:
        """By complex steps; the numbers of a path move its own block alone."""
        r = self.realization(theta)
        A, B, C, D = (np.zeros((len(theta), *np.shape(M))) for M in (r.A, r.B, r.C, r.D))
        thetas, steps = moved(theta)
        for path, (entries, s) in enumerate(self.parts()):
            column = slice(path * (1 + self.delayed), (path + 1) * (1 + self.delayed))
            for k in range(entries.start, entries.stop):
                Phi, now, before, seen, _ = discretised(
                    *self.path(thetas[k, entries]), self.dt, r.lag[column.start]
                )
                A[k, s, s] = Phi.imag / steps[k]
                B[k, s, column] = np.hstack([now, before])[:, : 1 + self.delayed].imag / steps[k]
                C[k, path // self.inputs, s] = seen[0].imag / steps[k]
        at, outputs = self.constant_places()
        D[at, outputs, -1] = 1.0
        return A, B, C, D

    def parts(self) -> tuple[tuple[slice, slice], ...]:
        """Each path has numbers and states of its own."""
        paths = self.inputs * self.outputs
        each = self.n_plain // paths
        return tuple(
            (slice(k * each, (k + 1) * each), slice(k * self.degree, (k + 1) * self.degree))
            for k in range(paths)
        )

    def starts(self, records: Sequence[Record], focus: Focus) -> InitialGuesses:
        """Instrumental variables in continuous time, at several dead times."""
        every = [
            found_paths(
                [(r.u[:, : self.inputs], r.y[:, i]) for r in records],
                self.degree,
                self.zeros,
                self.dt,
                self.delayed,
                bool(self.levels),
            )
            for i in range(self.outputs)
        ]
        starts = []
        for k in range(max(len(found) for found in every)):
            chosen = [found[min(k, len(found) - 1)] for found in every]
            theta = np.concatenate([self.path_numbers(f) for row in chosen for f in row.paths])
            levels = [row.level for row, wanted in zip(chosen, self.levels, strict=False) if wanted]
            starts.append((chosen[0].how, np.concatenate([theta, levels])))
        return starts

    def continuous_response(self, theta: Array, w: Array) -> NDArray[np.complex128]:
        """G(jω) of the paths themselves, without the hold, (len(w), ny, nu)."""
        s = 1j * w
        out = np.zeros((len(w), self.outputs, self.inputs), dtype=np.complex128)
        for k, (num, den, delay) in enumerate(self.paths(theta)):
            bottom = np.polyval([1.0, *den[::-1]], s)
            out[:, *divmod(k, self.inputs)] = np.polyval(num[::-1], s) / bottom * np.exp(-s * delay)
        return out

    def in_continuous_time(self, theta: Array, dt: float) -> tuple[Array, Array, Array, Array]:
        """The paths themselves, each dead time as its Padé approximation of order ``PADE``."""
        from scipy.linalg import block_diag

        blocks, B, C = [], [], []
        for k, (num, den, delay) in enumerate(self.paths(theta)):
            top, bottom = np.asarray(num, dtype=np.float64)[::-1], np.append(1.0, den[::-1])
            if delay > 0.0:
                late, early = _pade(delay)
                top, bottom = np.convolve(top, late), np.convolve(bottom, early)
            A, b = companion(bottom[:0:-1] / bottom[0])
            blocks.append(A)
            B.append(b * np.eye(self.inputs)[k % self.inputs])
            row = np.append(top[::-1], np.zeros(len(A) - len(top))) / bottom[0]
            C.append(np.outer(np.eye(self.outputs)[k // self.inputs], row))
        D = np.zeros((self.outputs, self.inputs))
        return block_diag(*blocks), np.vstack(B), np.hstack(C), D

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        lines = []
        for k, (num, den, delay) in enumerate(self.paths(np.asarray(theta))):
            i, j = divmod(k, self.inputs)
            top, bottom = _text(num), _text([*den, 1.0])
            wait = f" e^(−{delay:.4g} s)" if delay > 0.0 else ""
            lines.append(f"{outputs[i].name} = ({top})/({bottom}){wait} · {inputs[j].name}")
        return tuple(lines)


def _pade(delay: float) -> tuple[Array, Array]:
    """Numerator and denominator of e^{−τ s}, the highest power first (Golub & Van Loan, §11.3)."""
    n, terms = PADE, [1.0]
    for k in range(1, n + 1):
        terms.append(terms[-1] * (n - k + 1) / (k * (2 * n - k + 1)) * delay)
    signs = (-1.0) ** np.arange(n + 1)
    early = np.array(terms, dtype=np.float64)[::-1]
    return np.asarray(signs[::-1] * early), early


def _text(coefficients: Sequence[float]) -> str:
    """Powers of s, the highest first."""
    parts: list[str] = []
    for k in reversed(range(len(coefficients))):
        value = float(coefficients[k])
        if value == 0.0:
            continue
        power = {0: "", 1: " s"}.get(k, f" s^{k}")
        number = f"{abs(value):.5g}" if value != 1.0 or k == 0 else ""
        sign = "−" if value < 0 else "+"
        term = f"{number}{power}".strip()
        parts.append(f"{sign} {term}" if parts else ("−" if value < 0 else "") + term)
    return " ".join(parts) or "0"


@dead_time_entry.register
def _(s: ContinuousStructure, i: int, j: int) -> int | None:
    each = s.n_plain // (s.inputs * s.outputs)
    return (i * s.inputs + j + 1) * each - 1 if s.delayed else None
