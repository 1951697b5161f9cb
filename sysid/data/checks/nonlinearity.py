"""Test of a log for nonlinearity, made before any nonlinear model is fitted.

The best linear one-step predictor with many lags leaves errors that nothing linear in the past
predicts. If the plant is linear, nothing else in the past predicts them either; so products,
squares, cubes and absolute values of the lags are tried,

    e(t) = γᵀ r̃(t) + w(t),   r̃ = products of lags with all linear lags projected out.

γ is learned on some blocks of the log and tested on the next, never on the rows it was learned
from: each block gives Σ γ̂ᵀr̃ e over its standard deviation, and the sum over √blocks is the
statistic z. Unlike an F test of all products at once it does not care how many there are and how
heavy their tails.

On short logs of slow plants z is not quite standard normal: projections share rows, and lagged
outputs hold past errors. So the same number is computed from surrogate logs, which the fitted
linear predictor makes from the same inputs and its own shuffled errors, and z is judged by their
mean and spread. Calibration and power stand in ``reports/nonlinearity.md``.

Sources: Luukkonen, Saikkonen & Teräsvirta (1988) for the score test with products of lags; Dawid
(1984) for testing each block with what the blocks before it taught; Davison & Hinkley (1997),
§8.2, for surrogates from a fitted linear model.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sysid.data.checks.far_delay import NEAR, far_lags, first_seen
from sysid.data.impulse import chosen_order, orthonormal, regressors
from sysid.data.record import Array, Record, shortened
from sysid.errors import DataError

NONLINEAR = 0.01
"""Level of the test for nonlinearity, over all outputs."""

TRACE = 0.005
"""Share of the linear predictor's error below which a nonlinearity is but a trace."""

ROWS = 6_000
"""Samples looked at, as evenly spread pieces of the log: more would only find trifles."""

BLOCKS = 10
LEARNED = 3
"""Blocks that only teach; each later one is tested with what all before it have taught."""

RIDGE = 1e-2
"""Penalty on γ relative to the products' power: the share of noise a block may mistake for law."""

LAGS = 2
"""Lags of each output, and of each input its strongest ones, that enter products."""

MAX_SIGNALS = 8
SURROGATES = 40
MIN_SPREAD = 1.0
"""z has spread 1 on long logs; where surrogates say less they are not like the log."""

STRETCH = 200
"""Samples after which a surrogate starts again from the measured past: it must not drift away."""

ROWS_A_LAG = 12
"""Samples for each further lag around a long delay."""

MIN_SAMPLES = 150
KNOWN = 1e-11
"""Directions of the lags with less power than this share of the strongest are left out."""


@dataclass(frozen=True)
class NonlinearityTest:
    """Whether products of lags predict what the best linear predictor of one output leaves.

    Attributes:
        output: name of the output.
        statistic: z less its mean over the surrogates, over their spread.
        p_value: chance of a larger one if the plant is linear (one-sided).
        share: part of the linear predictor's error variance that the products predicted on blocks
            they were not learned from, 0 … 1.
        shape: the kind of product that carries most of it, in words.
        samples: samples looked at.
    """

    output: str
    statistic: float
    p_value: float
    share: float
    shape: str
    samples: int


def nonlinearity_tests(
    records: Sequence[Record], *, feedback: bool = False
) -> tuple[NonlinearityTest, ...]:
    """One test an output; experiments are pooled, each with its own means.

    Args:
        records: experiments with the same channels.
        feedback: whether a controller was running. The input of the same sample then reveals the
            measurement that it responds to, which is no law of the plant, and is left out.
    """
    records = shortened(records, ROWS)
    samples = sum(len(r) for r in records)
    first = records[0]
    order = _order(records) if samples >= MIN_SAMPLES else 0
    if not order:
        raise DataError(f"{first.name}: {samples} samples are too few to test for nonlinearity")
    windows = [w for row in first_seen(records) for w in row]
    far = far_lags(windows, max(order, NEAR))
    if len(far) * first.nu * ROWS_A_LAG > samples:  # the record is too short for so many lags
        far = far[:0]
    lags = np.union1d(np.arange(int(feedback), order + 1), far)
    measured = _Linear.of(records, order, lags)
    driven = measured.strongest(first.ny, first.nu)
    scores = [measured.scored(j, first.ny, driven) for j in range(first.ny)]
    rng = np.random.default_rng(0)
    null = np.zeros((SURROGATES, first.ny))
    for b, surrogate in enumerate(_surrogates(records, measured, rng)):
        refitted = _Linear.of(surrogate, order, lags)
        null[b] = [refitted.scored(j, first.ny, driven).z for j in range(first.ny)]
    tests = []
    for j, name in enumerate(first.output_names):
        spread = float(np.std(null[:, j], ddof=1)) * float(np.sqrt(1.0 + 1.0 / SURROGATES))
        z = (scores[j].z - float(np.mean(null[:, j]))) / max(spread, MIN_SPREAD)
        # mean and spread come from the surrogates themselves, hence Student's t
        p = float(special.stdtr(SURROGATES - 1, -z))
        tests.append(NonlinearityTest(name, z, p, scores[j].share, scores[j].shape, samples))
    return tuple(tests)


@dataclass(frozen=True, eq=False)
class _Score:
    z: float
    share: float
    shape: str


@dataclass(frozen=True, eq=False)
class _Linear:
    """The linear predictor of all outputs: scaled lags X, outputs Y, coefficients, errors."""

    order: int
    lags: NDArray[np.int64]
    X: Array
    Y: Array
    basis: Array
    theta: Array
    errors: Array

    @staticmethod
    def of(records: Sequence[Record], order: int, lags: NDArray[np.int64]) -> "_Linear":
        X, Y, _ = regressors(records, order, lags)
        scale = np.sqrt(np.mean(X**2, axis=0))
        scale[scale == 0.0] = 1.0
        basis, back = orthonormal(X, KNOWN)
        theta = back @ (basis.T @ Y)
        return _Linear(order, lags, X / scale, Y, basis, theta, Y - X @ theta)

    def strongest(self, ny: int, nu: int) -> list[list[int]]:
        """For each output the columns of X of each input's strongest lags."""
        width, order = len(self.lags), self.order
        power = np.abs(self.theta)
        strongest_columns = []
        for j in range(ny):
            columns = []
            for i in range(nu):
                at = ny * order + i * width
                columns += [at + int(k) for k in np.argsort(-power[at : at + width, j])[:LAGS]]
            strongest_columns.append(columns)
        return strongest_columns

    def scored(self, output: int, ny: int, driven: Sequence[Sequence[int]]) -> _Score:
        """z of one output."""
        order = self.order
        own_lags = [output * order + k for k in range(min(LAGS, order))]
        others = [i * order for i in range(ny) if i != output]
        room = max(MAX_SIGNALS - len(own_lags) - len(others), LAGS)
        chosen = [*own_lags, *driven[output][:room], *others]
        kinds = ["output"] * len(own_lags) + ["input"] * len(driven[output][:room])
        kinds += ["output"] * len(others)
        columns, labels = _products(self.X[:, chosen], kinds)
        before = np.sqrt(np.mean(columns**2, axis=0))
        for _ in range(2):  # the second pass takes away what rounding left of the first
            columns = columns - self.basis @ (self.basis.T @ columns)
        power = np.sqrt(np.mean(columns**2, axis=0))
        kept = power > 1e-5 * before
        e = self.errors[:, output]
        if not kept.any() or float(e @ e) <= 1e-20 * float(np.sum(self.Y[:, output] ** 2)):
            return _Score(0.0, 0.0, "nothing")
        names = [n for n, good in zip(labels, kept, strict=True) if good]
        return _judged(columns[:, kept] / power[kept], e, names)


def _judged(Z: Array, e: Array, labels: Sequence[str]) -> _Score:
    """Learn on the blocks so far, test on the next."""
    order, blocks = _blocks(len(e))
    Z, e = Z[order], e[order]
    G = [Z[rows].T @ Z[rows] for rows in blocks]
    right = [Z[rows].T @ e[rows] for rows in blocks]
    scores: list[float] = []
    explained = total = 0.0
    gram, moment, count = sum(G[:LEARNED]), sum(right[:LEARNED]), blocks[LEARNED].start
    for b in range(LEARNED, len(blocks)):
        gamma = _ridge(np.asarray(gram), np.asarray(moment), count)
        g, errors = Z[blocks[b]] @ gamma, e[blocks[b]]
        spread = float(np.linalg.norm(g * errors))
        if spread > 0.0:
            scores.append(float(g @ errors) / spread)
        explained += float(np.sum(errors**2 - (errors - g) ** 2))
        total += float(errors @ errors)
        gram, moment, count = gram + G[b], moment + right[b], count + len(errors)
    parts = _ridge(np.asarray(gram), np.asarray(moment), count) * moment
    shares: dict[str, float] = {}
    for label, part in zip(labels, parts, strict=True):
        shares[label] = shares.get(label, 0.0) + float(part)
    z = sum(scores) / float(np.sqrt(max(len(scores), 1)))
    shape = max(shares, key=lambda k: shares[k])
    return _Score(z, max(explained / total, 0.0) if total > 0.0 else 0.0, shape)


def _ridge(gram: Array, moment: Array, count: int) -> Array:
    return np.asarray(np.linalg.solve(gram + RIDGE * count * np.eye(len(gram)), moment))


def _products(v: Array, kinds: Sequence[str]) -> tuple[Array, list[str]]:
    """Squares, cubes, absolute values and products of signals of unit power, with their kinds."""
    columns: list[Array] = []
    labels: list[str] = []
    for k, what in enumerate(kinds):
        x = v[:, k]
        square, size = x * x, np.abs(x)
        columns += [square, size, square * x, x * size]
        labels += [f"even in the {what}"] * 2 + [f"odd in the {what}"] * 2
        for m in range(k):
            columns.append(x * v[:, m])
            same = kinds[m] == what
            labels.append(f"even in the {what}" if same else "of both input and output")
    return np.column_stack(columns), labels


def _blocks(rows: int) -> tuple[NDArray[np.int64], list[slice]]:
    """Rows of ten blocks, each four pieces from all over the log, in a fixed shuffled order.

    A law that shows at one level only is then met while learning and while testing.

    Returns:
        the rows, block after block, and where each block stands among them.
    """
    pieces = np.array_split(np.arange(rows), 4 * BLOCKS)
    order = np.random.default_rng(0).permutation(4 * BLOCKS)
    blocks = [np.concatenate([pieces[k] for k in np.sort(order[b::BLOCKS])]) for b in range(BLOCKS)]
    ends = np.cumsum([0, *map(len, blocks)])
    return np.concatenate(blocks), [slice(int(a), int(b)) for a, b in pairwise(ends)]


def _order(records: Sequence[Record]) -> int:
    """More lags than BIC asks for, so that no linear dynamics are left; 16 rows a coefficient."""
    order = chosen_order(records)
    if not order:
        return 0
    samples = sum(len(r) for r in records)
    most = samples // (16 * (records[0].nu + records[0].ny))
    return max(2, min(order + max(order // 2, 4), most))


def _surrogates(
    records: Sequence[Record], fit: _Linear, rng: np.random.Generator
) -> Iterator[list[Record]]:
    """The records with outputs that the linear predictor makes from shuffled errors, many times.

    Each stretch starts from the measured past; all stretches of all surrogates advance at once.
    """
    order, ny = fit.order, records[0].ny
    head = max(order, int(fit.lags[-1]))
    u_mean = [r.u[head:].mean(axis=0) for r in records]
    y_mean = [r.y[head:].mean(axis=0) for r in records]
    starts = [
        (k, a, min(a + STRETCH, len(r)))
        for k, r in enumerate(records)
        for a in range(head, len(r), STRETCH)
    ]
    longest = max(b - a for _, a, b in starts)
    A = fit.theta[: ny * order].reshape(ny, order, ny)
    B = fit.theta[ny * order :].reshape(records[0].nu, len(fit.lags), ny)
    y = np.zeros((order + longest, SURROGATES, len(starts), ny))
    forced = np.zeros((longest, len(starts), ny))
    drawn = rng.integers(0, len(fit.errors), (SURROGATES, longest, len(starts))).swapaxes(0, 1)
    for s, (k, a, b) in enumerate(starts):
        past = records[k].y[a - order : a] - y_mean[k]
        y[:order, :, s] = past[:, None]
        u = records[k].u[a - head : b] - u_mean[k]
        for at, lag in enumerate(fit.lags):
            forced[: b - a, s] += u[head - lag : len(u) - lag] @ B[:, at]
    back = A.transpose(1, 0, 2)[::-1].reshape(order * ny, ny)
    for t in range(longest):
        past = y[t : t + order].transpose(1, 2, 0, 3).reshape(-1, order * ny)
        free = (past @ back).reshape(SURROGATES, len(starts), ny)
        y[t + order] = free + forced[t] + fit.errors[drawn[t]]
    for each in range(SURROGATES):
        made = [r.y.copy() for r in records]
        for s, (k, a, b) in enumerate(starts):
            made[k][a:b] = y[order : order + b - a, each, s] + y_mean[k]
        yield [replace(r, y=m) for r, m in zip(records, made, strict=True)]
