"""Excitation of a stream: the information of each parameter, and of the worst combination.

With each regressor scaled to size 1 and the output by its own spread σ_y, the information about
what a regressor does to the output is

    Λ = (σ_y/σ)² D⁻¹ RᵀR D⁻¹,   D² = diag(RᵀR)/N

so that 1/√λ_min(Λ) is the standard error, as a share of the output's spread, of the mixture of
regressors that is known worst: a mean command or measurement that only stands adds nothing to σ_y.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.estimation.online.factor import Factor

WORST = 0.05
"""What the worst-known mixture may be uncertain by, as a share of the output's spread."""

NEED = 1.0 / WORST**2
"""Least eigenvalue of Λ from which the excitation is enough."""

TAKES_PART = 0.35
"""Weight from which a signal is named as part of the worst-known mixture (a tenth of its power)."""

TOGETHER = 0.999
"""Correlation beyond which two inputs move as one."""


@dataclass(frozen=True)
class Excitation:
    """Whether one output's equation is known well enough.

    Attributes:
        smallest: least eigenvalue of Λ, 0 where a direction is without information.
        need: what it should be.
        lacking: signals of the worst-known mixture, where it is less.
        why: what is wrong with them, as a sentence; empty where the excitation is enough.
    """

    output: str
    smallest: float
    need: float
    lacking: tuple[str, ...]
    why: str

    @property
    def enough(self) -> bool:
        """Whether the data determine every mixture of the parameters."""
        return self.smallest >= self.need


def excitation(
    factor: Factor,
    signals: Sequence[str],
    names: tuple[str, Sequence[str]],
    newest: tuple[Array, Array],
) -> Excitation:
    """The excitation of one equation.

    Args:
        factor: what is known of it.
        signals: name of the signal behind each coefficient, (n,).
        names: of the output, and of all inputs.
        newest: that output (N,) and the inputs (N, nu) of the newest rows.
    """
    output, inputs = names
    y, u = newest
    n = factor.n
    size = np.linalg.norm(factor.R, axis=0)
    variance = factor.loss / factor.weight if factor.weight > n else 0.0
    spread = float(np.var(y)) if len(y) else 0.0
    still = np.flatnonzero(size == 0.0)
    if factor.weight <= n or spread == 0.0 or len(still):
        smallest, weights = 0.0, np.where(size == 0.0, 1.0, 0.0) if len(still) else np.ones(n)
    else:
        _, s, Vt = np.linalg.svd(factor.R / size * np.sqrt(factor.weight))
        # errors below rounding of the output are no better known than that
        floor = max(variance, 1e-24 * spread)
        smallest, weights = float(s[-1] ** 2 * spread / floor), np.abs(Vt[-1])
    if smallest >= NEED:
        return Excitation(output, smallest, NEED, (), "")
    part: list[str] = [
        s for s, w in zip(signals, weights, strict=True) if w >= TAKES_PART * weights.max()
    ]
    lacking = tuple(dict.fromkeys(part))
    return Excitation(output, smallest, NEED, lacking, _why(output, lacking, inputs, y, u))


def _why(output: str, lacking: Sequence[str], inputs: Sequence[str], y: Array, u: Array) -> str:
    if len(y) < 2:
        return "no rows yet."
    still = [n for n, c in zip(inputs, u.T, strict=True) if np.ptp(c) == 0.0]
    if still:
        values = ", ".join(f"{n} stays at {u[-1, inputs.index(n)]:g}" for n in still)
        return f"{values}: vary {'it' if len(still) == 1 else 'them'}."
    if np.ptp(y) == 0.0:
        return f"{output} stays at {y[-1]:g}: command more than the dead zone."
    pairs = [
        (a, b)
        for k, a in enumerate(inputs)
        for m, b in enumerate(inputs[k + 1 :], k + 1)
        if abs(float(np.corrcoef(u[:, k], u[:, m])[0, 1])) > TOGETHER
    ]
    if pairs:
        a, b = pairs[0]
        return f"{a} and {b} move together: move one without the other."
    have = "has" if len(lacking) == 1 else "have"
    return f"{' and '.join(lacking)} {have} too little information so far."
