"""The result of a diagnosis, as frozen dataclasses and as JSON."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from sysid.criteria.verdicts import ResidualReport
from sysid.data.documents import by_field, plain_object
from sysid.data.record import Array, Record
from sysid.diagnosis.gap import Gap
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.several.results import SeveralLogs
from sysid.diagnosis.shapes.grading import FoundShape
from sysid.diagnosis.validation.excess_error import ExcessError
from sysid.diagnosis.validation.localise import Region
from sysid.diagnosis.validation.model_error import ResidualVerdict
from sysid.effects.samples import DROPOUTS, HELD_TELEMETRY, QUANTISATION
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.outside_text import html_lines, html_table
from sysid.robot.calibration.geometry import GeometryEstimate
from sysid.structures.model import Model

if TYPE_CHECKING:
    from sysid.diagnosis.isolability import Isolability

OF_THE_LOG = {
    QUANTISATION.id: "its measurements are coarse",
    HELD_TELEMETRY.id: "its telemetry repeats",
    DROPOUTS.id: "some measurements are lost",
}
"""What the samples themselves show: a matter of sensor and log, that no model lacks."""


@dataclass(frozen=True)
class Value:
    """One number of a named effect.

    Attributes:
        name: with the output that it belongs to in brackets.
        value: NaN where the log never goes where the parameter acts.
        std_error: None where the log does not determine it.
        unit: of value, error and interval.
        interval: a 95 % interval where gradients give no standard error; an end that the log leaves
            open is None.
        in_file: the same parameter in the file's units where they are others: a speed, and a share
            of full drive where that is not declared but the largest command of the log; else None.
        bounded: whether it ended on the bound of the search, beyond which it may lie.
    """

    name: str
    value: float
    std_error: float | None
    unit: str
    interval: tuple[float | None, float | None] | None = None
    in_file: "Value | None" = None
    bounded: bool = False

    def times(self, factor: float, unit: str, name: str = "") -> "Value":
        """The same in another unit; under another name where it then is another parameter."""
        low, high = (None if v is None else factor * v for v in self.interval or (None, None))
        return Value(
            name or self.name,
            factor * self.value,
            None if self.std_error is None else factor * self.std_error,
            unit,
            None if self.interval is None else (low, high),
            bounded=self.bounded and not name,
        )

    @property
    def in_log_units(self) -> "Value":
        """The parameter as a reader of the log's columns meets it."""
        return self.in_file or self

    @property
    def visited(self) -> bool:
        """Whether the log goes where the parameter acts."""
        return not math.isnan(self.value)

    @property
    def words(self) -> str:
        """What is known beside the value: a 95 % interval or half of it, or why there is none."""
        if not self.visited:
            return "not seen in this log"
        if self.interval is not None:
            low, high = self.interval
            if low is None and high is None:
                return "not determined"
            if low is None or high is None:
                return f"at most {high:.4g}" if low is None else f"at least {low:.4g}"
            return f"{low:.4g} to {high:.4g}"
        if self.bounded:
            return "on the bound of the search"
        return "" if self.std_error is None else f"± {NORMAL * self.std_error:.2g}"

    @property
    def ends(self) -> tuple[float | None, float | None] | None:
        """The 95 % interval; an end that the log leaves open is None, as is all where unknown."""
        if self.interval is not None or self.std_error is None or self.bounded:
            return self.interval
        reach = NORMAL * self.std_error
        return self.value - reach, self.value + reach

    @property
    def shown(self) -> str:
        """The parameter in a sentence, after its name."""
        unit = f" {self.unit}" if self.unit else ""
        if not self.visited:
            return "is not seen in this log"
        if self.interval is None:
            if self.bounded:
                return f"= {self.value:.3g}{unit} ({self.words})"
            return f"= {self.value:.3g} {self.words}{unit}".replace("  ", " ")
        if None in self.interval:
            return f"is {self.words}{unit}"
        return f"= {self.value:.4g} ({self.words}){unit}"

    def to_json(self) -> dict[str, Any]:
        """{name, value, std_error, unit, interval, visited, on_bound}, and the same ``in_file``."""
        in_file = {} if self.in_file is None else {"in_file": self.in_file}
        return {
            "name": self.name,
            "value": self.value,
            "std_error": self.std_error,
            "unit": self.unit,
            "interval": self.interval,
            "visited": self.visited,
            "on_bound": self.bounded,
            **in_file,
        }


@dataclass(frozen=True)
class NamedEffect:
    """One accepted effect.

    Attributes:
        stage: actuator, motor, vehicle, sensor or any.
        evidence: what speaks for it; None for what is read off the samples, where no error is
            compared.
        indistinguishable: other effects that explain this log as well.
        remains: what stays there although it is added, in words; empty where that is noise.
    """

    id: str
    stage: str
    channels: tuple[str, ...]
    parameters: tuple[Value, ...]
    evidence: Evidence | None
    indistinguishable: tuple[str, ...]
    sentence: str
    remains: str = ""

    @property
    def error_ratio_without(self) -> float | None:
        """Held-out RMSE without the effect over that with it; None where it lowers no error."""
        return None if self.evidence is None else 1.0 / max(self.evidence.ratio, 1e-3)

    @property
    def fit_words(self) -> str:
        """The held-out error without the effect, and what remains; empty where unknown."""
        if self.error_ratio_without is None:
            return ""
        ratio = f"Without it the held-out error is {self.error_ratio_without:.3g} times as large"
        return f"{ratio}; {self.remains}." if self.remains else f"{ratio}."

    def to_json(self) -> dict[str, Any]:
        """As ``diagnosis.json`` holds it; of evidence the relative fall of the held-out RMSE."""
        e = self.evidence
        return {
            "id": self.id,
            "stage": self.stage,
            "channels": self.channels,
            "parameters": self.parameters,
            "evidence": e and {**e.to_json(), "heldout_gain": 1.0 - e.ratio},
            "indistinguishable": self.indistinguishable,
            "sentence": self.sentence,
            "error_ratio_without": self.error_ratio_without,
            "remains": self.remains,
        }


@dataclass(frozen=True)
class RejectedEffect:
    """An effect that was selected first and rejected later, with the reason.

    Attributes:
        rule: the rule that spoke, by its name in the ledger.
    """

    id: str
    reason: str
    rule: str = ""


@dataclass(frozen=True)
class Experiment:
    """A run that would show what this log cannot.

    Attributes:
        columns: ``t`` [s] and one command a track, as the log calls them.
        schedule: one row at each change: (time, command, command, …).
        file: name under which the schedule is written beside the diagnosis, empty when it is not.
    """

    purpose: str
    effects: tuple[str, ...]
    columns: tuple[str, ...]
    schedule: tuple[tuple[float, ...], ...]
    file: str = ""


@dataclass(frozen=True, eq=False)
class Trace:
    """A record with the free runs of both models on it, for pictures and words.

    Attributes:
        before, after: measurements of both models, (N, ny).
        role: ``estimation`` or ``held-out``.
        counted: samples that count in this role, (N,) of 0 and 1.
    """

    record: Record
    before: Array
    after: Array
    role: str
    counted: Array


@dataclass(frozen=True)
class Against:
    """A model that the result is compared with: its free run on the held-out data.

    Attributes:
        name: what it is called: its structure, or its name in a workspace.
        rmse: of each output, in its unit.
    """

    name: str
    rmse: dict[str, float]

    def sentence(self, gap: Gap) -> str:
        """How far its errors are from those of the original and of the augmented model."""
        parts = (
            f"{v:.3g} on {name} ({gap.channels[name].rmse_before:.3g} before, "
            f"{gap.channels[name].rmse_after:.3g} after)"
            for name, v in self.rmse.items()
        )
        return f"{self.name} has a held-out error of {', '.join(parts)}."


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Where a model and a log disagree, what is missing, and the proof.

    Attributes:
        verdict: ``effects-found``, ``shape-found``, ``no-missing-effect`` or ``unexplained``.
        shapes: what has no physics and explains part of what the augmented model leaves.
        curves: the shape at the place of a named effect, by the log without the effect's law.
        candidates: (id, score) of every effect tried first, best first.
        detectable: per effect the smallest size this log would have shown, None where it cannot.
        description: a sparse description of what no effect explains, empty without one.
        path: proof on a mission's path, JSON-able, empty without one.
        isolability: which effects the log could show and distinguish.
        against: what another model of the same channels makes of the held-out data, if one was
            given to compare with.
        geometry: the vehicle's lengths, where nobody gave them and the pose contradicts those
            that are assumed.
        changes: what changes within a log, and when, in sentences.
        reading: what was done to the logs as they were read, in sentences.
        unfollowed: that the augmented model does not follow the log, and what to do; empty where it
            does.
        undecided: why nothing is named although the errors are far above the noise of the
            measurements; empty elsewhere.
        excess_error: size of the errors of the augmented model beyond the noise, where they are
            structured: what has no name.
        tests: residual tests of the augmented model on the estimation data, as `compare` shows
            them; None where nothing was added or its errors on held-out data are structured anyway.
    """

    verdict: str
    story: str
    base_words: str
    effects: tuple[NamedEffect, ...]
    minor: tuple[str, ...]
    candidates: tuple[tuple[str, float], ...]
    where: tuple[Region, ...]
    where_after: tuple[Region, ...]
    gap: Gap
    detectable: dict[str, float | None]
    next_experiments: tuple[Experiment, ...]
    before: Model
    after: Model
    residuals: tuple[ResidualVerdict, ...] = ()
    description: str = ""
    warnings: tuple[str, ...] = ()
    traces: tuple[Trace, ...] = ()
    path: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    against: Against | None = None
    isolability: "Isolability | None" = None
    changes: tuple[str, ...] = ()
    geometry: GeometryEstimate | None = None
    unfollowed: str = ""
    undecided: str = ""
    rejected: tuple[RejectedEffect, ...] = ()
    excess_error: ExcessError | None = None
    tests: ResidualReport | None = None
    reading: tuple[str, ...] = ()
    shapes: tuple[FoundShape, ...] = ()
    curves: tuple[FoundShape, ...] = ()
    several: SeveralLogs = field(default_factory=SeveralLogs)

    @property
    def grown(self) -> bool:
        """Whether anything was added to the model: what is only seen in the samples is not."""
        return self.after is not self.before

    def __repr__(self) -> str:
        return (
            f"<Diagnosis {self.verdict}: {', '.join(e.id for e in self.effects) or 'no effects'}>"
        )

    def _repr_html_(self) -> str:
        rows = [(e.id, ", ".join(e.channels), e.sentence) for e in self.effects]
        words = self.verdict.replace("-", " ").capitalize()
        closed = f": {self.gap.closed_percent:.0f} % of the excess error closed" if rows else ""
        table = html_table(rows, ("effect", "outputs", "")) if rows else ""
        return html_lines(f"{words}{closed}.", self.story) + table + html_lines(*self.warnings)

    def to_json(self, before: str = "", after: str = "") -> dict[str, Any]:
        """The document ``diagnosis.json``.

        Args:
            before, after: ids under which the models are kept in the workspace.
        """
        return plain_object(
            {
                "verdict": self.verdict,
                "story": self.story,
                "changes": self.changes,
                "base": self.base_words,
                "against": self.against,
                "isolability": self.isolability,
                "geometry": self.geometry,
                "effects": self.effects,
                "shapes": self.shapes,
                "curves": self.curves,
                "minor": self.minor,
                "rejected": self.rejected,
                "excess_error": self.excess_error,
                **by_field(self.several),
                "candidates": [{"id": k, "score": v} for k, v in self.candidates],
                "where": self.where,
                "where_after": self.where_after,
                "gap": self.gap,
                "detectable": self.detectable,
                "next_experiments": self.next_experiments,
                "original_model": before,
                "augmented_model": after,
                "residual_tests": self.residuals,
                "description": self.description,
                "reading": self.reading,
                "warnings": self.warnings,
                "path": self.path,
                "seconds": self.seconds,
            }
        )
