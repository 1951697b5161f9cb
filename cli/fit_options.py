"""Options of fitting and validation, as the library takes them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from .options import changed, in_panel, one_of, pairs

if TYPE_CHECKING:
    from sysid.estimation.assessment.findings import Policy
    from sysid.fitting.options import FitOptions

fitting_option, judging_option = in_panel("Fitting"), in_panel("Judging")
_fitting_more = in_panel("Fitting", advanced=True)
_judging_more = in_panel("Judging", advanced=True)

STRUCTURES = fitting_option(
    "NAME",
    "Structures, e.g. oe,narmax, or a file of equations my.ode.yaml [by the data].",
    "-s",
    "--structure",
)
_INITIAL = _judging_more(
    "HOW",
    "Initial states: auto, zero or estimated; backcast in the fit, measured in the free run.",
    default="auto",
    parse=str.lower,
)
_OF_FIT, _OF_FREE_RUN = "backcast", "measured"
"""Initial states that only one of the two can have."""


def criterion(help: str) -> Any:
    """The option that names the one criterion of a ranking."""
    return fitting_option("NAME", help, "-c", "--criterion", default="fit")


def validation(help: str) -> Any:
    """The option for logs that judge."""
    return judging_option("LOG", help, "-v", "--val")


def names(text: str | None) -> tuple[str, ...]:
    """``--structure arx,my.ode.yaml`` as names and files; none where the option is not given."""
    given = (n.strip() for n in (text or "").split(",") if n.strip())
    return tuple(n if n.endswith((".yaml", ".yml")) else n.lower() for n in given)


def _number(text: str) -> float:
    value = float(text)
    if math.isnan(value):
        raise ValueError
    return value


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def _bounds(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    return _number(low), _number(high)


def _read(option: str, advice: str, read: Callable[[str], Any], sep: str | None = ",") -> Any:
    return partial(pairs, option=option, advice=advice, read=read, sep=sep)


def _tolerance(value: float) -> float:
    if not 0.0 < value < 1.0:
        raise UsageError(f"--tolerance is a relative change between 0 and 1, got {value:g}")
    return value


@dataclass(frozen=True)
class Fitting:
    """How to fit: the library's ``FitOptions`` as a line gives them."""

    focus: str = _fitting_more(
        "WHAT", "Minimise prediction or simulation errors.", default="prediction", parse=str.lower
    )
    initial: str = _INITIAL
    fixed: list[str] | None = _fitting_more(
        "NAME=VALUE",
        "Fix a parameter at a value, e.g. a1=-0.9.",
        "--fix",
        parse=_read("--fix", "NAME=VALUE with a finite number, such as a1=-0.9", _finite),
    )
    bounds: list[str] | None = _fitting_more(
        "NAME=LOW:HIGH",
        "Keep a parameter between bounds, e.g. a1=-1:0.",
        "--bound",
        parse=_read("--bound", "NAME=LOW:HIGH such as a1=-1:0", _bounds),
    )
    structure_options: list[str] | None = _fitting_more(
        "NAME=VALUE",
        "Option of the structure; `sysid structures NAME` lists them.",
        "--option",
        parse=_read("--option", "it like units=20", str, sep=None),
    )
    robust: bool = fitting_option(None, "Detect outliers and leave them out.", default=False)
    stable: bool = _fitting_more(None, "Restrict the search to stable models.", default=False)
    method: str = _fitting_more(
        "NAME",
        "Search direction: levenberg-marquardt, gauss-newton or gradient; instrumental variables: "
        "iv4 (arx), sriv (oe, tf); inputs without feedback, linear: two-stage, joint.",
        default="levenberg-marquardt",
        parse=str.lower,
    )
    max_evaluations: int | None = _fitting_more(
        "N", "Most iterations from one start; 200 for most structures.", "--max-iterations", min=1
    )
    tolerance: float | None = _fitting_more(
        "X", "Relative change of cost and step at convergence, e.g. 1e-9.", parse=_tolerance
    )

    def made(self) -> "FitOptions":
        """As the library takes them."""
        from sysid.fitting.options import FitOptions

        given = changed(self)
        if self.initial == _OF_FREE_RUN:
            del given["initial"]
        return FitOptions(**given)


@dataclass(frozen=True)
class Judging:
    """How figures are made: the library's ``Policy`` as a line gives it."""

    initial: str = _INITIAL
    skip: int = _judging_more(
        "N", "Leave the first N samples out of the error figures.", default=0, min=0
    )
    horizons: list[int] | None = _judging_more(
        "K", "Also show the K-step prediction; repeatable.", "--horizon", min=2
    )

    def made(self) -> "Policy":
        """As the library takes it."""
        from sysid.estimation.assessment.figures import Start
        from sysid.estimation.assessment.findings import Policy

        estimated = self.initial in ("auto", _OF_FIT)
        chosen = Start.ESTIMATED.value if estimated else self.initial
        one_of(chosen, [s.value for s in Start], "--initial")
        return Policy(Start(chosen), self.skip, tuple(sorted(set(self.horizons or []))))
