"""Orders and delays of an ARX, chosen from the rows so far."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sysid.data.checks.delay import estimate_delays
from sysid.data.facts import LogFacts
from sysid.data.record import Array, Channel, Record
from sysid.errors import DataError
from sysid.fitting import normal_equations as ne
from sysid.structures.linear.families import ARX

MOST_DELAY = 20
"""Samples up to which a delay is looked for; for a longer one the orders have to be given."""


def chosen_orders(
    pieces: Sequence[Array], inputs: Sequence[Channel], outputs: Sequence[Channel], dt: float
) -> dict[str, Any]:
    """First or second order, by BIC, with the delays that the rows show (``estimate_delays``).

    Args:
        pieces: uninterrupted rows, outputs before inputs.
        dt: sample time [s].
    """
    ny, nu = len(outputs), len(inputs)
    records = [
        Record(p[:, ny : ny + nu], p[:, :ny], dt, tuple(inputs), tuple(outputs))
        for p in pieces
        if len(p) > MOST_DELAY + 2
    ]
    nk = [[1] * nu for _ in range(ny)]
    plain = {"na": 1, "nb": 1, "nk": nk}
    if not records:
        return plain
    try:
        within = not LogFacts.of(records).closed_loop  # else it is a controller that answers
        delays = estimate_delays(records, MOST_DELAY, shortest=0 if within else 1)
    except DataError:  # nothing moves yet
        return plain
    names_u, names_y = [c.name for c in inputs], [c.name for c in outputs]
    for d in delays:
        nk[names_y.index(d.output)][names_u.index(d.input)] = 1 if d.delay is None else d.delay
    start = MOST_DELAY + 2
    scores = {}
    for order in (1, 2):
        structure = ARX.from_orders({"na": order, "nb": order, "nk": nk}, nu, ny)
        score = 0.0
        for i in range(ny):
            terms = structure.layout(i).terms
            gram = ne.lag_gram(records, max(max(map(max, nk)) + 2, 2), start)
            solved = ne.solve(gram, gram.column(i, 0), [gram.column(s, k) for s, k in terms])
            if solved is None or not solved.loss > 0.0:
                return plain
            score += gram.samples * np.log(solved.loss) + len(terms) * np.log(gram.samples)
        scores[order] = score
    best = min(scores, key=lambda order: scores[order])
    return {"na": best, "nb": best, "nk": nk}
