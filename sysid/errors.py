"""Everything that can go wrong, in words: the exceptions and the endings of a fit.

Every message is one sentence that says what is wrong, where, and what to do about it; what to
choose otherwise is named by its field (``argument``).
"""

from enum import Enum
from typing import ClassVar

from sysid.outside_text import visible

LONGEST_SENTENCE = 2000
"""Letters of a message; what a file or a command line adds beyond is left out of the middle."""

Columns = tuple[str, ...]
"""Columns of a log that belong together."""


class SysidError(Exception):
    """Base of all errors a user can cause; its text is shown to the user as it is.

    What it repeats of a file can neither steer the terminal nor fill it.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, sentence: str = "") -> None:
        super().__init__(_bounded(visible(sentence)))


class DataError(SysidError):
    """The data cannot serve: malformed, constant, too short, not increasing in time."""


class UnclearColumnsError(DataError):
    """Several columns can be the input or the output by their names, or none can.

    Attributes:
        inputs, outputs: groups of columns that can be them; one group where that is clear.
    """

    def __init__(
        self, sentence: str, inputs: tuple[Columns, ...], outputs: tuple[Columns, ...]
    ) -> None:
        super().__init__(sentence)
        self.inputs, self.outputs = inputs, outputs


class ModelError(SysidError):
    """A model, structure or plant cannot do what was asked of it."""


class UsageError(SysidError):
    """Wrong use: an unknown option, name or order; the exit code is 2."""

    exit_code: ClassVar[int] = 2


def _bounded(sentence: str) -> str:
    beyond = len(sentence) - LONGEST_SENTENCE
    if beyond <= 0:
        return sentence
    head, tail = sentence[: LONGEST_SENTENCE * 3 // 4], sentence[-LONGEST_SENTENCE // 4 :]
    return f"{head} … ({beyond} letters left out) … {tail}"


def argument(**fields: object) -> str:
    """Fields and their values as messages name them: `` `units={'t': 'ms'}` ``.

    A message names a field in backticks, as a script would give it; without a value the name
    alone will do, `` `ts` ``. The command line shows its own options instead.

    Args:
        fields: arguments of a function or of a class of options that a script may use.
    """
    return f"`{', '.join(f'{name}={value!r}' for name, value in fields.items())}`"


class Termination(Enum):
    """How a fit ended; each member's value is the sentence a user reads."""

    CLOSED_FORM = "The least-squares problem was solved directly; there is nothing to iterate."
    CONVERGED_COST = "Converged: the cost no longer falls (relative change below the tolerance)."
    CONVERGED_STEP = "Converged: the parameters no longer move (step below the tolerance)."
    CONVERGED_GRADIENT = "Converged: the gradient vanished, a stationary point was reached."
    NO_FREE_PARAMETERS = "Nothing was estimated: every parameter is fixed."
    MAX_ITERATIONS = (
        "Stopped at the iteration limit before converging: its numbers may still move; lower the "
        "orders or allow more iterations."
    )
    AT_BOUND = "Converged with a parameter at its bound: widen the bound or check the structure."
    DIVERGED = (
        "Diverged: no finite cost was found from any start; lower the orders or check the data."
    )

    @property
    def code(self) -> str:
        """The ending's machine-readable name, lower case with dashes."""
        return self.name.lower().replace("_", "-")

    def to_json(self) -> str:
        """Its code."""
        return self.code

    @property
    def good(self) -> bool:
        """Whether the estimate is a stationary point of the cost."""
        return self not in (Termination.MAX_ITERATIONS, Termination.DIVERGED)
