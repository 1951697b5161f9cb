"""C code that a structure gives for its step, where it is not recorded from ``step``."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CStep:
    """One step of a model as C99.

    The body finds the inputs as deviations from the operating point in ``v[]``, the states in
    ``x[]`` (zero at rest), and adds the outputs to ``out[]``; then it advances ``x[]``. The names
    ``state``, ``u`` and ``y`` are taken.

    Attributes:
        words: lines of the comment at the head of the file: how the code works.
        body: lines between reading the inputs and writing the outputs.
        support: constant tables and functions that the body needs.
    """

    n_states: int
    words: tuple[str, ...]
    body: tuple[str, ...]
    support: tuple[str, ...] = ()
