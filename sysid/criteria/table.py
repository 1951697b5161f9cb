"""The table of criteria: name → meaning, formula, and how two values compare.

With V = det(EᵀE/N) of one-step errors, N samples, n parameters (estimated initial states count, the
noise variance does not) and ny outputs:

    AIC  = N ln V + 2n + N ny (ln 2π + 1)          AICc = AIC + 2n(n+1)/(N−n−1)
    nAIC = ln V + 2n/N                             BIC  = N ln V + N ny (ln 2π + 1) + n ln N
    MDL  = V (1 + n ln N / N)                      FPE  = V (1 + n/N) / (1 − n/N)

Other packages add theirs under the entry-point group ``sysid.criteria``: the name of the entry
point is the criterion's, what it points to is a :class:`Criterion`. They are imported when they
are needed.

Sources: Akaike (1969, 1974), Hurvich & Tsai (1989), Schwarz (1978), Rissanen (1978), Ljung (1999)
§16.4; thesis (3.39)–(3.41) with the bracket of (3.39) balanced.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from sysid.errors import DataError, UsageError
from sysid.extensions import loaded, points, unusable

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "sysid.criteria"
"""Entry-point group of criteria of other packages."""


@dataclass(frozen=True)
class Loss:
    """The loss of one-step errors and what it is weighed against.

    Attributes:
        log: ln V, V = det(EᵀE/N); −inf for a perfect fit, inf for a model that ran away.
        samples: N, samples that were predicted.
        parameters: n, numbers estimated from the data, initial states included.
        outputs: ny.

    Raises:
        DataError: N < 1, n < 0 or ny < 1.
    """

    log: float
    samples: int
    parameters: int
    outputs: int = 1

    def __post_init__(self) -> None:
        N, n, ny = self.samples, self.parameters, self.outputs
        if N < 1 or n < 0 or ny < 1:
            raise DataError(f"criteria need N ≥ 1, n ≥ 0 and ny ≥ 1, got N={N}, n={n}, ny={ny}")

    @property
    def value(self) -> float:
        """V, inf where it is too large for a number."""
        try:
            return math.exp(self.log)
        except OverflowError:
            return math.inf

    @property
    def deviance(self) -> float:
        """−2 ln L of Gaussian errors: N ln V + N ny (ln 2π + 1)."""
        constant = math.log(2.0 * math.pi) + 1.0
        return self.samples * self.log + self.samples * self.outputs * constant


Ratio = Callable[[float, float, int, int], float]
"""(value, best, N, ny) → how many times the RMS error, V^(1/2ny), is that of the best one."""


def ratio_of_deviances(value: float, best: float, samples: int, outputs: int) -> float:
    """For N ln V plus a penalty."""
    return _exp((value - best) / max(samples, 1) / (2.0 * outputs))


def ratio_of_logarithms(value: float, best: float, samples: int, outputs: int) -> float:
    """For ln V plus a penalty."""
    return _exp((value - best) / (2.0 * outputs))


def ratio_of_losses(value: float, best: float, samples: int, outputs: int) -> float:
    """For V times a penalty."""
    return float((value / max(best, _TINY)) ** (1.0 / (2.0 * outputs)))


def ratio_of_errors(value: float, best: float, samples: int, outputs: int) -> float:
    """For an RMS error itself."""
    return value / max(best, _TINY)


def ratio_of_percentages(value: float, best: float, samples: int, outputs: int) -> float:
    """For 100 % less an RMS error."""
    return (100.0 - value) / max(100.0 - best, 1e-12)


_TINY = 1e-300
"""A loss of nothing counts as this: a ratio to zero says nothing."""


def _exp(x: float) -> float:
    return math.exp(x) if x < 700.0 else math.inf  # e^709 is the largest number


@dataclass(frozen=True)
class Criterion:
    """One way to say which of several models is best.

    Attributes:
        sentence: what it says and when to use it, in one sentence.
        ratio: how many times larger the errors are behind one value than behind the best one;
            models whose errors differ by no more than chance count as equal.
        value: the criterion of a loss; None for the figures of the free run (``fit``, ``rmse``),
            which are taken on held-out data.
    """

    sentence: str
    ratio: Ratio = ratio_of_deviances
    value: Callable[[Loss], float] | None = None
    smaller_is_better: bool = True

    @property
    def of_free_run(self) -> bool:
        """Whether it is a figure of the free run, not of one-step errors and size."""
        return self.value is None

    def cost(self, value: float) -> float:
        """A value as what is to be made small."""
        return value if self.smaller_is_better else -value

    def cost_of(self, loss: Loss) -> float:
        """What a loss costs: the smallest is best. A figure of the free run has none (NaN)."""
        return math.nan if self.value is None else self.cost(float(self.value(loss)))


def _aic(loss: Loss) -> float:
    return loss.deviance + 2.0 * loss.parameters


def _aicc(loss: Loss) -> float:
    n, room = loss.parameters, loss.samples - loss.parameters - 1
    return _aic(loss) + 2.0 * n * (n + 1) / room if room > 0 else math.inf


def _bic(loss: Loss) -> float:
    return loss.deviance + loss.parameters * math.log(loss.samples)


def _mdl(loss: Loss) -> float:
    return loss.value * (1.0 + loss.parameters * math.log(loss.samples) / loss.samples)


def _fpe(loss: Loss) -> float:
    share = loss.parameters / loss.samples
    return loss.value * (1.0 + share) / (1.0 - share) if share < 1.0 else math.inf


BUILT_IN: Mapping[str, Criterion] = MappingProxyType(
    {
        "aic": Criterion("Akaike: expected information lost; favours good prediction.", value=_aic),
        "aicc": Criterion("Akaike corrected for short records; use when N < 40 n.", value=_aicc),
        "naic": Criterion(
            "Akaike per sample, without its constant; ranks like AIC.",
            ratio_of_logarithms,
            lambda loss: loss.log + 2.0 * loss.parameters / loss.samples,
        ),
        "bic": Criterion(
            "Schwarz: penalises size more; finds the true order as N grows.", value=_bic
        ),
        "mdl": Criterion(
            "Rissanen: shortest description; ranks nearly like BIC.", ratio_of_losses, _mdl
        ),
        "fpe": Criterion(
            "Akaike's final prediction error: expected loss on new data.", ratio_of_losses, _fpe
        ),
        "loss": Criterion(
            "Loss V = det(EᵀE/N); never rises with size, so it overfits.",
            ratio_of_losses,
            lambda loss: loss.value,
        ),
        "fit": Criterion(
            "Fit percent 100(1 − ‖y−ŷ‖/‖y−ȳ‖); use held-out data.",
            ratio_of_percentages,
            smaller_is_better=False,
        ),
        "rmse": Criterion("Root mean squared error; use held-out data.", ratio_of_errors),
    }
)
"""Name → criterion. Those with a loss are better when smaller; a perfect fit has loss, mdl and fpe
0 and the others −inf. With no more samples than parameters (N ≤ n) fpe is inf, with N ≤ n + 1 aicc:
such a model cannot be preferred."""


def names() -> tuple[str, ...]:
    """Names of all criteria that can be asked for; nothing is imported for it."""
    return (*BUILT_IN, *_others())


def criterion(name: str) -> Criterion:
    """The criterion of this name (case does not matter).

    Raises:
        UsageError: there is none of that name, or its package cannot be used.
    """
    key = name.lower()
    if key in BUILT_IN:
        return BUILT_IN[key]
    if key not in _others():
        raise UsageError(f"no criterion {name!r}; choose one of {', '.join(names())}")
    return _loaded(key)


def known_name(name: str) -> str:
    """The name of a criterion as the table has it.

    Raises:
        UsageError: there is none of that name, or its package cannot be used.
    """
    criterion(name)
    return name.lower()


def weighed(loss: Loss) -> dict[str, float]:
    """Every criterion of a loss by name, those of other packages too.

    Raises:
        UsageError: a package that is installed offers a criterion that cannot be used, or fails.
    """
    table = {name: criterion(name) for name in names()}
    return {name: _value(name, c, loss) for name, c in table.items() if c.value is not None}


def _value(name: str, criterion: Criterion, loss: Loss) -> float:
    assert criterion.value is not None
    if name in BUILT_IN:
        return float(criterion.value(loss))
    try:
        return float(criterion.value(loss))
    except Exception as error:  # whatever a foreign function does
        raise unusable(_others()[name], "criterion", f"fails ({error})") from None


@cache
def _others() -> "Mapping[str, EntryPoint]":
    """Entry points of other packages; those that come with the workbench cannot be replaced."""
    entry_points = {name.lower(): point for name, point in points(GROUP).items()}
    return {name: point for name, point in entry_points.items() if name not in BUILT_IN}


@cache
def _loaded(name: str) -> Criterion:
    criterion = loaded(_others()[name], "criterion")
    if not isinstance(criterion, Criterion) or criterion.value is None:
        raise unusable(
            _others()[name], "criterion", "is not a Criterion with a function of the loss"
        )
    return criterion
