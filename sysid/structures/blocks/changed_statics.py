"""Replace statics in a fitted chain by others that match them as well as possible."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.blocks.fit import ChainData, Fitted
from sysid.structures.blocks.gains import argument_scaled, scale_gain
from sysid.structures.blocks.layers import LinearLayer, StaticLayer
from sysid.structures.blocks.static.functions import Static
from sysid.structures.blocks.static.starts import shaped


def with_statics(fitted: Fitted, layer: int, statics: Sequence[Static], data: ChainData) -> Fitted:
    """The chain with other statics in one layer, each following the one it replaces.

    A gain that the new static does not have goes to the linear block beside it. Statics of the
    same text stay as they are, points included. Nothing is fitted: cost and held-out error are
    those of before.
    """
    chain, theta = fitted.chain, fitted.theta.copy()
    old = chain.layers[layer]
    assert isinstance(old, StaticLayer)
    signals = [chain.signals(theta, u) for u, _ in data.data]
    states = fitted.p[chain.n :].reshape(len(data.data), chain.n_states).copy()
    place = chain.place(layer)
    new: list[Static] = []
    parts: list[Array] = []
    for c, static in enumerate(statics):
        parameters_of_static = theta[place][old.edges[c] : old.edges[c + 1]]
        if static.text == old.statics[c].text:
            new.append(old.statics[c])
            parts.append(parameters_of_static)
            continue
        x = np.concatenate([s[layer][c] for s in signals])
        value = np.concatenate([s[layer + 1][c] for s in signals])
        shape = shaped(static, x, value, upright=old.last)
        p = shape.p
        if shape.gain != 1.0 and old.last:
            # gain · g(w) = g'(gain · w) for limits and kinks
            _, p = argument_scaled(shape.static, p, shape.gain)
            scale_gain(chain, layer - 1, theta, shape.gain, row=c)
            _scale_states(chain, layer - 1, states, shape.gain, c)
        elif shape.gain != 1.0:
            scale_gain(chain, layer + 1, theta, shape.gain, column=c)
        new.append(shape.static)
        if old.last and not shape.static.has_offset:
            p = np.append(p, shape.offset)
        parts.append(p)
    layers = list(chain.layers)
    layers[layer] = replace(old, statics=tuple(new))
    changed = BlockChain(tuple(layers), chain.nu)
    start = np.concatenate([theta[: place.start], *parts, theta[place.stop :], states.ravel()])
    return replace(fitted, chain=changed, p=start)


def _scale_states(chain: BlockChain, k: int, states: Array, gain: float, row: int) -> None:
    """Multiply the states behind one row of linear layer k, in place."""
    at = sum(layer.n_states for layer in chain.layers[:k])
    layer = chain.layers[k]
    assert isinstance(layer, LinearLayer)
    for (i, _), order in zip(layer.pairs, layer.orders, strict=True):
        if i == row:
            states[:, at : at + order] *= gain
        at += order
