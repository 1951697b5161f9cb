"""Where the gains of a chain of blocks are put, and which parameters pin them there.

A gain can be moved from one block to the next without changing what the chain does, so the data
say nothing about it. It is put in one place, and one or two parameters hold it there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.blocks.layers import LinearLayer, StaticLayer
from sysid.structures.blocks.static.functions import Static
from sysid.structures.blocks.static.kinds import KINDS, spline_knots


def normalised(
    chain: BlockChain, theta: Array, data: Sequence[tuple[Array, Array]]
) -> tuple[BlockChain, Array, list[int]]:
    """The same input-output map with every gain in one place, and the entries that pin it.

    - A signal between two blocks gets the spread of the input it comes from, or before the last
      static that of the output it goes to; the largest coefficient of that row's B pins it.
    - A static with a gain of its own before a linear block runs from its lowest to its highest
      point along a line of slope one, and these two points pin it (of a polynomial the largest
      term is the identity at the end of the range). What was divided out goes to B.

    Args:
        chain, theta: the chain and its parameters.
        data: (u, y) of each experiment: what spreads are taken from.

    Returns:
        (chain, θ, entries of θ to hold).
    """
    theta = theta.copy()
    layers = list(chain.layers)
    fixed: list[int] = []
    runs = [chain.signals(theta, u) for u, _ in data]
    joined = [np.concatenate([run[k] for run in runs], axis=1) for k in range(len(layers))]
    targets = np.concatenate([y for _, y in data]).T
    for k, layer in enumerate(chain.layers):
        if not isinstance(layer, StaticLayer):
            continue
        statics = list(layer.statics)
        for c, static in enumerate(statics):
            first = chain.edges[k] + layer.edges[c]
            place = slice(first, first + static.n)
            x = joined[k][c]
            if k and (static.has_gain or not layer.last):
                wanted = float((targets if layer.last else joined[0])[c].std())
                spread = float(x.std())
                factor = wanted / spread if spread > 0.0 and wanted > 0.0 else 1.0
                fixed += scale_gain(chain, k - 1, theta, factor, row=c)
                statics[c], theta[place] = argument_scaled(static, theta[place], factor)
                x = x * factor
                if not static.has_gain:
                    scale_gain(chain, k + 1, theta, 1.0 / factor, column=c)
            if static.has_gain and not layer.last:
                factor, pins = _unit_gain(statics[c], theta[place], x)
                theta[place] = value_scaled(statics[c], theta[place], factor)
                scale_gain(chain, k + 1, theta, 1.0 / factor, column=c)
                fixed += [first + q for q in pins]
        layers[k] = replace(layer, statics=tuple(statics))
    return BlockChain(tuple(layers), chain.nu), theta, sorted(fixed)


def scale_gain(
    chain: BlockChain, k: int, theta: Array, gain: float, *, column: int = -1, row: int = -1
) -> list[int]:
    """Multiply the B of one column or row of linear layer k, in place.

    Returns:
        The place in θ of the largest coefficient concerned, none where there is no entry.
    """
    layer = chain.layers[k]
    assert isinstance(layer, LinearLayer)
    entries: list[int] = []
    for i, j, _, s, _, _ in layer.entries(theta[chain.place(k)]):
        if j == column or i == row:
            first = chain.edges[k] + s.start
            entries += list(range(first, first + layer.nb[i][j]))
    theta[entries] *= gain
    return [max(entries, key=lambda q: abs(theta[q]))] if entries else []


def argument_scaled(static: Static, p: Array, factor: float) -> tuple[Static, Array]:
    """g' with g'(factor·w) = g(w), or factor·g(w) where the static has no gain of its own."""
    stages, parts, alive = [], [], True
    for stage, place in zip(static.stages, static.slices(), strict=True):
        part = p[place].copy()
        if alive and stage.kind == "polynomial":
            part /= factor ** np.arange(1.0, stage.size + 1)
        elif alive and stage.kind == "piecewise":
            part[: stage.size] *= factor
        elif alive and stage.kind == "spline":
            stage = replace(stage, knots=tuple((spline_knots(stage) * factor).tolist()))
        elif alive:
            part *= factor
        alive = alive and not KINDS[stage.kind].has_gain
        stages.append(stage)
        parts.append(part)
    return Static(tuple(stages)), np.concatenate([*parts, np.zeros(0)])


def value_scaled(static: Static, p: Array, factor: float) -> Array:
    """Parameters with which a static with a gain is ``factor`` times what it was."""
    out = p.copy()
    last, places = _last_gain(static), static.slices()
    part = places[last]
    out[part.stop - static.stages[last].size : part.stop] *= factor
    for place in places[last + 1 :]:
        out[place] *= factor
    return out


def _last_gain(static: Static) -> int:
    """The last stage that has a gain of its own."""
    return max(k for k, s in enumerate(static.stages) if KINDS[s.kind].has_gain)


def _unit_gain(static: Static, p: Array, x: Array) -> tuple[float, list[int]]:
    """Factor that gives a static the slope of the identity, and the entries that pin it."""
    last, places = _last_gain(static), static.slices()
    stage, place = static.stages[last], places[last]
    for inner, part in zip(static.stages[:last], places[:last], strict=True):
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
    first = place.stop - stage.size
    rise = float(values[high] - values[low])
    if high == low or rise == 0.0:
        return 1.0, [first]
    return float(points[high] - points[low]) / rise, [first + low, first + high]
