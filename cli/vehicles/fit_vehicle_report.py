"""What ``sysid fit-vehicle`` shows: numbers, and errors before and after."""

from math import floor, isfinite, log10
from typing import TYPE_CHECKING, Any

from .. import render
from ..read_as import show_decisions

if TYPE_CHECKING:
    from sysid.robot.calibration.square_runs import SquareResult
    from sysid.robot.calibration.vehicle_fit import VehicleFit


def show(fitted: "VehicleFit", document: dict[str, Any]) -> None:
    """Print the result for a person."""
    show_decisions(document["read_as"])
    identifiable = [n for n in fitted.numbers if n.identifiable]
    render.table(
        ("quantity", "value", "± standard error", "unit", "what it is"),
        [
            (n.name, _digits(n.value, n.std_error), f"{n.std_error:.2g}", n.unit, n.sentence)
            for n in identifiable
        ],
    )
    for n in fitted.numbers:
        if not n.identifiable:
            render.say(f"{n.name}: {n.sentence}")
    for a, b, r in fitted.correlations.strong():
        render.say(f"Errors of {a} and {b} are correlated ({r:.2f}).")
    _show_errors(fitted)
    if fitted.squares is not None:
        show_squares(fitted.squares)
    render.cautions(document["notes"])
    acting = fitted.acting
    render.say(f"As a vehicle without slip: r = {acting.r:.4g} m, B = {acting.B:.4g} m.")
    render.files(document, output="Vehicle", plot="Picture")


def show_squares(squares: "SquareResult") -> None:
    """Print what squares driven both ways say."""
    rows = []
    for name, centre, count in zip(("cw", "ccw"), squares.centres, squares.runs, strict=True):
        if centre is not None:
            rows.append((name, count, float(centre[0]), float(centre[1])))
    render.table(("squares", "runs", "missed x [m]", "missed y [m]"), rows)
    before, after = squares.worst
    render.say(squares.sentence)
    if after is not None:
        render.say(f"Farthest centre of the returns: {before:.3g} m, corrected {after:.3g} m.")


def _show_errors(fitted: "VehicleFit") -> None:
    steps = (fitted.before, fitted.plain, fitted.after)
    first, last = fitted.drift
    rows: list[tuple[object, ...]] = [
        ("path after two seconds [m]", *(e.path for e in steps)),
        ("heading after two seconds [rad]", *(e.heading for e in steps)),
    ]
    if first.per_metre is not None:
        rows.append(("drift for each metre [m]", first.per_metre, None, last.per_metre))
    if first.per_turn is not None:
        rows.append(("drift for each turn [rad]", first.per_turn, None, last.per_turn))
    for k, fold in enumerate(fitted.folds):
        half = ("second half by the first", "first half by the second")[k]
        rows.append((f"{half}: path [m]", fold.before.path, None, fold.after.path))
        rows.append((f"{half}: heading [rad]", fold.before.heading, None, fold.after.heading))
    windows = f"{fitted.windows[1]} held-out windows; fitted on {fitted.windows[0]}"
    render.table(
        ("mean error", "before", "plain", "after"),
        rows,
        "Paths that were not used",
        f"{windows}; {fitted.before_sentence}; plain: radius and width by linear regression.",
    )


def _digits(value: float, error: float) -> str:
    """A value to the second digit of its standard error."""
    if not (isfinite(error) and error > 0.0):
        return f"{value:.4g}"
    return f"{value:.{min(max(1 - floor(log10(error)), 0), 6)}f}"
