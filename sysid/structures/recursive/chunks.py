"""Stretches of data side by side, over which free runs are made at once."""

from typing import Any, NamedTuple

Values = Any
"""An array of numpy or jax.numpy."""


class Chunks(NamedTuple):
    """Stretches of data side by side.

    Attributes:
        u: inputs with what came before them, (before + L, nu, B).
        past: outputs before each stretch, (depth, ny, B).
        y: measured outputs, (L, ny, B).
        weight: what each error counts, 0 where a stretch has ended, (L, ny, B).
        restart: where the run begins anew from the measured past, (L, B): shorter runs without
            another shape to compile.
        limits: lowest and highest output, (ny, 2).
    """

    u: Values
    past: Values
    y: Values
    weight: Values
    restart: Values
    limits: Values
