"""Linear structures as C: the difference equations of their transfer matrix.

With the state x of each group, drive v = u − u₀ and output w,

    w = num₀·v + x₁,  xₖ ← xₖ₊₁ + numₖ·v − denₖ w,

the transposed direct form II, which is what Python's filters run.
"""

from collections.abc import Iterator

from sysid.export.c.writing import CBody, number
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.transfer import Group
from sysid.structures.model import Model


def linear(model: Model) -> CBody:
    """The code of an ARX, ARMAX, OE or BJ model."""
    structure = model.structure
    assert isinstance(structure, PolynomialStructure)
    transfer = structure.transfer(model.theta)
    lines: list[str] = []
    at = 0
    for group in transfer.groups:
        lines += ["", *_group_lines(group, at)]
        at += group.order
    return CBody(
        transfer.n_states,
        (
            "Each block below is a transfer function in transposed direct form II: w is its",
            "output, x its states, v the inputs as deviations from the operating point.",
        ),
        ("    double w;", *lines) if lines else (),
    )


def _group_lines(group: Group, at: int) -> Iterator[str]:
    """One transfer function; its first state is x[at]."""
    first = [f"x[{at}]"] if group.order else []
    yield f"    w = {_sum([*first, *_products(group, 0)])};"
    yield f"    out[{group.output}] += w;"
    for k in range(1, group.order + 1):
        following = [f"x[{at + k}]"] if k < group.order else []
        feedback = [f"{number(-group.den[k])} * w"] if group.den[k] else []
        yield f"    x[{at + k - 1}] = {_sum([*following, *_products(group, k), *feedback])};"


def _products(group: Group, k: int) -> list[str]:
    """num_k·v, without the terms that are zero."""
    pairs = zip(group.inputs, group.num[:, k], strict=True)
    return [f"{number(b)} * v[{j}]" for j, b in pairs if b]


def _sum(terms: list[str]) -> str:
    return " + ".join(terms) if terms else "0.0"
