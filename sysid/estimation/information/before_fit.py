"""Whether a log can show a grey box's parameters apart, asked before time is spent on a fit.

Rank and condition of the slopes ∂ŷ/∂θ at the point where the search begins and, where that lacks
rank, at some of its random starts within the bounds: rank may be low at a point by chance (a rate
that is zero there), while a combination that shows nowhere is a matter of the equations and the log
(local identifiability; Ljung 1999, §4.5; Walter & Pronzato 1997, ch. 2).
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record, shortened
from sysid.errors import SysidError
from sysid.estimation.identify import Request
from sysid.estimation.information.experiments import with_mending
from sysid.estimation.information.sensitivity import (
    TAKES_PART,
    Distinguished,
    hidden,
    information,
)
from sysid.estimation.information.subject import Subject, subject_at
from sysid.estimation.pem import constrained
from sysid.fitting.options import FitOptions
from sysid.methods.grey_box import prepared
from sysid.methods.grey_box_starts import Setting, varied
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.own_names import options_in_generic_names
from sysid.structures.registry import structure_class

POINTS = 5
"""Points that are tried: the first guess, and random ones."""

SAMPLES = 20_000
"""Samples that are run through, in pieces of the log: a fit runs through all some forty times."""

OFF_ZERO = 0.1
"""What random points have in the place of a zero; only rank is asked there."""


@dataclass(frozen=True, kw_only=True)
class Identifiability(Distinguished):
    """What the slopes at the best of the points tried say.

    Attributes:
        sentences: one each: which parameters only show together, and what would help.
    """

    sentences: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        return {**super().to_json(), "sentences": self.sentences}


def before_fit(
    structure: GreyBox[Any], records: Sequence[Record], options: FitOptions
) -> Identifiability | None:
    """What a fit of this grey box with these options could distinguish.

    Returns:
        None where nothing is estimated, or no point gives a finite run.
    """
    parameters = constrained(structure, records[0], options)
    setting, guesses, free = prepared(structure, records, options, parameters, ())
    if not np.any(free):
        return None
    pieces = shortened(records, SAMPLES)
    u, y = [np.asarray(r.u) for r in pieces], [np.asarray(r.y) for r in pieces]
    size = np.ptp(np.concatenate(y), axis=0)
    size = np.where(size > 0.0, size, 1.0)
    random = [_off_zero(setting, t, free) for t in varied(setting, guesses[:1], free)[1][1:POINTS]]
    best: tuple[Subject, Array, float, int] | None = None
    for theta in (guesses[0][1], *random):
        subject = subject_at(setting.structure, theta, setting.parameters, size, pieces)
        n = len(subject.names)
        slopes = subject.slopes(u, [subject.state(a, b) for a, b in zip(u, y, strict=True)])
        if not all(np.all(np.isfinite(D)) for D in slopes):
            continue
        found = information(slopes, n)
        null = found.null[:, np.max(np.abs(found.null), axis=0, initial=0.0) > TAKES_PART]
        # of equal ones a random point: where the search begins a zero may hide who takes part
        if best is None or null.shape[1] <= best[1].shape[1]:
            states = sum(D.shape[2] - n for D in slopes)
            best = subject, null, found.condition, n + states
        if not best[1].size:
            break
    if best is None:
        return None
    subject, null, condition, count = best
    open_ = hidden(subject.names, null)
    sentences = tuple(with_mending(subject, list(group)) for group in open_)
    return Identifiability(
        rank=count - null.shape[1],
        count=count,
        condition=condition,
        null=open_,
        sentences=sentences,
    )


def before_request(records: Sequence[Record], request: Request) -> Mapping[str, Identifiability]:
    """Of each grey box that a fit is asked for; what is wrong with the request the fit will say."""
    found = {}
    for name in request.structures:
        with suppress(SysidError):
            cls = structure_class(name)
            if not issubclass(cls, GreyBox):
                continue
            first, options = records[0], request.options
            own = options_in_generic_names(options.structure_options, first.inputs, first.outputs)
            made = cls.from_orders({}, first.nu, first.ny, own)
            inside = [r.split(request.split)[0] if request.split else r for r in records]
            if told := before_fit(made, inside, options):
                found[made.name] = told
    return found


def _off_zero(setting: Setting, theta: Array, free: NDArray[np.bool_]) -> Array:
    """θ whose free entries are not zero: a factor of zero hides others from the slopes."""
    moved = np.where(free & (theta == 0.0), OFF_ZERO, theta)
    return np.where(free, np.clip(moved, setting.lower, setting.upper), theta)
