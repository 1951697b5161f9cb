"""NARX networks as C: regressors, linear part, products and units, kept inside their limits.

For each output one function computes, with z the scaled regressors kept inside the training range
and v their principal components,

    ŷ = y₀ + (r − r̄) L + Σ p_k Π z + Σ a_k f(v, s_k, c_k)

(see ``sysid.structures.narx.wavelet_network``). The states are past outputs and inputs, as in
Python.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sysid.export.c.polynomial import Places, limit_words, limited
from sysid.export.c.writing import CBody, factor, integers, number, table
from sysid.structures.model import Model
from sysid.structures.narx.structure import NarxWavelet
from sysid.structures.narx.wavelet_network import RowDesign, Weights
from sysid.structures.recursive.expressions import Expression, Number, Signal
from sysid.structures.recursive.regressors import Row, lag_of

_UNITS: Mapping[str, tuple[str, ...]] = {
    "wavelet": (
        "double r2 = 0.0;",
        "for (j = 0; j < {q}; j++) {{",
        "    const double t = shape[k] * (v[j] - place[k][j]);",
        "    r2 += t * t;",
        "}}",
        "value += amplitude[k] * (1.0 + flag[k] * ({dim} - 1.0 - r2)) * exp(-0.5 * r2);",
    ),
    "piecewise-constant": (
        "double most = 0.0;",
        "for (j = 0; j < {q}; j++)",
        "    most = fmax(most, fabs(shape[k] * (v[j] - place[k][j])));",
        "if (most <= 1.0)",
        "    value += amplitude[k];",
    ),
    "fourier": (
        "double t = 0.0;",
        "for (j = 0; j < {q}; j++)",
        "    t += v[j] * place[k][j];",
        "value += amplitude[k] * cos(t + shape[k]);",
    ),
    "neural": (
        "double t = 0.0;",
        "for (j = 0; j < {q}; j++)",
        "    t += v[j] * place[k][j];",
        "value += amplitude[k] * tanh(t + shape[k]);",
    ),
}
"""What one unit k adds, by estimator."""

_CALLS: Mapping[str, str] = {
    "+": "({0} + {1})",
    "-": "({0} - {1})",
    "*": "({0} * {1})",
    "/": "({0} / {1})",
    "^": "pow({0}, {1})",
    "minus": "(-{0})",
    "abs": "fabs({0})",
    "sign": "sign({0})",
    "pos": "fmax({0}, 0.0)",
    "neg": "fmin({0}, 0.0)",
    "sqrt": "sqrt(fmax({0}, 0.0))",
    "exp": "exp(fmin({0}, 30.0))",
    "tanh": "tanh({0})",
    "sin": "sin({0})",
    "cos": "cos({0})",
    "min": "fmin({0}, {1})",
    "max": "fmax({0}, {1})",
}

_SIGN = (
    "static double sign(double a)",
    "{",
    "    return (double)((a > 0.0) - (a < 0.0));",
    "}",
    "",
)


def narx(model: Model) -> CBody:
    """The code of a NARX network with any of its estimators."""
    structure = model.structure
    assert isinstance(structure, NarxWavelet)
    run = structure.free_run()
    places = Places(run.y_depth, run.u_depth)
    estimator = structure.options_given.estimator
    support: list[str] = []
    lines = [f"    double s[{structure.ny}];"]
    for i, (row, design) in enumerate(zip(structure.rows, structure.maps, strict=True)):
        weights = design.weights(model.theta[run.theta_index[i]])
        support += _map(i, estimator, design, weights)
        lines += ["    {", f"        double r[{len(row)}];"]
        lines += [f"        r[{k}] = {written(e, places)};" for k, e in enumerate(row)]
        lines += [f"        s[{i}] = map{i}(r);", "    }"]
    if _calls(structure.rows, "sign"):
        support = [*_SIGN, *support]
    lines += ["", *limited(structure.limits), *places.kept()]
    return CBody(
        run.n_states,
        (
            "r holds the regressors of an output, s the outputs, x past outputs and inputs, v the",
            "inputs, all as deviations from the operating point. Each map is linear in r, plus",
            "products and units of what lies inside the range of the data.",
            *limit_words(structure.limits),
        ),
        tuple(lines),
        tuple(support),
        mathematical=True,
    )


def written(e: Expression, places: Places) -> str:
    """A regressor as a C expression."""
    if isinstance(e, Number):
        return number(e.value)
    if isinstance(e, Signal):
        return places.name(e.kind, e.channel, lag_of(e))
    return _CALLS[e.name].format(*(written(a, places) for a in e.args))


def _calls(rows: Sequence[Row], name: str) -> bool:
    def found(e: Expression) -> bool:
        if isinstance(e, Number | Signal):
            return False
        return e.name == name or any(found(a) for a in e.args)

    return any(found(e) for row in rows for e in row)


def _map(i: int, estimator: str, design: RowDesign, w: Weights) -> Iterator[str]:
    """The function of one output, with its tables."""
    f, terms = design.frame(), design.terms
    d, K = len(f.mean), len(w.amplitude)
    dim = float(f.dim[0]) if K else 0.0
    yield f"static double map{i}(const double r[{d}])"
    yield "{"
    tables = {"mean": f.mean, "linear": w.linear}
    if terms or K:
        tables |= {"scale": f.scale, "low": f.low, "high": f.high}
    if K:
        P = np.array(design.projection)
        tables |= {"projection": P, "amplitude": w.amplitude, "shape": w.shape, "place": w.place}
        if estimator == "wavelet":
            tables["flag"] = f.flag
        if design.views:
            yield from (f"    {line}" for line in integers("view", design.views))
    for name, values in tables.items():
        yield from (f"    {line}" for line in table(name, np.asarray(values)))
    yield f"    double value = {number(float(w.constant))};"
    if terms or K:
        yield f"    double z[{d}];"
    yield f"    int k{', j' if K else ''};"
    yield ""
    yield f"    for (k = 0; k < {d}; k++) {{"
    yield "        const double away = r[k] - mean[k];"
    yield "        value += linear[k] * away;"
    if terms or K:
        yield "        z[k] = fmin(fmax(away / scale[k], low[k]), high[k]);"
    yield "    }"
    for p, t in zip(w.products, terms, strict=True):
        yield f"    value += {factor(float(p))} * {' * '.join(f'z[{k}]' for k in t)};"
    if K:
        yield from (f"    {line}" for line in _units(estimator, design, P.shape[1], dim))
    yield "    return value;"
    yield "}"
    yield ""


def _units(estimator: str, design: RowDesign, width: int, dim: float) -> Iterator[str]:
    d, _, K, q = design.sizes
    yield "{"
    yield f"    double v[{width}];"
    yield f"    for (j = 0; j < {width}; j++) {{"
    yield "        v[j] = 0.0;"
    yield f"        for (k = 0; k < {d}; k++)"
    yield "            v[j] += z[k] * projection[k][j];"
    yield "    }"
    yield f"    for (k = 0; k < {K}; k++) {{"
    for line in _UNITS[estimator]:
        text = line.format(q=q, dim=number(dim))
        yield "        " + (text.replace("v[j]", "v[view[k][j]]") if design.views else text)
    yield "    }"
    yield "}"
