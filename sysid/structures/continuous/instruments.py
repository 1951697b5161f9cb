"""Starts of continuous-time models: refined instrumental variables at several dead times (SRIVC).

Of A(s) x = Σ_j B_j(s) u_j e^{−τ s} with y = x + noise, filtered by 1/A of the last round, the
highest derivative is a linear combination of lower ones. With instruments from the simulated x the
noise does not bias it (Young & Jakeman 1980, Int. J. Control 31, 741; Garnier & Wang 2008, ch. 4).
The first filter is 1/(s + λ)ⁿ, at several λ.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sysid.data.record import Array
from sysid.structures.continuous.channel import companion, held
from sysid.structures.state_space.realization import run

ROUNDS, FEW = 10, 3
"""Rounds of refinement, and those that show whether a dead time is worth them."""

CUT_OFFS = (0.02, 0.08, 0.3)
"""First filters: λ as a share of the Nyquist frequency."""

DEAD_TIMES = (*range(13), 14, 16, 18, 21, 24, 28, 33, 40, 50, 60, 75, 90, 110, 135, 165, 200)
"""Dead times that are tried first [samples]. With a zero the error has several minima over them,
the deepest no wider than the fastest time constant."""

LONGEST = 5_000
"""Samples of a record from which starts are found."""

KEPT = 3
"""Starts that are handed on."""

SAME = 1e-4
"""Relative change at which the rounds end."""

Rows = Sequence[tuple[Array, Array]]
"""(u (N, nu), y (N,)) of each record."""


@dataclass(frozen=True, eq=False)
class Found:
    """A transfer function that was found: b_0 … b_m, a_0 … a_{n−1} and τ [s]."""

    num: Array
    den: Array
    delay: float


@dataclass(frozen=True, eq=False)
class FoundRow:
    """The paths to one output, with one denominator.

    Attributes:
        level: of the output where all inputs are zero.
        cost: mean squared error of the free run.
        how: in words.
    """

    paths: tuple[Found, ...]
    level: float
    cost: float
    how: str


def found_paths(
    rows: Rows, n: int, m: int, dt: float, delayed: bool, level: bool
) -> tuple[FoundRow, ...]:
    """Transfer functions of one output at the best dead times, best first.

    Kept, as many shapes of process models ask for the same.
    """
    some = [np.column_stack([u[:LONGEST], y[:LONGEST]]) for u, y in rows]
    asked = tuple((len(r), r.tobytes()) for r in some)
    return _found_paths(asked, n, m, dt, delayed, level)


@lru_cache(64)
def _found_paths(
    asked: tuple[tuple[int, bytes], ...], n: int, m: int, dt: float, delayed: bool, level: bool
) -> tuple[FoundRow, ...]:
    """The same of records given by their length and the bytes of inputs and output."""
    tables = [np.frombuffer(whole).reshape(length, -1) for length, whole in asked]
    rows = [(r[:, :-1], r[:, -1]) for r in tables]
    shortest = min(len(y) for _, y in rows)
    tried: dict[int, FoundRow] = {}
    every = [_filter(s, n, dt) for s in CUT_OFFS]

    def at(d: int) -> float:
        if d not in tried:
            best = min(tried.values(), key=lambda f: f.cost, default=None)
            # the filter of a wrong dead time may lead into the wrong minimum
            first = [best.paths[0].den, every[1]] if best else every
            tried[d] = _at_dead_time(rows, first, m, dt, d, level, FEW)
        return tried[d].cost

    lags = [d for d in DEAD_TIMES if d < shortest // 4] if delayed else [0]
    best = min(lags, key=at)
    low = max([d for d in lags if d < best], default=best)
    high = min([d for d in lags if d > best], default=best)
    while high - low > 2:
        below, above = (low + best) // 2, (best + high + 1) // 2
        new = min((below, best, above), key=at)
        low, high = (low, best) if new < best else (best, high) if new > best else (below, above)
        best = new
    kept = sorted(tried, key=at)[:KEPT]
    full = [_at_dead_time(rows, [tried[d].paths[0].den], m, dt, d, level, ROUNDS) for d in kept]
    return tuple(sorted(full, key=lambda f: f.cost))


def _filter(share: float, n: int, dt: float) -> Array:
    """(s + λ)ⁿ, λ a share of the Nyquist frequency."""
    return np.asarray(np.poly([-share * np.pi / dt] * n), dtype=np.float64)[:0:-1]


def _at_dead_time(
    rows: Rows, first: Sequence[Array], m: int, dt: float, d: int, level: bool, rounds: int
) -> FoundRow:
    """The best from several first filters."""
    delayed = [(_later(u, d), y) for u, y in rows]
    found = (_refined(delayed, den, m, dt, d, level, rounds) for den in first)
    return min(found, key=lambda f: f.cost)


def _refined(
    rows: Rows, den: Array, m: int, dt: float, d: int, level: bool, rounds: int
) -> FoundRow:
    """The best of the rounds from one first filter."""
    nu, best = rows[0][0].shape[1], None
    instruments: list[Array] | None = None
    for _ in range(rounds):
        last = den
        left, right, sides = [], [], []
        for k, (u, y) in enumerate(rows):
            own, top = derivatives(y, den, dt)
            inputs = [derivatives(column, den, dt, hold=True)[0][:, : m + 1] for column in u.T]
            constant = [np.ones((len(y), 1))] if level else []
            left.append(np.hstack([-own, *inputs, *constant]))
            right.append(top)
            if instruments is not None:
                clean = derivatives(instruments[k], den, dt)[0]
                sides.append(np.hstack([-clean, *inputs, *constant]))
        L, r = np.concatenate(left), np.concatenate(right)
        Z = np.concatenate(sides) if sides else L
        scale = np.maximum(np.linalg.norm(L, axis=0), 1e-300)
        solved = np.linalg.lstsq((Z / scale).T @ (L / scale), (Z / scale).T @ r, rcond=1e-13)[0]
        solved = solved / scale
        n = len(den)
        den = stable(solved[:n])
        nums = solved[n : n + nu * (m + 1)].reshape(nu, m + 1)
        instruments = [_clean(u, nums, den, dt) for u, _ in rows]
        paths = tuple(Found(num, den, d * dt) for num in nums)
        row = _judged(rows, instruments, paths, d, level)
        if best is None or row.cost < best.cost:
            best = row
        if np.linalg.norm(den - last) < SAME * np.linalg.norm(den):
            break
    assert best is not None
    return best


def _judged(
    rows: Rows, runs: Sequence[Array], paths: tuple[Found, ...], d: int, level: bool
) -> FoundRow:
    """The paths with the error of their free runs; the level that suits the outputs best."""
    e = np.concatenate([y - run for (_, y), run in zip(rows, runs, strict=True)])
    offset = float(np.mean(e)) if level else 0.0
    cost = float(np.mean((e - offset) ** 2))
    how = f"instrumental variables, dead time {d} samples" if d else "instrumental variables"
    return FoundRow(paths, offset, cost if np.isfinite(cost) else np.inf, how)


def _clean(u: Array, nums: Array, den: Array, dt: float) -> Array:
    """The simulated output of the paths, (N,)."""
    n = len(den)
    with np.errstate(all="ignore"):
        A, B = held(*companion(den), dt)
        C = np.zeros((n, len(nums)))
        C[: nums.shape[1]] = nums.T
        # the poles are common: with A, B and C turned round, one run for all inputs
        out: Array = run((A.T, C, B.T, np.zeros((1, len(nums)))), u)[:, 0]
    return np.nan_to_num(out, nan=1e100, posinf=1e100, neginf=-1e100)


def derivatives(x: Array, den: Array, dt: float, hold: bool = False) -> tuple[Array, Array]:
    """s^i/A(s) x for i < n, (N, n), and sⁿ/A(s) x, (N,).

    Args:
        hold: whether x is held between samples; else it goes straight from one to the next.
    """
    n, (A, B) = len(den), companion(den)
    start = x[0] if len(x) else 0.0
    x = x - start  # the filter was at rest at the first value
    power, over = held(A, B, dt)
    if hold:
        states = run((power, over, np.eye(n), np.zeros((n, 1))), x[:, None])
    else:
        ramp = _over_ramp(A, B, dt)
        inputs = np.column_stack([x, np.append(np.diff(x) / dt, 0.0)])
        states = run((power, np.hstack([over, ramp]), np.eye(n), np.zeros((n, 2))), inputs)
    rest = np.zeros(n)
    if den[0]:
        rest[0] = start / den[0]
    states = states + rest
    return states, x + start - states @ den


def _over_ramp(A: Array, B: Array, time: float) -> Array:
    """∫₀ᵗ e^{A(t−s)} B s ds."""
    n = len(A)
    wide = np.zeros((n + 1, n + 1))
    wide[:n, :n], wide[:n, n:] = A, B
    unit = np.zeros((n + 1, 1))
    unit[-1, 0] = 1.0
    _, over = held(wide, unit, time)
    return np.asarray(over[:n])


def stable(den: Array) -> Array:
    """A with the roots of the right half plane mirrored."""
    roots = np.roots([1.0, *den[::-1]]) if np.all(np.isfinite(den)) else np.full(len(den), -1.0)
    right = roots.real > 0.0
    roots[right] = -np.conj(roots[right])
    return np.asarray(np.real(np.poly(roots)))[:0:-1]


def _later(u: Array, d: int) -> Array:
    """u(t − d), held before its first sample."""
    return np.concatenate([np.repeat(u[:1], d, axis=0), u])[: len(u)] if d else u
