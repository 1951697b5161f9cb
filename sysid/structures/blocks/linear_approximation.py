"""Best linear approximation of a log: where every block-oriented fit starts.

The best linear approximation of a nonlinear system is the linear model with the smallest error
for inputs like those of the log; for Gaussian-like inputs its poles are those of the system's
linear blocks (Bussgang 1952; Pintelon & Schoukens 2012, ch. 3).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.data.record import Array, Record
from sysid.fitting.problem import Focus
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.static.functions import IDENTITY
from sysid.structures.blocks.trials import ChainData, Effort, Trial, best_start
from sysid.structures.linear.families import OE
from sysid.structures.linear.starts import starts_of
from sysid.structures.orders import Orders, spread

POLES = Effort(60, 1e-6)
"""Of the descents whose poles are dealt out: these stay as they are for a while."""


def centred(records: Sequence[Record]) -> tuple[Record, ...]:
    """The records about their joint means, for linear models of logs with offsets."""
    u = np.concatenate([r.u for r in records]).mean(axis=0)
    y = np.concatenate([r.y for r in records]).mean(axis=0)
    return tuple(replace(r, u=r.u - u, y=r.y - y, sha256="-") for r in records)


def linear_starts(records: Sequence[Record], orders: Orders) -> list[tuple[str, dict[str, float]]]:
    """Named output-error models of these orders, as parameter name → value.

    SRIV, ARX and where they are doubtful a grid of poles (see ``starts_of``), about the means of
    the records.
    """
    middle = centred(records)
    structure = OE(orders)
    names = [p.name for p in structure.parameters(records[0].inputs, records[0].outputs)]
    return [
        (kind, dict(zip(names, theta.tolist(), strict=True)))
        for kind, theta in starts_of(structure, middle, Focus.SIMULATION)
    ]


def linear_model(orders: Orders, data: ChainData, effort: Effort) -> Trial:
    """The best end of descents from all these starts: a chain of identities."""
    first = data.records[0]
    structure = HammersteinWiener((orders,), ((IDENTITY,) * first.nu, (IDENTITY,) * first.ny))
    starts = [values for _, values in linear_starts(data.records, orders)]
    best = best_start(structure, starts, data, effort)
    assert best is not None  # ARX always gives a start
    return best


def input_denominators(records: Sequence[Record], orders: Sequence[int]) -> list[list[Array]]:
    """For each input the denominators of that order behind its responses, one an output.

    Args:
        orders: order of each input's denominator.
    """
    nu, ny = len(orders), records[0].ny
    numerators = [n + 1 for n in orders]
    raw: dict[str, Any] = {"nb": [numerators] * ny, "nf": [list(orders)] * ny, "nk": 0}
    layout = spread(raw, "bf", nu, ny, OE.name)
    best = linear_model(layout, ChainData.of(records), POLES)
    denominators = best.chain.denominators(best.theta)
    return [denominators[j::nu] for j in range(nu)]
