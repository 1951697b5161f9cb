"""Where the gains of a chain of blocks are put, and which parameters pin them there.

A gain can be moved from one block to the next without changing what the chain does, so the data
say nothing about it. It is put in one place, and one or two parameters hold it there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.structures.block_chain import BlockChain, LinearLayer, StaticLayer
from sysid.structures.static import KINDS, Stage, Static, spline_knots


def argument_scaled(static: Static, p: Array, factor: float) -> tuple[Static, Array]:
    """The static g' with g'(factor·w) = g(w), where it has a gain to take the factor up."""
    stages, parts, alive = [], [], True
    for stage, place in zip(static.stages, static.slices(), strict=True):
        part = p[place].copy()
        if alive and stage.kind == "polynomial":
            part /= factor ** np.arange(1.0, stage.size + 1)
            alive = False
        elif alive and stage.kind == "piecewise":
            part[: stage.size] *= factor
            alive = False
        elif alive and stage.kind == "spline":
            stage = replace(stage, knots=tuple((spline_knots(stage) * factor).tolist()))
            alive = False
        elif alive:
            part *= factor
        stages.append(stage)
        parts.append(part)
    return Static(tuple(stages)), np.concatenate([*parts, np.zeros(0)])


def value_scaled(static: Static, p: Array, factor: float) -> Array:
    """Parameters with which the static is ``factor`` times what it was, where it has a gain."""
    out = p.copy()
    places = static.slices()
    last = max(k for k, s in enumerate(static.stages) if KINDS[s.kind].has_gain)
    stage, part = static.stages[last], places[last]
    out[part.stop - stage.size : part.stop] *= factor
    for place in places[last + 1 :]:
        out[place] *= factor
    return out


def normalised(
    chain: BlockChain, theta: Array, data: Sequence[tuple[Array, Array]]
) -> tuple[BlockChain, Array, list[int]]:
    """The same input-output map with every gain in one place, and the entries that pin it.

    Signals behind a first linear block and before a static with a gain get the spread of what
    they come from or go to; a static with a gain before a linear block takes the spread of its
    argument: its highest and lowest point lie on a line of slope one (of a polynomial the
    largest term is the identity at the end of the range). What was divided out goes to B.

    Returns:
        (chain, θ, entries of θ to hold).
    """
    theta = theta.copy()
    layers = list(chain.layers)
    held: list[int] = []
    signals = [chain.signals(theta, u) for u, _ in data]
    joined = [np.concatenate([s[k] for s in signals], axis=1) for k in range(len(layers))]
    for k, layer in enumerate(layers):
        if not isinstance(layer, StaticLayer):
            continue
        base = chain.edges[k]
        for c, static in enumerate(layer.statics):
            place = slice(base + layer.edges[c], base + layer.edges[c] + static.n)
            before = layers[k - 1] if k else None
            if isinstance(before, LinearLayer) and not static.is_identity:
                movable = static.has_gain or not layer.last
                if movable:
                    towards = (
                        np.concatenate([y[:, c] for _, y in data]) if layer.last else joined[0][c]
                    )
                    spread = float(joined[k][c].std())
                    factor = float(towards.std()) / spread if spread > 0 else 1.0
                    held += _row_scaled(chain, k - 1, c, theta, factor)
                    if static.has_gain:
                        static, theta[place] = argument_scaled(static, theta[place], factor)
                    else:
                        theta[place] *= factor
                        if k + 1 < len(layers) and not layer.last:
                            _column_scaled(chain, k + 1, c, theta, 1.0 / factor)
                    layers[k] = replace(
                        layers[k],
                        statics=(
                            *layers[k].statics[:c],  # type: ignore[union-attr]
                            static,
                            *layers[k].statics[c + 1 :],  # type: ignore[union-attr]
                        ),
                    )
                    joined[k][c] = joined[k][c] * factor
            if static.has_gain and not layer.last:
                factor, pins = _unit_gain(static, theta[place], joined[k][c])
                theta[place] = value_scaled(static, theta[place], factor)
                _column_scaled(chain, k + 1, c, theta, 1.0 / factor)
                held += [place.start + q for q in pins]
    return BlockChain(tuple(layers), chain.nu), theta, sorted(held)


def _row_scaled(chain: BlockChain, k: int, i: int, theta: Array, factor: float) -> list[int]:
    """Multiply the B of row i of layer k; returns the largest coefficient's place."""
    layer = chain.layers[k]
    assert isinstance(layer, LinearLayer)
    entries: list[int] = []
    for out, j, _, s, _, _ in layer.entries(theta[chain.place(k)]):
        if out == i:
            first = chain.edges[k] + s.start
            entries += list(range(first, first + layer.nb[out][j]))
    theta[entries] *= factor
    return [max(entries, key=lambda q: abs(theta[q]))] if entries else []


def _column_scaled(chain: BlockChain, k: int, j: int, theta: Array, factor: float) -> None:
    """Multiply the B of column j of layer k."""
    layer = chain.layers[k]
    assert isinstance(layer, LinearLayer)
    for i, column, _, s, _, _ in layer.entries(theta[chain.place(k)]):
        if column == j:
            first = chain.edges[k] + s.start
            theta[first : first + layer.nb[i][j]] *= factor


def _unit_gain(static: Static, p: Array, x: Array) -> tuple[float, list[int]]:
    """Factor that gives a static the spread of its argument, and the entries that pin it."""
    last = max(k for k, s in enumerate(static.stages) if KINDS[s.kind].has_gain)
    stage: Stage = static.stages[last]
    place = static.slices()[last]
    for inner, part in zip(static.stages[:last], static.slices()[:last], strict=True):
        x = inner.value(x, p[part])
    if stage.kind == "polynomial":
        reach = max(float(np.max(np.abs(x))), 1e-300)
        sizes = np.abs(p[place]) * reach ** np.arange(1.0, stage.size + 1)
        largest = int(np.argmax(sizes))
        value = p[place][largest] * reach**largest
        return (1.0 / value if value else 1.0), [place.start + largest]
    values = p[place][-stage.size :]
    points = p[place][: stage.size] if stage.kind == "piecewise" else spline_knots(stage)
    low, high = sorted((int(np.argmin(values)), int(np.argmax(values))))
    rise = values[high] - values[low]
    first = place.stop - stage.size
    if high == low or rise == 0.0:
        return 1.0, [first]
    return float((points[high] - points[low]) / rise), [first + low, first + high]
