"""The whole diagnosis: where, what, added, proven."""

import time
from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Record
from sysid.discrepancy.augment import model_of, values_of
from sysid.discrepancy.base_model import Base, given_base, plain_base
from sysid.discrepancy.diagnosis import Diagnosis, NamedEffect, Trace
from sysid.discrepancy.evidence import noise_floor
from sysid.discrepancy.localise import Region, localise
from sysid.discrepancy.naming import Named, Naming, Node, Progress
from sysid.discrepancy.verify import measure_gap
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED, about, chain_effects
from sysid.structures.model import Model


def diagnose(
    estimation: Sequence[Record],
    held: Sequence[Record] | None = None,
    *,
    model: Model | None = None,
    progress: Progress | None = None,
    seed: int = 0,
) -> Diagnosis:
    """Where a model and logs disagree, which effects are missing, and how far they close the gap.

    Args:
        estimation: logs that effects are searched on.
        held: logs that judge; None holds out blocks of the estimation logs.
        model: the model that disagrees; None fits the plainest base first.
        progress: told what is being done and how far it is.
        seed: of every bootstrap.

    Raises:
        DataError: the logs cannot serve.
        ModelError: the model cannot be run on them.
    """
    started = time.perf_counter()
    say = progress or (lambda text, share: None)
    say("the model before", 0.02)
    effects = chain_effects()
    if model is None:
        base = plain_base(estimation, held, effects)
    else:
        base = given_base(model, estimation, held, effects)
        effects = (*effects, CHANGED)
    naming = base.search.run(base.node, effects, lambda text, share: say(text, 0.1 + 0.7 * share))
    say("the proof", 0.85)
    floor = noise_floor(base.search.held)
    names = estimation[0].output_names
    gap = measure_gap(naming.base.errors.held, naming.final.errors.held, floor, names, seed)
    before = model if model is not None else model_of(base, naming.base)
    after = model_of(base, naming.final) if naming.named else before
    return Diagnosis(
        verdict="effects-found" if naming.named else "no-missing-effect",
        story=_story(naming),
        base_words=base.words,
        effects=tuple(_named(base, naming, n) for n in naming.named),
        minor=tuple(id for id, _ in naming.minor),
        candidates=naming.candidates,
        where=_where(base, naming.base, floor, seed),
        where_after=_where(base, naming.final, floor, seed),
        gap=gap,
        detectable={},
        next_experiments=(),
        before=before,
        after=after,
        traces=_traces(base, naming),
        seconds=time.perf_counter() - started,
    )


def _story(naming: Naming) -> str:
    if naming.named:
        return "Missing: " + ", ".join(n.id for n in naming.named) + "."
    return "No effect of the catalogue lowers the held-out error beyond doubt."


def _named(base: Base, naming: Naming, n: Named) -> NamedEffect:
    e = about(n.id)
    names = base.search.estimation[0].output_names
    return NamedEffect(
        n.id,
        e.stage,
        tuple(names[i] for i in np.flatnonzero(n.touched)),
        values_of(base, naming.final, n.id),
        n.evidence.delta_bic,
        n.evidence.p_value,
        1.0 - n.evidence.ratio,
        n.ties,
        _sentence(e, n, naming),
    )


def _sentence(e: Effect, n: Named, naming: Naming) -> str:
    text = e.sentence
    if n.ties:
        text += f" This log cannot tell it from {', '.join(n.ties)}."
    return text


def _where(base: Base, node: Node, floor: Array, seed: int) -> tuple[Region, ...]:
    errors = [np.nan_to_num(e) for e in node.errors.held]
    return localise(base.search.held, errors, floor, base.scales, seed)


def _traces(base: Base, naming: Naming) -> tuple[Trace, ...]:
    found = []
    for role, records, data, a, b in (
        ("estimation", base.search.estimation, base.search.data, "estimation", "estimation"),
        ("held-out", base.search.held, base.search.held_data, "held", "held"),
    ):
        del a, b
        before = data.split(base.search.model.run(naming.base.q, data)[0])
        after = data.split(base.search.model.run(naming.final.q, data)[0])
        weights = data.split(data.weight)
        found += [
            Trace(r, x, y, role, np.asarray(w.max(axis=1) > 0.0, dtype=np.float64))
            for r, x, y, w in zip(records, before, after, weights, strict=True)
        ]
    return tuple(found)
