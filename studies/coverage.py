"""Are the standard errors honest: do 95 % intervals cover the truth, is it ever 4 of them away?

Simulates records of known systems, fits the right structure to each with the default options and
counts, parameter by parameter, how often estimate ± 1.96 standard errors holds the truth. Some
minutes of one core.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from studies.runner import Study, by_case
from sysid.data.record import Record
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.report.markdown import table
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.registry import structure_class

Array = NDArray[np.float64]
STUDY = Study("coverage", "coverage.md", runs=400)

RUN_IN = 300
"""Samples simulated before a record begins, so that none of them starts at rest."""

OUTLIER = 10.0
"""Size of a wrong reading in standard deviations of the white noise."""

NORMAL_95 = 1.959964


@dataclass(frozen=True)
class Case:
    """A true system, its noise, and the structure that is fitted.

    Attributes:
        name: row of the table.
        structure, orders: what is fitted.
        theta: the truth, in the structure's order.
        noise: white noise e (N, ny) to the disturbance added to the free run, where the fitted
            structure has no noise model of its own; None takes the structure's own.
        sigma: standard deviation of e.
        samples: length of a record.
        nu, ny: numbers of inputs and outputs.
        slow: whether the input is an AR(1) process with pole 0.9 instead of white.
        options: how it is fitted; parameters that these fix are not counted.
        outliers: share of the readings that are wrong by ten times sigma.
    """

    name: str
    structure: str
    orders: dict[str, object]
    theta: tuple[float, ...]
    noise: Callable[[Array], Array] | None = None
    sigma: float = 0.3
    samples: int = 1000
    nu: int = 1
    ny: int = 1
    slow: bool = False
    options: FitOptions = field(default_factory=FitOptions)
    outliers: float = 0.0

    def fitted(self) -> PolynomialStructure:
        """The structure that is fitted; it holds the truth."""
        found = structure_class(self.structure).from_orders(self.orders, self.nu, self.ny)
        assert isinstance(found, PolynomialStructure)
        return found


def _ar1(e: Array) -> Array:
    return np.asarray(lfilter([1.0], [1.0, -0.9], e, axis=0))


def _arma(e: Array) -> Array:
    return np.asarray(lfilter([1.0, 0.6], [1.0, -1.3, 0.8], e, axis=0))


A, B, C = (-1.5, 0.7), (1.0, 0.5), (-0.9, 0.3)
SISO: dict[str, object] = {"na": 2, "nb": 2, "nk": 1}
OE: dict[str, object] = {"nb": 2, "nf": 2, "nk": 1}
ROW1 = (-1.2, 0.5, 1.0, 0.5, -0.6, 0.4)
ROW2 = (-1.0, 0.4, 0.3, -0.2, 0.8, 0.1)

CASES = (
    Case("ARX", "arx", SISO, (*A, *B)),
    Case("ARX, 2 inputs, 2 outputs", "arx", SISO, (*ROW1, *ROW2), nu=2, ny=2),
    Case(
        "ARX, coupled outputs",
        "arx",
        {"na": [[1, 1], [1, 1]], "nb": 1},
        (-0.7, 0.2, 1.0, 0.4, 0.1, -0.8, 0.3, 1.0),
        nu=2,
        ny=2,
    ),
    Case("ARMAX", "armax", SISO | {"nc": 2}, (*A, *B, *C)),
    Case("ARMAX, slow input", "armax", SISO | {"nc": 2}, (*A, *B, *C), slow=True),
    Case(
        "ARMAX, 2 inputs, 2 outputs",
        "armax",
        SISO | {"nc": 1},
        (*ROW1, -0.7, *ROW2, 0.6),
        nu=2,
        ny=2,
    ),
    Case("OE, white noise", "oe", OE, (*B, *A)),
    Case("OE, AR(1) noise 0.9", "oe", OE, (*B, *A), noise=_ar1),
    Case("OE, resonant noise", "oe", OE, (*B, *A), noise=_arma),
    Case("OE, AR(1) noise, slow input", "oe", OE, (*B, *A), noise=_ar1, slow=True),
    Case(
        "OE, fast-sampled motor",
        "oe",
        OE,
        (0.01, 0.009, -1.88, 0.882),
        sigma=0.05,
        slow=True,
    ),
    Case(
        "OE, 2 inputs, 2 outputs, AR(1) noise",
        "oe",
        {"nb": 1, "nf": 1},
        (1.0, 0.5, -0.8, -0.5, -0.4, 1.0, -0.6, -0.9),
        noise=_ar1,
        nu=2,
        ny=2,
    ),
    Case("BJ", "bj", OE | {"nc": 1, "nd": 1}, (*B, 0.5, -0.9, *A)),
    Case(
        "BJ, second-order noise",
        "bj",
        OE | {"nc": 2, "nd": 2},
        (*B, 0.4, 0.3, -1.2, 0.5, *A),
        samples=2000,
    ),
    Case(
        "BJ, 2 inputs, 2 outputs",
        "bj",
        {"nb": 1, "nf": 1, "nc": 1, "nd": 1},
        (1.0, 0.5, 0.4, -0.8, -0.8, -0.5, -0.4, 1.0, -0.3, -0.9, -0.6, -0.9),
        nu=2,
        ny=2,
    ),
    Case("ARX, a1 fixed", "arx", SISO, (*A, *B), options=FitOptions(fixed={"a1": A[0]})),
    Case(
        "OE, AR(1) noise 0.9, f1 fixed",
        "oe",
        OE,
        (*B, *A),
        noise=_ar1,
        options=FitOptions(fixed={"f1": A[0]}),
    ),
    Case(
        "ARX, a2 within bounds",
        "arx",
        SISO,
        (*A, *B),
        options=FitOptions(bounds={"a2": (0.5, 0.9)}),
    ),
    Case(
        "OE, AR(1) noise 0.9, f2 within bounds",
        "oe",
        OE,
        (*B, *A),
        noise=_ar1,
        options=FitOptions(bounds={"f2": (0.5, 0.9)}),
    ),
    Case(
        "ARX, robust, 2 % outliers",
        "arx",
        SISO,
        (*A, *B),
        options=FitOptions(robust=True),
        outliers=0.02,
    ),
    Case(
        "OE, robust, 2 % outliers",
        "oe",
        OE,
        (*B, *A),
        options=FitOptions(robust=True),
        outliers=0.02,
    ),
    Case(
        "BJ, robust, 2 % outliers",
        "bj",
        OE | {"nc": 1, "nd": 1},
        (*B, 0.5, -0.9, *A),
        options=FitOptions(robust=True),
        outliers=0.02,
    ),
)


def simulated(case: Case, seed: int) -> Record:
    """One record of the case: free run plus disturbance, cut out of a longer experiment."""
    rng = np.random.default_rng((seed, sum(case.name.encode())))
    n = case.samples + RUN_IN
    u = rng.standard_normal((n, case.nu))
    if case.slow:
        u = np.asarray(lfilter([np.sqrt(0.19)], [1.0, -0.9], u, axis=0))
    e = case.sigma * rng.standard_normal((n, case.ny))
    structure, theta = case.fitted(), np.array(case.theta)
    y = structure.simulate(theta, u)
    if case.noise is not None:
        y = y + case.noise(e)
    else:
        h = structure.noise_response(theta, RUN_IN)
        for i in range(case.ny):
            for j in range(case.ny):
                y[:, i] += lfilter(h[:, i, j], [1.0], e[:, j])
    wrong = rng.random(y.shape) < case.outliers
    y = y + np.where(wrong, rng.choice([-OUTLIER, OUTLIER], y.shape) * case.sigma, 0.0)
    return Record(u[RUN_IN:], y[RUN_IN:], 0.1)


def standardised(case: Case, seed: int) -> Array:
    """(estimate − truth)/standard error of every parameter that is not fixed."""
    model = fit(case.fitted(), [simulated(case, seed)], case.options)
    free = [k for k, p in enumerate(model.parameters) if p.name not in case.options.fixed]
    errors = np.sqrt(np.diag(model.covariance))
    return np.asarray((model.theta - np.array(case.theta)) / errors)[free]


@dataclass(frozen=True)
class Outcome:
    """What the records of one case gave.

    Attributes:
        pooled: share of all intervals that hold the truth [%].
        lowest, highest: the same of the parameter with the fewest and the most [%].
        beyond: share of estimates more than four standard errors away [%].
        spread: standard deviation of the standardised errors, 1 where they are honest.
    """

    pooled: float
    lowest: float
    highest: float
    beyond: float
    spread: float


def one(name: str, seed: int) -> list[float]:
    """One record of a case."""
    return standardised(next(c for c in CASES if c.name == name), seed).tolist()


def outcome(draws: Sequence[Sequence[float]]) -> Outcome:
    """Count over the standardised errors of the records of a case; an estimate on a bound holds no
    interval."""
    z = np.array(draws)
    held = 100.0 * np.mean(np.abs(z) <= NORMAL_95, axis=0)
    return Outcome(
        float(held.mean()),
        float(held.min()),
        float(held.max()),
        float(100.0 * np.mean(~(np.abs(z) <= 4.0))),
        float(z.std()),
    )


def row(case: Case, draws: Sequence[Sequence[float]]) -> list[str]:
    """A line of the report."""
    found = outcome(draws)
    return [
        case.name,
        str(case.samples),
        str(len(case.theta) - len(case.options.fixed)),
        f"{found.pooled:.1f}",
        f"{found.lowest:.1f} … {found.highest:.1f}",
        f"{found.beyond:.2f}",
        f"{found.spread:.2f}",
    ]


def main() -> None:
    """Run the study and write its report."""
    asked = STUDY.asked(__doc__)
    found = by_case(one, [c.name for c in CASES], asked)
    headers = [
        "system",
        "samples",
        "parameters",
        "covered",
        "per parameter",
        "beyond 4 σ̂",
        "spread",
    ]
    rows = [row(c, found[c.name]) for c in CASES if c.name in found]
    text = HEAD.format(records=asked.runs, error=100.0 * np.sqrt(0.95 * 0.05 / asked.runs))
    STUDY.write(asked, text + "\n" + table(headers, rows, "lrrrrrr"))


HEAD = """# Coverage of the confidence intervals

{records} simulated records a line, cut out of a longer experiment; every fit with the default
options. *Covered* is the share [%] of 95 % intervals that hold the truth, over all parameters and
for the worst and best single parameter (standard error of one parameter's figure: {error:.1f});
*beyond 4 σ̂* the share [%] of estimates more than four standard errors away; *spread* the standard
deviation of (estimate − truth)/standard error, 1 where the standard errors are honest. An OE model
of data with coloured noise has no noise model: its intervals come from the sandwich form. Lines
with a fixed parameter count the others; *outliers* are readings wrong by ten times the white noise.
"""

if __name__ == "__main__":
    main()
