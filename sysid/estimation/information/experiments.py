"""Which experiment would show what a log does not: others are run with the plant as it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.estimation.information.sensitivity import (
    DOUBTFUL,
    Information,
    hidden_words,
    information,
)
from sysid.estimation.information.subject import Subject
from sysid.fitting.profile import NORMAL
from sysid.structures.motion import time_constants

LENGTH = 1000
"""Most samples of an experiment that is tried."""

WORTH = 0.7
"""An experiment is named where it leaves at most this share of the error."""


UNSEEN = 10.0
"""A standard error of so many times the value is rounding: nothing is seen."""

BEYOND = " over twice the range"


@dataclass(frozen=True)
class Mending:
    """What would mend a doubtful parameter.

    Attributes:
        error: standard error that would be left.
        experiment: in words; empty where no experiment that was tried helps.
        with_others: parameters, itself among them, of which only combinations show in all of them.
    """

    name: str
    error: float
    experiment: str
    with_others: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """What to do."""
        if self.experiment:
            error = f"±{NORMAL * self.error:.2g} (95 %)"
            return f"{self.name}: {self.experiment} would leave an error of {error}."
        if len(self.with_others) > 1:
            return (
                f"No experiment that was tried separates {', '.join(self.with_others)}: fix one of "
                "them, or measure another output."
            )
        return f"{self.name}: none of the experiments tried shows it better than this log."


def mendings(
    subject: Subject, doubtful: Sequence[str], errors: Sequence[float]
) -> tuple[Mending, ...]:
    """For each doubtful parameter the experiment, of those tried, that shows it best.

    Args:
        errors: standard errors from the log by the order of ``subject.names``.
    """
    tried = _tried(subject)
    rest = [subject.rest()] * len(tried)
    n = len(subject.names)
    found: list[tuple[str, Information]] = []
    for (words, _), D in zip(tried, subject.slopes([u for _, u in tried], rest), strict=True):
        if np.all(np.isfinite(D)):
            found.append((words, information([D], n)))
    return tuple(_mending(subject, name, errors, found) for name in doubtful)


def with_mending(subject: Subject, names: Sequence[str]) -> str:
    """Which parameters only show together, and which experiment would separate them."""
    found = mendings(subject, names, [np.inf] * len(subject.names))
    return " ".join(dict.fromkeys([hidden_words(names), *(m.sentence for m in found)]))


def _mending(
    subject: Subject, name: str, errors: Sequence[float], found: Sequence[tuple[str, Information]]
) -> Mending:
    k = subject.names.index(name)
    each = [(float(i.errors[k]), w) for w, i in found]
    best, words = min(each, default=(np.inf, ""))
    inside = min((e for e in each if BEYOND not in e[1]), default=(np.inf, ""))
    enough = DOUBTFUL * abs(subject.theta[subject.free[k]])
    if inside[0] < min(enough, WORTH * errors[k]):  # no need to leave the range
        best, words = inside
    value = abs(subject.theta[subject.free[k]])
    if best < WORTH * errors[k] and (best < UNSEEN * value or not value):
        return Mending(name, float(best), words)
    alike = {
        n
        for e, (_, i) in zip(each, found, strict=True)
        if e[0] == np.inf
        for n in _null_with(subject, i, k)
    }
    return Mending(name, float(best), "", tuple(n for n in subject.names if n in alike))


def _null_with(subject: Subject, of: Information, k: int) -> set[str]:
    """Parameters that share a direction without information with the k-th."""
    weights = np.abs(of.null[:, np.abs(of.null[k]) > 0.05])
    others = np.flatnonzero(np.max(weights, axis=1, initial=0.0) > 0.05)
    return {subject.names[j] for j in others}


def _tried(subject: Subject) -> list[tuple[str, Array]]:
    """Experiments of one length within and beyond the range of the inputs, in words and as u."""
    low, high = subject.u_range.T
    slow = _slowest(subject)
    held = {
        "fast switching": max(slow // 5, 1),
        "steps held until it settles": max(4 * slow, 5),
        "steps as long as its slowest motion": slow,
    }
    ranges = {
        "": (low, high),
        BEYOND: (low - (high - low) / 2.0, high + (high - low) / 2.0),
        " over a quarter of the range": (low + 0.375 * (high - low), high - 0.375 * (high - low)),
    }
    length = int(np.clip(40 * slow, 200, LENGTH))
    out: list[tuple[str, Array]] = []
    for what, samples in held.items():
        for where, (a, b) in ranges.items():
            rng = np.random.default_rng(len(out))
            levels = rng.choice(5, (-(-length // samples), len(a))) / 4.0
            u = np.repeat(a + levels * (b - a), samples, axis=0)[:length]
            words = f"{what} ({samples * subject.dt:.3g} s){where}"
            out.append((words, u))
    return out


def _slowest(subject: Subject) -> int:
    """Samples of the slowest motion that settles."""
    constants = np.abs(time_constants(subject.structure, subject.theta))
    finite = constants[np.isfinite(constants)]
    return int(np.clip(np.max(finite, initial=10.0), 2, LENGTH // 8))
