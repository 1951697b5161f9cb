"""Effects that only correct the laws of effects accepted before: what one law leaves looks partly
like its look-alikes, and what two leave like anything."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import RULE, VERDICT
from sysid.diagnosis.search.selection import CandidateModel
from sysid.effects.base import Effect, Place
from sysid.effects.catalogue import NOT_NAMED, about


def is_redundant(
    base: CandidateModel, rest: CandidateModel, whole: CandidateModel, noise: Array
) -> bool:
    """Whether the newest effect of ``whole`` is redundant.

    A look-alike that takes hardly anything of the gap is, and one that takes less than it leaves;
    and a third effect with a minor share, unless it takes most of the rest.

    Args:
        base: the original model.
        rest: without the effect.
        noise: of each output, (ny,).
    """
    id = whole.effects[-1]
    others = [e for e in rest.effects if e not in NOT_NAMED]
    alike = any(_look_alike(about(id), about(other)) for other in others)
    if id in NOT_NAMED or not (alike or len(others) > 1):
        return False
    first, now, then = (n.errors.mean_squares()[1][whole.touched] for n in (base, rest, whole))
    taken, gap = now - then, first - then
    if alike and not np.any(taken >= RULE.redundant * gap):
        return True
    small = RULE.look_alike if alike else 0.01 * VERDICT.min_share
    enough = bool(np.any(taken >= small * gap))
    return not enough and not explains_most_of_remainder(rest, whole, noise)


def explains_most_of_remainder(rest: CandidateModel, whole: CandidateModel, noise: Array) -> bool:
    """Whether the newest effect takes most of what the others leave above the noise of an output.

    Args:
        rest: without the effect.
        whole: with it.
        noise: of each output, (ny,).
    """
    now, then = (n.errors.mean_squares()[1] for n in (rest, whole))
    at = whole.touched
    remainder = (now - noise**2)[at]
    return bool(np.any((remainder > 0.0) & ((now - then)[at] > RULE.of_remainder * remainder)))


def _look_alike(a: Effect, b: Effect) -> bool:
    """Whether the catalogue lists two effects as a tie, or both bend the command by a curve."""
    curves = all(e.place is Place.COMMAND and not e.memory.states for e in (a, b))
    return curves or a.id in b.hints.ties or b.id in a.hints.ties
