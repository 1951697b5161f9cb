"""Which base effects are searched on."""

from dataclasses import replace

import numpy as np

from sysid.data.facts import LogFacts
from sysid.diagnosis.base_model import fit_baseline
from sysid.diagnosis.policies import RULE, VERDICT
from sysid.diagnosis.rules.ledger import confirmed
from sysid.diagnosis.rules.outside_catalogue import stand_in, swings
from sysid.diagnosis.search.forward_selection import Progress
from sysid.diagnosis.session import DiagnosisSession, SelectionResult
from sysid.effects.catalogue import DELAY, chain_effects
from sysid.errors import SysidError


def or_on_first_order(
    result: SelectionResult,
    facts: LogFacts,
    holdout: LogFacts | None,
    say: Progress,
) -> SelectionResult:
    """What a search on the plain base has found, or on one of first order where that explains more.

    Play, friction, a fall that takes longer than a rise look like further poles, and a base with
    these poles leaves of them what no law explains. Those effects are compared that no rule speaks
    against; where no effect is found, the shapes. Their numbers (a gain, a time constant) say more
    of a core of first order.
    """
    session, selection = result.session, result.selection
    if session.base.search.model.order == 1 or session.required_ratio() == 0.0:
        return result
    kept, _ = confirmed(session, selection)
    closed = session.gap(kept).closed_percent >= VERDICT.nearly_all
    if kept.selected and closed and not session.far_above_noise(kept.final):
        return result
    try:
        offset = session.base.search.level
        base = fit_baseline(facts, holdout, chain_effects(), highest=1, offset=offset)
    except SysidError:
        return result
    first_order = replace(session, base=base).searched(base.search.model.effects, say)
    found, _ = confirmed(first_order.session, first_order.selection)
    if found.selected and swings(session.base) and stand_in(first_order.session, found):
        return result  # what swings and is not explained is a spring, which no effect is
    if not (found.selected or kept.selected):
        left, other = (_left_by_shapes(r.session) for r in (first_order, result))
        return first_order if left < RULE.tie * other else result
    return first_order if first_order.session.explains_more(found, kept.final) else result


def or_a_sample_later(
    result: SelectionResult, facts: LogFacts, holdout: LogFacts | None
) -> SelectionResult:
    """What a search on the base without a delay has found, or the same on one of a sample.

    Which of both a log is written by is seen before any effect is known, and friction shifts it:
    a command that then takes effect one sample later does so in the base. The sample is taken where
    the other effects beside it leave as little without a delay of their own.
    """
    session, final = result.session, result.selection.final
    before = session.base.search
    if before.delay != 0 or DELAY.id not in final.effects:
        return result
    base = fit_baseline(facts, holdout, chain_effects(), before.model.order, 1, before.level)
    own, q = set(before.model.of(DELAY.id)), final.q.copy()
    q[list(own)] = before.model.null[list(own)]
    others = tuple(e for e in final.effects if e != DELAY.id)
    free = tuple(k for k in final.free if k not in own)
    same = base.search.evaluate(others, q, free, final.touched)
    fitted = base.search.fitted(same)  # where a drive sticks, other numbers may fit one log better
    later = min(same, fitted, key=lambda c: c.holdout_rmse)
    if later.holdout_rmse > RULE.tie * final.holdout_rmse:
        return result
    selected = base.search.account(base.model, later, base.search.model.effects, ())
    found = replace(result.selection, base=base.model, final=later, selected=selected, intervals={})
    return SelectionResult(replace(session, base=base), found)


def _left_by_shapes(session: DiagnosisSession) -> float:
    """Held-out error of a base, or what the best shape of each output leaves of it."""
    base = session.base.model
    left = base.errors.mean_squares()[1].copy()
    for s in session.shapes(base):
        if s.proven and not s.follows_anything:
            left[s.index] = min(left[s.index], s.after.mean_squares()[1][0])
    return float(np.sqrt(np.sum(left)))
