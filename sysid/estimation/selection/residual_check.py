"""The last word of a selection: residuals in which the inputs show are those of a wrong model."""

from collections.abc import Sequence

from sysid.criteria import table
from sysid.estimation.assessment.findings import Assessment
from sysid.estimation.soundness import bounded_run
from sysid.fitting.holdout import CLOSE
from sysid.structures.orders import orders_text


def valid_first(
    judged: Sequence[Assessment],
    reason: str,
    criterion: str = "fit",
    names: Sequence[str] = (),
) -> tuple[tuple[Assessment, ...], str]:
    """Assessments, one whose residuals do not follow the inputs first, and why it leads.

    Held-out errors of structures differ by how far a coarse search came, and by chance. Residuals
    correlated with the inputs show that dynamics are missing or biased, and intervals do not hold
    then (Ljung 1999, §16.6). So a leader that fails this test gives way to the first model behind
    it that passes every test, whose free run is bounded and that errs no more, neither in free run
    nor one step ahead: the test has little power beside strongly coloured residuals, where a noise
    model predicts what an output-error model leaves. That a search was given up while noise
    polynomials cancelled each other is nothing against such a model.

    Args:
        judged: the leader first.
        criterion: what ranked them; one of one-step errors has the last word itself.
        names: structures that may come before others for it, all when empty: what nobody named
            leads by its errors alone, since with many states it leaves no trace of a nonlinearity.
    """
    first = judged[0]
    ranks = table.criterion(criterion)
    if not ranks.of_free_run or all(t.passed for t in first.residuals.independence if t.judged):
        return tuple(judged), reason
    limits = [(1.0 + CLOSE) * error for error in _errors(first)]
    lead = next(
        (
            a
            for a in judged[1:]
            if a.residuals.passed
            and (not names or a.model.structure.name in names)
            and bounded_run(a.model.structure, a.model.theta)
            and all(e <= limit for e, limit in zip(_errors(a), limits, strict=True))
        ),
        None,
    )
    if lead is None:
        return tuple(judged), reason
    s = lead.model.structure
    why = (
        f"{s.name} {orders_text(s.order_values())} leads: the residuals of "
        f"{first.model.structure.name}, ahead on held-out data, are correlated with the inputs, "
        f"those of {s.name} are not, and on all estimation data it errs no more."
    )
    return (lead, *(a for a in judged if a is not lead)), why


def _errors(a: Assessment) -> tuple[float, float]:
    """Error in free run and one step ahead, in percent of the outputs' spread."""
    return 100.0 - a.estimation.free_run.mean_fit, 100.0 - a.estimation.one_step.mean_fit
