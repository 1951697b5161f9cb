"""The least-squares problem of a polynomial NARMAX model one step ahead."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.fitting.problem import HUGE, Data, Problem
from sysid.structures.difference_equations.monomials import Term, columns, is_noise, lagged


class OneStep(Problem):
    """ε(t) = y(t) − Σ θ_k p_k(t) of one output, past errors from the recursion itself.

    Without noise terms the problem is linear. With them ε depends on its own past,
    ∂ε/∂θ(t) = −p(t) − Σ_l g_l(t) ∂ε/∂θ(t−l), g_l(t) = Σ of the noise terms' cofactors.

    Args:
        terms: terms of the output's equation.
        at: place of its first coefficient in the structure's θ.
        data: (u, y) of each record.
        first: first sample whose terms lie inside the record; ε before it is zero.
    """

    def __init__(self, terms: Sequence[Term], at: int, output: int, data: Data, first: int) -> None:
        self.index = np.arange(at, at + len(terms))
        self.n_initial = 0
        self.lengths = tuple(max(len(y) - first, 0) for _, y in data)
        self.channels = (output,) * len(data)
        noise = [k for k, t in enumerate(terms) if is_noise(t)]
        self._plain = [k for k, t in enumerate(terms) if not is_noise(t)]
        self._noise = [(k, next(f.lag for f in terms[k] if f.kind == "e")) for k in noise]
        # a noise term's value is its cofactor (what multiplies the error) times the past error
        cofactors = [tuple(f for f in t if f.kind != "e") if is_noise(t) else t for t in terms]
        self._values = [columns(cofactors, u, y)[first:] for u, y in data]
        self._targets = [y[first:, output] for _, y in data]

    def residual(self, p: Array) -> Array:
        return np.concatenate([np.zeros(0), *self._errors(p)])

    def jacobian(self, p: Array) -> Array:
        blocks = []
        for values, e in zip(self._values, self._errors(p), strict=True):
            J = -values.copy()
            for k, lag in self._noise:
                J[:, k] *= lagged(e, lag)
            gains = self._gains(values, p)
            if gains:
                with np.errstate(over="ignore", invalid="ignore"):
                    for t in range(len(J)):
                        for lag, g in gains:
                            if t >= lag:
                                J[t] -= g[t] * J[t - lag]
                J = np.nan_to_num(J, nan=0.0, posinf=HUGE, neginf=-HUGE)
            blocks.append(J)
        return np.concatenate([np.zeros((0, len(self.index))), *blocks])

    def _gains(self, values: Array, p: Array) -> list[tuple[int, Array]]:
        gains: dict[int, Array] = {}
        for k, lag in self._noise:
            gains[lag] = gains.get(lag, 0.0) + p[k] * values[:, k]
        return [(lag, g) for lag, g in sorted(gains.items()) if np.any(g)]

    def _errors(self, p: Array) -> list[Array]:
        errors = []
        with np.errstate(over="ignore", invalid="ignore"):
            for values, y in zip(self._values, self._targets, strict=True):
                e = y - values[:, self._plain] @ p[self._plain]
                gains = self._gains(values, p)
                if gains:
                    e = _fed_back(e, gains)
                errors.append(e)
        return errors


def _fed_back(plain: Array, gains: Sequence[tuple[int, Array]]) -> Array:
    """ε(t) = plain(t) − Σ g_l(t) ε(t−l); HUGE throughout where that runs away."""
    e: list[float] = []
    rows = zip(plain.tolist(), *(g.tolist() for _, g in gains), strict=True)
    lags = [lag for lag, _ in gains]
    for t, (value, *row) in enumerate(rows):
        for lag, g in zip(lags, row, strict=True):
            if t >= lag:
                value -= g * e[t - lag]
        e.append(value)
    out = np.array(e)
    size = float(np.max(np.abs(plain), initial=0.0))
    if not np.all(np.abs(out) <= 1e6 * (size + 1e-300)):
        return np.full(len(out), HUGE)
    return out
