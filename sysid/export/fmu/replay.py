"""Expected outputs of a unit: rows of inputs and outputs to compare every tool with."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.export.fmu.description import Role, Variable, named_apart
from sysid.plant.selftest import SelfTest, reach
from sysid.structures.plant import Plant


@dataclass(frozen=True, eq=False)
class Replay:
    """Inputs of a unit, sample by sample from its start, and its outputs.

    Attributes:
        u: values of the inputs, (N, inputs).
        now: outputs at the instant of each row, (N, outputs).
        late: outputs one sample later, while the inputs of the row are still held, (N, outputs).
        scale: what errors of each output are relative to.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    u: Array
    now: Array
    late: Array
    scale: Array

    def text(self) -> str:
        """As CSV: a column ``in:NAME`` for each input, ``now:NAME`` and ``late:NAME`` after."""
        into = io.StringIO()
        table = csv.writer(into, lineterminator="\n")
        columns = {"in": self.inputs, "now": self.outputs, "late": self.outputs}
        table.writerow([f"{kind}:{name}" for kind, names in columns.items() for name in names])
        table.writerows(
            [map(repr, row.tolist()) for row in np.hstack([self.u, self.now, self.late])]
        )
        return into.getvalue()


def replay_from(text: str, where: str) -> Replay:
    """The rows of a CSV file."""
    try:
        head, *rows = csv.reader(io.StringIO(text))
        values = np.array([[float(v) for v in row] for row in rows]).reshape(len(rows), len(head))
        kinds = [name.partition(":")[0] for name in head]
        parts = {
            kind: [k for k, column_kind in enumerate(kinds) if column_kind == kind]
            for kind in _KINDS
        }
        names = {kind: tuple(head[k].partition(":")[2] for k in at) for kind, at in parts.items()}
        if not rows or names["now"] != names["late"] or set(kinds) != set(_KINDS):
            raise ValueError("columns are missing")
    except ValueError:
        raise ModelError(f"{where} is damaged: export the plant again") from None
    u, now, late = (values[:, parts[kind]] for kind in _KINDS)
    if not np.all(np.isfinite(np.hstack([now, late]))):
        raise ModelError(f"{where} is damaged: export the plant again")
    return Replay(names["in"], names["now"], u, now, late, reach(now))


_KINDS = ("in", "now", "late")


def plant_replay(plant: Plant, test: SelfTest) -> Replay:
    """What the unit of a plant must give in its self-test."""
    state, late = plant.initial_state(), []
    for u in test.u:
        state, _ = plant.step(state, u)
        late.append(plant.readout(state, u))
    inputs, outputs = channel_names([c.name for c in plant.inputs], [c.name for c in plant.outputs])
    return Replay(inputs, outputs, test.u, test.y, np.array(late), test.scale())


def channel_names(
    inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Channels of a plant by the names that its unit has for them."""
    every = named_apart(Variable(n, Role.INPUT) for n in (*inputs, *outputs))
    names = tuple(v.name for v in every)
    return names[: len(inputs)], names[len(inputs) :]
