"""The step of a model as C: recorded from the structure's ``step``, or the structure's own."""

from typing import Any

from sysid.errors import ModelError
from sysid.export.c.program import Program, assigned
from sysid.export.c.traced import Traced, cells_of
from sysid.structures.c_step import CStep
from sysid.structures.model import Model

WORDS = (
    "x holds the states, v the inputs as deviations from the operating point. The lines below are",
    "the equations of the model as sysid computes them, recorded: its constants are numbers here.",
)

UNWRITABLE = (ArithmeticError, AttributeError, LookupError, ModelError, TypeError, ValueError)
"""What a step raises that does with recording arrays what only numbers can do."""


def c_step(model: Model) -> CStep:
    """One step of a model as C.

    Raises:
        ModelError: the structure's equations use what cannot be written as C.
    """
    structure = model.structure
    try:
        own = structure.c_step(model.theta)
        return _recorded(model) if own is None else own
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        ModelError,
        TypeError,
        ValueError,
    ) as error:
        # NumPy says that a signal is no number, its cause says what to write instead
        raise _refused(model, str(error.__cause__ or error)) from None


def _recorded(model: Model) -> CStep:
    structure = model.structure
    n, ny = structure.n_states(model.theta), len(model.outputs)
    program = Program()
    x: Any = Traced(program.inputs("x", n))
    v: Any = Traced(program.inputs("v", len(model.inputs)))
    after, y = map(cells_of, structure.step(model.theta)(x, v))
    if (after.shape, y.shape) != ((n,), (ny,)):
        raise ValueError(
            f"a step gives states {after.shape} and outputs {y.shape} where ({n},) and ({ny},) are "
            "expected"
        )
    moved, out = after.tolist(), y.tolist()
    lines = [
        *program.lines([*moved, *out]),
        *assigned("out", out, operator="+="),
        *assigned("x", moved),
    ]
    return CStep(
        n, WORDS, tuple(f"    {line}" for line in lines), tuple(program.support("\n".join(lines)))
    )


def _refused(model: Model, why: str) -> ModelError:
    """The error that says why a model has no C code, and what to run instead."""
    return ModelError(
        f"this {model.structure.name} model cannot be written as C: {why}; run its plant.json "
        "with sysid"
    )
