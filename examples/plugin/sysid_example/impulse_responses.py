"""An exporter: what every output of a linear plant does after a unit impulse of every input."""

import csv
import io
from typing import ClassVar

import numpy as np

from sysid.errors import ModelError
from sysid.export.base import Exporter, Source

SAMPLES = 200


class ImpulseResponses(Exporter):
    """``impulse/responses.csv``: t [s], and a column ``output<-input`` for every pair."""

    name: ClassVar[str] = "impulse"
    title: ClassVar[str] = "table of impulse responses"

    def files(self, source: Source) -> dict[str, str]:
        """The table.

        Raises:
            ModelError: the plant is not linear, so that no table of them would describe it.
        """
        model = source.model
        if not model.structure.traits.linear:
            raise ModelError(
                f"{source.name} is not linear and has no impulse response; export it without "
                f"{self.name}"
            )
        plant = model.plant()
        table = [np.round(model.dt * np.arange(SAMPLES), 12)]
        header = ["t"]
        for j, into in enumerate(plant.inputs):
            state, u, y = plant.initial_state(), plant.u_offset.copy(), []
            u[j] += 1.0
            for _ in range(SAMPLES):
                state, now = plant.step(state, u)
                y.append(now - plant.y_offset)
                u = plant.u_offset
            table += list(np.transpose(y))
            header += [f"{out.name}<-{into.name}" for out in plant.outputs]
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(header)
        rows.writerows(zip(*(column.tolist() for column in table), strict=True))
        return {"responses.csv": text.getvalue()}

    def usage(self) -> str:
        """Where the table is."""
        return f"`{self.name}/responses.csv` holds the impulse responses, {SAMPLES} samples each."
