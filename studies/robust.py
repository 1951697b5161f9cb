"""Do robust fits find the truth behind outliers, with honest standard errors, for every structure?

Two readings in a hundred are 10 σ off, or the disturbance of two samples in a hundred is 10 σ
larger; counted is how often estimate ± 3 standard errors holds the truth, for wavelet networks the
free-run fit on fresh clean data. The same fits without outliers show what caution costs. An hour of
one core.
"""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.outlier_cases import CASES, KINDS, Case, Drawn
from studies.runner import Study, by_case
from sysid.data.record import Record
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.fitting.outliers import find_outliers
from sysid.report.markdown import table
from sysid.structures.model import Model

STUDY = Study("robust", "robust.md", runs=50, first=1000)
"""Seeds below the first were looked at while the search for outliers was made."""

RECORDS = {"dc-motor": 16, "tanks": 16, "narx-wavelet": 24}
"""Most records of the structures whose fits take seconds."""

BEYOND = 3.0
"""Standard errors between estimate and truth that count as a miss."""

OTHER_NOISE = ("Laplace", "Student, 5 degrees of freedom", "read in steps of 2 σ")
"""Noise that is fine although its largest values look like outliers, or half of it is zero."""


@dataclass(frozen=True)
class Fits:
    """What the fits of one case and one kind of outliers came to.

    Attributes:
        off: (estimate − truth)/standard error, (records, parameters).
        errors: estimate − truth, the same shape.
        clean_fit: free-run fit on fresh clean data, by record [%].
        found: outliers left out, by record.
        struck: outliers there were, by record.
    """

    off: np.ndarray
    errors: np.ndarray
    clean_fit: np.ndarray
    found: np.ndarray
    struck: np.ndarray

    @property
    def within(self) -> float:
        """Share of the parameters within BEYOND standard errors of the truth [%]."""
        return 100.0 * float(np.mean(np.abs(self.off) < BEYOND))

    @property
    def spread(self) -> float:
        """Root mean square of ``off``: 1 where the standard errors are honest."""
        return float(np.sqrt(np.mean(self.off**2)))


def compared(case: Case, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Estimates of the parameters with a known truth, less that truth; and their errors."""
    table = {p.name: p for p in model.parameter_table()}
    truth = dict(case.truth)
    names = [name for name in truth if name in table and not table[name].fixed]
    errors = np.array([table[n].value - truth[n] for n in names])
    return errors, np.array([table[n].std_error for n in names])


def fresh_fit(case: Case, model: Model, seed: int) -> float:
    """Free-run fit on fresh data without noise [%]."""
    u = case.drive(seed + 10_000, case.samples)
    y = case.run(u, np.zeros(case.samples))
    run = model.simulate(u[:, None])[:, 0]
    return float(100.0 * (1.0 - np.linalg.norm(y - run) / np.linalg.norm(y - y.mean())))


def one(name: str, seed: int, kind: str, robust: bool) -> list[Any]:
    """One record, one fit: what ``Fits`` holds of it."""
    case = CASES[name]
    options = FitOptions(robust=robust)
    model = fit(case.made(), [case.record(seed, kind)], options, detrend="none")
    errors, sizes = compared(case, model)
    struck = 0 if kind == "clean" else int(np.sum(Drawn.of(seed, case.samples).outliers != 0.0))
    left_out = int(model.provenance.options.get("left_out", 0))
    off = (errors / sizes).tolist()
    return [off, errors.tolist(), fresh_fit(case, model, seed), left_out, struck]


def fits(records: Sequence[Sequence[Any]]) -> Fits:
    """The fits of a case to some records."""
    return Fits(*(np.array(part, dtype=float) for part in zip(*records, strict=True)))


def alarms(kind: str, records: int, samples: int = 1000) -> tuple[float, int]:
    """Good errors left out among white ones of some distribution: share [%] and most a record."""
    counts = []
    for seed in range(records):
        rng = np.random.default_rng([seed, 4])
        y = rng.standard_normal((samples, 1))
        if kind == "Laplace":
            y = rng.laplace(size=(samples, 1))
        elif kind.startswith("Student"):
            y = rng.standard_t(5, size=(samples, 1))
        elif kind.startswith("read"):
            y = 2.0 * np.round(y / 2.0)
        record = Record(rng.standard_normal((samples, 1)), y, 0.1)
        counts.append(int(np.sum(find_outliers(lambda v: v.copy(), record).found)))
    return 100.0 * float(np.mean(counts)) / samples, max(counts)


def row(name: str, asked: Namespace) -> list[str] | None:
    """One line of the report; None where no run of it is asked for."""
    few = Namespace(**{**vars(asked), "runs": min(RECORDS.get(name, asked.runs), asked.runs)})
    ways = [("clean", False), ("clean", True), *((k, r) for r in (True, False) for k in KINDS)]
    found = [by_case(one, [name], few, *way).get(name) for way in ways]
    if not all(found):
        return None
    plain, careful, *rest = (fits(records) for records in found if records)
    struck, least = rest[: len(KINDS)], rest[len(KINDS) :]
    lost = [plain.clean_fit - f.clean_fit for f in struck]
    if plain.off.shape[1]:
        size = [np.sqrt(np.mean(f.errors**2, axis=0)) for f in (plain, careful)]
        cost = 100.0 * (float(np.median(size[1] / size[0])) - 1.0)
        shown = [f"{f.within:.1f}" for pair in zip(least, struck, strict=True) for f in pair]
        spread = [f"{f.spread:.2f}" for f in struck]
    else:
        cost = float(np.mean(plain.clean_fit - careful.clean_fit))
        shown, spread = ["–"] * 4, ["–"] * 2
    return [
        name,
        str(len(plain.off)),
        *shown,
        *spread,
        " / ".join(f"{np.sum(f.found):.0f}" for f in struck)
        + f" of {np.sum(struck[0].struck):.0f}",
        f"{np.mean(careful.found):.2f}",
        " / ".join(f"{np.mean(points):+.2f}" for points in lost),
        f"{np.max(lost):+.2f}",
        f"{cost:+.1f}",
    ]


def main() -> None:
    """Run the study and write its report."""
    asked = STUDY.asked(__doc__)
    headers = [
        "structure", "records", "disturbance: least squares", "robust",
        "reading: least squares", "robust", "spread, disturbance", "spread, reading",
        "left out", "left out of clean records", "fit lost", "in the worst record", "cost",
    ]  # fmt: skip
    rows = [cells for name in CASES if (cells := row(name, asked)) is not None]
    lines = [[k, *(f"{v:.2f}" for v in alarms(k, 200))] for k in ("Gaussian", *OTHER_NOISE)]
    noise = table(["noise", "left out [%]", "most in a record"], lines, "lrr")
    STUDY.write(asked, HEAD + table(headers, rows, "l" + "r" * 12) + TAIL + noise)


HEAD = """# Robust fits of every structure

Two samples in a hundred are struck by 10 standard deviations of the noise, in the *disturbance*,
which the plant answers, or in the *reading* alone. Shown is the share [%] of the parameters whose
estimate is within 3 standard errors of the truth, by least squares and with `--robust`; *spread* is
the root mean square of (estimate − truth)/standard error, 1 where the standard errors are honest.
*Fit lost* is how much lower the free-run fit on fresh clean data is with `--robust` behind
outliers than by least squares without any [points], on average (disturbance / reading) and in the
worst record: it counts for wavelet networks, whose parameters have no truth, and shows a curve
that has gone wrong. *Left out* are the outliers found in all records
(disturbance / reading) of those there were; a structure without a noise model cannot tell in which
samples a disturbance came in, only where its effect stands out. *Cost* is how much larger the
errors of the parameters are on clean records with `--robust` [%] (for networks: points of fit).

"""

TAIL = """
White noise without a single outlier, 200 records of 1000 samples each:

"""

if __name__ == "__main__":
    main()
