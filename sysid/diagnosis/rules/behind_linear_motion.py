"""An effect that explains less than linear motion of a higher order does."""

from sysid.diagnosis.diagnosis import RejectedEffect
from sysid.diagnosis.rules.linear_motion import linear_motion, worse_than_rival
from sysid.diagnosis.search.selection import Selection
from sysid.diagnosis.session import DiagnosisSession


def behind_linear_motion(session: DiagnosisSession, selection: Selection) -> RejectedEffect | None:
    """The weakest effect that explains less than linear motion does, where one is not linear."""
    if all(linear_motion(session.base, selection, n) for n in selection.selected):
        return None
    return worse_than_rival(session.base, session.linear_rival, selection)
