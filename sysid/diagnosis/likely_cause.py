"""The likely cause of a prediction error: one effect and a sentence, from a diagnosis."""

from dataclasses import dataclass

from sysid.data.record import Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.diagnosis import OF_THE_LOG
from sysid.diagnosis.search.forward_selection import Progress
from sysid.errors import SysidError
from sysid.structures.model import Model
from sysid.vehicle.kinematics import Geometry

BESIDE_THE_PLANT = (
    "The plant explains the measured wheel speeds, so the cause lies in what the runs have besides "
    "it: check the mission's start, laws, vehicle lengths and ground."
)
NO_NAME = (
    "The plant does not explain the measured wheel speeds, and no effect of the catalogue is "
    "significant; run `sysid diagnose` on this log."
)
"""What a diagnosis without a name means for a drive that leaves its prediction."""


@dataclass(frozen=True)
class LikelyCause:
    """What explains a log that does not go with its prediction.

    Attributes:
        name: id of the effect that a diagnosis names first; None where it names none.
    """

    name: str | None
    others: tuple[str, ...]
    sentence: str


def likely_cause(
    record: Record, model: Model, geometry: Geometry | None, progress: Progress | None = None
) -> LikelyCause:
    """Diagnose a drive by the model that predicted it.

    What only the samples show (coarse measurements, lost ones) turns no robot aside and is no
    cause.
    """
    try:
        model.check(record)
        diagnosis = diagnose([record], model=model, geometry=geometry, progress=progress)
    except SysidError as error:
        return LikelyCause(None, (), f"No cause can be named: {error}.")
    causes = [e for e in diagnosis.effects if e.id not in OF_THE_LOG]
    if not causes:
        explained = diagnosis.verdict == "no-missing-effect"
        return LikelyCause(None, (), BESIDE_THE_PLANT if explained else NO_NAME)
    first, *rest = causes
    others = tuple(e.id for e in rest)
    also = f" Also found: {', '.join(others)}." if others else ""
    return LikelyCause(first.id, others, f"Likely cause: {first.id}. {first.sentence}{also}")
