"""Names, units and printed equations of NARX models."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Channel
from sysid.data.unit_words import ratio
from sysid.fitting.problem import Parameter
from sysid.structures.difference_equations.regressors import Row, named
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.narx.wavelet_network import Kind, RowDesign, Weights

DILATIONS = (0.05, 40.0)
"""Admissible dilations: narrower units fit single samples, wider ones are the linear part."""

REACH = 1.5
"""How far from the origin of v a centre may lie, in half widths of the training range."""


def shapes(d: RowDesign, kind: Kind) -> tuple[Parameter, ...]:
    """A row's parameters without names and units: which are bounded, which cannot be refined."""
    _, T, K, q = d.sizes
    free = Parameter("")
    plain = (free,) * (1 + len(d.mean) + T + K)
    if not kind.smooth:
        # shape and place of a box have no gradient: they stay where the frame put them
        return (*plain, *(Parameter("", fixed=0.0),) * (K * (1 + q)))
    if kind.shape != "dilation":
        return (*plain, *(free,) * (K * (1 + q)))
    dilation = Parameter("", lower=DILATIONS[0], upper=DILATIONS[1])
    centre = Parameter("", lower=-REACH, upper=REACH)
    return (*plain, *(dilation,) * K, *(centre,) * (K * q))


def parameters(
    row: Row,
    d: RowDesign,
    kind: Kind,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    output: int,
) -> tuple[Parameter, ...]:
    """Names and units of a row's parameters; ``fixed`` is set by the fit."""
    top = outputs[output].unit
    _, _, K, q = d.sizes
    names: list[tuple[str, str]] = [("y0", top)]
    for e in row:
        below = ""
        if isinstance(e, Signal):
            below = (inputs if e.kind == "u" else outputs)[e.channel].unit
        names.append((named(e, inputs, outputs), ratio(top, below)))
    names += [
        ("product[" + "·".join(named(row[k], inputs, outputs) for k in t) + "]", top)
        for t in d.terms
    ]
    names += [(f"{kind.unit}{k + 1}.amplitude", top) for k in range(K)]
    names += [(f"{kind.unit}{k + 1}.{kind.shape}", "") for k in range(K)]
    names += [(f"{kind.unit}{k + 1}.{kind.place}{j + 1}", "") for k in range(K) for j in range(q)]
    tag = "" if len(outputs) == 1 else f"[{outputs[output].name}]"
    return tuple(
        Parameter(name + tag, unit, p.lower, p.upper)
        for (name, unit), p in zip(names, shapes(d, kind), strict=True)
    )


def equation(
    row: Row,
    d: RowDesign,
    kind: Kind,
    w: Weights,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    output: int,
) -> str:
    """``y(t) = 0.2 + 0.81·y(t-1) + … + 6 wavelets of y(t-1), u(t-1) + e(t)``."""
    name = outputs[output].name
    constant = float(w.constant) - float(np.array(d.mean) @ w.linear)
    parts = [_signed(constant, "")]
    parts += [
        _signed(float(v), named(e, inputs, outputs)) for v, e in zip(w.linear, row, strict=True)
    ]
    for v, t in zip(w.products, d.terms, strict=True):
        parts.append(_signed(float(v), "·".join(f"z[{named(row[k], inputs, outputs)}]" for k in t)))
    text = " ".join(parts).removeprefix("+ ")
    if d.flags:
        seen = ", ".join(named(row[k], inputs, outputs) for k in d.seen_by_units())
        each = f"each of {d.sizes[3]} of " if d.views else "of "
        plural = "" if len(d.flags) == 1 else "s"
        text += f" + {len(d.flags)} {kind.unit}{plural} {each}({seen})"
    error = "e(t)" if len(outputs) == 1 else f"e_{name}(t)"
    return f"{name}(t) = {text} + {error}"


def _signed(value: float, what: str) -> str:
    sign = "-" if value < 0 else "+"
    return f"{sign} {abs(value):.5g}" + (f"·{what}" if what else "")
