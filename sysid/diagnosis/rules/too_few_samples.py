"""Too few held-out samples to test what remains of the errors."""

from sysid.diagnosis.diagnosis import RejectedEffect
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.rules.final_model import final_evidence
from sysid.diagnosis.search.selection import Selection
from sysid.diagnosis.session import DiagnosisSession


def too_few_samples(session: DiagnosisSession, selection: Selection) -> RejectedEffect | None:
    """The effect that too few held-out samples confirm, where they cannot be tested at all."""
    if not selection.effects or session.residual_structure(selection, after=True) is not None:
        return None
    chances = {n.id: final_evidence(session.base, selection, n).p_value for n in selection.effects}
    id, p = max(chances.items(), key=lambda pair: pair[1])
    too_few = f"the held-out samples are too few to confirm it (p = {p:.2g})"
    return RejectedEffect(id, too_few) if p >= RULE.p else None
