"""The residuals of one output, tested against lags of its inputs; see ``residuals.py``."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.criteria.coloured import AutoRegression, ar_fit
from sysid.criteria.fit import Array, Signals, as_records, centred, inputs_of, one_output
from sysid.criteria.portmanteau import Mask, Trial, orthonormal, score
from sysid.criteria.verdicts import ResidualTest, Sentences, verdict
from sysid.errors import DataError

LAGS = 25
"""Largest lag tested, each way: the choice of Ljung (1999) §16.6; lowered on short records."""

_INDEPENDENCE = (
    "The residuals of {output} do not depend on past inputs ({p}).",
    "The residuals of {output} are correlated with the inputs ({p}), mostly with {signal} {lag} "
    "samples earlier: dynamics are missing; raise nb and nf (or na), check the delay nk, or try a "
    "nonlinear structure.",
    "No input direction can be tested on {output}: excite the input more.",
)
_FEEDBACK = (
    "No sign of feedback from {output} to the inputs ({p}).",
    "{signal} responds to {output} ({p}): the log is of a closed loop; prefer structures with a "
    "noise model and check OE and delays.",
    "The inputs are predictable: feedback from {output} cannot be tested.",
)


@dataclass(frozen=True, eq=False)
class OutputResiduals:
    """The residuals of one output, with what its tests against inputs share; one array a record.

    Attributes:
        output: its name.
        level: confidence level of each test.
        known: residuals without their means, (N,), NaN where missing.
        inputs: without their means, (N, nu).
        names: of the inputs.
        jacobian, uncertain, keep: as a ``Trial`` has them.
    """

    output: str
    level: float
    known: Sequence[Array]
    inputs: Sequence[Array]
    names: tuple[str, ...]
    jacobian: Sequence[Array]
    uncertain: Sequence[Array]
    keep: Sequence[Mask]

    @staticmethod
    def of(
        errors: Signals,
        inputs: Signals,
        jacobian: Signals | None = None,
        uncertain: Signals | None = None,
        *,
        input_names: Sequence[str] = (),
        output: str = "the output",
        level: float = 0.99,
    ) -> "OutputResiduals":
        """One output's residuals, and what the fit absorbed.

        Args:
            errors: residuals of one output, (N,), or one such array a record; NaN are left out.
            inputs: all inputs, (N, nu), or one such array a record.
            jacobian: ∂ŷ/∂θ of that output by what was estimated from these data, (N, n), or one
                such array a record. Without it a model fitted to these data passes too easily.
            uncertain: G√P of parameters estimated from other data, (N, k), or one such array a
                record.

        Raises:
            DataError: shapes do not fit, an input is not finite, or fewer than 20 usable samples.
        """
        es = one_output(errors)
        us = [centred(u) for u in inputs_of(inputs, [len(e) for e in es])]
        js = jacobian_records(jacobian, es)
        keep = complete([e[:, None] for e in es], js)
        affordable(keep, us[0].shape[1])  # refuses too few samples
        known = [np.where(k, centred(e), np.nan) for k, e in zip(keep, es, strict=True)]
        names = named(input_names, "input", us)
        unsure = uncertain_records(uncertain, es)
        return OutputResiduals(output, level, known, us, names, js, unsure, keep)

    @cached_property
    def filled(self) -> list[Array]:
        """Residuals with 0 where they are missing."""
        return [np.nan_to_num(e) for e in self.known]

    @cached_property
    def noise(self) -> AutoRegression:
        """The colour of the residuals."""
        return ar_fit(self.known)

    @cached_property
    def basis(self) -> Sequence[Array]:
        """``orthonormal`` of the Jacobian."""
        return orthonormal(self.jacobian, self.keep, True)

    def independence(self, lags: int = LAGS, first: int = 0) -> ResidualTest:
        """Whether the residuals are independent of present and past inputs, lags first … lags.

        Means are removed: an offset is no dependence (whiteness shows it). The first ``lags``
        samples of each record, whose past inputs are unknown, serve the projection only.

        Args:
            lags: largest lag; lowered where there are fewer than 10 samples a correlation.
        """
        past = range(first, self.affordable(lags) + 1)
        return self.tested("independence", _INDEPENDENCE, self.inputs, past, noise=self.noise)

    def feedback(self) -> ResidualTest:
        """Whether the residuals are followed by reactions of the inputs, lags −25 … −1.

        Future inputs count only for what present and past inputs do not predict of them (Sims
        1972): otherwise a model that is too small would look like feedback wherever the input is
        slow. Never judged: feedback is a property of the data, with which models that carry a
        noise model (ARX, ARMAX, BJ) can live.
        """
        lags = self.affordable(LAGS, 2)
        ahead, known = range(-lags, 0), range(lags + 1)
        return self.tested(
            "feedback", _FEEDBACK, self.inputs, ahead, known, noise=self.noise, judged=False
        )

    def affordable(self, lags: int = LAGS, ways: int = 1) -> int:
        """At most ``lags`` of all inputs, tested in so many ways, see :func:`affordable`."""
        return affordable(self.keep, ways * len(self.names), lags)

    def tested(
        self,
        name: str,
        sentences: Sentences,
        signals: Sequence[Array],
        tested: range,
        nuisance: range = range(0),
        *,
        noise: AutoRegression | None,
        judged: bool = True,
    ) -> ResidualTest:
        """The residuals against lags of signals, (N, nu)."""
        before, after = max(*tested, *nuisance), max(-tested[0], 0)
        trial = Trial(
            errors=self.filled,
            signals=signals,
            jacobian=self.jacobian,
            keep=self.keep,
            rows=[k & _inside(len(k), before, after) for k in self.keep],
            tested=tested,
            nuisance=nuisance,
            centred=True,
            noise=noise,
            uncertain=self.uncertain,
            basis=self.basis,
        )
        return verdict(
            score(trial), name, self.output, self.names, tested, sentences, self.level, judged
        )


def named(given: Sequence[str], kind: str, records: Sequence[Array]) -> tuple[str, ...]:
    """The names of the columns of records; ``input 1`` … where none are given."""
    return tuple(given) or tuple(f"{kind} {i + 1}" for i in range(records[0].shape[1]))


def complete(es: Sequence[Array], js: Sequence[Array]) -> list[Mask]:
    """Rows in which neither a residual nor its Jacobian is missing."""
    return [
        # column by column: NumPy's reductions along the short axis are ten times slower
        ~np.any([np.isnan(c) for c in (*e.T, *j.T)], axis=0)
        for e, j in zip(es, js, strict=True)
    ]


def _inside(samples: int, before: int, after: int) -> Mask:
    """Rows that have ``before`` samples before them and ``after`` behind them in the record."""
    t = np.arange(samples)
    return np.asarray((t >= before) & (t < samples - after))


def affordable(keep: Sequence[Mask], signals: int, lags: int = LAGS) -> int:
    """At most ``lags``, with 10 samples for every correlation, and at least 1."""
    samples = sum(int(k.sum()) for k in keep)
    if samples < 20:
        raise DataError(
            f"{samples} one-step errors are too few to judge a model: at least 20 are needed; "
            "record longer, or lower the orders"
        )
    return max(min(lags, samples // (10 * max(signals, 1))), 1)


def uncertain_records(uncertain: Signals | None, es: Sequence[Array]) -> tuple[Array, ...]:
    """G√P by record, 0 where it is missing; no column where nothing was estimated elsewhere."""
    return tuple(np.nan_to_num(g) for g in jacobian_records(uncertain, es))


def jacobian_records(jacobian: Signals | None, es: Sequence[Array]) -> tuple[Array, ...]:
    """J of each record of residuals (N, 1), (N, n); without columns where none is given.

    Raises:
        DataError: its rows are not those of the residuals.
    """
    if jacobian is None:
        return tuple(np.zeros((len(e), 0)) for e in es)
    records = as_records(jacobian, "jacobian")
    if [len(j) for j in records] != [len(e) for e in es]:
        raise DataError(
            f"{[len(e) for e in es]} residuals but Jacobians of {[len(j) for j in records]} rows"
        )
    return records
