"""The logs of stored models, read again with the options of the fit."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.workspace.store import StoredModel

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.estimation.selection.comparison import Contender

SAME_INSTANT = 1e-3
"""Share of a sample within which two instants are the same: times are stored as they were read."""


def judged_on(records: "Sequence[Record]", logs: Sequence[Path]) -> dict[str, Any] | None:
    """What a report holds of its validation data, so that they can be found again."""
    if not records:
        return None
    return {
        "files": [str(p.resolve()) for p in logs],
        "sources": [{"sha256": r.sha256, "first": r.t0, "samples": len(r)} for r in records],
    }


def as_fitted(
    stored: StoredModel | None, read: "ReadOptions", steps: "Preparation"
) -> "tuple[ReadOptions, Preparation]":
    """How to read and prepare a log: as the model's own data were, where nothing else is said."""
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions

    stored_read, stored_steps = _stored(stored.model.provenance.options if stored else {})
    return (
        stored_read if read == ReadOptions() else read,
        stored_steps if steps == Preparation() else steps,
    )


def _stored(options: Mapping[str, Any]) -> "tuple[ReadOptions, Preparation]":
    """How the logs of a model were read and prepared."""
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.schema import checked
    from sysid.errors import UsageError

    try:
        return (
            checked(ReadOptions, options.get("read", {})),
            checked(Preparation, options.get("prepare", {})),
        )
    except ValueError as error:
        raise UsageError(
            f"the options stored with the model are damaged ({error}); fit it again"
        ) from None


class StoredData:
    """Reads the logs of many models, each log once."""

    def __init__(self) -> None:
        self._read: dict[str, tuple[Record, ...]] = {}

    def contender(self, stored: StoredModel) -> "Contender":
        """The model with its data, as far as they are at hand, to be compared with others."""
        from sysid.estimation.selection.comparison import Contender

        records, judged_on = self.estimation(stored), self.validation(stored)
        return Contender(stored.id, stored.model, records, stored.report, judged_on)

    def estimation(self, stored: StoredModel) -> "tuple[Record, ...] | None":
        provenance = stored.model.provenance
        wanted = [(s.sha256, s.first, s.samples) for s in provenance.data]
        return self._found(stored, provenance.options.get("files"), wanted)

    def validation(self, stored: StoredModel) -> "tuple[Record, ...] | None":
        """What the model was judged on when it was fitted, or None where that is not known."""
        judged_on = stored.report.get("judged_on")
        if not isinstance(judged_on, Mapping):
            return None
        try:
            wanted = [(s["sha256"], s["first"], s["samples"]) for s in judged_on["sources"]]
        except (KeyError, TypeError):
            return None
        return self._found(stored, judged_on.get("files"), wanted)

    def judging(self, stored: StoredModel) -> "tuple[Record, ...]":
        """What judges a model: its validation log, else what it was fitted to."""
        return self.validation(stored) or self.estimation(stored) or ()

    def _found(
        self, stored: StoredModel, files: Any, wanted: list[tuple[str, float, int]]
    ) -> "tuple[Record, ...] | None":
        """The pieces of a model's logs; None where they are gone or are not what it was fitted to.

        A diagnosis models the rate of an output that integrates: the file holds the output.
        """
        from sysid.errors import SysidError

        model = stored.model
        try:
            whole = self._prepared(model.provenance.options, list(files or []), model.dt)
        except (SysidError, KeyError, TypeError):
            return None
        pieces = [_piece(whole, *source) for source in wanted]
        records = tuple(p for p in pieces if p is not None)
        if not records or len(records) != len(wanted):
            return None
        there = {*records[0].input_names, *records[0].output_names}
        return records if {c.name for c in (*model.inputs, *model.outputs)} <= there else None

    def _prepared(
        self, options: Mapping[str, Any], files: list[str], dt: float
    ) -> "tuple[Record, ...]":
        from json import dumps

        from sysid.data.preparation import read_prepared

        how = {"read": options.get("read", {}), "prepare": options.get("prepare", {})}
        key = dumps([files, how, dt], sort_keys=True, default=str)
        if key not in self._read:
            read, steps = _stored(how)
            self._read[key], _ = read_prepared([Path(f) for f in files], read, steps, dt)
        return self._read[key]


def _piece(whole: "Sequence[Record]", sha256: str, first: float, samples: int) -> "Record | None":
    """The stretch of ``samples`` samples from the instant ``first`` of the file with that hash."""
    for r in whole:
        at = (first - r.t0) / r.dt
        start = round(at)
        if r.sha256 == sha256 and abs(at - start) < SAME_INSTANT and start >= 0:
            piece = r.rows(start, start + samples)
            if len(piece) == samples:
                return piece
    return None
