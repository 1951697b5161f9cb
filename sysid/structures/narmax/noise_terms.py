"""Past errors in the equation: which of them, by extended least squares.

The errors of the process model alone are the first guess of e; terms in past e are ordered by their
error reduction ratio after the process terms, as many kept as BIC asks for, all coefficients
re-estimated, and with the errors of that model everything is repeated (Billings 2013, §3.6).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.fitting.normal_equations import scaled_lstsq
from sysid.structures.difference_equations.frols import bic_size, forward, gram_beyond
from sysid.structures.difference_equations.monomials import (
    Term,
    columns,
    is_noise,
    noise_pool,
)
from sysid.structures.narmax.structure import NARMAX

ROUNDS = 8
RUNAWAY = 10.0
"""Errors this many times as large as without noise terms: the predictor is not invertible."""


def with_noise_terms(s: NARMAX, records: Sequence[Record]) -> tuple[NARMAX, tuple[str, ...]]:
    """The structure with noise terms where it asks for lags of the error and has none yet."""
    rows, notes = [], []
    for i, row in enumerate(s.rows):
        if not s.noise_lags or any(is_noise(t) for t in row):
            rows.append(row)
            continue
        degree = max(len(t) for t in row)
        chosen = _chosen(s, records, i, row, noise_pool(s.orders, i, s.noise_lags, degree))
        if not chosen:
            notes.append(
                f"No past error improves the equation of {records[0].outputs[i].name}: its "
                "errors are white already, or the noise is no part of the process."
            )
        rows.append((*row, *chosen))
    err = s.err
    if err:
        err = tuple((*e, *[0.0] * (len(r) - len(e))) for e, r in zip(err, rows, strict=True))
    return replace(s, terms=tuple(rows), err=err), tuple(notes)


def _chosen(
    s: NARMAX, records: Sequence[Record], output: int, row: tuple[Term, ...], pool: Sequence[Term]
) -> tuple[Term, ...]:
    first = max(s.first_sample(), max((f.lag for t in pool for f in t if f.kind != "e"), default=0))
    data = [r for r in records if len(r) > first + s.noise_lags]
    if not data:
        return ()
    process = [columns(row, r.u, r.y)[first:] for r in data]
    target = np.concatenate([r.y[first:, output] for r in data])
    Phi = np.concatenate(process)
    theta = scaled_lstsq(Phi, target)
    errors = target - Phi @ theta
    plain = float(errors @ errors)
    kept: tuple[Term, ...] = ()
    for _ in range(ROUNDS):
        noise = _values(pool, data, errors, first, output)
        order = _selected(Phi, noise, target)
        if not order:
            return ()
        chosen = tuple(pool[k] for k in order)
        both = np.hstack([Phi, noise[:, order]])
        errors = target - both @ scaled_lstsq(both, target)
        power = float(errors @ errors)
        if not power <= RUNAWAY * plain:
            return ()
        if set(chosen) == set(kept):
            break
        kept = chosen
    return kept


def _selected(Phi: Array, noise: Array, target: Array) -> list[int]:
    """Noise terms by error reduction ratio after the process terms, as many as BIC keeps."""
    samples = len(target)
    gram, usable, _ = gram_beyond(Phi, noise, target)
    path = forward(gram, usable, max(samples // 20, 1))
    count = bic_size([1.0, *path.unexplained()], samples) - 1
    kept: list[int] = path.order[:count].tolist()
    return kept


def _values(
    pool: Sequence[Term], data: Sequence[Record], errors: Array, first: int, output: int
) -> Array:
    blocks, at = [], 0
    for r in data:
        e = np.zeros_like(r.y)
        e[first:, output] = errors[at : at + len(r) - first]
        at += len(r) - first
        blocks.append(columns(pool, r.u, r.y, e)[first:])
    return np.concatenate(blocks)
