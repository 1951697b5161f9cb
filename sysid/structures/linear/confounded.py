"""Inputs in fixed proportion to each other: the parameters that such logs cannot distinguish."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Record
from sysid.fitting.normal_equations import RANK_TOLERANCE
from sysid.fitting.uncertainty import PART
from sysid.structures.linear.polynomial import PolynomialStructure


def confounded(structure: PolynomialStructure, records: Sequence[Record]) -> Array:
    """Directions of θ that inputs in fixed proportion to each other leave open, (n, n_open).

    With u₂ = α u₁ only B₁/F₁ + α B₂/F₂ is seen. Rows without F show that as a singular JᵀJ; with
    denominators of its own for each input the errors are curved along that line, JᵀJ is regular
    wherever the search ends, and still nothing says which input has which poles.
    """
    n = len(structure.parameters(records[0].inputs, records[0].outputs))
    if "f" not in structure.letters:
        return np.zeros((n, 0))
    groups = []
    for weights in _proportions(records).T:
        alike = np.abs(weights) > PART
        for i in range(structure.ny):
            lay, index = structure.layout(i), structure.row_index(i)
            _, b, _, _, f = lay.slices()
            members = [j for j in range(structure.nu) if alike[j] and lay.nb[j]]
            if len(members) < 2:
                continue
            direction = np.zeros(n)
            for j in members:
                direction[index[b[j]]] = direction[index[f[j]]] = weights[j]
            groups.append(direction / np.linalg.norm(direction))
    return np.array(groups).T if groups else np.zeros((n, 0))


def _proportions(records: Sequence[Record]) -> Array:
    """Null space of the inputs, each scaled to unit norm, (nu, k)."""
    R = np.linalg.qr(np.vstack([np.linalg.qr(r.u, mode="r") for r in records]), mode="r")
    scale = np.linalg.norm(R, axis=0)
    scale[scale == 0] = 1.0
    _, s, Vt = np.linalg.svd(R / scale, full_matrices=True)
    s = np.concatenate([s, np.zeros(len(Vt) - len(s))])
    return np.asarray(Vt[s <= s.max(initial=0.0) * RANK_TOLERANCE].T)
