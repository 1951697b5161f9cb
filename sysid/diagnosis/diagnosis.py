"""The result of a diagnosis, as frozen dataclasses and as JSON."""

from dataclasses import dataclass, field
from typing import Any

from sysid.data.documents import by_field, plain_object
from sysid.data.record import Array, Record
from sysid.diagnosis.gap import Gap
from sysid.diagnosis.named_effects import NamedEffect, RejectedEffect
from sysid.diagnosis.several.results import SeveralLogs
from sysid.diagnosis.validation.excess_error import ExcessError
from sysid.diagnosis.validation.localise import Region
from sysid.diagnosis.validation.model_error import ResidualVerdict
from sysid.effects.samples import DROPOUTS, HELD_TELEMETRY, QUANTISATION
from sysid.robot.calibration.geometry import GeometryEstimate
from sysid.structures.model import Model

OF_THE_LOG = {
    QUANTISATION.id: "its measurements are coarse",
    HELD_TELEMETRY.id: "its telemetry repeats",
    DROPOUTS.id: "some measurements are lost",
}
"""What the samples themselves show: a matter of sensor and log, that no model lacks."""


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


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Where a model and a log disagree, what is missing, and the proof.

    Attributes:
        verdict: ``effects-found``, ``no-missing-effect`` or ``unexplained``.
        candidates: (id, score) of every effect tried first, best first.
        detectable: per effect the smallest size this log would have shown, None where it cannot.
        description: a sparse description of what no effect explains, empty without one.
        path: proof on a mission's path, JSON-able, empty without one.
        baseline_words: the base that the effects were added to where that is not the original
            model.
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
    baseline_words: str = ""
    changes: tuple[str, ...] = ()
    geometry: GeometryEstimate | None = None
    unfollowed: str = ""
    undecided: str = ""
    rejected: tuple[RejectedEffect, ...] = ()
    excess_error: ExcessError | None = None
    reading: tuple[str, ...] = ()
    several: SeveralLogs = field(default_factory=SeveralLogs)

    @property
    def grown(self) -> bool:
        """Whether anything was added to the model: what is only seen in the samples is not."""
        return self.after is not self.before

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
                "added_to": self.baseline_words or self.base_words,
                "geometry": self.geometry,
                "effects": self.effects,
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
