"""Billings & Voon's correlation tests of a nonlinear model's residuals.

Whiteness and independence from the input are not enough for a nonlinear model: residuals that hold
u² or u(t−1) e(t−1) may pass both. Billings & Voon (1986) ask in addition whether

    φ_ε(εu)(τ) = E ε(t) ε(t−τ) u(t−τ)        products of past errors and inputs predict ε,
    φ_(u²)'ε(τ) = E (u²(t−τ) − mean) ε(t)    even functions of the input predict ε,
    φ_(u²)'ε²(τ) = E (u²(t−τ) − mean) ε²(t)  the input predicts the size of ε,

beside φ_εε and φ_uε. Each is decided by one portmanteau number over all lags and inputs, in the
score form of ``residuals.py``: the model's Jacobian is projected out of the instruments, and the
covariance of the correlations comes from an AR(20) fit of ε (of ε² for its size), so that neither
what the parameters took nor coloured noise is mistaken for a nonlinearity. The band ±2.58/√N of
the literature holds for white inputs and residuals only. Of u² only what is left beside its best
straight line in u is taken. In φ_(u²)'ε² errors beyond 2.58 σ count as 2.58 σ: with heavy-tailed
noise a few of them would rule the sum.

Bands from simulated residuals of the fitted colour were tried and alarmed twice as often (lagged
outputs in the Jacobian hold past errors, which surrogates do not know); the score form holds its
level: ``reports/nonlinear_tests.md``.

Sources: Billings & Voon (1986), Int. J. Control 44; Billings (2013), §5.2.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.criteria.fit import Array, centred
from sysid.criteria.output_residuals import OutputResiduals
from sysid.criteria.verdicts import ResidualTest

LARGE = 2.58
"""Errors beyond so many standard deviations count as that many in their size."""

CONSTANT = 1e-10
"""Share of its power below which nothing is left of the square of an input."""

FURTHER = ("error products", "input squares", "error size")


def further_tests(given: OutputResiduals, *, noise_model: bool = True) -> tuple[ResidualTest, ...]:
    """The three tests that nonlinear models must stand beside the linear ones, as in ``FURTHER``.

    Args:
        noise_model: False for structures without one: products of errors are then reported but
            not judged (coloured residuals fail).
    """
    # the size is flat in θ where ε is independent of the past: nothing to project out
    none = [np.zeros((len(e), 0)) for e in given.known]
    size = replace(given, known=_sizes(given.known), jacobian=none, uncertain=none)
    squares = _squares(given.inputs)
    products = [e[:, None] * u for e, u in zip(given.filled, given.inputs, strict=True)]
    last = given.affordable()
    return tuple(
        residuals.tested(
            name, _SAYS[name], signals, range(first, last + 1), noise=noise, judged=judged
        )
        for name, residuals, signals, first, noise, judged in (
            ("error products", given, products, 1, None, noise_model),
            ("input squares", given, squares, 0, given.noise, True),
            ("error size", size, squares, 0, size.noise, True),
        )
    )


def _squares(us: Sequence[Array]) -> list[Array]:
    """u² less its best straight line in u, zero where nothing is left of it (two levels).

    The square of an input that is not symmetric holds the input itself: what is linear would then
    be mistaken for even.
    """
    squares = [centred(u**2) for u in us]
    power = sum(np.sum(u**2, axis=0) for u in us)
    slope = sum(np.sum(s * u, axis=0) for s, u in zip(squares, us, strict=True))
    slope = np.divide(slope, power, out=np.zeros_like(slope), where=power > 0.0)
    nonlinear_parts = [s - slope * u for s, u in zip(squares, us, strict=True)]
    remaining = sum(np.sum(f**2, axis=0) for f in nonlinear_parts)
    whole = sum(np.sum(u**4, axis=0) for u in us)
    return [f * (remaining > CONSTANT * whole) for f in nonlinear_parts]


def _sizes(known: Sequence[Array]) -> list[Array]:
    """ε² with large errors cut, each record's mean removed, NaN where missing."""
    every = np.concatenate([e[~np.isnan(e)] for e in known])
    largest = LARGE**2 * float(np.mean(every**2))
    return [centred(np.minimum(e**2, largest)) for e in known]


_SAYS = {
    "error products": (
        "Products of past residuals and inputs do not predict {output} ({p}).",
        "Past residuals of {output} times {signal} predict it ({p}), most {lag} samples earlier: "
        "products of output and input are missing, or noise terms with the input.",
        "No product of residual and input can be tested on {output}.",
    ),
    "input squares": (
        "The residuals of {output} do not depend on squares of past inputs ({p}).",
        "The residuals of {output} depend on the square of {signal} ({p}), mostly {lag} "
        "samples earlier: even terms of the input are missing (a square, an absolute value).",
        "The squares of the inputs are constant (two levels): they cannot be tested on {output}.",
    ),
    "error size": (
        "The size of the residuals of {output} does not depend on the inputs ({p}).",
        "The size of the residuals of {output} depends on {signal} ({p}), mostly {lag} "
        "samples earlier: a nonlinear term is missing, or the noise depends on the input.",
        "The squares of the inputs are constant (two levels): the size of the residuals of "
        "{output} cannot be tested.",
    ),
}
