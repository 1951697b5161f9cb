"""Effects around a given model or on the baseline, whichever explains more.

A model that fits a log partly has absorbed part of what is missing.
"""

from collections.abc import Sequence
from dataclasses import replace

from sysid.data.column_words import may_move
from sysid.data.facts import LogFacts
from sysid.diagnosis.base_model import LARGEST_ORDER, fit_baseline
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.forward_selection import Progress
from sysid.diagnosis.session import DiagnosisSession, SelectionResult
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED, chain_effects
from sysid.errors import SysidError
from sysid.structures.model import Model


def around_model(
    model: Model,
    session: DiagnosisSession,
    facts: LogFacts,
    holdout: LogFacts | None,
    say: Progress,
) -> SelectionResult:
    """Effects around a given model as it is, or on the baseline where that explains more.

    A model fitted to the same logs has absorbed what is missing: then the baseline comes first.
    Otherwise it is tried where the effects leave much unexplained, or where there are several: some
    may only correct errors of the model.
    """
    if not session.needs_explanation:
        return session.searched((), say)
    fitted_logs = {s.sha256 for s in model.provenance.data}
    absorbed = any(r.sha256 in fitted_logs for r in facts.records)
    if absorbed:
        on_baseline = _on_baseline(session, facts, holdout, say)
        if on_baseline is not None:
            return on_baseline
    effects = session.base.search.model.effects
    effects = effects if absorbed else (*effects, CHANGED)
    result = session.searched(effects, lambda text, share: say(text, 0.5 * share))
    named = [n.id for n in result.selection.selected]
    if absorbed or (len(named) == 1 and not session.unexplained(result.selection)):
        return result
    on_plain_base = _on_baseline(
        session, facts, holdout, lambda text, share: say(text, 0.35 + 0.5 * share)
    )
    if on_plain_base is None:
        return result
    simpler = len(on_plain_base.selection.selected) < len(named) and CHANGED.id not in named
    below = RULE.as_good if simpler else RULE.held_out
    return (
        on_plain_base
        if on_plain_base.session.explains_more(
            on_plain_base.selection, result.selection.final, below
        )
        else result
    )


def possible(effects: Sequence[Effect], facts: LogFacts) -> tuple[Effect, ...]:
    """Effects without those that gather over a log, where a log changes at one time."""
    at_once = any(c.is_step for c in facts.changes)
    return tuple(e for e in effects if not (at_once and e.gathers))


def or_on_first_order(
    result: SelectionResult,
    facts: LogFacts,
    holdout: LogFacts | None,
    say: Progress,
) -> SelectionResult:
    """What a search on the plain base has found, or on one of first order where that explains more.

    Play and friction look like further poles, and a base with these poles leaves of them what no
    law explains.
    """
    session, selection = result.session, result.selection
    moves = any(may_move(c.name, c.unit) for c in session.base.parts.estimation[0].outputs)
    if session.base.search.model.order == 1 or not moves or not session.needs_explanation:
        return result
    if selection.selected and not session.unexplained(selection):
        return result
    on_first_order = _on_baseline(session, facts, holdout, say, highest=1)
    if on_first_order is None or not on_first_order.session.explains_more(
        on_first_order.selection, selection.final
    ):
        return result
    return on_first_order


def _on_baseline(
    given: DiagnosisSession,
    facts: LogFacts,
    holdout: LogFacts | None,
    say: Progress,
    highest: int = LARGEST_ORDER,
) -> SelectionResult | None:
    """Effects on the baseline, where they explain more than the given model; else None."""
    try:
        base = fit_baseline(facts, holdout, possible(chain_effects(), facts), highest)
    except SysidError:
        return None
    sizes = [[len(e) for e in b.model.errors.holdout] for b in (base, given.base)]
    if sizes[0] != sizes[1]:
        return None  # an output that integrates: other samples
    session = replace(given, base=base)
    result = session.searched(base.search.model.effects, say)
    if not session.explains_more(result.selection, given.base.model):
        return None
    return replace(result, session=replace(session, given=given))
