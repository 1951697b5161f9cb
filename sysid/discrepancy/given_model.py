"""Effects around a given model, or on the plainest base where that explains more."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.data.record import Record
from sysid.discrepancy.base_model import plain_base
from sysid.discrepancy.policies import RULE
from sysid.discrepancy.search.naming import Progress
from sysid.discrepancy.study import Outcome, Study
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


def _plainest(
    doubted: Study, estimation: Sequence[Record], held: Sequence[Record] | None, say: Progress
) -> Outcome | None:
    """Effects on the plainest base, where they explain more than the doubted model; else None."""
    try:
        base = plain_base(estimation, held, chain_effects())
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
