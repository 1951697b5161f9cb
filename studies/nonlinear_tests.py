"""Alarm rates of Billings & Voon's tests on right and wrong nonlinear models.

Right models alarm as often as the level says; wrong ones are what the tests are for. Every model is
fitted by (iterated) least squares to each simulated log, so that what the fit absorbs is in.
"""

from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter

from studies.runner import Study, by_case, fewer
from sysid.criteria.fit import Array
from sysid.criteria.nonlinear import further_tests
from sysid.criteria.output_residuals import OutputResiduals
from sysid.criteria.residuals import whiteness_test
from sysid.report.markdown import table

STUDY = Study("nonlinear_tests", "nonlinear_tests.md", runs=400)
TESTS = ("whiteness", "independence", "error products", "input squares", "error size")


@dataclass(frozen=True)
class Fitted:
    """Residuals, input and Jacobian of a model fitted to a simulated log."""

    errors: Array
    inputs: Array
    jacobian: Array


Draw = Callable[[Generator, int], Fitted]


@dataclass(frozen=True)
class Case:
    """A truth with a model, and whether the model has a noise model."""

    name: str
    draw: Draw
    noise_model: bool = True


def signal(rng: Generator, samples: int, kind: str) -> Array:
    """White, slow (pole 0.9), stepwise or two-level input of about unit size."""
    if kind == "white":
        return rng.standard_normal(samples)
    if kind == "slow":
        return np.asarray(lfilter([np.sqrt(0.19)], [1.0, -0.9], rng.standard_normal(samples)))
    if kind == "steps":
        return np.repeat(rng.uniform(-1.7, 1.7, samples // 10 + 1), 10)[:samples]
    return np.repeat(rng.choice([-1.0, 1.0], samples // 5 + 1), 5)[:samples]


def least_squares(columns: list[Array], y: Array, first: int) -> tuple[Array, Array]:
    """Errors (NaN where columns are unknown) and the columns."""
    Phi = np.column_stack(columns)
    theta = np.linalg.lstsq(Phi[first:], y[first:], rcond=None)[0]
    errors = y - Phi @ theta
    errors[:first] = np.nan
    return errors, Phi


def back(x: Array, lag: int) -> Array:
    out = np.zeros_like(x)
    out[lag:] = x[: len(x) - lag]
    return out


def narx(kind: str, leave: str = "", heavy: bool = False, growing: bool = False) -> Draw:
    """y = 0.6 y₁ + 0.5 u₁ + 0.2 u₁² − 0.15 y₁u₁ + 0.1 u₂³ + e, fitted without ``leave``."""

    def draw(rng: Generator, samples: int) -> Fitted:
        u = signal(rng, samples, kind)
        e = rng.standard_t(5, samples) if heavy else rng.standard_normal(samples)
        e *= 0.3 * (1.0 + 0.8 * np.abs(back(u, 1))) if growing else 0.3
        y = np.zeros(samples)
        for t in range(2, samples):
            a, b = u[t - 1], u[t - 2]
            y[t] = 0.6 * y[t - 1] + 0.5 * a + 0.2 * a * a - 0.15 * y[t - 1] * a + 0.1 * b**3 + e[t]
        terms = {
            "y": back(y, 1),
            "u": back(u, 1),
            "u²": back(u, 1) ** 2,
            "yu": back(y, 1) * back(u, 1),
            "u³": back(u, 2) ** 3,
        }
        kept = [np.ones(samples), *(v for k, v in terms.items() if k != leave)]
        errors, Phi = least_squares(kept, y, 2)
        return Fitted(errors, u, Phi)

    return draw


def bilinear_noise(kind: str) -> Draw:
    """The errors hold 0.5 u₁ e₁ and the model is linear: products of errors and inputs show it."""

    def draw(rng: Generator, samples: int) -> Fitted:
        u, e = signal(rng, samples, kind), 0.3 * rng.standard_normal(samples)
        y = np.zeros(samples)
        for t in range(1, samples):
            y[t] = 0.6 * y[t - 1] + 0.5 * u[t - 1] + e[t] + 0.5 * u[t - 1] * e[t - 1]
        errors, Phi = least_squares([np.ones(samples), back(y, 1), back(u, 1)], y, 1)
        return Fitted(errors, u, Phi)

    return draw


def hammerstein(kind: str, alpha: tuple[float, ...], square: bool = True) -> Draw:
    """FIR(12) of u and of u² with AR noise on the output, fitted as it is or without u²."""

    def draw(rng: Generator, samples: int) -> Fitted:
        u = signal(rng, samples, kind)
        g = 0.7 ** np.arange(12)
        v = lfilter([1.0], alpha, rng.standard_normal(samples + 300))[300:]
        y = lfilter(g, [1.0], u + 0.3 * u**2) + 0.5 * v / v.std()
        columns = [np.ones(samples), *(back(u, k) for k in range(12))]
        if square:
            columns += [back(u**2, k) for k in range(12)]
        errors, Phi = least_squares(columns, y, 12)
        return Fitted(errors, u, Phi)

    return draw


RIGHT = (
    *(Case(f"NARX, {k} input", narx(k)) for k in ("white", "slow", "steps")),
    Case("NARX, white input, heavy-tailed noise", narx("white", heavy=True)),
    Case("Hammerstein, white noise, steps", hammerstein("steps", (1.0,)), False),
    Case("Hammerstein, AR(1) noise, white input", hammerstein("white", (1.0, -0.9)), False),
    Case("Hammerstein, AR(1) noise, slow input", hammerstein("slow", (1.0, -0.9)), False),
    Case("Hammerstein, AR(2) noise, steps", hammerstein("steps", (1.0, -1.6, 0.8)), False),
)
WRONG = (
    Case("NARX without u², white input", narx("white", "u²")),
    Case("NARX without u², slow input", narx("slow", "u²")),
    Case("NARX without y u, white input", narx("white", "yu")),
    Case("NARX without u³, white input", narx("white", "u³")),
    Case("ARX, bilinear noise u e, white input", bilinear_noise("white")),
    Case("NARX, noise grows with |u|, white input", narx("white", growing=True)),
    Case("Hammerstein without u², AR(1) noise, slow input",
         hammerstein("slow", (1.0, -0.9), square=False), False),
    Case("Hammerstein without u², AR(1) noise, two-level input",
         hammerstein("binary", (1.0, -0.9), square=False), False),
)  # fmt: skip


def alarms(name: str, seed: int, samples: int) -> list[str]:
    """The tests that alarm in one replicate at a nominal 1 %."""
    case = next(c for c in (*RIGHT, *WRONG) if c.name == name)
    found = case.draw(np.random.default_rng([seed, samples]), samples)
    given = OutputResiduals.of(found.errors, found.inputs, found.jacobian)
    white = whiteness_test(found.errors, found.jacobian, judged=case.noise_model)
    further = further_tests(given, noise_model=case.noise_model)
    tests = (white, given.independence(), *further)
    return [t.name for t in tests if not t.passed]


def alarm_table(cases: Sequence[Case], asked: Namespace) -> str:
    """Alarm rates [%]; – where the test is not judged for the structure."""
    rows = []
    found = {n: by_case(alarms, [c.name for c in cases], asked, n) for n in (300, 1000)}
    for case in cases:
        for samples in found:
            if seen := found[samples].get(case.name):
                hidden = () if case.noise_model else ("whiteness", "error products")
                cells = [
                    "–" if k in hidden else f"{100.0 * np.mean([k in s for s in seen]):.1f}"
                    for k in TESTS
                ]
                rows.append([case.name, str(samples), *cells])
    return table(["model", "N", *TESTS], rows, "l" + "r" * (1 + len(TESTS)))


HEAD = """# Alarm rates of the nonlinear residual tests

Share [%] of simulated models on which a test of Billings & Voon alarms at a nominal 1 %; model and
log are drawn anew each time. "–": not held against a structure without noise model.

## Right models: every figure should be 1

{replicates} replicates a line, standard error {error:.1f}.
"""
MIDDLE = """
## Wrong models: 100 is full power

{replicates} replicates a line. Which test alarms says what is missing. A two-level input hides its
square: nothing can be tested, and nothing is claimed.
"""


def main() -> None:
    """Run the study and write its report."""
    asked = STUDY.asked(__doc__)
    few = fewer(asked, 4)
    error = 100.0 * np.sqrt(0.0099 / asked.runs)
    parts = [
        HEAD.format(replicates=asked.runs, error=error),
        alarm_table(RIGHT, asked),
        MIDDLE.format(replicates=few.runs),
        alarm_table(WRONG, few),
    ]
    STUDY.write(asked, "\n".join(parts))


if __name__ == "__main__":
    main()
