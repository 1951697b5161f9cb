"""Fits of linear structures to frequency responses.

    θ̂ = argmin Σ_k Σ_ij |Ĝ_ij(ω_k) − G_ij(ω_k; θ)|² / σ²_ij(ω_k)

σ² is the response's own variance; where it has none, errors count relative to |Ĝ|, and their size
is read off the fit. Searches begin at rational approximations by Sanathanan & Koerner (1963, IEEE
Trans. Autom. Control 8, 56) for several dead times (Pintelon & Schoukens 2012, ch. 9); those of
state space at a subspace estimate.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.frequency_response import FrequencyResponse, read_frequency_response
from sysid.data.preprocess import Detrend
from sysid.data.record import Array
from sysid.errors import DataError, Termination, UsageError
from sysid.structures.continuous.instruments import Found, stable
from sysid.structures.continuous.structure import ContinuousStructure
from sysid.structures.linear.base import LinearStructure
from sysid.structures.linear.families import OE
from sysid.structures.linear.output_error import reflected
from sysid.structures.model import Model, Provenance
from sysid.structures.orders import parse_orders
from sysid.structures.registry import structure_class
from sysid.structures.state_space.innovations import StateSpace
from sysid.structures.state_space.response_subspace import from_response
from sysid.structures.state_space.structure import RealizedStructure

Complex = NDArray[np.complexfloating[Any, Any]]

ROUNDS = 15
"""Of reweighing a rational approximation."""

DELAYS = 25
"""Dead times that are tried, from none to ``LONGEST`` periods of the highest frequency."""

LONGEST = 6.0

STARTS = 3

FASTER = 10.0
"""A model of a response without a sample time is run so much faster than its highest frequency."""

PLENTY = 100_000
"""Samples of a log for which a structure tries all of its usual orders."""

LEAST = 1e-6
"""Least standard error, as a share of the largest response: the response's own rounding."""

AROUND, BELOW = 7, 0.5
"""A standard error is at least this share of the median of so many frequencies around it, or in
relation to the response where that is less. Of few averages an estimated variance may come out near
zero by chance, and would own the fit; at a resonance or a zero only one of the two falls."""


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A model of a frequency response.

    Attributes:
        error: weighed root mean square error; near 1 where the variance is known and the structure
            holds.
        relative: of |Ĝ − G| over |Ĝ|, root mean square.
        weighed: whether the response had a variance.
    """

    model: Model
    error: float
    relative: float
    weighed: bool


def fit_response(
    response: FrequencyResponse | str | Path,
    name: str,
    orders: Mapping[str, Any] | str | None = None,
    options: Mapping[str, str] | None = None,
    band: tuple[float, float] | None = None,
) -> ResponseFit:
    """Fit ``tf``, ``process``, ``oe`` or ``ss`` to a frequency response.

    Args:
        response: or its ``.frd.csv``.
        orders: of the structure, as text or a mapping; the best of its usual ones by BIC when None.
        options: of the structure, as text.
        band: lowest and highest frequency that count [Hz].

    Raises:
        UsageError: another structure, or a band without frequencies.
        DataError: there are fewer numbers than parameters.
    """
    if isinstance(response, str | Path):
        response = read_frequency_response(response)
    if isinstance(orders, str):
        orders = parse_orders(orders)
    cls = structure_class(name)
    if not issubclass(cls, ContinuousStructure | OE | StateSpace):
        raise UsageError(f"{name} is not fitted to frequency responses; tf, process, oe and ss are")
    if not issubclass(cls, ContinuousStructure) and response.sample_time is None:
        raise UsageError(
            f"{response.name} is a response in continuous time, and {name} steps from sample to "
            "sample; fit tf or process, or say its sample time"
        )
    response = _within(response, band)
    nu, ny = len(response.inputs), len(response.outputs)
    if issubclass(cls, StateSpace):  # a response says nothing of K
        options = {"noise": "none", **(options or {})}
    said = orders or cls.orders_said(options or {})
    grid = [said] if said else _usual(cls, nu, ny)
    fits = []
    for k, o in enumerate(grid):
        try:
            fits.append(_fitted(cls.from_orders(o, nu, ny, options), response))
        except DataError:  # more than the response shows
            if k + 1 == len(grid) and not fits:
                raise
    return min(fits, key=lambda f: round(_bic(f, response), 2))


def _usual(cls: Any, nu: int, ny: int) -> list[Mapping[str, Any]]:
    if issubclass(cls, OE):
        return [{"nb": n, "nf": n, "nk": 1} for n in (1, 2, 3, 4)]
    return list(cls.candidate_orders(nu, ny, PLENTY, None))


def _within(response: FrequencyResponse, band: tuple[float, float] | None) -> FrequencyResponse:
    low, high = band or (0.0, np.inf)
    kept = (response.frequency >= low) & (response.frequency <= high) & (response.frequency > 0.0)
    if not kept.any():
        raise UsageError(f"{response.name} has no frequency from {low:g} to {high:g} Hz")
    return replace(
        response,
        frequency=response.frequency[kept],
        value=response.value[kept],
        variance=None if response.variance is None else response.variance[kept],
        coherence=None if response.coherence is None else response.coherence[kept],
    )


def _sigma(response: FrequencyResponse) -> Array:
    """Standard errors; of a response without, its sizes."""
    size = np.abs(response.value)
    least = LEAST * float(size.max())
    if response.variance is None:
        return np.maximum(size, least)
    from scipy.ndimage import median_filter

    sigma = np.sqrt(np.maximum(np.nan_to_num(response.variance, posinf=1e30), least**2))
    size = np.maximum(size, least)
    near = [median_filter(e, (AROUND, 1, 1), mode="nearest") for e in (sigma, sigma / size)]
    return np.asarray(np.maximum(sigma, BELOW * np.minimum(near[0], near[1] * size)))


def _fitted(structure: Any, response: FrequencyResponse) -> ResponseFit:
    from scipy.optimize import least_squares

    dt = response.sample_time or 1.0 / (FASTER * response.frequency[-1])
    if isinstance(structure, ContinuousStructure):
        structure = replace(structure, dt=dt)
    sigma, w = _sigma(response), response.w
    of = _response_of(structure, w, response.sample_time)

    def errors(theta: Array) -> Array:
        with np.errstate(all="ignore"):
            e = np.sqrt(2.0) * ((response.value - of(theta)) / sigma).ravel()
        both = np.concatenate([e.real, e.imag])
        return np.asarray(np.nan_to_num(both, nan=1e6, posinf=1e6, neginf=-1e6))

    table = structure.parameters(response.inputs, response.outputs)
    low, high = (np.array([getattr(p, side) for p in table]) for side in ("lower", "upper"))
    numbers = 2 * response.value.size
    if numbers <= len(table):
        raise DataError(
            f"{response.name}: {numbers} numbers are too few for {len(table)} parameters"
        )
    inside = 1e-9 + np.zeros(len(table))
    found = []
    for start in _starts(structure, response, sigma):
        begin = np.clip(start, low + inside, high - inside)
        found.append(least_squares(errors, begin, bounds=(low, high), x_scale="jac"))
    best = min(found, key=lambda f: f.cost)
    error = float(np.sqrt(2.0 * best.cost / numbers))
    inflated = 1.0 if response.variance is not None else error**2 * numbers / (numbers - len(table))
    slopes = np.asarray(best.jac)
    covariance = inflated * np.linalg.pinv(slopes.T @ slopes)
    gone = np.abs(response.value - of(best.x)) / np.maximum(np.abs(response.value), 1e-300)
    at: Any = slice(None)
    if isinstance(structure, RealizedStructure):
        at = structure.in_order(best.x, table)
    model = Model(
        structure=structure,
        theta=best.x[at],
        covariance=covariance[at][:, at],
        parameters=table,
        dt=dt,
        inputs=response.inputs,
        outputs=response.outputs,
        detrend=Detrend.none(len(response.inputs), len(response.outputs)),
        noise_covariance=np.zeros((len(response.outputs),) * 2),
        n_estimated=len(table),
        criteria={},
        termination=Termination.CONVERGED_COST,
        provenance=Provenance(options={"response": response.name}),
    )
    relative = float(np.sqrt(np.mean(gone**2)))
    return ResponseFit(model, error, relative, response.variance is not None)


def _bic(fit: ResponseFit, response: FrequencyResponse) -> float:
    numbers = 2 * response.value.size
    misfit = (
        numbers * fit.error**2
        if fit.weighed
        else numbers * float(np.log(max(fit.error, 1e-12) ** 2))
    )
    return misfit + fit.model.n_estimated * float(np.log(numbers))


def _response_of(
    structure: LinearStructure, w: Array, sample_time: float | None
) -> Callable[[Array], Complex]:
    """θ → G at w, (nf, ny, nu)."""
    if isinstance(structure, ContinuousStructure) and sample_time is None:
        return lambda theta: structure.continuous_response(theta, w)
    assert sample_time is not None
    if isinstance(structure, RealizedStructure):
        z = np.exp(1j * w * sample_time)
        return lambda theta: structure.realization(theta).response(z)
    return lambda theta: structure.transfer(theta).response(w * sample_time)


def _starts(structure: Any, response: FrequencyResponse, sigma: Array) -> list[Array]:
    """θ of rational approximations of every path, at the dead times that suit each best."""
    nu, ny = len(response.inputs), len(response.outputs)
    if isinstance(structure, OE):
        return [_of_polynomials(structure, response, sigma)]
    if isinstance(structure, StateSpace):
        return [_of_subspace(structure, response, sigma)]
    longest = LONGEST / response.frequency[-1] if structure.delayed else 0.0
    delays = np.linspace(0.0, longest, DELAYS) if structure.delayed else np.zeros(1)
    every = []
    for i in range(ny):
        for j in range(nu):
            value, weight = response.value[:, i, j], 1.0 / sigma[:, i, j]
            tried = []
            for delay in delays.tolist():
                turned = value * np.exp(1j * response.w * delay)
                num, den, cost = _rational(
                    1j * response.w, turned, weight, structure.degree, structure.zeros
                )
                tried.append((cost, Found(num, den, delay)))
            tried.sort(key=lambda t: t[0])
            every.append([f for _, f in tried[:STARTS]])
    return [
        np.concatenate([structure.path_numbers(found[min(k, len(found) - 1)]) for found in every])
        for k in range(min(STARTS, len(delays)))
    ]


def _of_subspace(structure: StateSpace, response: FrequencyResponse, sigma: Array) -> Array:
    """θ of matrices."""
    assert response.sample_time is not None
    w = response.w * response.sample_time
    found = from_response(response.value, sigma, w, structure.n, structure.nk == 0)
    K = np.zeros((structure.n, structure.ny))
    theta = None if found is None else structure.theta_of((*found, K))
    if theta is None or not np.all(np.isfinite(theta)):
        raise DataError(
            f"{response.name} does not show {structure.n} states in ss; take fewer (`orders`)"
        )
    return theta


def _of_polynomials(structure: OE, response: FrequencyResponse, sigma: Array) -> Array:
    """θ of an output-error structure: a rational approximation in q⁻¹ of each path."""
    assert response.sample_time is not None
    q = np.exp(-1j * response.w * response.sample_time)
    theta = np.zeros(sum(structure.layout(i).n for i in range(structure.ny)))
    for i in range(structure.ny):
        lay = structure.layout(i)
        _, b, _, _, f = lay.slices()
        row = structure.row_index(i)
        for j in range(structure.nu):
            turned = response.value[:, i, j] / q ** lay.nk[j]
            num, den = _in_q(q, turned, 1.0 / sigma[:, i, j], lay.nb[j], lay.nf[j])
            theta[row[b[j]]], theta[row[f[j]]] = num, den
    return theta


def _rational(
    s: Complex, value: Complex, weight: Array, n: int, m: int
) -> tuple[Array, Array, float]:
    """b_0 … b_m, a_0 … a_{n−1} of Σ b s^k/(sⁿ + Σ a s^k), and its weighed error."""
    unit = float(np.sqrt(np.abs(s[0]) * np.abs(s[-1])))
    x = s / unit
    top, bottom = x[:, None] ** np.arange(m + 1), x[:, None] ** np.arange(n)
    found, cost = _reweighed(top, bottom, x**n, value, weight)
    num = found[: m + 1] * unit ** (n - np.arange(m + 1.0))
    den = found[m + 1 :] * unit ** (n - np.arange(float(n)))
    return num, stable(den), cost


def _in_q(q: Complex, value: Complex, weight: Array, nb: int, nf: int) -> tuple[Array, Array]:
    """b and f of Σ b q^−k/(1 + Σ f q^−k), k from 0 and from 1."""
    top, bottom = q[:, None] ** np.arange(nb), q[:, None] ** np.arange(1, nf + 1)
    theta, _ = _reweighed(top, bottom, np.ones_like(q), value, weight)
    return theta[:nb], reflected(np.append(1.0, theta[nb:]))[1:]


def _reweighed(
    top: Complex, bottom: Complex, lead: Complex, value: Complex, weight: Array
) -> tuple[Array, float]:
    """Real b and a with top b/(lead + bottom a) nearest to the values, and the weighed error.

    Linear least squares, weighed with the denominator of the round before.
    """
    last: Any = np.ones(len(value), dtype=np.complex128)
    best: tuple[Array, float] | None = None
    for _ in range(ROUNDS):
        w = weight / np.abs(last)
        A = np.hstack([top, -value[:, None] * bottom]) * w[:, None]
        theta = _solved(A, value * lead * w)
        den = lead + bottom @ theta[top.shape[1] :]
        last = np.where(np.abs(den) > 1e-12, den, 1e-12)
        gone = value - top @ theta[: top.shape[1]] / last
        cost = float(np.sum(np.abs(weight * gone) ** 2))
        if best is None or cost < best[1]:
            best = theta, cost
    assert best is not None
    return best


def _solved(A: Any, b: Any) -> Array:
    """Real least squares of complex equations."""
    whole, right = np.vstack([A.real, A.imag]), np.concatenate([b.real, b.imag])
    size = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(whole / size, right, rcond=1e-12)[0] / size)
