"""All rows of a log larger than memory: ARX solved on them, and every model judged on them.

Orders and structures are chosen on stretches of the log. The normal equations of ARX are sums over
instants, so they are added up block by block, each block with the rows before it that its first
instants look back to: the result is that of the whole log in memory, to rounding.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.io import blocks_of
from sysid.data.preprocess import Detrend
from sysid.data.reading.blocks import Blocks
from sysid.data.record import Record
from sysid.estimation.assessment.figures import Figures
from sysid.estimation.assessment.findings import Assessment, DataFigures, Policy, assess, figures_on
from sysid.estimation.identify import Identification, Request
from sysid.estimation.pem import fit, offsets_of
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.fitting.searchable import InitialGuesses
from sysid.methods.linear import is_linear, solved_outcome
from sysid.methods.method import Fitter
from sysid.methods.outcome import FitOutcome
from sysid.structures.base import Structure
from sysid.structures.linear.constant_input import with_ones
from sysid.structures.linear.families import ARX
from sysid.structures.linear.least_squares import solve_in_blocks
from sysid.structures.model import Model

BLOCK_ROWS = 500_000
"""Rows read at once: with the text and its copies 300 MB for ten columns."""


@dataclass(frozen=True, eq=False)
class AllRows:
    """The rows of a log in blocks.

    Attributes:
        log: the file.
        dt: sample time [s].
    """

    log: Blocks
    dt: float
    rows: int = BLOCK_ROWS

    def records(self, lead: int = 0) -> Iterator[Record]:
        """The blocks in order; one that follows the last one begins with its ``lead`` last rows."""
        before, end = None, 0.0
        for block in blocks_of(self.log, self.rows):
            for r in block.records:
                start = block.origin + r.t0
                unclocked = start == 0.0  # without a time column every block begins at zero
                whole = replace(r, dt=self.dt)
                if before is not None and (abs(start - end) < 0.5 * self.dt or unclocked):
                    u, y = (np.vstack([getattr(p, s) for p in (before, r)]) for s in ("u", "y"))
                    whole = replace(whole, u=u, y=y, pose=None, references=None)
                    whole = replace(whole, reference_names=(), t0=r.t0 - len(before) * self.dt)
                yield whole
                before = whole.rows(max(len(whole) - lead, 0), len(whole))
                end = start + len(r) * self.dt


def on_all_rows(
    identification: Identification,
    facts: LogFacts,
    request: Request,
    log: Blocks,
    rows: int = BLOCK_ROWS,
) -> Identification:
    """The models of stretches of a log, those of ARX solved on all rows, each judged on all rows.

    Args:
        identification: what the stretches gave.
        rows: read at once.
    """
    every = AllRows(log, facts.records[0].dt, rows)
    label = f"{log.path.name}, all rows"
    judged, solved = [], []
    for a in identification.assessments:
        structure, options = a.model.structure, request.options
        if isinstance(structure, ARX) and is_linear(options, a.model.parameters):
            a = _solved(a, facts, request, every)
            solved.append(structure.name)
        if a.validation is None:
            a = replace(a, validation=_figures(a.model, every, label, request.policy))
        judged.append(a)
    reason = (
        f"{identification.reason} Orders were chosen on {len(facts.records)} stretches of "
        f"{log.path.name}; "
        + (f"{' and '.join(dict.fromkeys(solved))} was solved on all rows, and " if solved else "")
        + "each model is judged on all rows."
    )
    return replace(identification, assessments=tuple(judged), reason=reason)


def _solved(a: Assessment, facts: LogFacts, request: Request, every: AllRows) -> Assessment:
    """An assessment of the same ARX with the parameters of all rows."""
    structure = a.model.structure
    offsets = offsets_of(structure, facts, request.detrend)
    options = replace(request.options, extra=a.model.provenance.options)
    solver = _solver(every, offsets.detrend)
    model = fit(structure, facts, options, detrend=offsets, solver=solver)
    label = a.estimation.one_step.data
    again = assess(model, (facts.records, label), None, a.policy, a.seconds, a.chosen)
    warnings = tuple(dict.fromkeys((*a.warnings, *again.warnings)))
    return replace(again, validation=a.validation, warnings=warnings)


def _solver(every: AllRows, detrend: Detrend) -> Fitter:
    def solve(
        structure: Structure,
        plain: Sequence[Record],
        options: FitOptions,
        parameters: tuple[Parameter, ...],
        initial_guesses: InitialGuesses,
    ) -> FitOutcome:
        assert isinstance(structure, ARX)
        constant = structure.nu > len(detrend.u_offset)

        def blocks(lead: int) -> Iterable[Record]:
            for r in every.records(lead):
                yield with_ones(detrend.remove(r)) if constant else detrend.remove(r)

        solved = solve_in_blocks(structure, blocks, plain)
        return solved_outcome(structure, parameters, solved, "least squares over all rows")

    return solve


def _figures(model: Model, every: AllRows, label: str, policy: Policy) -> DataFigures:
    least = 2 * (policy.skip + model.structure.first_sample() + 1)
    parts = [figures_on(model, [r], label, policy) for r in every.records() if len(r) > least]
    return DataFigures(
        pooled([p.free_run for p in parts]),
        pooled([p.one_step for p in parts]),
        tuple(pooled(list(k)) for k in zip(*(p.k_step for p in parts), strict=True)),
    )


def pooled(parts: Sequence[Figures]) -> Figures:
    """The figures of parts of a log as those of the whole, as experiments are pooled.

    With the RMSE e and the fit 100 (1 − e √N / s) of each part: Σ e² N and Σ s² over the parts.
    """

    def total(part: Figures, name: str) -> float:
        return part.rmse[name] ** 2 * part.samples

    def spread(part: Figures, name: str) -> float:
        missed = 1.0 - part.fit_percent[name] / 100.0
        return total(part, name) / missed**2 if missed else 0.0

    def sums(of: Callable[[Figures, str], float], name: str) -> float:
        return float(np.nansum([of(p, name) for p in parts]))

    samples = sum(p.samples for p in parts)
    names = tuple(parts[0].rmse)
    with np.errstate(divide="ignore", invalid="ignore"):
        fits = {n: 1.0 - np.sqrt(np.divide(sums(total, n), sums(spread, n))) for n in names}
        errors = {n: np.sqrt(np.divide(sums(total, n), samples)) for n in names}
    return replace(
        parts[0],
        samples=samples,
        fit_percent={n: 100.0 * float(v) for n, v in fits.items()},
        rmse={n: float(v) for n, v in errors.items()},
        left_out=sum(p.left_out for p in parts),
    )
