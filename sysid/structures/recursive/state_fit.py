"""The initial state of a nonlinear free run that meets the head of a record."""

import numpy as np

from sysid.data.record import Array
from sysid.structures.recursive.free_run import FreeRun

PULL = 1e-2
"""Weight of the prior against one sample: it decides only what the head leaves open."""

STEP = 1e-6
ROUNDS = 15


def fitted_state(
    run: FreeRun, theta: Array, u: Array, y: Array, samples: int, spread: Array
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
        found = run.driven(theta, np.concatenate([before, head]), past)
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
