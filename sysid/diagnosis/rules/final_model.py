"""Final acceptance: every selected effect is checked again in the final model.

Its gain must be more than chance among all effects tried, and the 95 % interval of one of its
parameters must exclude the null value. That is a likelihood interval where the run jumps with the
parameter or where gradients leave it in doubt.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.augment import std_errors
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.diagnosis import RejectedEffect
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.admission import sampled
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.search.full_model import NO_LIMIT
from sysid.diagnosis.search.intervals import SAME_RUN, UNCERTAIN, intervals_of
from sysid.diagnosis.search.selection import CandidateModel, Interval, SelectedEffect, Selection
from sysid.diagnosis.validation.exchange import with_exchanged_lags
from sysid.effects.catalogue import CHANGED, about
from sysid.fitting.profile import NORMAL


@dataclass(frozen=True)
class ParameterEstimate:
    """One free parameter of an accepted effect.

    Attributes:
        value, null: estimate, and the value at which the effect does nothing.
        std_error: by slopes.
        interval: 95 %, where slopes are not asked.
        sampled: how late a log's making leaves any output [s], if it is a delay or a lag: up to
            there it is none of the machine.
    """

    value: float
    null: float
    std_error: float
    interval: Interval | None = None
    sampled: float = 0.0

    @property
    def away(self) -> bool:
        """Whether 95 % say that the parameter does something."""
        if self.interval is None:
            beyond = abs(self.value - self.null) - self.sampled
            return beyond > NORMAL * self.std_error > 0.0
        if not self.interval.visited:
            return False
        low, high = self.interval.low, self.interval.high
        if abs(self.null) > NO_LIMIT:
            return (high if self.null > 0.0 else low) is not None
        above = low is not None and low > self.null + self.sampled
        return above or (high is not None and high < self.null)


def against(
    evidence: Evidence,
    parameters: Sequence[ParameterEstimate],
    needed: float = RULE.own_part,
    tested: bool = True,
) -> str:
    """The objection to an accepted effect, in words after its name; empty where there is none.

    Args:
        needed: what the held-out error must fall below, as a share of before.
        tested: whether the held-out samples suffice to test the errors that are left: else chance
            alone decides.
    """
    if not evidence.delta_bic < RULE.bic:
        return f"its parameters cost more than they gain (ΔBIC {evidence.delta_bic:.3g})"
    if not evidence.ratio < needed:
        change = 100.0 * (evidence.ratio - 1.0)
        return f"in the final model it changes the held-out error by {change:+.0f} %"
    if not (evidence.p_value < RULE.p or (tested and _beyond_chance(evidence))):
        return f"its gain may be chance (p = {evidence.p_value:.2g} among all effects tried)"
    if parameters and not any(n.away for n in parameters):
        return "the 95 % interval of each of its parameters includes the null value"
    return ""


def _beyond_chance(evidence: Evidence) -> bool:
    """Whether so much is gained that a few blocks which hold most of it make no chance of it.

    Events a log holds seldom (a stop, a reversal) spread the gains of its blocks and keep their t
    small, however often the same gain is found in all of them together.
    """
    return evidence.delta_bic < RULE.certain_bic and evidence.t > RULE.t


def weakest(base: Base, selection: Selection, tested: bool = True) -> RejectedEffect | None:
    """The accepted effect to reject first, or None where all hold; see ``against``."""
    # one alone must do what a first effect must; beside others each keeps its own part
    rule = base.search.needed if len(selection.selected) == 1 else RULE.own_part, tested
    objections = [
        (n, against(final_evidence(base, selection, n), estimates_of(base, selection, n), *rule))
        for n in selection.selected
    ]
    failed = [(n, reason) for n, reason in objections if reason]
    if not failed:
        return None
    named, reason = max(failed, key=lambda f: f[0].evidence.delta_bic)
    return RejectedEffect(named.id, reason)


def final_evidence(base: Base, selection: Selection, named: SelectedEffect) -> Evidence:
    """What speaks for an accepted effect in the final model, whose parameters others have moved."""
    final = replace(selection.final, touched=named.touched)
    return base.search.evidence(named.rest, final, len(base.search.model.effects))


def estimates_of(
    base: Base, selection: Selection, named: SelectedEffect
) -> tuple[ParameterEstimate, ...]:
    """The free parameters in the final model that show whether an accepted effect is there."""
    if named.id == CHANGED.id:
        return ()
    candidate, model = selection.final, base.search.model
    at = std_errors(base, candidate)
    parameters = {
        k: ParameterEstimate(
            float(candidate.q[k]),
            model.parameters[k].null,
            at[k],
            selection.intervals.get(k),
            sampled(model, k, candidate.q),
        )
        for k in _telling(base, candidate, named.id)
        if k in at
    }
    if not any(n.away for n in parameters.values()) or all(n.away for n in parameters.values()):
        return tuple(parameters.values())
    acting = _acting_alone(base, candidate, tuple(parameters))
    return tuple(parameters[k] for k in acting or parameters)


def _telling(base: Base, candidate: CandidateModel, id: str) -> tuple[int, ...]:
    """Slots of an effect whose numbers show whether it is there: all, or of one that ties tracks
    the first of its law. Without that tie, the others only bend each track's own response."""
    effect, model = about(id), base.search.model
    own = model.of(id)
    law = effect.law(model.chosen(effect, candidate.q)) if effect.couples else None
    if law is None:
        return own
    return tuple(k for k in own if model.parameters[k].name == law.parameters[0])


def _acting_alone(base: Base, candidate: CandidateModel, own: Sequence[int]) -> tuple[int, ...]:
    """Slots of an effect that do something while its other free parameters do nothing.

    What only shapes an effect says nothing of whether it is there: the time of a fading is no sign
    of one as long as its depth may be none.
    """
    model, data = base.search.model, base.search.data
    batch = np.repeat(candidate.q[None], len(own) + 1, axis=0)
    batch[:, list(own)] = [model.parameters[k].null for k in own]
    for row, k in zip(batch, own, strict=False):
        row[k] = candidate.q[k]
    *runs, rest = np.nan_to_num(model.run(batch, data)) * data.weight
    least = SAME_RUN * max(float(np.max(np.abs(rest))), 1e-300)
    return tuple(k for k, run in zip(own, runs, strict=True) if np.max(np.abs(run - rest)) > least)


def uncertain_parameters(base: Base, selection: Selection) -> tuple[int, ...]:
    """Free parameters that slopes say nothing of, and all of an effect that they put nowhere far
    away.

    A slope of nothing is no certainty: the log never goes where the parameter acts.
    """
    doubtful: list[int] = []
    final, model = selection.final, base.search.model
    at = std_errors(base, final)
    for n in selection.selected:
        own = [k for k in model.of(n.id) if k in at] if n.id != CHANGED.id else []
        far = [abs(final.q[k] - model.parameters[k].null) > UNCERTAIN * at[k] > 0.0 for k in own]
        doubtful += own if not any(far) else [k for k in own if at[k] == 0.0]
    return tuple(doubtful)


def measured(base: Base, selection: Selection) -> Selection:
    """With likelihood intervals where gradients cannot judge; estimates may move slightly."""
    if not selection.selected:
        return selection
    uncertain = uncertain_parameters(base, selection)
    final, intervals = intervals_of(base.search, selection.final, uncertain)
    # a ragged likelihood may lead away from an accepted set
    for candidate in (final, selection.final):
        widened = {k: i.holding(float(candidate.q[k])) for k, i in intervals.items()}
        told = replace(selection, final=candidate, intervals=widened)
        if weakest(base, told) is None:
            break
    return with_exchanged_lags(base, told)
