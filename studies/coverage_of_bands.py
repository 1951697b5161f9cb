"""Are the bands of pictures honest: do 95 % bands of a step and a Bode diagram hold the truth?

Simulates records of known systems as ``studies.coverage`` does, fits the right structure to each
with the default options, and counts at 20 times and at 20 frequencies how often the band that
``sysid plot`` draws holds the true response. Some minutes of one core.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from studies.coverage import NORMAL_95, OE, A, Array, B, Case, _ar1, simulated
from studies.runner import Study, by_case
from sysid.estimation.assessment.responses import frequency_curves, step_curves
from sysid.estimation.pem import fit
from sysid.report.markdown import table

STUDY = Study("coverage_of_bands", "coverage_of_bands.md", runs=800)

POINTS = 20
"""Times, and frequencies, at which a band is asked."""

LOWEST = 0.01
"""Of the frequencies, as a share of the Nyquist frequency."""

FIRST: dict[str, object] = {"nb": 1, "nf": 1, "nk": 1}
NOISE: dict[str, object] = {"nc": 1, "nd": 1}
MOTOR = (0.01, 0.009, -1.88, 0.882)

CASES = (
    Case("OE, first order, white noise", "oe", FIRST, (1.0, -0.8)),
    Case("OE, first order, AR(1) noise 0.9", "oe", FIRST, (1.0, -0.8), noise=_ar1),
    Case("OE, second order, white noise", "oe", OE, (*B, *A)),
    Case("OE, second order, AR(1) noise 0.9", "oe", OE, (*B, *A), noise=_ar1),
    Case("OE, fast-sampled motor, slow input", "oe", OE, MOTOR, sigma=0.05, slow=True),
    Case("OE, second order, white noise, 200 samples", "oe", OE, (*B, *A), samples=200),
    Case("BJ, first order, coloured noise", "bj", FIRST | NOISE, (1.0, 0.5, -0.9, -0.8)),
    Case("BJ, second order, coloured noise", "bj", OE | NOISE, (*B, 0.5, -0.9, *A)),
    Case("BJ, second order, white noise", "bj", OE | NOISE, (*B, 0.0, 0.0, *A)),
    Case("BJ, second order, coloured noise, 200 samples", "bj", OE | NOISE, (*B, 0.5, -0.9, *A),
         samples=200),
)  # fmt: skip


def one(name: str, seed: int) -> list[list[bool]]:
    """Whether the band holds the truth at each point: of a step, of |G|, of arg G."""
    case = next(c for c in CASES if c.name == name)
    record = simulated(case, seed)
    model = fit(case.fitted(), [record], case.options)
    truth = replace(model, theta=np.array(case.theta))
    (settles,) = step_curves(truth)
    step, of_truth = (step_curves(m, seconds=settles.x[-1])[0] for m in (model, truth))
    moving = np.flatnonzero(step.error > 0.0)  # before the delay there is nothing to know
    at = moving[np.linspace(0, len(moving) - 1, POINTS).round().astype(int)]
    held = [np.abs(step.y - of_truth.y)[at] <= NORMAL_95 * step.error[at]]
    w = np.geomspace(LOWEST, 0.99, POINTS) * np.pi / model.dt
    bode, true = (frequency_curves(m, w)[0] for m in (model, truth))
    of_gain, of_phase = bode.bands()
    low, high = of_gain
    held.append((low <= np.abs(true.response)) & (np.abs(true.response) <= high))
    low, high = of_phase
    middle = 0.5 * (low + high)
    off = np.angle(true.response * np.exp(-1j * middle))  # within ± π
    held.append(np.abs(off) <= high - middle)
    return [h.tolist() for h in held]


def row(case: Case, draws: Sequence[Sequence[Sequence[bool]]]) -> list[str]:
    """A line of the report: the share covered of each kind, at the worst and at the best point."""
    held: Array = 100.0 * np.mean(np.array(draws, dtype=np.float64), axis=0)
    cells = (f"{k.mean():.1f} ({k.min():.1f} … {k.max():.1f})" for k in held)
    return [case.name, str(case.samples), *cells]


def main() -> None:
    """Run the study and write its report."""
    asked = STUDY.asked(__doc__)
    found = by_case(one, [c.name for c in CASES], asked)
    headers = ["system", "samples", "step [%]", "gain [%]", "phase [%]"]
    rows = [row(c, found[c.name]) for c in CASES if c.name in found]
    text = HEAD.format(records=asked.runs, error=100.0 * np.sqrt(0.95 * 0.05 / asked.runs))
    STUDY.write(asked, text + "\n" + table(headers, rows, "lrrrr"))


HEAD = """# Coverage of the bands of step responses and Bode diagrams

{records} simulated records a line, cut out of a longer experiment; every fit with the default
options. The share [%] of records whose pointwise 95 % band holds the true response: the mean of 20
points, and in brackets the worst and the best of them (standard error of one point: {error:.1f};
points beside each other err alike, so that the mean is hardly surer). Steps are asked at 20 times
until the response has settled, gain and phase at 20 frequencies from 1 to 99 % of the Nyquist
frequency. An OE model of data with coloured noise has no noise model: its bands come from
the sandwich form.
"""

if __name__ == "__main__":
    main()
