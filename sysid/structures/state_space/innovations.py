"""State space in innovations form, ``ss``: one model for all inputs and outputs together."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel, Record
from sysid.data.unit_words import ratio
from sysid.errors import UsageError
from sysid.fitting.problem import Focus, Parameter
from sysid.fitting.searchable import InitialGuesses
from sysid.structures.base import refuse_options
from sysid.structures.linear.polynomial import linear_traits
from sysid.structures.special_runs import traced_step
from sysid.structures.state_space.realization import Realization, inside
from sysid.structures.state_space.structure import RealizedStructure
from sysid.structures.state_space.subspace import Subspace, subspace
from sysid.structures.traits import Traits

LARGEST = 30
"""Largest order that is accepted."""

AN_OUTPUT = 3
"""States an output at most where nobody asked for any: a fit of more takes too long for that."""


def _default_orders(records: Sequence[Record]) -> tuple[Mapping[str, Any], ...]:
    """Of several outputs, the order that singular values show: least N σ²ₙ₊₁ + d(n) ln N.

    N σ² stands as −N ln(1 − ρ²) of canonical correlations ρ of past and future, d(n) is the count
    of numbers (Bauer 2001, Automatica 37, 1561).
    """
    nu, ny = records[0].nu, records[0].ny
    tried = StateSpace.candidate_orders(nu, ny, sum(map(len, records)), 1)
    if ny == 1 or not tried:
        return ()
    plain = Detrend.means(records).remove
    most = min(tried[-1]["n"], AN_OUTPUT * ny)
    looked = StateSpace((), nu, ny, most, 1).looked_at([plain(r) for r in records])
    if looked is None:
        return ()
    samples = sum(map(len, looked.errors))
    left = samples * np.log1p(np.append(looked.singular, 0.0) ** 2)
    each = np.log(samples) * (nu + 2 * ny)
    return ({"n": min(range(ny, most + 1), key=lambda n: left[n] + n * each)},)


@dataclass(frozen=True)
class StateSpace(RealizedStructure):
    """x(t+1) = A x + B u + K e, y = C x + D u + e in observable canonical form.

    The states are outputs as they are foreseen: of output i those 0 … ν_i − 1 samples ahead, Σ ν_i
    = n, as equal as possible (Ljung 1999, §4.3 and appendix 4A). So C holds zeros and ones, A has a
    row of free numbers an output, B and K are free. θ stacks A's rows, B, D and K.

    Attributes:
        n: states.
        nk: 1 where inputs act a sample later, 0 where they act at once (D).
        noise: whether K is part of it; without, errors are those of the free run.
    """

    n: int
    nk: int
    noise: bool = True

    name: ClassVar[str] = "ss"
    traits: ClassVar[Traits] = linear_traits(
        title="State space in innovations form",
        equation="x(t+1) = A x(t) + B u(t) + K e(t), y(t) = C x(t) + D u(t) + e(t)",
        when="several outputs that share dynamics; logs from under a controller",
        order_names=("n",),
        order_words={"n": "states", "nk": "delay of the inputs in samples, 0 or 1"},
        options={"noise": "none: no Kalman gain K, errors are those of the free run"},
        has_noise_model=True,
        search_cost=4.0,
        by_default=False,
        default_orders=_default_orders,
    )

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        """The structure with n states."""
        refuse_options(cls.name, options, tuple(cls.traits.options))
        given = dict(raw)
        n, nk = given.pop("n", None), given.pop("nk", 1)
        if given or not isinstance(n, int) or not ny <= n <= LARGEST or nk not in (0, 1):
            raise UsageError(
                f"`orders`: ss needs n, the number of states from {ny} (one an output) to "
                f"{LARGEST}, and may have nk=0 where inputs act at once; such as n={max(2, ny)}"
            )
        noise = (options or {}).get("noise", "kalman")
        if noise not in ("kalman", "none"):
            raise UsageError(f"`structure_options`: noise={noise!r} is neither kalman nor none")
        return cls((), nu, ny, n, nk, noise == "kalman")

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """One state an output, and up to four more an output."""
        most = min(4 * ny + 2, 10, max(ny, samples // (20 * (nu + ny))))
        return tuple({"n": n} for n in range(ny, most + 1))

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        noise = "kalman" if raw["settings"].get("noise", True) else "none"
        return cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]), {"noise": noise})

    def order_values(self) -> dict[str, Any]:
        return {"n": self.n} | ({"nk": 0} if self.nk == 0 else {})

    def settings(self) -> dict[str, Any]:
        return {"noise": self.noise}

    @property
    def core_states(self) -> int:
        """n."""
        return self.n

    @property
    def _lengths(self) -> tuple[int, ...]:
        """ν_i."""
        return tuple(self.n // self.ny + (i < self.n % self.ny) for i in range(self.ny))

    @property
    def _sizes(self) -> tuple[int, int, int, int]:
        """Numbers of A, B, D and K."""
        n, nu, ny = self.n, self.inputs, self.ny
        return ny * n, n * nu, ny * nu * (self.nk == 0), n * ny * self.noise

    @property
    def n_plain(self) -> int:
        return sum(self._sizes)

    def plain_parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names by row and column, counted from 1; units of state over input or output."""
        of_state = [outputs[i] for i, k in enumerate(self._lengths) for _ in range(k)]
        last = np.cumsum(self._lengths)
        table = [
            Parameter(f"A{last[i]},{k + 1}", ratio(out.unit, of_state[k].unit))
            for i, out in enumerate(outputs)
            for k in range(self.n)
        ]
        table += [
            Parameter(f"B{k + 1},{j + 1}", ratio(c.unit, u.unit))
            for k, c in enumerate(of_state)
            for j, u in enumerate(inputs)
        ]
        if self.nk == 0:
            table += [
                Parameter(f"D{i + 1},{j + 1}", ratio(c.unit, u.unit))
                for i, c in enumerate(outputs)
                for j, u in enumerate(inputs)
            ]
        if self.noise:
            table += [
                Parameter(f"K{k + 1},{i + 1}", ratio(c.unit, out.unit))
                for k, c in enumerate(of_state)
                for i, out in enumerate(outputs)
            ]
        return tuple(table)

    def plain(self, theta: Any) -> Realization:
        theta = np.asarray(theta)
        n, nu, ny = self.n, self.inputs, self.ny
        a, b, d, k = np.split(theta, np.cumsum(self._sizes)[:-1])
        last = np.cumsum(self._lengths) - 1
        A = np.eye(n, k=1).astype(theta.dtype)
        A[last] = a.reshape(ny, n)
        C = np.zeros((ny, n))
        C[np.arange(ny), last - np.array(self._lengths) + 1] = 1.0
        D = d.reshape(ny, nu) if self.nk == 0 else np.zeros((ny, nu))
        K = k.reshape(n, ny) if self.noise else None
        return Realization(A, b.reshape(n, nu), C, D, K, tuple(range(nu)), (0,) * nu, nu)

    def matrix_slopes(self, theta: Array, ahead: bool) -> tuple[Array, Array, Array, Array]:
        """Of Ā = A − K C, B̄ = [B − K D, K]: A, B, K and D are linear in θ, C is constant."""
        n, nu, ny, r = self.n, self.nu, self.ny, self.realization(theta)
        count = len(theta)
        units = np.split(np.eye(count), np.cumsum(self._sizes), axis=1)
        dA, dB, dD = (np.zeros((count, *shape)) for shape in ((n, n), (n, nu), (ny, nu)))
        dA[:, np.cumsum(self._lengths) - 1] = units[0].reshape(count, ny, n)
        dB[:, :, : self.inputs] = units[1].reshape(count, n, self.inputs)
        if self.nk == 0:
            dD[:, :, : self.inputs] = units[2].reshape(count, ny, self.inputs)
        dD[:, np.flatnonzero(self.levels), -1] += units[4]
        if ahead and self.noise:
            dK = units[3].reshape(count, n, ny)
            dA, dB = dA - dK @ r.C, np.concatenate([dB - dK @ r.D - r.K @ dD, dK], axis=2)
            dD = np.concatenate([dD, np.zeros((count, ny, ny))], axis=2)
        return dA, dB, np.zeros((count, ny, n)), dD

    def theta_of(self, matrices: tuple[Array, Array, Array, Array, Array]) -> Array | None:
        """θ of matrices in any basis; None where these outputs do not show the states."""
        A, B, C, D, K = matrices
        rows = []
        for i, count in enumerate(self._lengths):
            row = C[i]
            for _ in range(count):
                rows.append(row)
                row = row @ A
        T = np.array(rows)
        if np.linalg.cond(T) > 1e12:
            return None
        back = np.linalg.inv(T)
        last = np.cumsum(self._lengths) - 1
        parts = [(T @ A @ back)[last].ravel(), (T @ B).ravel()]
        parts += [D.ravel()] if self.nk == 0 else []
        parts += [(T @ K).ravel()] if self.noise else []
        return np.concatenate(parts)

    def for_fit(self, records: Sequence[Record], focus: Focus) -> Self:
        """Free runs say nothing of K."""
        return replace(self, noise=False) if focus is Focus.SIMULATION else self

    def starts(self, records: Sequence[Record], focus: Focus) -> InitialGuesses:
        """Subspace estimates with the weights of CVA and of N4SID."""
        found = []
        weights = (("subspace, CVA weights", True), ("subspace, N4SID weights", False))
        for name, cva in weights[: 2 if self.ny > 1 else 1]:  # they differ by a number then
            looked = self.looked_at(records, cva)
            theta = None if looked is None else self.theta_of(_settled(*looked.matrices(self.n)))
            if theta is not None and np.all(np.isfinite(theta)):
                found.append((name, self._with_levels(theta, records)))
        if not found:  # a start that can at least be run
            theta = np.zeros(self.n_plain)
            found.append(("nothing known", self._with_levels(theta, records)))
        return found

    def looked_at(self, records: Sequence[Record], cva: bool = True) -> Subspace | None:
        """Singular values and states that records without offsets show."""
        u, y = (np.concatenate([getattr(r, s) for r in records]) for s in ("u", "y"))
        mean_u, mean_y = u.mean(axis=0), y.mean(axis=0)
        if not self.levels:
            mean_u, mean_y = 0.0 * mean_u, 0.0 * mean_y
        own = slice(0, self.inputs)
        data = [((r.u - mean_u)[:, own], r.y - mean_y) for r in records]
        return subspace(data, self.nk == 0, self.n, cva)

    def _with_levels(self, theta: Array, records: Sequence[Record]) -> Array:
        if not self.levels:
            return theta
        u, y = (np.concatenate([getattr(r, s) for r in records]) for s in ("u", "y"))
        plain = self.without_constant()
        gain = plain.transfer(theta).static_gain()
        level = y.mean(axis=0) - np.nan_to_num(gain @ u[:, : self.inputs].mean(axis=0))
        return np.concatenate([theta, level[list(self.levels)]])

    def stabilised(self, theta: Array) -> Array:
        """Poles outside the unit circle brought in."""
        r = self.realization(theta)
        if np.all(np.abs(np.linalg.eigvals(r.A)) < 1.0):
            return theta
        own = self.without_constant()
        p = own.plain(theta[: self.n_plain])
        K = np.zeros((self.n, self.ny)) if p.K is None else p.K
        moved = self.theta_of((inside(p.A), p.B, p.C, p.D, K))
        return theta if moved is None else np.concatenate([moved, theta[self.n_plain :]])

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """The matrices, row by row."""
        r = self.plain(np.asarray(theta)[: self.n_plain])
        lines = [self.traits.equation]
        for name in "ABCDK":
            M = getattr(r, name)
            if M is not None and np.any(M):
                rows = "; ".join(", ".join(f"{v:.5g}" for v in row) for row in M)
                lines.append(f"{name} = [{rows}]")
        return tuple(lines)


@traced_step.register
def _(s: StateSpace, theta: Any, like: Array) -> Callable[[Any, Any], tuple[Any, Any]]:
    if s.levels:  # only while it is fitted
        return s.step(theta)
    n, nu, ny = s.n, s.inputs, s.ny
    ends = np.cumsum(s._sizes)
    last = np.cumsum(s._lengths) - 1
    first = last - np.array(s._lengths) + 1
    B = theta[ends[0] : ends[1]].reshape((n, nu))
    D = theta[ends[1] : ends[2]].reshape((ny, nu)) if s.nk == 0 else None
    rows = {int(k): theta[i * n : (i + 1) * n] for i, k in enumerate(last)}

    def advance(x: Any, u: Any) -> tuple[Any, Any]:
        xp = theta.__array_namespace__()
        y = xp.stack([x[int(k)] for k in first])
        after = xp.stack([rows[k] @ x if k in rows else x[k + 1] for k in range(n)])
        return after + B @ u, y if D is None else y + D @ u

    return advance


def _settled(
    A: Array, B: Array, C: Array, D: Array, K: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Matrices whose free run and whose predictor are both bounded."""
    A = inside(A)
    for _ in range(20):
        if np.all(np.abs(np.linalg.eigvals(A - K @ C)) < 1.0):
            break
        K = 0.7 * K
    return A, B, C, D, K
