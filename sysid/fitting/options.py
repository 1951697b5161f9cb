"""Options of a fit."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from sysid.errors import UsageError
from sysid.fitting.marquardt import Method
from sysid.fitting.problem import Focus, Initial
from sysid.fitting.solvers import TOLERANCE

EVALUATIONS = 200
"""Usual limit of a search: a well-posed one ends after some twenty evaluations."""


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        focus: what is minimised.
        initial: initial states; ``AUTO`` estimates them only where that lowers the cost
            significantly, ``BACKCAST`` refits them between rounds without counting them.
        robust: Huber loss instead of the quadratic one, outliers found and left out.
        stable: admit only parameters whose free run is stable.
        fixed: values of parameters that are not estimated, by name.
        bounds: (lower, upper) by name.
        max_evaluations: limit of each search; None for what is usual with the structure.
        tolerance: relative change of cost and step at which a search has converged; None for
            what is usual with the structure.
        patience: evaluations without such a change after which it is given up, None for never.
        method: iterations of the search: Levenberg-Marquardt, Gauss-Newton or gradient; or another
            way than prediction errors of the log as it is (``Method``).
        structure_options: options of the structure itself, as text.
        extra: facts to keep in the model's provenance (how the files were read …).

    Raises:
        UsageError: there is no such focus, initial state or method.
    """

    focus: Focus = Focus.PREDICTION
    initial: Initial = Initial.AUTO
    robust: bool = False
    stable: bool = False
    fixed: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    max_evaluations: int | None = None
    tolerance: float | None = None
    patience: int | None = None
    method: Method = Method.LEVENBERG_MARQUARDT
    structure_options: Mapping[str, str] = field(default_factory=dict)
    extra: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, kind in (("focus", Focus), ("initial", Initial), ("method", Method)):
            given = getattr(self, name)
            try:  # a script may give a member by its value
                object.__setattr__(self, name, kind(given))
            except ValueError:
                known = ", ".join(str(m.value) for m in kind)
                raise UsageError(f"`{name}` is one of {known}, got {given!r}") from None

    def limit(self, default: int = EVALUATIONS) -> int:
        """Evaluations of a search: what was asked for, else what is usual there."""
        return default if self.max_evaluations is None else self.max_evaluations

    def precision(self, default: float = TOLERANCE) -> float:
        """Tolerance of a search: what was asked for, else what is usual there."""
        return default if self.tolerance is None else self.tolerance
