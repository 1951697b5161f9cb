"""Follow a log while it is written: lines in, estimates out, and the model at the end."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.following.lines import Lines
from sysid.data.following.rows import RowReader, Rows
from sysid.data.operating_point import OperatingPoint, Origin
from sysid.data.preprocess import Detrend
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Record, names_of
from sysid.errors import DataError, Termination, UsageError
from sysid.estimation import pem
from sysid.estimation.assessment.findings import Policy, assess
from sysid.estimation.identify import Identification
from sysid.estimation.offsets.estimated_offset import narrowed, without_offset
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.online.change import FALSE_ALARMS
from sysid.estimation.online.live_fit import LiveFit
from sysid.estimation.online.live_state import LiveChange
from sysid.fitting.options import FitOptions
from sysid.fitting.searchable import StartReport
from sysid.methods.outcome import FitOutcome
from sysid.structures.linear.constant_input import (
    widened,
)
from sysid.structures.model import Model

OFFSET_POLICIES = ("auto", "none", "level")
"""What may be done about levels while rows come: means and trends need the whole log."""

APART = 5
"""Samples that a kept log leaves out between two stretches: more than a gap that is filled."""

MIN_KEPT_ROWS = 10
"""Rows of a stretch at least, to be kept in a log: a shorter piece is left out when it is read."""


@dataclass(frozen=True)
class LiveOptions:
    """How a plant is followed.

    Attributes:
        orders: na, nb, nk; None to choose them from the rows.
        forgetting: λ, 1 weighs all rows alike.
        false_alarms: chance of ever saying that an unchanged plant has changed.
        detrend: one of ``OFFSET_POLICIES``; auto gives each output a constant unless drives are
            commanded and wheel speeds measured, whose zeros are physical.

    Raises:
        UsageError: the policy is none of these.
    """

    orders: Mapping[str, Any] | None = None
    forgetting: float = 1.0
    false_alarms: float = FALSE_ALARMS
    detrend: str = "auto"

    def __post_init__(self) -> None:
        if self.detrend not in OFFSET_POLICIES:
            raise UsageError(
                f"`detrend` is one of {', '.join(OFFSET_POLICIES)} while following, got "
                f"{self.detrend!r}"
            )


class LogFeed:
    """Rows of a log's lines.

    Attributes:
        reader: of the lines; it knows channels and sample time once rows have come.
        ended: whether nothing can come any more.
    """

    def __init__(self, lines: Lines, options: ReadOptions) -> None:
        self._lines, self.reader = lines, RowReader(lines.where, options)
        self.where, self.ended = lines.where, False

    def new(self, last: bool = False) -> Rows | None:
        """The rows since the last call; None while channels are not known.

        Args:
            last: nothing will follow: few lines must do, and one without an end is whole.
        """
        lines = self._lines.new()
        if self._lines.restarted:
            self.reader.restart()
        self.ended = self._lines.ended
        if last or self.ended:
            lines += self._lines.last()
        return self.reader.read(lines, last or self.ended)

    def close(self) -> None:
        self._lines.close()


@dataclass
class Follower:
    """Takes rows from a feed into a ``LiveFit``, which it makes when channels are known.

    Attributes:
        live: the estimate, None before the first rows.
    """

    feed: LogFeed
    options: LiveOptions = field(default_factory=LiveOptions)
    live: LiveFit | None = None

    def poll(self, last: bool = False) -> tuple[int, tuple[LiveChange, ...]]:
        """Take what has come.

        Args:
            last: nothing will follow.

        Returns:
            How many rows came, and the changes of the plant that they made certain.
        """
        rows = self.feed.new(last)
        if rows is None or not len(rows.t):
            return 0, ()
        if self.live is None:
            self.live = self._begun(rows)
        live = self.live
        changes: list[LiveChange] = []
        edges = [0, *(k for k in np.flatnonzero(rows.gap).tolist() if k), len(rows.t)]
        for a, b in pairwise(edges):
            if rows.gap[a]:
                live.interrupt()
            changes += live.update(rows.u[a:b], rows.y[a:b])
        return len(rows.t), tuple(changes)

    def _begun(self, rows: Rows) -> LiveFit:
        reader, options = self.feed.reader, self.options
        sample = Record(rows.u, rows.y, reader.dt, reader.inputs, reader.outputs)
        level = options.detrend == "level" or (
            options.detrend == "auto" and not sample.is_robot_log
        )
        return LiveFit(
            reader.inputs,
            reader.outputs,
            reader.dt,
            options.orders,
            forgetting=options.forgetting,
            level=level,
            false_alarms=options.false_alarms,
        )


def kept_log(live: LiveFit) -> tuple[str, ReadOptions]:
    """The rows that an estimate stands on as a CSV log, and how it is read."""
    channels = (*live.inputs, *live.outputs)
    nu, ny = len(live.inputs), len(live.outputs)
    lines = [",".join(["t", *(f'"{c.name}"' if "," in c.name else c.name for c in channels)])]
    k, kept = 0, 0
    for piece in live.recursion.pieces():
        if len(piece) < MIN_KEPT_ROWS:
            continue
        for row in np.column_stack([piece[:, ny : ny + nu], piece[:, :ny]]).tolist():
            lines.append(f"{k * live.dt:.12g}," + ",".join(map(repr, row)))
            k += 1
        kept += len(piece)
        k += APART
    if kept <= live.recursion.structure.first_sample() + len(live.model().theta) + 1:
        raise DataError(
            f"{live.rows} rows so far, {kept} of them in a row since the last change: "
            "too few for a model; follow for longer"
        )
    options = ReadOptions(
        inputs=tuple(c.name for c in live.inputs),
        outputs=tuple(c.name for c in live.outputs),
        time="t",
        units={c.name: c.unit for c in channels if c.unit},
        resample="split",
        unwrap={"": None},
        held="keep",
    )
    return "\n".join(lines) + "\n", options


def identification(
    live: LiveFit, records: Sequence[Record], options: FitOptions, policy: Policy
) -> Identification:
    """The model of a followed plant, judged on the rows it stands on.

    Args:
        records: the rows of ``kept_log``, read again.
        options: facts to keep with the model.
    """
    records = tuple(replace(r, inputs=live.inputs, outputs=live.outputs) for r in records)
    model = _model(live, records, options)
    name = names_of(records)
    lacking = [e for e in live.state().excitation if not e.enough]
    notes = tuple(f"the excitation of {e.output} is not enough: {e.why}" for e in lacking)
    judged = assess(model, (records, name), None, policy, 0.0, {}, notes)
    return Identification((judged,), "", {}, records, ())


def _model(live: LiveFit, records: Sequence[Record], options: FitOptions) -> Model:
    """The recursive estimate as a model like any other."""
    estimate = live.recursion.estimate(whole=True)
    wide = live.recursion.structure
    plain = wide.without_constant()
    parameters = plain.parameters(live.inputs, live.outputs)
    ny = len(live.outputs)
    if wide.orders.constant:
        parameters = widened(wide, parameters, live.outputs)
    outcome = FitOutcome(
        wide,
        parameters,
        estimate.theta,
        estimate.covariance,
        estimate.null,
        termination=Termination.CLOSED_FORM,
        starts=(StartReport("all", "recursive least squares", None, None, 1),),
    )
    if wide.orders.constant:
        places, _ = wide.constant_places()
        if np.all(np.isfinite(np.diag(estimate.covariance)[places])):
            offsets = Offsets(Detrend.none(plain.nu, ny), Origin.ESTIMATED, (True,) * ny)
            fitted = narrowed(wide, outcome, LogFacts.of(records), offsets)
            return pem.model_with_offset(fitted, records, options)
        unknown = (
            "the offset cannot be distinguished from the effect of the inputs; it was set to zero."
        )
        outcome = replace(without_offset(wide, outcome), warnings=(unknown,))
    none = Detrend.none(plain.nu, ny)
    return pem.model_of(outcome, records, records, options, none, OperatingPoint())
