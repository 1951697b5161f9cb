"""An output that only its controller keeps from running away, or that alone moves its input: no
free run of a model says anything of it.
"""

from sysid.diagnosis.diagnosis import RejectedEffect
from sysid.diagnosis.search.selection import Selection
from sysid.diagnosis.session import DiagnosisSession


def unstable_in_loop(session: DiagnosisSession, selection: Selection) -> RejectedEffect | None:
    """The last effect that acts on nothing but outputs of a plant which is unstable by itself, or
    whose input nothing but a controller moves.

    A balancing robot stands only because its commands answer its fall. A model whose free run stays
    bounded is of another plant, and its errors say nothing of what this one lacks.
    """
    for named in reversed(selection.selected):
        if session.without_free_run[named.touched].all():
            return RejectedEffect(
                named.id, "its output runs away without the controller, or alone moves the input"
            )
    return None
