"""Physics outside the catalogue, for which an effect may stand in."""

import numpy as np

from sysid.diagnosis.base_model import Base
from sysid.diagnosis.diagnosis import RejectedEffect
from sysid.diagnosis.policies import VERDICT
from sysid.diagnosis.search.selection import Selection
from sysid.diagnosis.session import DiagnosisSession
from sysid.diagnosis.validation.model_error import structured
from sysid.effects.base import Place
from sysid.effects.catalogue import about


def outside_catalogue(session: DiagnosisSession, selection: Selection) -> RejectedEffect | None:
    """The last effect where all may stand in for physics outside the catalogue.

    Outflow, radiation and boiling are none of its effects, and bend like a dead zone. Without
    friction and gears beside it, an effect of the actuator or sensor explains nearly all. Nor is
    the stiffness of a spring one of its effects: beside what swings long, the same is asked of all
    but what a sensor does.
    """
    moves = session.moves
    by_sensor = all(about(n.id).place is Place.READING for n in selection.selected)
    if moves and (by_sensor or not swings(session.base)):
        return None
    return stand_in(session, selection)


def stand_in(session: DiagnosisSession, selection: Selection) -> RejectedEffect | None:
    """The last effect where errors remain that the command predicts, and much of the gap."""
    structure = session.residual_structure(selection.final)
    if not structured(structure) or session.gap(selection).closed_percent >= VERDICT.nearly_all:
        return None
    last = min(selection.selected, key=lambda n: -n.evidence.delta_bic)
    return RejectedEffect(
        last.id,
        "the remaining errors are correlated with the command, and the catalogue covers motion "
        "rather than processes: other physics may look like it",
    )


def swings(base: Base) -> bool:
    """Whether it swings long, as on a spring."""
    return least_damping(base) < VERDICT.min_damping


def least_damping(base: Base) -> float:
    """The least damping ratio ζ of its poles, ln z = −ζ ω₀ Δt ± …; 1 where none swings."""
    z = base.poles
    swinging = z[(np.abs(z.imag) > 0.0) & (np.abs(z) > 0.0)].astype(complex)
    s = np.log(swinging)
    return float(np.min(-s.real / np.abs(s), initial=1.0))
