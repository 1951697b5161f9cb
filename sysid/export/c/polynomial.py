"""Polynomial NARMAX models as C: the sum of their terms, kept inside its limits.

In free run past errors are zero, so their terms are left out. The states are past outputs and
inputs, y_j(t−1) … y_j(t−depth_j) and u_j likewise, as in Python.
"""

from collections.abc import Iterator, Sequence

from sysid.data.record import Array
from sysid.export.c.writing import CBody, factor, number, shifted
from sysid.structures.model import Model
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.narx.run import Limits
from sysid.structures.recursive.monomials import Term, is_noise


def polynomial(model: Model) -> CBody:
    """The code of a NARMAX model."""
    structure = model.structure
    assert isinstance(structure, NARMAX)
    run = structure.free_run()
    places = Places(run.y_depth, run.u_depth)
    lines = [f"    double s[{run.ny}];"]
    for i, row in enumerate(structure.rows):
        lines += ["", f"    s[{i}] = 0.0;"]
        lines += _terms(i, row, model.theta[structure.row_index(i)], places)
    lines += ["", *limited(structure.limits), *places.kept()]
    return CBody(
        run.n_states,
        (
            "Each output is a sum of products of past outputs and inputs; s holds the outputs, x",
            "past outputs and inputs, v the inputs, all as deviations from the operating point.",
            *limit_words(structure.limits),
        ),
        tuple(lines),
    )


def _terms(i: int, row: Sequence[Term], theta: Array, places: "Places") -> Iterator[str]:
    for value, t in zip(theta, row, strict=True):
        if not is_noise(t):
            factors = [factor(float(value)), *(places.name(f.kind, f.channel, f.lag) for f in t)]
            yield f"    s[{i}] += {' * '.join(factors)};"


class Places:
    """Where past samples lie in x[]: y_j(t−1) … y_j(t−depth_j), then u_j likewise.

    Args:
        y_depth, u_depth: how far each output and input is remembered.
    """

    def __init__(self, y_depth: Sequence[int], u_depth: Sequence[int]) -> None:
        self.blocks: list[tuple[str, int, int]] = []
        at = 0
        for kind, depths in (("y", y_depth), ("u", u_depth)):
            for j, depth in enumerate(depths):
                self.blocks.append((f"{kind}{j}", at, at + depth))
                at += depth
        self._at = {name: first for name, first, _ in self.blocks}

    def name(self, kind: str, channel: int, lag: int) -> str:
        """A lagged signal as C."""
        if lag == 0:
            return f"v[{channel}]"
        return f"x[{self._at[f'{kind}{channel}'] + lag - 1}]"

    def kept(self) -> Iterator[str]:
        """Lines that remember the outputs s[] and the inputs v[], and add s[] to out[]."""
        moved = [b for b in self.blocks if b[2] - b[1] > 1]
        if moved:
            yield "    {"
            yield "        int k;"
            for _, first, last in moved:
                yield from (f"    {line}" for line in shifted(first, last))
            yield "    }"
        for name, first, last in self.blocks:
            if last > first:
                yield f"    x[{first}] = {'s' if name[0] == 'y' else 'v'}[{name[1:]}];"
        for i in range(sum(name[0] == "y" for name, _, _ in self.blocks)):
            yield f"    out[{i}] += s[{i}];"


def limited(limits: Limits) -> Iterator[str]:
    """Lines that keep s[] inside the limits; what is no number goes to the lower one."""
    for i, (low, high) in enumerate(limits):
        if abs(low) < float("inf") or abs(high) < float("inf"):
            inside = f"s[{i}] >= {number(low)} ? s[{i}] : {number(low)}"
            yield f"    s[{i}] = s[{i}] > {number(high)} ? {number(high)} : ({inside});"


def limit_words(limits: Limits) -> tuple[str, ...]:
    """What the limits mean, where there are any."""
    if all(abs(low) == float("inf") for low, _ in limits):
        return ()
    return (
        "Outputs are kept inside the range of the data and a margin: beyond it the model says",
        "nothing.",
    )
