"""Where the search for friction of a servo starts: least squares over the samples in motion."""

import numpy as np

from sysid.data.record import Array
from sysid.discrepancy.search.prepared import Data
from sysid.discrepancy.search.supermodel import SuperModel
from sysid.effects.base import Effect
from sysid.effects.catalogue import LEVEL
from sysid.effects.servo import OF_SERVO

MOVES = 8.0
"""Changes of the position over a sample on either side, in its noise, from which it moves."""

SPANS = (1, 2, 3)
"""Samples over which the direction of the motion is taken; each is a start."""


def from_motion(model: SuperModel, e: Effect, q: Array, data: Data) -> list[Array]:
    """Cores and friction with which a servo moves as it was seen to.

    While it moves one way, F(q) y = B(q) u − F(1) (c sign ẏ + l) is linear in all numbers.

    Args:
        e: friction with a law of servos; its first number is c.
        q: numbers of the model without it, (slots,).
    """
    found = []
    for span in SPANS:
        row = q.copy()
        for i in range(model.tracks):
            if (numbers := _regressed(model.order, data, i, span)) is None:
                break
            gain, f, level, load = numbers
            row[model.place["core", "gain", i]] = gain
            for k in range(1, model.order + 1):
                row[model.place["core", f"f{k}", i]] = f[k - 1]
            for k in range(2, model.order + 1):
                row[model.place["core", f"b{k}", i]] = 0.0  # what friction takes then holds at once
            row[model.place[e.id, e.parameters[0].name, i]] = level
            row[model.place[e.id, OF_SERVO, i]] = 1.0
            if (bias := (LEVEL.id, LEVEL.parameters[0].name, i)) in model.place:
                row[model.place[bias]] = load
        else:
            found.append(row)
    return found


def _regressed(
    order: int, data: Data, track: int, span: int
) -> tuple[float, Array, float, float] | None:
    """Gain, F without its leading 1, c and l of a track; None where it hardly moves."""
    rows, rights = [], []
    noise = data.noise[track]
    columns = (data.drive[:, track], data.y[:, track], data.weight[:, track])
    for u, y, weight in zip(*(data.split(x) for x in columns), strict=True):
        at = np.arange(max(2 * span, order), len(y) - 1)
        if len(at) == 0:
            continue
        moved, goes_on = y[at] - y[at - 2 * span], y[at + 1] - y[at - span]
        counts = np.min([weight[at - k] for k in range(-1, order)], axis=0) > 0.0
        at = at[(np.abs(moved) > MOVES * noise) & (goes_on * moved > 0.0) & counts]
        way = np.sign(y[at] - y[at - 2 * span])
        past = [y[at - k] for k in range(order)] + [u[at - k] for k in range(order)]
        rows.append(np.column_stack([*past, way, np.ones(len(at))]))
        rights.append(y[at + 1])
    if sum(map(len, rights)) < 10 * (2 * order + 2):
        return None
    theta = np.linalg.lstsq(np.concatenate(rows), np.concatenate(rights), rcond=None)[0]
    f, last = -theta[:order], theta[2 * order :]
    size = 1.0 + f.sum()
    if not size > 1e-9 or np.any(np.abs(np.roots([1.0, *f])) >= 1.0):
        return None
    gain = float(theta[order : 2 * order].sum() / size)
    return gain, f, max(float(-last[0] / size), 0.0), float(-last[1] / size)
