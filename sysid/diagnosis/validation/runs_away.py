"""Outputs that no free run of a model says anything of: those of a plant that runs away unless a
controller holds it (a pole outside the unit circle), and those that alone move their input."""

from collections.abc import Sequence

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record, shortened

LAGS = 40
"""Lags of the regression: with few, noise of the measurements draws its poles inwards."""

SAMPLES = 5000
"""Samples that it is looked for on."""

SURE = 4.0
"""Standard errors by which a pole lies beyond 1; position in a loop has one at 1."""

ROWS_A_NUMBER = 5
"""Rows that a regression needs for each of its numbers."""


RUNS_AWAY = (
    "cannot stay bounded without its controller. No free run of a model follows it, and no effect "
    "is named on it. Diagnose the closed loop from its set point."
)


ANSWERS_ALONE = (
    "moves its input through a controller, and nothing else does, or the two are exchanged: what a "
    "model makes of them may be the disturbance and the controller. No effect is named on it. Step "
    "the set point, or add a test signal to the input, and record again."
)


def without_free_run(facts: LogFacts) -> tuple[str, ...]:
    """Outputs on which no effect can be named: those that run away, or alone move their input."""
    return tuple(dict.fromkeys((*running_away(facts), *answering_alone(facts))))


def of_answers(facts: LogFacts) -> tuple[str, ...]:
    """What is warned of outputs that alone move their input; empty where there is none."""
    answering = answering_alone(facts)
    return (f"{' and '.join(answering)} {ANSWERS_ALONE}",) if answering else ()


def answering_alone(facts: LogFacts) -> tuple[str, ...]:
    """Outputs of a log whose only input nothing but a controller moves that reads them, or which is
    rather what they cause."""
    own_rate = facts.at_own_rate
    alone = {t.output for t in own_rate.laws_alone if t.seen and own_rate.surely_closed_loop}
    return tuple(t.output for t in own_rate.feedback or () if t.exchanged or t.output in alone)


def running_away(facts: LogFacts) -> tuple[str, ...]:
    """Outputs of a closed loop that only feedback keeps from running away."""
    records = shortened(facts.records, SAMPLES)
    names = [n for i, n in enumerate(records[0].output_names) if runs_away(records, i)]
    return tuple(names) if names and facts.at_own_rate.surely_closed_loop else ()


def without(outputs: Sequence[str], records: Sequence[Record]) -> tuple[Record, ...]:
    """The records without some of their outputs."""
    kept = tuple(n for n in records[0].output_names if n not in outputs)
    return tuple(r.select(r.input_names, kept) for r in records)


def runs_away(records: Sequence[Record], i: int) -> bool:
    """Whether output i has a pole outside the unit circle by the regression

    y(k) = Σ a_j y(k − j) + Σ b_j u(k − j) + c,  j = 1 … LAGS,

    with feedback consistent as far as its errors are white (Ljung 1999, 13.4). The standard error
    of a pole z is that of Σ z^(LAGS − j) δa_j / A′(z), along z.
    """
    rows = [np.arange(LAGS, len(r)) for r in records if len(r) > LAGS]
    own = [r.y[:, i] for r in records if len(r) > LAGS]
    target = np.concatenate([y[k] for y, k in zip(own, rows, strict=True)] or [np.zeros(0)])
    numbers = LAGS * (1 + records[0].nu) + 1
    if len(target) < ROWS_A_NUMBER * numbers or not np.isfinite(target).all():
        return False
    every = [np.column_stack([r.y[:, i], r.u]) for r in records if len(r) > LAGS]
    X = np.vstack(
        [
            np.column_stack([*(s[k - j] for j in range(1, LAGS + 1)), np.ones(len(k))])
            for s, k in zip(every, rows, strict=True)
        ]
    )
    theta = np.linalg.lstsq(X, target, rcond=None)[0]
    variance = float(np.sum((target - X @ theta) ** 2)) / (len(target) - numbers)
    of_past = np.arange(LAGS) * (1 + records[0].nu)
    covariance = variance * np.linalg.pinv(X.T @ X)[np.ix_(of_past, of_past)]
    return _beyond_one(np.append(1.0, -theta[of_past]), covariance)


def _beyond_one(a: Array, covariance: Array) -> bool:
    for z in np.roots(a):
        if abs(z) > 1.0:
            slope = z ** np.arange(LAGS - 1, -1, -1) / np.polyval(np.polyder(a), z)
            along = np.real(np.conj(z) / abs(z) * slope)
            if abs(z) - 1.0 > SURE * float(np.sqrt(along @ covariance @ along)):
                return True
    return False
