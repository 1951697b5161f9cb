"""The studies behind ``bench_linear.py``: the systems, the contestants, and what is measured."""

import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import footprint
import numpy as np
from peers import PEERS, quiet
from references import ONE, Array, Row, accumulate_arx, bare_search

from sysid.data.record import Record
from sysid.estimation.pem import fit
from sysid.fitting.problem import Focus, Initial
from sysid.fitting.solvers import Descent, levenberg_marquardt
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.searchable import LinearSearch
from sysid.structures.registry import structure_class

ROUNDS = 3
BURST = 5
"""Runs of a quick contestant in each round; one that takes seconds runs once."""

SIGMA = 0.1
SAMPLES = 10_000


def poly(*coefficients: float) -> Array:
    """Coefficients in ascending powers of q⁻¹."""
    return np.array(coefficients)


A, B, C, D = poly(1, -1.5, 0.7), poly(0, 1, 0.5), poly(1, -0.5, 0.2), poly(1, -0.8, 0.1)
TWO_ROWS = (
    Row(poly(1, -1.2, 0.5), (poly(0, 1, 0.5), poly(0, -0.6, 0.4)), C),
    Row(poly(1, -1, 0.4), (poly(0, 0.3, -0.2), poly(0, 0.8, 0.1)), poly(1, 0.4, 0.1)),
)


@dataclass(frozen=True, eq=False)
class Case:
    """A true system and the structure that holds it.

    Attributes:
        title, structure, orders: what is fitted.
        truth: the true rows.
        seed: of input and noise; the record that judges has the next one.
        bare: whether the bare search knows the structure.
        factor: how many times faster than a package the whole fit must be, None without target.
    """

    title: str
    structure: str
    orders: dict[str, int]
    truth: tuple[Row, ...]
    seed: int
    bare: bool = True
    factor: float | None = 25.0

    def signals(self, seed: int, samples: int = SAMPLES) -> tuple[Array, Array]:
        """Random binary inputs and noisy outputs, from rest."""
        rng = np.random.default_rng(seed)
        u = np.sign(rng.standard_normal((samples, len(self.truth[0].B))))
        e = SIGMA * rng.standard_normal((samples, len(self.truth)))
        return u, np.column_stack([row.output(u, e[:, i]) for i, row in enumerate(self.truth)])

    def form(self) -> PolynomialStructure:
        """The structure that is fitted."""
        found = structure_class(self.structure).from_orders(
            self.orders, len(self.truth[0].B), len(self.truth)
        )
        assert isinstance(found, PolynomialStructure)
        return found

    def errors(self, rows: tuple[Row, ...]) -> tuple[float, float]:
        """RMS one-step error, and of the free run against the noise-free output."""
        u, y = self.signals(self.seed + 1)
        step = [row.one_step(u, y[:, i]) for i, row in enumerate(rows)]
        run = [
            row.free_run(u) - true.free_run(u) for row, true in zip(rows, self.truth, strict=True)
        ]
        return float(np.sqrt(np.mean(np.square(step)))), float(np.sqrt(np.mean(np.square(run))))


CASES = (
    Case("ARX(2,2,1)", "arx", {"na": 2, "nb": 2}, (Row(A, (B,)),), 20, bare=False, factor=None),
    Case("ARMAX(2,2,2)", "armax", {"na": 2, "nb": 2, "nc": 2}, (Row(A, (B,), C),), 30),
    Case("OE(2,2)", "oe", {"nb": 2, "nf": 2}, (Row(ONE, (B,), F=(A,)),), 40),
    Case(
        "BJ(2,2,2,2)",
        "bj",
        {"nb": 2, "nc": 2, "nd": 2, "nf": 2},
        (Row(ONE, (B,), C, D, (A,)),),
        50,
    ),
    Case("ARMAX, 2×2", "armax", {"na": 2, "nb": 2, "nc": 2}, TWO_ROWS, 60, bare=False),
)


@dataclass
class Ledger:
    """Targets and whether they were met, in the order they were measured."""

    rows: list[list[str]] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)

    def add(self, what: str, measured: float, sense: str, bound: float, unit: str = "") -> None:
        """Note one target; ``sense`` is ≤ or ≥."""
        met = measured <= bound if sense == "≤" else measured >= bound
        self.rows.append(
            [what, f"{measured:.3g}{unit}", f"{sense} {bound:g}{unit}", "yes" if met else "**no**"]
        )
        if not met:
            self.missed.append(what)
        print(f"  {what}: {measured:.3g}{unit} ({sense} {bound:g})", flush=True)


def take_turns(contestants: Mapping[str, Callable[[], Any]]) -> dict[str, tuple[float, Any]]:
    """Median seconds and answer of each, in rounds so that a busy moment hits them alike."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    answers: dict[str, Any] = {}
    for _ in range(ROUNDS):
        for name, run in contestants.items():
            for _ in range(BURST):
                start = time.perf_counter()
                answers[name] = run()
                times[name].append(time.perf_counter() - start)
                if times[name][-1] > 0.5:
                    break
    return {name: (statistics.median(times[name]), answers[name]) for name in contestants}


def whole_fit(case: Case, record: Record) -> tuple[Row, ...]:
    """The package's fit with starts, covariance and checks, as rows."""
    structure = case.form()
    p = structure.polynomials(fit(structure, [record]).theta)
    return tuple(
        Row(p.A[i][i], tuple(p.B[i]), p.C[i], p.D[i], tuple(p.F[i])) for i in range(structure.ny)
    )


def search_stage(case: Case, record: Record, start: Array) -> float:
    """The search alone, its problem built anew: ½ Σ ε²."""
    (problem,) = LinearSearch(case.form()).problems([record], Focus.PREDICTION, Initial.ZERO, False)
    nowhere = np.full(len(start), np.inf)
    free = np.ones(len(start), dtype=bool)
    return levenberg_marquardt(
        problem, start, Descent(free=free, lower=-nowhere, upper=nowhere)
    ).cost


def long_arx(ledger: Ledger) -> list[list[str]]:
    """ARX(4,4,1) on a million samples against accumulating its normal equations."""
    case = Case("", "arx", {"na": 4, "nb": 4}, (Row(A, (B,)),), 10)
    u, y = case.signals(case.seed, 1_000_000)
    record, flat_u, flat_y = Record(u, y, 0.1), u[:, 0].copy(), y[:, 0].copy()
    found = take_turns(
        {
            "sysid fit: θ, covariance, criteria, initial state": lambda: whole_fit(case, record),
            "normal equations in blocks of 16384, solved": lambda: accumulate_arx(
                flat_u, flat_y, 4, 4
            ),
        }
    )
    (ours, rows), (plain, theta) = found.values()
    reference = (Row(np.concatenate([ONE, theta[:4]]), (np.concatenate([[0.0], theta[4:]]),)),)
    ledger.add("ARX(4,4,1), 10⁶ samples: time over normal equations", ours / plain, "≤", 5.0)
    memory = footprint.memory_of_fit(1_000_000)
    for kind, above in memory.items():
        ledger.add(f"the same: {kind} memory above the data", above, "≤", 150.0, " MB")
    return [
        [name, _ms(seconds), f"{seconds / plain:.2f}", *_errors(case, answer)]
        for (name, (seconds, _)), answer in zip(found.items(), (rows, reference), strict=True)
    ]


def searches(ledger: Ledger) -> list[list[str]]:
    """The Levenberg-Marquardt stage against the bare one, from the same start."""
    rows = []
    for case in (c for c in CASES if c.bare):
        u, y = case.signals(case.seed)
        record = Record(u, y, 0.1)
        start = dict(LinearSearch(case.form()).starts([record], Focus.PREDICTION))["ARX"]
        found = take_turns(
            {
                "sysid": partial(search_stage, case, record, start),
                "bare": partial(bare_search, case.structure, u[:, 0], y[:, 0], start),
            }
        )
        (ours, cost), (plain, (_, plain_cost)) = found["sysid"], found["bare"]
        ledger.add(f"{case.title}, 10⁴ samples: search over bare search", ours / plain, "≤", 2.0)
        rms = [np.sqrt(2.0 * c / SAMPLES) for c in (cost, plain_cost)]
        ratio = f"{ours / plain:.2f}"
        rows.append([case.title, _ms(ours), _ms(plain), ratio, f"{rms[0]:.5f}", f"{rms[1]:.5f}"])
    return rows


def whole_fits(ledger: Ledger) -> list[list[str]]:
    """The whole fit against the packages that know the structure."""
    rows = []
    for case in CASES:
        u, y = case.signals(case.seed)
        record = Record(u, y, 0.1)
        contestants: dict[str, Callable[[], Any]] = {"sysid": partial(whole_fit, case, record)}
        for peer in PEERS:
            estimate = peer.estimator(case.structure, len(case.truth))
            if estimate is not None:
                contestants[peer.title] = partial(estimate, u, y)
        with quiet():
            contestants["sysid"]()
            found = take_turns(contestants)
        ours = found["sysid"][0]
        for name, (seconds, answer) in found.items():
            ratio = seconds / ours
            rows.append([case.title, name, _ms(seconds), f"{ratio:.3g}", *_errors(case, answer)])
            if name != "sysid" and case.factor is not None:
                ledger.add(f"{case.title}: {name} over sysid", ratio, "≥", case.factor)
        print(f"  {case.title}: {_ms(ours)} ms", flush=True)
        rows.append([""] * 6)
    return rows[:-1]


def commands(ledger: Ledger) -> list[list[str]]:
    """Cold starts, imports, and default fits of long records by the command itself."""
    usage = footprint.imports_of("--help")
    linear = footprint.imports_of(*footprint.LINEAR_FIT)
    ledger.add("numeric libraries that `sysid --help` imports", len(usage["numeric"]), "≤", 0)
    ledger.add("heavy libraries that a linear fit imports", len(linear["heavy"]), "≤", 0)
    ledger.add("BLAS threads that a linear fit allows itself", float(linear["cap"] or 99), "≤", 1)
    rows = [
        ["`sysid --help`", f"{footprint.seconds_of_command(('--help',), 5):.2f}"],
        [
            '`sysid fit prbs.csv --structure arx --orders "na=2 nb=2 nk=1"`',
            f"{footprint.seconds_of_command(footprint.LINEAR_FIT, 5):.2f}",
        ],
    ]
    for case, what in ((CASES[3], "1 input, 1 output"), (CASES[4], "2 inputs, 2 outputs")):
        u, y = case.signals(case.seed, 100_000)
        names = ["t", *(f"u{j + 1}" for j in range(u.shape[1]))]
        names += [f"y{i + 1}" for i in range(y.shape[1])]
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "long.csv"
            columns = np.column_stack([0.1 * np.arange(len(u)), u, y])
            np.savetxt(log, columns, "%.9g", ",", header=",".join(names), comments="")
            seconds = footprint.seconds_of_command(("fit", str(log)), 1)
        ledger.add(f"`sysid fit` of 10⁵ samples, {what}", seconds, "≤", 180.0, " s")
        rows.append([f"`sysid fit long.csv`, 10⁵ samples, {what}", f"{seconds:.1f}"])
    return rows


def _errors(case: Case, rows: tuple[Row, ...]) -> list[str]:
    one_step, free_run = case.errors(rows)
    return [f"{one_step:.5f}", f"{free_run:.2g}"]


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}" if seconds < 1.0 else f"{1e3 * seconds:.0f}"


ERRORS = ["one step", "free run"]
STUDIES: dict[str, tuple[list[str], str, Callable[[Ledger], list[list[str]]]]] = {
    "ARX(4,4,1) on 10⁶ samples": (["what", "ms", "ratio", *ERRORS], "lrrrr", long_arx),
    "The search alone": (
        ["structure", "sysid ms", "bare ms", "ratio", "sysid RMS ε", "bare RMS ε"],
        "lrrrrr",
        searches,
    ),
    "The whole fit against other packages": (
        ["structure", "package", "ms", "times sysid", *ERRORS],
        "llrrrr",
        whole_fits,
    ),
    "Commands": (["command, cold", "s"], "lr", commands),
}
