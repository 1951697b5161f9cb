"""A model as text and as HTML: what a console and a notebook show of it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.outside_text import html_lines, html_table
from sysid.structures.orders import orders_text

if TYPE_CHECKING:
    from sysid.structures.model import Model

NORMAL = 1.96
"""Standard errors on either side of a value that hold 95 % of a normal distribution."""

HEADS = ("parameter", "value", "std. error", "95 % interval", "unit", "")


def line(model: "Model") -> str:
    """``<Model oe nb=2 nf=2 nk=1: u → y, 0.1 s, 4 parameters>``."""
    orders = orders_text(model.structure.order_values())
    inputs, outputs = (", ".join(c.name for c in side) for side in (model.inputs, model.outputs))
    path = f"{inputs} → {outputs}" if inputs else outputs
    name = f"{model.structure.name} {orders}".rstrip()
    return f"<Model {name}: {path}, {model.dt:g} s, {len(model.theta)} parameters>"


def _facts(model: "Model") -> list[tuple[str, str]]:
    data = ", ".join(f"{s.name} ({s.samples} samples)" for s in model.provenance.data)
    criteria = ", ".join(f"{k.upper()} {v:.6g}" for k, v in model.criteria.items())
    orders = orders_text(model.structure.order_values())
    facts = [
        ("structure", f"{model.structure.traits.title} {orders}".rstrip()),
        ("data", data),
        ("sample time", f"{model.dt:g} s"),
        ("criteria", criteria),
        ("stable", "yes" if model.stable else "no"),
        ("ended", model.termination.value),
        ("offsets", model.operating_point_sentence()),
    ]
    return [(name, value) for name, value in facts if value]


def _rows(model: "Model") -> list[tuple[str, ...]]:
    """A row a parameter; a question mark where the interval holds zero."""
    rows: list[tuple[str, ...]] = []
    for p in model.parameter_table():
        if p.fixed or not np.isfinite(p.std_error):
            rows.append((p.name, f"{p.value:.6g}", "fixed" if p.fixed else "∞", "", p.unit, ""))
            continue
        reach = NORMAL * p.std_error
        interval = f"{p.value - reach:.6g} to {p.value + reach:.6g}"
        mark = "at its bound" if p.at_bound else "?" if abs(p.value) <= reach else ""
        rows.append((p.name, f"{p.value:.6g}", f"{p.std_error:.3g}", interval, p.unit, mark))
    return rows


def summary(model: "Model") -> str:
    """Facts, parameters with intervals, equations and warnings as text."""
    facts = _facts(model)
    wide = max(len(name) for name, _ in facts)
    lines = [f"{name:<{wide}}  {value}" for name, value in facts]
    lines += ["", *_columns([HEADS, *_rows(model)]), "", *model.equations()]
    lines += [f"! {w}" for w in model.warnings]
    return "\n".join(lines)


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def as_html(model: "Model") -> str:
    """The same as two tables of a notebook."""
    warnings = html_lines(*(f"! {w}" for w in model.warnings))
    return f"{html_table(_facts(model))}{html_table(_rows(model), HEADS)}{warnings}"
