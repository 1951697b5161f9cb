"""Best linear approximation of a log: where every block-oriented fit starts.

The best linear approximation of a nonlinear system is the linear model with the smallest error
for inputs like those of the log; for Gaussian-like inputs its poles are those of the system's
linear blocks (Bussgang 1952; Pintelon & Schoukens 2012, ch. 3).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, hankel

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record
from sysid.fitting.normal_equations import scaled_solution
from sysid.fitting.problem import Focus
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.static.functions import IDENTITY
from sysid.structures.blocks.trials import ChainData, Effort, Trial
from sysid.structures.linear.families import OE
from sysid.structures.linear.output_error import reflected
from sysid.structures.linear.starts import starts_of
from sysid.structures.orders import Orders, spread

DECAYS = (0.8, 0.9, 0.95, 0.98, 0.99)
RIDGES = (1e-6, 1e-4, 1e-2, 1.0)
"""Decay per lag and strength of the prior on the impulse response; the evidence chooses."""

LONGEST_RESPONSE = 160
"""Lags of all inputs together."""


def centred(records: Sequence[Record]) -> tuple[Record, ...]:
    """The records about their joint means, for linear models of logs with offsets."""
    u = np.concatenate([r.u for r in records]).mean(axis=0)
    y = np.concatenate([r.y for r in records]).mean(axis=0)
    return tuple(replace(r, u=r.u - u, y=r.y - y, sha256="-") for r in records)


def linear_starts(records: Sequence[Record], orders: Orders) -> list[tuple[str, dict[str, float]]]:
    """Named output-error models of these orders, as parameter name → value.

    SRIV, ARX and where they are doubtful a grid of poles (see ``initial``), and the poles of the
    regularised impulse response; all about the means of the records.
    """
    middle = centred(records)
    structure = OE(orders)
    names = [p.name for p in structure.parameters(records[0].inputs, records[0].outputs)]
    return [
        (kind, dict(zip(names, theta.tolist(), strict=True)))
        for kind, theta in starts_of(structure, middle, Focus.SIMULATION)
    ]


def _impulse_response(records: Sequence[Record], output: int, lags: int) -> Array:
    """Regularised impulse responses from all inputs to one output, (nu, lags), by the evidence.

    min ‖y − Φ g‖² + σ² gᵀ P⁻¹ g with P the tuned-correlated kernel c·λ^max(k,l) (Chen, Ohlsson &
    Ljung 2012, Automatica 48); λ and c/σ² from a grid by marginal likelihood.
    """
    nu = records[0].nu
    gram = np.zeros((nu * lags, nu * lags))
    right = np.zeros(nu * lags)
    power, samples = 0.0, 0
    for r in centred(records):
        first = min(lags - 1, max(len(r) - lags, 0))
        phi = np.concatenate(
            [
                np.lib.stride_tricks.sliding_window_view(
                    np.concatenate([np.zeros(lags - 1), r.u[:, j]]), lags
                )[first:, ::-1]
                for j in range(nu)
            ],
            axis=1,
        )
        target = r.y[first:, output]
        gram += phi.T @ phi
        right += phi.T @ target
        power += float(target @ target)
        samples += len(target)
    best: tuple[float, Array] = (np.inf, np.zeros(nu * lags))
    level = max(float(np.trace(gram)) / (nu * lags), 1e-300)
    k = np.arange(1, lags + 1)
    for decay in DECAYS:
        kernel = decay ** np.maximum(k[:, None], k[None, :])
        root = np.linalg.cholesky(kernel + 1e-12 * np.eye(lags))
        L = np.kron(np.eye(nu), root)
        inside = L.T @ gram @ L
        for ridge in RIDGES:
            shift = ridge * level
            factor = cho_factor(inside + shift * np.eye(nu * lags), lower=True)
            g = L @ cho_solve(factor, L.T @ right)
            # marginal likelihood with σ² profiled out
            unexplained = max(power - float(right @ g), 1e-300)
            logdet = 2.0 * float(np.sum(np.log(np.diag(factor[0])))) - nu * lags * np.log(shift)
            evidence = samples * np.log(unexplained / samples) + logdet
            if evidence < best[0]:
                best = (evidence, g)
    return best[1].reshape(nu, lags)


def _realised_denominator(responses: Array, order: int) -> Array:
    """Denominator 1 + f₁q⁻¹ + … of order ``order`` behind impulse responses (m, lags).

    Ho & Kalman (1966) with the singular value decomposition of Kung (1978): the shift of the
    observability range of the Hankel matrix; poles outside the unit circle are reflected.
    """
    lags = responses.shape[1]
    rows = lags // 2
    blocks = [hankel(h[1 : rows + 1], h[rows:lags]) for h in responses]
    U, s, _ = np.linalg.svd(np.concatenate(blocks, axis=1), full_matrices=False)
    seen = U[:, :order] * np.sqrt(s[:order])
    A = np.linalg.lstsq(seen[:-1], seen[1:], rcond=None)[0]
    return reflected(np.real(np.poly(np.linalg.eigvals(A))))


def input_denominators(
    records: Sequence[Record], orders: Sequence[int], *, refine: bool
) -> list[Array]:
    """For each input the denominator of that order behind its responses in all outputs.

    Regularised impulse responses, realised; with ``refine`` then
    fitted as an output-error model where there is one input and one output.
    """
    longest = max((len(r) for r in records), default=1)
    lags = int(min(LONGEST_RESPONSE // max(records[0].nu, 1), longest // 4))
    lags = max(lags, 2 * max(orders) + 4)
    responses = [_impulse_response(records, i, lags) for i in range(records[0].ny)]
    single = records[0].nu == records[0].ny == 1
    denominators = []
    for j, order in enumerate(orders):
        denominator = _realised_denominator(np.array([g[j] for g in responses]), order)
        denominators.append(_refined(records, denominator) if refine and single else denominator)
    return denominators


def _refined(records: Sequence[Record], denominator: Array) -> Array:
    """The denominator after a fit of the output-error model that starts from it."""
    order = len(denominator) - 1
    middle = centred(records)
    gram, right = np.zeros((order + 2, order + 2)), np.zeros(order + 2)
    for r in middle:
        x = np.ones((order + 2, len(r)))
        base = lfilter([1.0], denominator, r.u[:, 0])
        for lag in range(order + 1):
            x[lag, :lag], x[lag, lag:] = 0.0, base[: len(r) - lag]
        gram += x @ x.T
        right += x @ r.y[:, 0]
    b = scaled_solution(gram, right)
    orders = spread({"nb": order + 1, "nf": order, "nk": 0}, "bf", 1, 1, OE.name)
    start = Trial(
        HammersteinWiener((orders,), ((IDENTITY,), (IDENTITY,))),
        np.concatenate([b[:-1], denominator[1:], [0.0]]),
    )
    theta = start.descended(ChainData.of(middle), Effort(60, 1e-6)).theta
    return np.concatenate([[1.0], theta[order + 1 : -1]])
