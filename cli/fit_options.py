"""The options of ``sysid fit`` as the library takes them."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from . import reading

if TYPE_CHECKING:
    from sysid.estimation.assessment.findings import Policy
    from sysid.fitting.options import FitOptions


def structures(text: str | None) -> tuple[str, ...]:
    """``--structure arx,oe`` as names; none where the option is not given."""
    return tuple(n.strip().lower() for n in (text or "").split(",") if n.strip())


def estimation(
    focus: str,
    initial: str,
    fix: Sequence[str],
    bound: Sequence[str],
    option: Sequence[str],
    origin: Mapping[str, Any],
    max_iterations: int | None = None,
    tolerance: float | None = None,
) -> "FitOptions":
    """How to fit.

    Args:
        focus, initial: words of ``--focus`` and ``--initial``.
        fix: ``NAME=VALUE`` each.
        bound: ``NAME=LOW:HIGH`` each.
        option: ``NAME=VALUE`` each, for the structure to read.
        origin: where the data come from, stored with the model.
        max_iterations: limit of each search, None for the structure's own.
        tolerance: relative change at which a search has converged, None for the structure's own.

    Raises:
        UsageError: an option cannot be read.
    """
    from sysid.errors import UsageError
    from sysid.fitting.options import FitOptions
    from sysid.fitting.problem import Focus, Initial

    if tolerance is not None and not 0.0 < tolerance < 1.0:
        raise UsageError(f"--tolerance is a relative change between 0 and 1, got {tolerance:g}")
    return FitOptions(
        focus=Focus(reading.choice(focus, [f.value for f in Focus], "--focus")),
        initial=Initial(reading.choice(initial, [i.value for i in Initial], "--initial")),
        fixed=dict(_fixed(item) for item in fix),
        bounds=dict(_bounded(item) for item in bound),
        structure_options=dict(_pair(item, "--option", "units=20") for item in option),
        max_evaluations=max_iterations,
        tolerance=tolerance,
        extra=dict(origin),
    )


def judging(initial_state: str, skip: int, horizons: Sequence[int]) -> "Policy":
    """How figures are made.

    Raises:
        UsageError: there is no such initial state.
    """
    from sysid.estimation.assessment.figures import Start
    from sysid.estimation.assessment.findings import Policy

    start = reading.choice(initial_state, [s.value for s in Start], "--initial-state")
    return Policy(Start(start), skip, tuple(sorted(set(horizons))))


def _fixed(item: str) -> tuple[str, float]:
    name, text = _pair(item, "--fix", "a1=-0.9")
    value = _number(text, item, "--fix")
    if math.isinf(value):
        raise UsageError(f"--fix cannot hold {name} at {text!r}; give a finite number")
    return name, value


def _bounded(item: str) -> tuple[str, tuple[float, float]]:
    name, text = _pair(item, "--bound", "a1=-1:0")
    low, sign, high = text.partition(":")
    if not sign:
        raise UsageError(f"--bound cannot read {item!r}; write NAME=LOW:HIGH such as a1=-1:0")
    return name, (_number(low, item, "--bound"), _number(high, item, "--bound"))


def _pair(item: str, option: str, example: str) -> tuple[str, str]:
    name, sign, value = (part.strip() for part in item.partition("="))
    if not (name and sign and value):
        raise UsageError(f"{option} cannot read {item!r}; write it like {example}")
    return name, value


def _number(text: str, item: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise UsageError(f"{option} cannot read {item!r}: {text!r} is not a number")
    return value
