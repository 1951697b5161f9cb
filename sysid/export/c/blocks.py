"""Block-oriented models as C: transfer functions, and a function for each static.

Linear blocks run the difference equations of ``c_linear``; a static before a linear block passes
through the origin, see ``sysid.structures.blocks.chain``.
"""

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

import numpy as np

from sysid.data.record import Array
from sysid.export.c.writing import CBody, factor, number, table
from sysid.structures.blocks.layers import StaticLayer
from sysid.structures.blocks.static.kinds import Stage, spline_knots
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.model import Model


def blocks(model: Model) -> CBody:
    """The code of a Hammerstein–Wiener or Wiener–Hammerstein model."""
    structure = model.structure
    assert isinstance(structure, BlockStructure)
    chain = structure.chain
    support: list[str] = []
    lines: list[str] = []
    source, at = "v", 0
    for k, layer in enumerate(chain.layers):
        p, target = model.theta[chain.place(k)], f"s{k}"
        if isinstance(layer, StaticLayer):
            lines += ["", f"    double {target}[{len(layer.statics)}];"]
            for c in range(len(layer.statics)):
                own = p[layer.edges[c] : layer.edges[c + 1]]
                function, name = _static(layer, c, own, f"static{k}_{c}")
                support += function
                lines.append(f"    {target}[{c}] = {name.format(f'{source}[{c}]')};")
        else:
            lines += ["", f"    double {target}[{layer.n_outputs}] = {{0.0}};"]
            for i, j, order, _, B, F in layer.entries(p):
                lines += _filter(B, F, order, at, f"{source}[{j}]", f"{target}[{i}]")
                at += order
        source = target
    lines += ["", *(f"    out[{i}] += {source}[{i}];" for i in range(structure.ny))]
    return CBody(
        chain.n_states,
        (
            "s0, s1 … are the signals after each layer of blocks; a linear block is a transfer",
            "function in transposed direct form II: w is its output, x its states, v the inputs",
            "as deviations from the operating point.",
        ),
        tuple(lines),
        tuple(support),
        mathematical=True,
    )


def _filter(B: Array, F: Array, order: int, at: int, source: str, target: str) -> Iterator[str]:
    """One entry of a linear layer; its first state is x[at]."""

    def term(values: Array, k: int, signal: str, sign: float = 1.0) -> list[str]:
        value = sign * float(values[k]) if k < len(values) else 0.0
        return [f"{factor(value)} * {signal}"] if value else []

    def total(terms: list[str]) -> str:
        return " + ".join(terms) or "0.0"

    yield "    {"
    yield f"        const double w = {total([*term(B, 0, source), *_state(at, 0, order)])};"
    yield f"        {target} += w;"
    for k in range(1, order + 1):
        moved = [*_state(at, k, order), *term(B, k, source), *term(F, k, "w", -1.0)]
        yield f"        x[{at + k - 1}] = {total(moved)};"
    yield "    }"


def _state(at: int, k: int, order: int) -> list[str]:
    return [f"x[{at + k}]"] if k < order else []


def _static(layer: StaticLayer, c: int, p: Array, name: str) -> tuple[list[str], str]:
    """(its function, how it is called): channel c of a layer; p are the channel's parameters."""
    static = layer.statics[c]
    if static.is_identity:
        return [], "{0}" + (f" + {factor(float(p[0]))}" if layer.last else "")
    own = p[: static.n]
    if layer.has_y0(c):
        shift = float(p[static.n])
    else:
        shift = 0.0 if layer.last else -float(static.value(np.zeros(1), own)[0])
    lines = [f"static double {name}(double s)", "{"]
    for stage, part in zip(static.stages, static.slices(), strict=True):
        lines += [f"    {line}" for line in _STAGES[stage.kind](own[part], stage)]
    lines += [f"    return s{f' + {factor(shift)}' if shift else ''};", "}", ""]
    return lines, f"{name}({{0}})"


# ------------------------------------------------------------------------- kinds of stages


def _identity(p: Array, stage: Stage) -> list[str]:
    return []


def _abs(p: Array, stage: Stage) -> list[str]:
    return [f"s = fabs(s - {factor(float(p[0]))});"]


def _dead_zone(low: bool, high: bool) -> Callable[[Array, Stage], list[str]]:
    def lines(p: Array, stage: Stage) -> list[str]:
        parts = []
        if low:
            parts.append(f"fmin(s - {factor(float(p[0]))}, 0.0)")
        if high:
            parts.append(f"fmax(s - {factor(float(p[-1]))}, 0.0)")
        return [f"s = {' + '.join(parts)};"]

    return lines


def _saturation(low: bool, high: bool) -> Callable[[Array, Stage], list[str]]:
    def lines(p: Array, stage: Stage) -> list[str]:
        text = "s"
        if low:
            text = f"fmax({text}, {number(float(p[0]))})"
        if high:
            text = f"fmin({text}, {number(float(p[-1]))})"
        return [f"s = {text};"]

    return lines


def _polynomial(p: Array, stage: Stage) -> list[str]:
    text = f"{number(float(p[stage.size - 1]))} * s"
    for k in range(stage.size - 2, -1, -1):
        text = f"({text} + {factor(float(p[k]))}) * s"
    return [f"s = {text};"]


def _found(n: int) -> list[str]:
    """Lines that find the segment k of s among t[], the outer ones extended."""
    return [
        "int k = 0;",
        f"while (k < {n - 2} && s >= t[k + 1])",
        "    k++;",
        "h = t[k + 1] - t[k];",
        "part = (s - t[k]) / h;",
    ]


def _block(lines: list[str]) -> list[str]:
    return ["{", *(f"    {line}" for line in lines), "}"]


def _piecewise(p: Array, stage: Stage) -> list[str]:
    n = stage.size
    return _block([
        *table("t", p[:n]),
        *table("f", p[n:]),
        "double h, part;",
        *_found(n),
        "s = f[k] + part * (f[k + 1] - f[k]);",
    ])  # fmt: skip


def _curvatures(knots: Array, values: Array) -> Array:
    """Second derivatives at the knots of the natural cubic spline through these points."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(knots, values, bc_type="natural")(knots, 2))


def _spline(p: Array, stage: Stage) -> list[str]:
    n = stage.size
    return _block([
        *table("t", spline_knots(stage)),
        *table("f", p[:n]),
        *table("m", _curvatures(spline_knots(stage), p[:n])),
        "double h, part, a, b, slope;",
        *_found(n),
        "b = fmin(fmax(part, 0.0), 1.0);",
        "a = 1.0 - b;",
        "slope = (f[k + 1] - f[k]) / h",
        "    + ((1.0 - 3.0 * a * a) * m[k] + (3.0 * b * b - 1.0) * m[k + 1]) * h / 6.0;",
        "s = a * f[k] + b * f[k + 1]",
        "    + ((a * a * a - a) * m[k] + (b * b * b - b) * m[k + 1]) * h * h / 6.0",
        "    + slope * (part - b) * h;",
    ])  # fmt: skip


_STAGES: Mapping[str, Callable[[Array, Stage], list[str]]] = MappingProxyType(
    {
        "identity": _identity,
        "abs": _abs,
        "dead-zone": _dead_zone(True, True),
        "dead-zone-lower": _dead_zone(True, False),
        "dead-zone-upper": _dead_zone(False, True),
        "saturation": _saturation(True, True),
        "saturation-lower": _saturation(True, False),
        "saturation-upper": _saturation(False, True),
        "polynomial": _polynomial,
        "piecewise": _piecewise,
        "spline": _spline,
    }
)
"""Lines that replace s by its value under one stage."""
