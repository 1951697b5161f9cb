"""Effects around a given model or a base of high order, or on a plainer base where that explains
more: what fits a log in part has absorbed a part of what is missing."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.data.column_words import may_move
from sysid.data.record import Record
from sysid.diagnosis.base_model import LARGEST_ORDER, plain_base
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.naming import Progress
from sysid.diagnosis.study import Outcome, Study
from sysid.effects.catalogue import CHANGED, chain_effects
from sysid.errors import SysidError
from sysid.structures.model import Model


def around_model(
    model: Model,
    study: Study,
    estimation: Sequence[Record],
    held: Sequence[Record] | None,
    say: Progress,
) -> Outcome:
    """Effects around a given model as it is; or on the plainest base, where that explains more.

    A model that was fitted to the very logs has absorbed what is missing: then the plainest base
    comes first. Else it comes where what is added to the model does not explain all of the logs, or
    where several effects are added: some may only mend what is wrong with the model.
    """
    if not study.doubtful:
        return study.searched((), say)
    theirs = {s.sha256 for s in model.provenance.data}
    absorbed = any(r.sha256 in theirs for r in estimation)
    if absorbed:
        plainest = _plainest(study, estimation, held, say)
        if plainest is not None:
            return plainest
    effects = study.base.search.model.effects
    effects = effects if absorbed else (*effects, CHANGED)
    found = study.searched(effects, say)
    named = [n.id for n in found.naming.named]
    if absorbed or (len(named) == 1 and not study.unexplained(found.naming)):
        return found
    other = _plainest(study, estimation, held, say)
    if other is None:
        return found
    simpler = len(other.naming.named) < len(named) and CHANGED.id not in named
    below = RULE.as_good if simpler else RULE.held_out
    return other if other.study.explains_more(other.naming, found.naming.final, below) else found


def or_on_first_order(
    found: Outcome, estimation: Sequence[Record], held: Sequence[Record] | None, say: Progress
) -> Outcome:
    """What a search on the plain base has found, or on one of first order where that explains more.

    Play and friction look like further poles, and a base with these poles leaves of them what no
    law explains.
    """
    study, naming = found.study, found.naming
    moves = any(may_move(c.name, c.unit) for c in study.base.parts.estimation[0].outputs)
    if study.base.search.model.order == 1 or not moves or not study.doubtful:
        return found
    if naming.named and not study.unexplained(naming):
        return found
    other = _plainest(study, estimation, held, say, highest=1)
    if other is None or not other.study.explains_more(other.naming, naming.final):
        return found
    return other


def _plainest(
    doubted: Study,
    estimation: Sequence[Record],
    held: Sequence[Record] | None,
    say: Progress,
    highest: int = LARGEST_ORDER,
) -> Outcome | None:
    """Effects on the plainest base, where they explain more than the doubted model; else None."""
    try:
        base = plain_base(estimation, held, chain_effects(), highest)
    except SysidError:
        return None
    sizes = [[len(e) for e in b.node.errors.held] for b in (base, doubted.base)]
    if sizes[0] != sizes[1]:
        return None  # an output that integrates: other samples
    study = replace(doubted, base=base)
    found = study.searched(base.search.model.effects, say)
    if not study.explains_more(found.naming, doubted.base.node):
        return None
    return replace(found, study=replace(study, doubted=doubted))
