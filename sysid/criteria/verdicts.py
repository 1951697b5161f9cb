"""Results of residual tests, each by itself and all in one report."""

from dataclasses import dataclass, field, fields
from typing import Any

from scipy.special import chdtri

from sysid.criteria.fit import Array
from sysid.criteria.portmanteau import Score


@dataclass(frozen=True, eq=False)
class LagParts:
    """A test's statistic shared out among the lags: for a picture of what decided.

    Attributes:
        lags: lags [samples], negative ones in the future.
        signals: names of what was lagged.
        values: (signals, lags); standard normal each for a right model, their squares add up to
            the statistic.
    """

    lags: tuple[int, ...]
    signals: tuple[str, ...]
    values: Array


@dataclass(frozen=True)
class ResidualTest:
    """Outcome of one test on one output.

    Attributes:
        name: ``whiteness``, ``independence`` or ``feedback``; see also ``nonlinear.NAMES``.
        output: name of the output whose residuals were tested.
        statistic: cᵀC⁺c.
        dof: its degrees of freedom, rank C; 0 when nothing was left to test.
        p_value: chance of a larger statistic if the model is right (1 for dof 0).
        passed: ``p_value`` ≥ 1 − ``level``.
        level: confidence level of the test.
        worst_lag: lag with the largest standardised correlation; negative for future inputs.
        worst_signal: the input (or output, for whiteness) that lag belongs to.
        judged: whether the outcome counts against the model. Whiteness does not for a structure
            without noise model, feedback never does: it says something about the data.
        sentence: the outcome in words, with what to do.
        parts: the statistic by lag; not part of a written report.
    """

    name: str
    output: str
    statistic: float
    dof: int
    p_value: float
    passed: bool
    level: float
    worst_lag: int | None
    worst_signal: str | None
    judged: bool
    sentence: str
    parts: LagParts | None = field(default=None, repr=False, compare=False)

    @property
    def limit(self) -> float:
        """The value that ``statistic`` must not exceed: the ``level`` quantile of χ²(dof)."""
        return float(chdtri(self.dof, 1.0 - self.level)) if self.dof else 0.0

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: every field but ``parts``."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "parts"}


Sentences = tuple[str, str, str]
"""For a test that passed, one that failed, and one with nothing to test, with ``{output}``,
``{signal}``, ``{lag}``, ``{last}`` (the largest lag) and ``{p}``."""


def verdict(
    score: Score,
    name: str,
    output: str,
    signals: tuple[str, ...],
    lags: range,
    sentences: Sentences,
    level: float,
    judged: bool = True,
) -> ResidualTest:
    """A score judged at a level, in words.

    Args:
        output: whose residuals were tested.
        signals: names of what they were tested against.
        judged: whether the outcome counts against the model.
    """
    right, wrong, empty = sentences
    p, passed = score.p_value, score.p_value >= 1.0 - level
    signal, lag = (None, None) if score.worst is None else (signals[score.worst[0]], score.worst[1])
    sentence = (empty if score.dof == 0 else right if passed else wrong).format(
        output=output, signal=signal, lag=lag, last=max(lags), p=in_words(p)
    )
    return ResidualTest(
        name, output, score.statistic, score.dof, p, passed, level, lag, signal, judged, sentence,
        LagParts(tuple(lags), signals, score.parts),
    )  # fmt: skip


def in_words(p: float) -> str:
    """A p-value as a sentence gives it."""
    return f"p = {p:.2g}" if p >= 1e-12 else "p < 1e-12"


@dataclass(frozen=True)
class ResidualReport:
    """All residual tests of a model, one of each kind for every output.

    The tests of one kind run at level 1 − (1 − ``level``)/ny each (Bonferroni), so that a right
    model fails one of them with probability 1 − ``level`` whatever its number of outputs.
    ``nonlinear`` holds the further tests that nonlinear models must stand (``nonlinear.py``),
    ``fixed`` one test of each parameter that was not estimated but given, or stopped by a bound
    (``fixed_parameters.py``); their level is shared in the same way.
    """

    whiteness: tuple[ResidualTest, ...]
    independence: tuple[ResidualTest, ...]
    feedback: tuple[ResidualTest, ...]
    level: float
    nonlinear: tuple[ResidualTest, ...] = ()
    fixed: tuple[ResidualTest, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every test that counts against the model passed."""
        tests = (*self.whiteness, *self.independence, *self.nonlinear, *self.fixed)
        return all(t.passed for t in tests if t.judged)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: for each kind {passed, p_value, judged, sentence, outputs: [each test]}.

        ``p_value`` is the smallest one times the number of outputs, at most 1. The further tests
        of nonlinear models stand under ``nonlinear``, by their names.
        """
        kinds = dict.fromkeys(t.name for t in self.nonlinear)
        return {
            "passed": self.passed,
            "level": self.level,
            "whiteness": _summary(self.whiteness),
            "independence": _summary(self.independence),
            "feedback": _summary(self.feedback),
            "nonlinear": {
                kind: _summary(tuple(t for t in self.nonlinear if t.name == kind)) for kind in kinds
            },
            "held_parameters": [t.as_dict() for t in self.fixed],
        }


def _summary(tests: tuple[ResidualTest, ...]) -> dict[str, Any]:
    worst = min(tests, key=lambda t: t.p_value)
    return {
        "passed": all(t.passed for t in tests),
        "p_value": min(1.0, worst.p_value * len(tests)),
        "judged": worst.judged,
        "sentence": worst.sentence,
        "outputs": [t.as_dict() for t in tests],
    }
