"""``methods.md``: the paths of the three iterations on one problem, step by step."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sysid.data.record import Array, Channel, Record
from sysid.fitting.marquardt import Conditions, Method, loss, marquardt
from sysid.fitting.problem import Focus, Initial
from sysid.report.markdown import table
from sysid.structures.linear.families import OE
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.searchable import LinearSearch

B, F, NOISE, SAMPLES = 0.5, -0.8, 0.05, 400
START = np.array([0.1, 0.2])
SHOWN = (0, 1, 2, 3, 4, 5, 6, 8, 12, 20, 40)
"""Iterations in the table."""

HEAD = """# Iterations of a search

y(t) = b/(1 + f q⁻¹) u(t−1) + e(t) with b = 0.5, f = −0.8, 400 samples of white u, σ = 0.05; all
three from b = 0.1, f = 0.2. The methods are those of
`sysid fit --method`.

Levenberg–Marquardt keeps each step where the linearised errors can be trusted, Gauss–Newton takes
the whole step and halves it until the errors fall, the gradient walks down the slope in scaled
parameters. Near the minimum the first two are the same; the gradient has linear convergence, and
the more alike what two parameters do, the slower.

"""


def record() -> Record:
    """The data of the problem."""
    rng = np.random.default_rng(7)
    u = rng.standard_normal((SAMPLES, 1))
    y = np.zeros((SAMPLES, 1))
    for t in range(1, SAMPLES):
        y[t] = -F * y[t - 1] + B * u[t - 1]
    y += NOISE * rng.standard_normal(y.shape)
    return Record(u, y, 0.1, (Channel("u"),), (Channel("y"),))


def path(structure: PolynomialStructure, log: Record, method: Method) -> tuple[list[Array], int]:
    """The iterates of one method, and how often it evaluated the errors."""
    (problem,) = LinearSearch(structure).problems([log], Focus.SIMULATION, Initial.ZERO, False)
    walked: list[Array] = []

    def slopes(x: Array) -> Array:
        walked.append(x.copy())
        return problem.jacobian(x)

    conditions = Conditions(1e-9, 1000, method=method)
    end, evaluations, _ = marquardt(problem.residual, START, slopes, conditions)
    return [*walked, end], evaluations


def write(folder: Path) -> Mapping[str, str]:
    """The text of the report."""
    log = record()
    structure = OE.from_orders({"nb": 1, "nf": 1, "nk": 1}, 1, 1)
    (problem,) = LinearSearch(structure).problems([log], Focus.SIMULATION, Initial.ZERO, False)
    walks = {m: path(structure, log, m) for m in Method}
    rows = []
    for k in SHOWN:
        row = [str(k)]
        for walked, _ in walks.values():
            here = walked[min(k, len(walked) - 1)]
            over = k > len(walked) - 1
            row.append("" if over else f"{here[0]:.4f}, {here[1]:.4f}")
            row.append("" if over else f"{loss(problem.residual(here)):.4f}")
        rows.append(row)
    heads = ["iteration"]
    for m in Method:
        heads += [f"{m.value}: b, f", "½ Σ ε²"]
    ends = [
        [m.value, str(len(walked) - 1), str(spent), f"{walked[-1][0]:.5f}, {walked[-1][1]:.5f}"]
        for m, (walked, spent) in walks.items()
    ]
    text = HEAD + table(heads, rows) + "\n"
    text += table(["method", "iterations", "evaluations of the errors", "b, f at the end"], ends)
    return {"methods.md": text}
