"""The initial state of a nonlinear free run that meets the head of a record."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from sysid.data.record import Array


class BatchRun(Protocol):
    """Equations whose free runs from many states can be advanced at once.

    Attributes:
        ny: number of outputs.
        n_states: length of a state.
        depth, before: past outputs and inputs a run needs.
        y_depth, u_depth: the same by channel; a state stacks them.
    """

    ny: int
    n_states: int
    depth: int
    before: int

    @property
    def y_depth(self) -> Sequence[int]:
        """Past outputs in the state, by output."""

    @property
    def u_depth(self) -> Sequence[int]:
        """Past inputs in the state, by input."""

    def state(self, y: Array, u: Array) -> Array:
        """Past outputs and inputs → state."""

    def past(self, x0: Array | None) -> tuple[Array, Array]:
        """State → past outputs and inputs."""

    def input_products(self, u: Array) -> Any:
        """What of inputs (before + L, nu, B) can be known before the runs."""

    def weights(self, theta: Array, U: Any) -> Any:
        """The same with the parameters."""

    def runs(self, weights: Any, past: Array) -> Array:
        """All runs from past outputs (depth, ny, B): (depth + L, ny, B)."""


PULL = 1e-2
"""Weight of the prior against one sample: it decides only what the head leaves open."""

STEP = 1e-6
ROUNDS = 15


def fitted_state(
    run: BatchRun, theta: Array, u: Array, y: Array, samples: int, spread: Array
) -> Array:
    """State whose free run meets the first samples of y best.

    Levenberg-Marquardt over past outputs and inputs, slopes by differences (all in one batched
    run), drawn weakly towards "everything before was like the first sample".

    Args:
        run: the equation.
        theta: its coefficients.
        u, y: the record.
        samples: samples at its head that count.
        spread: (ny + nu,), the size of a usual change of each output and input.
    """
    n, k = run.n_states, min(samples, len(y))
    if n == 0 or k == 0:
        return np.zeros(n)
    prior = run.state(np.repeat(y[:1], run.depth, axis=0), np.repeat(u[:1], run.before, axis=0))
    depths = [*run.y_depth, *run.u_depth]
    scale = np.repeat(np.where(spread > 0, spread, 1.0), depths)
    out = np.where(spread > 0, spread, 1.0)[: run.ny]
    head = np.repeat(u[:k, :, None], n + 1, axis=2)

    def residuals(x: Array) -> Array:
        """Errors at x and next to it along each coordinate, (k·ny + n, n + 1)."""
        states = np.repeat(x[:, None], n + 1, axis=1)
        states[np.arange(n), np.arange(1, n + 1)] += STEP * scale
        pasts = [run.past(s) for s in states.T]
        past = np.stack([p for p, _ in pasts], axis=2)
        before = np.stack([q for _, q in pasts], axis=2)
        weights = run.weights(theta, run.input_products(np.concatenate([before, head])))
        found = run.runs(weights, past)[run.depth :]
        e = (found - y[:k, :, None]) / out[:, None]
        pull = PULL * (states - prior[:, None]) / scale[:, None]
        return np.concatenate([e.reshape(k * run.ny, n + 1), pull])

    x, damping = prior, 1e-3
    with np.errstate(over="ignore", invalid="ignore"):
        r = residuals(x)
        for _ in range(ROUNDS):
            J = (r[:, 1:] - r[:, :1]) / STEP
            cost, gradient, H = float(r[:, 0] @ r[:, 0]), J.T @ r[:, 0], J.T @ J
            if not np.all(np.isfinite(H)):
                return prior
            step = -np.linalg.solve(H + damping * np.eye(n), gradient)
            tried = residuals(x + step * scale)
            lower = float(tried[:, 0] @ tried[:, 0])
            if lower < cost:
                x, r, damping = x + step * scale, tried, damping / 10.0
                if cost - lower <= 1e-10 * cost:
                    break
            else:
                damping = max(damping * 10.0, 1e-9)
                if damping > 1e6:
                    break
    return x
