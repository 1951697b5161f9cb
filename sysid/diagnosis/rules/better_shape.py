"""A shape without physics, at another place or of time, that explains more than a name."""

from sysid.diagnosis.diagnosis import RejectedEffect
from sysid.diagnosis.search.selection import Selection
from sysid.diagnosis.session import DiagnosisSession
from sysid.diagnosis.shapes.grading import better_shape


def shape_instead(session: DiagnosisSession, selection: Selection) -> RejectedEffect | None:
    """An effect that a shape of another place, or of time, explains better; alone, or all together.

    Of all together the weakest goes first: the others are asked again.
    """
    selected = selection.selected
    tracks = [p.track for p in session.base.search.model.parameters]
    weakest_first = tuple(sorted(selected, key=lambda n: -n.evidence.delta_bic))
    single = [((n,), n.rest) for n in weakest_first]
    together = [(weakest_first, selection.base)] if len(selected) > 1 else []
    for names, without in (*together, *single):
        shape = better_shape(session.shapes(without), selection, names, without, tracks)
        if shape is not None:
            sentence, _ = shape.says()
            return RejectedEffect(names[0].id, f"a shape without physics explains more: {sentence}")
    return None
