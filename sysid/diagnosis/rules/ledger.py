"""What may speak against an accepted effect: the list of rules, and how it is walked."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from types import MappingProxyType

from sysid.diagnosis.diagnosis import RejectedEffect
from sysid.diagnosis.rules.better_shape import shape_instead
from sysid.diagnosis.rules.final_model import measured, weakest
from sysid.diagnosis.rules.outside_catalogue import outside_catalogue
from sysid.diagnosis.rules.unstable_in_loop import unstable_in_loop
from sysid.diagnosis.search.selection import Selection
from sysid.diagnosis.session import DiagnosisSession

Objection = Callable[[DiagnosisSession, Selection], RejectedEffect | None]
"""The accepted effect that a rule speaks against, and why; None where it has nothing to say."""


def final_model(session: DiagnosisSession, selection: Selection) -> RejectedEffect | None:
    """The accepted effect that no longer holds in the final model."""
    tested = session.residual_structure(selection.final) is not None
    return weakest(session.base, selection, tested)


BEFORE_INTERVALS: Mapping[str, Objection] = MappingProxyType(
    {"unstable-in-loop": unstable_in_loop, "better-shape": shape_instead}
)
"""Rules that need no intervals of parameters."""

OBJECTIONS: Mapping[str, Objection] = MappingProxyType(
    {
        "final-model": final_model,
        "outside-catalogue": outside_catalogue,
    }
)
"""Rules by name, in the order in which they are asked. ``studies/ablation.py`` leaves each out."""


def confirmed(
    session: DiagnosisSession, selection: Selection
) -> tuple[Selection, tuple[RejectedEffect, ...]]:
    """The accepted effects against which no rule speaks, and the others, each with its rule.

    After each rejection what is left is fitted again, and every rule is asked once more.
    """
    rejected: list[RejectedEffect] = []
    while (said := objection(BEFORE_INTERVALS, session, selection)) is not None:
        rejected.append(said)
        selection = session.base.search.without_effect(selection, said.id)
    selection = measured(session.base, selection)
    while (said := objection(OBJECTIONS, session, selection)) is not None:
        rejected.append(said)
        gone = {r.id for r in rejected}
        other = _tied_instead(session, selection, said.id, gone)
        selection = other or measured(
            session.base, session.base.search.without_effect(selection, said.id)
        )
    return selection, tuple(rejected)


def _tied_instead(
    session: DiagnosisSession, selection: Selection, id: str, gone: Collection[str]
) -> Selection | None:
    """What ties with a rejected effect in its place, if no rule speaks against that; else None."""
    search = session.base.search
    (named,) = (n for n in selection.selected if n.id == id)
    for rival in (r for r in named.ties if r in named.rivals and r not in gone):
        model = named.rivals[rival]
        selected = search.account(selection.base, model, search.model.effects, ())
        other = replace(selection, final=model, selected=selected, intervals={})
        other = measured(session.base, other)
        if objection(OBJECTIONS, session, other) is None:
            return other
    return None


def objection(
    rules: Mapping[str, Objection], session: DiagnosisSession, selection: Selection
) -> RejectedEffect | None:
    """What the first rule that objects says, with its name."""
    for name, rule in rules.items():
        if selection.selected and (said := rule(session, selection)) is not None:
            return replace(said, rule=name)
    return None
