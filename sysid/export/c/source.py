"""The plant as C99: one step function with a state struct, and a self-test."""

import re

import numpy as np

from sysid.export.c.fields import places
from sysid.export.c.step import PlantStep, c_step
from sysid.export.templates import fill
from sysid.plant.selftest import TOLERANCE, SelfTest
from sysid.structures.model import Model

_MATHEMATICAL = re.compile(r"\b(HUGE_VAL|NAN|[a-z]\w*\()")
"""What needs math.h: infinity, and calls of functions."""


def c_sources(
    model: Model, test: SelfTest, name: str = "", tolerance: float = TOLERANCE
) -> dict[str, str]:
    """:func:`plant_sources` of a model's step."""
    return plant_sources(model, c_step(model), test, name, tolerance)


def plant_sources(
    model: Model, written: PlantStep, test: SelfTest, name: str, tolerance: float
) -> dict[str, str]:
    """``plant.h``, ``plant.c`` and ``selftest.c`` of a model.

    The code computes what the structure's ``step`` computes, in double precision, so that it
    agrees with Python to rounding.

    Args:
        test: the rows ``selftest.c`` checks.
        name: what to call the plant; the structure's title where that is empty.
        tolerance: error that ``selftest.c`` allows, in parts of the range of each output.
    """

    def used(word: str) -> bool:
        texts = written.body if word in ("x", "v") else lines
        return any(re.search(rf"\b{word}\b", line) for line in texts)

    lines = (*written.entering, *written.starting, *written.body)
    code = "\n".join((*written.support, *written.body, *written.following))
    values = [v for _, v in places(written.parameters)]
    common = {
        "title": f"{name}: {model.structure.traits.title}"
        if name
        else model.structure.traits.title,
        "model": model,
        "step": written,
    }
    return {
        "plant.h": fill("c/plant.h", **common),
        "plant.c": fill(
            "c/plant.c",
            **common,
            needs_math=_MATHEMATICAL.search(code) or not np.all(np.isfinite(values)),
            lines=lines,
            used=used,
        ),
        "selftest.c": fill(
            "c/selftest.c",
            **common,
            rows=np.column_stack([test.u, test.y]),
            scale=test.scale(),
            tolerance=tolerance,
        ),
    }
