"""Initial guesses of gain, time constant and Coulomb friction of motors, by least squares."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Record

SPANS = (1, 3, 10, 30, 100, 300)
"""Samples over which speeds change in the regression: the noise of fast sampling averages out."""

LEAST_ROWS = 30


def central_guesses(
    records: Sequence[Record], position: bool
) -> tuple[tuple[str, Array, Array, Array, Array], ...]:
    """(words, gain, time constant, Coulomb level, constant load) by track, for several spans.

    ω(t + m) = a ω(t) + b ū − c sign(ω) + d over spans of m samples with ū the mean command; then
    τ = −m dt / ln a, K = b/(1 − a), level = c/b, load = −d/b, both in
    units of the command.
    """
    guesses = []
    for span in SPANS:
        rows = sum(max(len(r) // span - 2, 0) for r in records)
        if rows < LEAST_ROWS:
            break
        guess = [_track(records, position, span, i) for i in range(records[0].ny)]
        if any(g is None for g in guess):
            continue
        table = np.array(guess, dtype=np.float64)
        guesses.append((f"differences over {span} samples", *table.T))
    return tuple(guesses) or (_steady(records, position),)


def _speeds(r: Record, position: bool, span: int, i: int) -> tuple[Array, Array]:
    """Speed at the ends of stretches of ``span`` samples, and the mean command in each."""
    y, u = r.y[:, i], r.u[:, i]
    count = (len(y) - 1) // span
    mean = u[: count * span].reshape(count, span).mean(axis=1)
    if not position:
        return y[: count * span + 1 : span], mean
    # the mean speed of a stretch is that of its middle; commands are averaged likewise
    v = np.diff(y[: count * span + 1 : span]) / (span * r.dt)
    return v, 0.5 * (mean[:-1] + mean[1:])


def _track(
    records: Sequence[Record], position: bool, span: int, i: int
) -> tuple[float, float, float, float] | None:
    left, right = [], []
    for r in records:
        w, u = _speeds(r, position, span, i)
        n = min(len(w) - 1, len(u))
        if n < 2:
            continue
        small = 0.02 * float(np.max(np.abs(w), initial=0.0))
        sign = np.where(np.abs(w[:n]) > small, np.sign(w[:n]), 0.0)
        left.append(np.column_stack([w[:n], u[:n], -sign, np.ones(n)]))
        right.append(w[1 : n + 1])
    if not left:
        return None
    A, b = np.concatenate(left), np.concatenate(right)
    size = np.linalg.norm(A, axis=0)
    size[size == 0.0] = 1.0
    a, gain, level, load = np.linalg.lstsq(A / size, b, rcond=1e-9)[0] / size
    if gain == 0.0 or not 1e-3 < a < 1.0 - 1e-6:
        return None
    dt = records[0].dt
    K = gain / (1.0 - a)
    reach = max(float(np.max(np.abs(r.u[:, i]))) for r in records)
    return (
        K,
        float(-span * dt / np.log(a)),
        float(np.clip(level / gain, 0.0, 0.5 * reach)),
        float(-load / gain),
    )


def _steady(records: Sequence[Record], position: bool) -> tuple[str, Array, Array, Array, Array]:
    """Where differences say nothing: outputs over commands, and two samples."""
    ny, dt = records[0].ny, records[0].dt
    gains = []
    for i in range(ny):
        y = np.concatenate([np.diff(r.y[:, i]) / dt if position else r.y[1:, i] for r in records])
        u = np.concatenate([r.u[:-1, i] for r in records])
        gains.append(float(y @ u / max(float(u @ u), 1e-300)) or 1.0)
    return (
        "outputs over commands",
        np.array(gains),
        np.full(ny, 2.0 * dt),
        np.zeros(ny),
        np.zeros(ny),
    )
