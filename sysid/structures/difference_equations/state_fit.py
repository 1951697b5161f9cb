"""The initial state of a nonlinear free run that meets the head of a record."""

import numpy as np

from sysid.data.record import Array, Index
from sysid.fitting.batched import OneTrial, descend_alone
from sysid.structures.difference_equations.free_run import FreeRun

PULL = 1e-2
"""Weight of the prior against one sample: it decides only what the head leaves open."""

STEP = 1e-6
ROUNDS = 15
GAIN = 1e-10


def fitted_state(
    run: FreeRun, theta: Array, u: Array, y: Array, samples: int, spread: Array
) -> Array:
    """State whose free run meets the first samples of y best.

    Levenberg-Marquardt over past outputs and inputs, slopes by differences (all in one batched
    run), drawn weakly towards "everything before was like the first sample".

    Args:
        u, y: the record.
        samples: samples at its head that count.
        spread: (ny + nu,), the size of a usual change of each output and input.
    """
    n, k = run.n_states, min(samples, len(y))
    if n == 0 or k == 0:
        return np.zeros(n)
    prior = run.state(np.repeat(y[:1], run.depth, axis=0), np.repeat(u[:1], run.before, axis=0))
    size = np.where(spread > 0, spread, 1.0)
    scale = np.repeat(size, [*run.y_depth, *run.u_depth])
    head = np.repeat(u[:k, :, None], n + 1, axis=2)

    def tried(z: Array, _: Index) -> OneTrial:
        """The run at z and next to it along each coordinate, z in usual changes from the prior."""
        moved = np.column_stack([z.T, z.T + STEP * np.eye(n)])
        pasts = [run.past(prior + scale * s) for s in moved.T]
        past, before = (np.stack(parts, axis=2) for parts in zip(*pasts, strict=True))
        outputs = run.driven(theta, np.concatenate([before, head]), past)
        e = ((y[:k, :, None] - outputs) / size[: run.ny, None]).reshape(k * run.ny, n + 1)
        e = np.concatenate([e, -PULL * moved])
        return OneTrial(e[:, 0], lambda: (e[:, :1] - e[:, 1:]) / STEP)

    return prior + scale * descend_alone(tried, np.zeros(n), ROUNDS, GAIN)
