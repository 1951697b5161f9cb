"""An output that only its controller keeps from running away: no free run of a model follows it."""

from sysid.diagnosis.diagnosis import RejectedEffect
from sysid.diagnosis.search.selection import Selection
from sysid.diagnosis.session import DiagnosisSession


def unstable_in_loop(session: DiagnosisSession, selection: Selection) -> RejectedEffect | None:
    """The last effect that acts on nothing but outputs of a plant which is unstable by itself.

    A balancing robot stands only because its commands answer its fall. A model whose free run stays
    bounded is of another plant, and its errors say nothing of what this one lacks.
    """
    for named in reversed(selection.selected):
        if session.running_away[named.touched].all():
            return RejectedEffect(named.id, "its output runs away without the controller")
    return None
