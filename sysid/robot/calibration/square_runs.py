"""Radii and width from squares driven both ways (Borenstein & Feng 1996).

A vehicle whose odometry is wrong comes back to another place than the one it left. Unequal wheels
bend the sides of a square, a wrong width changes its corners; driven one way the two errors add up,
driven the other way they differ, so squares both ways distinguish them:

    E_d = D_right / D_left,    E_b = B_actual / B_nominal
"""

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.files import read_bytes
from sysid.data.record import Array
from sysid.errors import DataError
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.fitting.differences import slopes
from sysid.vehicle.kinematics import Geometry, chained_arcs

TURNS_ALIKE = 0.03
"""Share of the larger singular value of the returns' Jacobian below which the smaller one
determines nothing: squares one way move along one line whatever is wrong."""


@dataclass(frozen=True, eq=False)
class SquareRun:
    """One closed square.

    Attributes:
        side: length of a side [m].
        predicted: (E_d, E_b) → what ``found`` would be, (2,) [m].
        found: where the run ended, or by how much it missed its start, (2,) [m].
    """

    clockwise: bool
    side: float
    predicted: Callable[[float, float], Array]
    found: Array

    @cached_property
    def missed(self) -> Array:
        """Where it ended less where the odometry as it is said so, (2,) [m]."""
        return np.asarray(self.found - self.predicted(1.0, 1.0))


@dataclass(frozen=True, eq=False)
class SquareResult:
    """Errors from closed squares.

    Attributes:
        wheel_ratio, width_ratio: E_d and E_b with their standard errors; None where the squares do
            not determine them (one direction only), an error of None where too few runs show a
            scatter.
        runs: how many clockwise and counter-clockwise.
        side: mean length of a side [m].
        centres: mean of what was missed, clockwise and counter-clockwise, (2,) [m] each; None
            where there are none.
        worst: larger distance of the two centres from the start, before and after [m].
    """

    wheel_ratio: tuple[float, float | None] | None
    width_ratio: tuple[float, float | None] | None
    runs: tuple[int, int]
    side: float
    centres: tuple[Array | None, Array | None]
    worst: tuple[float, float | None]
    sentence: str

    def to_json(self) -> dict[str, Any]:
        def number(pair: tuple[float, float | None] | None) -> dict[str, float | None] | None:
            return None if pair is None else {"value": pair[0], "std_error": pair[1]}

        cw, ccw = self.centres
        return {
            "E_d": number(self.wheel_ratio),
            "E_b": number(self.width_ratio),
            "runs": {"cw": self.runs[0], "ccw": self.runs[1]},
            "side_m": self.side,
            "centre_m": {
                "cw": None if cw is None else cw.tolist(),
                "ccw": None if ccw is None else ccw.tolist(),
            },
            "worst_m": {"before": self.worst[0], "after": self.worst[1]},
            "sentence": self.sentence,
        }


def scales(wheel_ratio: float) -> tuple[float, float]:
    """Factors on the left and the right radius that keep their mean.

    c_L = 2/(E_d + 1),  c_R = 2/(1/E_d + 1)     (Borenstein & Feng 1996, eqs. 5.13 and 5.14)
    """
    return 2.0 / (wheel_ratio + 1.0), 2.0 / (1.0 / wheel_ratio + 1.0)


def ideal_return(
    wheel_ratio: float, width_ratio: float, side: float, width: float, clockwise: bool
) -> Array:
    """Where a vehicle ends whose odometry says that it drove a square back to its start, (2,) [m].

    Sides along x first; every corner is a turn on the spot.

    Args:
        wheel_ratio, width_ratio: E_d and E_b.
        side: of the square by the odometry [m].
        width: nominal distance of the wheels [m].
    """
    arc = 0.25 * math.pi * width * (-1.0 if clockwise else 1.0)
    rolled = np.array([(side, side), (-arc, arc)] * 4) * scales(wheel_ratio)
    turn = np.diff(rolled, axis=1)[:, 0] / (width_ratio * width)
    return chained_arcs(rolled.mean(axis=1), turn)[-1, :2]


def returned(
    clockwise: Sequence[bool], missed: Sequence[Sequence[float]], side: float, geometry: Geometry
) -> tuple[SquareRun, ...]:
    """Runs of which only the return was measured.

    Args:
        missed: measured end less the end by odometry, x along the first side, (n, 2) [m].
        side: of the square [m].
    """
    if not (math.isfinite(side) and side > 0.0):
        raise DataError(f"the side of the squares is {side:g} m; give a length above 0")
    return tuple(
        SquareRun(
            cw,
            side,
            lambda d, b, cw=cw: ideal_return(d, b, side, geometry.B, cw),  # type: ignore[misc]
            np.asarray(m, dtype=np.float64),
        )
        for cw, m in zip(clockwise, missed, strict=True)
    )


def read_returns(path: Path, side: float, geometry: Geometry) -> tuple[SquareRun, ...]:
    """Runs from a table with the columns ``direction`` (cw or ccw), ``x`` and ``y`` [m].

    Args:
        path: CSV; x and y are where the vehicle ended less where its odometry says it did, x along
            the first side.
        side: of the square [m].
    """
    text = read_bytes(path).decode("utf-8-sig", "replace")
    try:
        rows = list(csv.DictReader(text.splitlines()))
    except csv.Error as error:
        raise DataError(f"{path.name} is not a CSV table ({error}); write it again") from None
    lacking = [n for n in ("direction", "x", "y") if not rows or n not in rows[0]]
    if lacking:
        raise DataError(
            f"{path.name} has no column {lacking[0]}; a table of returns has direction (cw or "
            "ccw), x and y [m], a row a run"
        )
    ways, missed = [], []
    for line, row in enumerate(rows, start=2):
        way = (row["direction"] or "").strip().lower()
        try:
            missed.append([float(row["x"]), float(row["y"])])
        except (TypeError, ValueError):
            way = ""
        if way not in ("cw", "ccw") or not np.isfinite(missed[-1]).all():
            raise DataError(f"{path.name}, line {line}: write cw or ccw and two numbers in metres")
        ways.append(way == "cw")
    return returned(ways, missed, side, geometry)


def square_result(runs: Sequence[SquareRun]) -> SquareResult:
    """E_d and E_b with standard errors from the scatter of the returns.

    Args:
        runs: closed squares; both ways, or the two cannot be distinguished.
    """
    if not runs:
        raise DataError("the runs contain no closed square; drive squares both ways")
    groups = [[r for r in runs if r.clockwise is cw] for cw in (True, False)]
    counts = (len(groups[0]), len(groups[1]))
    means = [np.mean([r.missed for r in g], axis=0) if g else None for g in groups]
    worst = max(float(np.linalg.norm(m)) for m in means if m is not None)
    plain = SquareResult(
        None,
        None,
        counts,
        float(np.mean([r.side for r in runs])),
        (means[0], means[1]),
        (worst, None),
        "",
    )
    if 0 in counts:
        way = "clockwise" if counts[0] else "counter-clockwise"
        other = "counter-clockwise" if counts[0] else "clockwise"
        text = (
            f"All {len(runs)} squares were driven {way}, where unequal wheels and a wrong width "
            f"cannot be distinguished; drive some {other}."
        )
        return replace(plain, sentence=text)
    return _solved(plain, groups)


def _solved(plain: SquareResult, groups: list[list[SquareRun]]) -> SquareResult:
    """Least squares on the mean returns of both directions, each weighed alike."""
    from scipy.optimize import least_squares

    measured = np.concatenate([np.mean([r.found for r in g], axis=0) for g in groups])

    def predicted(p: Array) -> Array:
        return np.concatenate(
            [np.mean([r.predicted(*p.tolist()) for r in g], axis=0) for g in groups]
        )

    def away(p: Array) -> Array:
        return np.asarray(predicted(p) - measured)

    def jacobian(p: Array) -> Array:
        return slopes(predicted, p, np.full(2, 1e-5))

    p: Array = least_squares(away, np.ones(2), jacobian, (0.1, np.inf), xtol=1e-12).x
    J = jacobian(p)
    size = np.linalg.svd(J, compute_uv=False)
    if size[1] < TURNS_ALIKE * size[0]:
        text = "Both errors move the returns along one line, so neither can be determined."
        return replace(plain, sentence=text)
    errors = _std_errors(np.asarray(np.linalg.pinv(J), dtype=np.float64), groups)
    residual = (measured - predicted(p)).reshape(2, 2)
    after = float(np.linalg.norm(residual, axis=1).max())
    cw, ccw = plain.runs
    said = f"{cw} clockwise and {ccw} counter-clockwise squares of {plain.side:.3g} m"
    shown = ["" if e is None else f" ± {NORMAL * e:.1g}" for e in errors]
    text = (
        f"From {said}: the right wheel is {p[0]:.5g}{shown[0]} times the left one (E_d), and the "
        f"vehicle turns as if it were {p[1]:.5g}{shown[1]} times as wide as given (E_b)."
    )
    if errors[0] is None:
        text += " One run per direction gives no standard errors; drive at least two."
    return replace(
        plain,
        wheel_ratio=(float(p[0]), errors[0]),
        width_ratio=(float(p[1]), errors[1]),
        worst=(plain.worst[0], after),
        sentence=text,
    )


def _std_errors(solve: Array, groups: list[list[SquareRun]]) -> tuple[float | None, float | None]:
    """From the scatter of the runs about the mean of their direction, pooled over both."""
    freedom = sum(len(g) - 1 for g in groups)
    if freedom < 1:
        return None, None
    missed = [np.array([r.missed for r in g]) for g in groups]
    apart = np.concatenate([m - m.mean(axis=0) for m in missed])
    scatter = apart.T @ apart / freedom
    covariance = np.kron(np.diag([1.0 / len(g) for g in groups]), scatter)
    errors = np.sqrt(np.diag(solve @ covariance @ solve.T))
    return float(errors[0]), float(errors[1])
