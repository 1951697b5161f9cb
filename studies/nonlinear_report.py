"""``nonlinear_structures.md``: what every structure reached on every measured record."""

from collections.abc import Iterator, Mapping, Sequence

from studies.attempts import BEST_LINEAR, Fitted, number
from studies.records import Trial
from sysid.report.markdown import table

HEAD = """# Nonlinear structures on measured records

Every structure that applies to a record is fitted with its default options
to the training part; orders, sizes, statics and starts are chosen there, and a hold-out inside the
training part says which structure to take: it stands in **bold**. The test part chooses nothing.
All figures are free runs: only the input is given, from an initial state estimated at the head.
Lower is better for RMSE and RRSE, higher for fit. *n* counts estimated parameters, *s* processor
seconds of search and fit. `linear` is the one of ARX, ARMAX, OE and BJ that `sysid fit` puts first.
"""

HIGHER = ("fit",)
"""Metrics of which more is better."""


def report(trials: Mapping[str, Trial], results: Mapping[str, Sequence[Fitted]]) -> str:
    """The whole page: a summary, then every record with every structure that lost."""
    parts = [HEAD, "## Summary\n", _summary(trials, results)]
    for record, trial in trials.items():
        parts += [f"## {trial.name}\n", _details(trial, results[record])]
    return "\n".join(parts)


def _summary(trials: Mapping[str, Trial], results: Mapping[str, Sequence[Fitted]]) -> str:
    rows = []
    for record, trial in trials.items():
        taken = choice(results[record])
        for test in trial.least:
            linear = next((f for f in results[record] if f.structure == BEST_LINEAR), None)
            best = _best(trial, results[record], test)
            value = taken.tests.get(test) if taken else None
            rows.append(
                [
                    trial.name,
                    test,
                    f"{trial.least[test]:g} {trial.unit}",
                    f"{trial.aim[test]:g}",
                    number(linear.tests.get(test) if linear else None),
                    taken.structure if taken else "–",
                    number(value),
                    verdict(trial, test, value),
                    f"{best.structure} {number(best.tests[test])}" if best else "–",
                ]
            )
    heads = [
        "record", "test", "at least", "aim", "linear", "chosen", "its figure", "reached",
        "best on the test (hindsight)",
    ]  # fmt: skip
    return table(heads, rows, "llrrrlrll")


def _details(trial: Trial, found: Sequence[Fitted]) -> str:
    tests = list(trial.tests)
    taken = choice(found)
    heads = [
        "structure",
        "chosen by the fit",
        "n",
        "held out %",
        f"train {trial.unit}",
        *(f"{t} {trial.unit}" for t in tests),
        "s",
    ]
    rows = []
    for f in sorted(found, key=lambda f: _rank(trial, f, tests[0])):
        name = f"**{f.structure}**" if f is taken else f.structure
        asked = f"; asked {f.asked}" if f.asked else ""
        unstable = "" if f.stable else "; unstable"
        rows.append(
            [
                name,
                f.error or f"{f.chosen}{asked}{unstable}",
                str(f.n) if f.n else "–",
                "–" if f.held is None else f"{f.held:.2f}",
                number(f.train),
                *(number(f.tests.get(t)) for t in tests),
                "–" if f.seconds is None else f"{f.seconds:.0f}",
            ]
        )
    goal = "; ".join(_goals(trial))
    return f"{goal}.\n\n" + table(heads, rows, "llrrr" + "r" * len(tests) + "r")


def _goals(trial: Trial) -> Iterator[str]:
    for test, least in trial.least.items():
        yield f"{test}: at least {least:g}, aim {trial.aim[test]:g} {trial.unit}"


def choice(found: Sequence[Fitted]) -> Fitted | None:
    """The structure that the inner hold-out of the training part takes."""
    judged = [f for f in found if f.held is not None and f.stable]
    return max(judged, key=lambda f: f.held or 0.0, default=None)


def verdict(trial: Trial, test: str, value: float | None) -> str:
    """``aim``, ``least`` or ``no``."""
    if value is None:
        return "no"
    sign = -1.0 if trial.metric in HIGHER else 1.0
    if sign * value <= sign * trial.aim[test]:
        return "aim"
    return "least" if sign * value <= sign * trial.least[test] else "no"


def _best(trial: Trial, found: Sequence[Fitted], test: str) -> Fitted | None:
    judged = [f for f in found if f.tests.get(test) is not None]
    return min(judged, key=lambda f: _rank(trial, f, test), default=None)


def _rank(trial: Trial, f: Fitted, test: str) -> float:
    value = f.tests.get(test)
    if value is None:
        return float("inf")
    return -value if trial.metric in HIGHER else value
