"""Was the log recorded under feedback? Do the commands answer to surprises of the readings?

``impulse.feedback_tests`` sees feedback where commands are otherwise predictable. Under a reference
that steps, its jumps drown the answer. Here both sides are made robust: between the jumps a command
in open loop follows from its own past, while under feedback

    Δu(t) = Σ_k φ_k u(t−k) + Σ_{k≥0} γ_k w(t−k) + rest,

with w what surprises in the readings. On robot logs k starts at 0, since a reading is taken before
its command takes effect; elsewhere y(t) may feel u(t), and k starts at 1. Residuals are clipped at
three robust standard deviations, so that jumps count no more than others.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtrc

from sysid.data.impulse import feedback_tests
from sysid.data.record import Array, Record
from sysid.errors import DataError

PAST = 8
"""Past samples that predict a command or a reading."""

ANSWER = 4
"""Number of samples within which a command answers."""

LEVEL = 1e-4
SHARE = 0.05
"""A reaction that explains less than this of the command's changes is none that matters."""


def in_closed_loop(records: Sequence[Record]) -> bool:
    """Whether a command answers to surprises of an output.

    False where the records are too short to tell, and where commands hold still in more than half
    of the samples: an answer to noisy readings never does.
    """
    try:
        tests = feedback_tests(records)
    except DataError:
        tests = ()
    moving = {n for j, n in enumerate(records[0].input_names) if _moves(records, j)}
    if not moving:
        return False
    if any(t.p_value < LEVEL and t.share > SHARE and t.input in moving for t in tests):
        return True
    heard = [surprises(records, i) for i in range(records[0].ny)]
    pairs = [
        reaction(records, j, w)
        for j, n in enumerate(records[0].input_names)
        for w in heard
        if n in moving
    ]
    return any(p < LEVEL / len(pairs) and share > SHARE for p, share in pairs)


def reaction(records: Sequence[Record], j: int, surprise: Sequence[Array]) -> tuple[float, float]:
    """(p-value, share) of the changes of input ``j`` that follow from an output's surprises."""
    rows, targets = [], []
    for r, w in zip(records, surprise, strict=True):
        first = PAST + ANSWER + 1
        if len(r) <= first + 10:
            continue
        past = [r.u[first - k : len(r) - k, j] for k in range(1, PAST + 1)]
        begin = 0 if r.is_robot_log else 1
        heard = [w[first - k : len(r) - k] for k in range(begin, begin + ANSWER)]
        rows.append(np.column_stack([np.ones(len(r) - first), *past, *heard]))
        targets.append(r.u[first:, j] - r.u[first - 1 : -1, j])
    if not rows or sum(map(len, rows)) < 10 * (PAST + ANSWER):
        return 1.0, 0.0
    X, y = np.concatenate(rows), np.concatenate(targets)
    own, whole = _basis(X[:, :-ANSWER]), _basis(X)
    y = _clipped(y - _robust(own, y))
    before, after = y - own @ (own.T @ y), y - whole @ (whole.T @ y)
    a, b = float(before @ before), float(after @ after)
    free = len(y) - X.shape[1]
    if a <= 0.0 or b <= 0.0:
        return 1.0, 0.0
    return float(fdtrc(ANSWER, free, max(a - b, 0.0) / ANSWER / (b / free))), 1.0 - b / a


def _moves(records: Sequence[Record], j: int) -> bool:
    change = np.concatenate([np.diff(r.u[:, j]) for r in records])
    return bool(len(change)) and float(np.median(np.abs(change))) > 0.0


def surprises(records: Sequence[Record], i: int) -> list[Array]:
    """What the past of all channels does not predict of output ``i``, clipped; (N,) a record."""
    blocks = []
    for r in records:
        lagged = [_late(x, k) for x in (*r.y.T, *r.u.T) for k in range(1, PAST + 1)]
        lagged += [] if r.is_robot_log else list(r.u.T)
        blocks.append(np.column_stack([np.ones(len(r)), *lagged]))
    X, y = np.concatenate(blocks), np.concatenate([r.y[:, i] for r in records])
    w = _clipped(y - _robust(_basis(X), y))
    return np.split(w, np.cumsum([len(r) for r in records])[:-1])


def _late(x: Array, k: int) -> Array:
    return np.concatenate([np.repeat(x[:1], k), x[:-k]])


def _basis(X: Array) -> Array:
    """Orthonormal basis of the columns' span."""
    kept = X / np.maximum(np.sqrt(np.sum(X**2, axis=0)), 1e-300)
    values, vectors = np.linalg.eigh(kept.T @ kept)
    known = values > 1e-10 * values[-1]
    return np.asarray(kept @ (vectors[:, known] / np.sqrt(values[known])))


def _robust(basis: Array, y: Array) -> Array:
    """Prediction by least squares with clipped residuals (Huber), five rounds."""
    fit = basis @ (basis.T @ y)
    for _ in range(5):
        fit = basis @ (basis.T @ (fit + _clipped(y - fit)))
    return np.asarray(fit)


def _clipped(e: Array) -> Array:
    spread = 3.0 * 1.4826 * float(np.median(np.abs(e - np.median(e))))
    return np.clip(e, -spread, spread) if spread > 0.0 else e
