"""Pictures of fits, rankings and replays from their results."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sysid.criteria.table import criterion
from sysid.criteria.verdicts import ResidualTest
from sysid.data.record import Record
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.assessment.findings import Assessment
from sysid.estimation.identify import Identification
from sysid.estimation.selection.comparison import Ranking
from sysid.plant.replay import Replay
from sysid.report.correlation_panels import LagTest
from sysid.report.fit_picture import FitPicture, FitSegment
from sysid.report.plots import write_picture
from sysid.report.ranking_drawing import RankingPicture, RankingRow
from sysid.structures.orders import orders_text


def draw_fit(path: Path, title: str, identification: Identification) -> None:
    """Draw measured, simulated and residual of the winner with what decides its residual tests."""
    best = identification.assessments[0]
    model = best.model
    named = f"{title}: {orders_text(model.structure.order_values())}"
    write_picture(
        path,
        FitPicture(
            title=named if len(named) < TITLE else title,
            outputs=model.outputs,
            inputs=model.inputs,
            segments=_segments(best, identification),
            initial_state=best.judged.free_run.initial_state,
            estimation_fit=tuple(best.estimation.free_run.fit_percent.values()),
            validation_fit=(
                tuple(best.validation.free_run.fit_percent.values()) if best.validation else ()
            ),
            whiteness=_drawn(best.residuals.whiteness, "white", "not white"),
            independence=_drawn(
                best.residuals.independence, "no linear effect left", "correlated with the inputs"
            ),
            feedback=_drawn(best.residuals.feedback, "", ""),
        ),
    )


TITLE = 70
"""Longest title that fits on a picture."""


def draw_ranking(path: Path, ranking: Ranking) -> None:
    """Draw the models of a comparison as bars with their fits beside them."""
    about, outputs = criterion(ranking.criterion), tuple(ranking.best.figures["fit_percent"])
    rows = []
    for line in ranking.lines:
        structure = line.contender.model.structure
        fits = line.figures["fit_percent"]
        residuals = line.contender.report.get("residuals") or {}
        rows.append(
            RankingRow(
                line.contender.id,
                f"{structure.name} {orders_text(structure.order_values())}",
                line.value,
                f"{line.value:.6g}",
                tuple(float("nan") if fits[n] is None else fits[n] for n in outputs),
                residuals.get("passed"),
            )
        )
    write_picture(
        path,
        RankingPicture(
            f"Models ranked by {ranking.criterion}, fits on {ranking.data}"[:TITLE],
            ranking.criterion,
            tuple(rows),
            outputs,
            not about.smaller_is_better,
            about.only_differences,
        ),
    )


def draw_replay(path: Path, result: Replay) -> None:
    """Draw the measured outputs of a log beside the plant's."""
    record = result.record
    segment = FitSegment(record.t, record.y, result.simulated, record.u, "validation", record.name)
    picture = FitPicture(
        title=f"The exported plant on {record.name}",
        outputs=record.outputs,
        inputs=record.inputs,
        segments=(segment,),
        initial_state="rest",
        validation_fit=tuple(result.summary()["fit_percent"].values()),
    )
    write_picture(path, picture)


def _drawn(tests: Sequence[ResidualTest], right: str, wrong: str) -> tuple[LagTest, ...]:
    """The tests of one kind for a picture; none where nothing was left to test."""
    if any(t.parts is None or not t.parts.values.size for t in tests):
        return ()
    return tuple(
        LagTest(
            np.array(t.parts.lags, dtype=np.float64),
            t.parts.signals,
            t.parts.values,
            t.statistic,
            t.limit,
            right if t.passed else wrong,
            t.judged,
        )
        for t in tests
        if t.parts is not None
    )


def _segments(best: Assessment, identification: Identification) -> tuple[FitSegment, ...]:
    def segment(record: Record, part: str) -> FitSegment:
        run = outputs(best.model, record, None, Start.ESTIMATED)
        return FitSegment(
            t=record.t,
            measured=record.y,
            simulated=run,
            u=record.u,
            part="estimation" if part == "estimation" else "validation",
            label=record.name,
        )

    inside = [segment(r, "estimation") for r in identification.estimation]
    outside = [segment(r, "validation") for r in identification.validation]
    if len(inside) == len(outside):  # a split record continues in its validation part
        return tuple(s for pair in zip(inside, outside, strict=True) for s in pair)
    return (*inside, *outside)
