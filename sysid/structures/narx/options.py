"""Options of the NARX structure as users type them, and which designs belong to it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import UsageError
from sysid.structures.difference_equations.regressors import MAX_REGRESSORS, Row
from sysid.structures.difference_equations.signals import lagged_signals
from sysid.structures.narx.wavelet_network import DEGREE, KINDS, RowDesign
from sysid.structures.options import MARGIN, choice, margin, whole_number
from sysid.structures.orders import Orders

MAX_UNITS = 200
SUBSETS = ("auto", "each", "pairs", "outputs", "all")

OPTIONS: Mapping[str, str] = {
    "estimator": "kind of unit: wavelet, piecewise-constant, fourier, neural; wavelet unless given",
    "units": f"number of units of each output, 0 to {MAX_UNITS} (0: products of regressors only); "
    "chosen on the data unless given",
    "degree": f"largest degree of products of regressors, 1 to {DEGREE}; chosen on the data "
    "unless given",
    "regressors": 'expressions added to the lags, such as "|u(t-1)|, y*sign(u)" (outputs divided '
    "by ;); none unless given",
    "network": "what a unit sees: each (one regressor: the network is a sum of curves), pairs of "
    "them, outputs (past outputs and the newest inputs), all, or auto, the best on held-out data "
    "(default)",
    "refine": "samples of free run over which everything is refined: auto (default), none for "
    "one-step least squares only, or their number",
    "starts": "starts of the refinement side by side, 1 to 16; 3 unless given",
    "seed": "seed of what is drawn at random; 0 unless given",
    "margin": "how far outside the training range the free run may go, as a share of it; 0.15 "
    "unless given",
}


@dataclass(frozen=True)
class NarxOptions:
    """Options in their own types; None where the data choose.

    Attributes: as in OPTIONS; ``refine`` is None for auto and 0 for none.
    """

    estimator: str = "wavelet"
    units: int | None = None
    degree: int | None = None
    network: str = "auto"
    refine: int | None = None
    starts: int = 3
    seed: int = 0
    margin: float = MARGIN


def read(given: Mapping[str, str]) -> NarxOptions:
    """Options from text."""
    refine = 0 if given.get("refine", "").strip() == "none" else _whole(given, "refine", 2, 100_000)
    return NarxOptions(
        choice(given, "estimator", tuple(KINDS)),
        _whole(given, "units", 0, MAX_UNITS),
        _whole(given, "degree", 1, DEGREE),
        choice(given, "network", SUBSETS),
        refine,
        _whole(given, "starts", 1, 16) or 3,
        _whole(given, "seed", 0, 2**31 - 1) or 0,
        margin(given),
    )


def _whole(given: Mapping[str, str], name: str, low: int, high: int) -> int | None:
    return whole_number(given, name, low, high, "narx-wavelet")


def check_regressors(orders: Orders, customs: Sequence[Row]) -> None:
    """Refuse outputs without regressors, and more than a network can use."""
    for i in range(orders.ny):
        count = len(lagged_signals(orders, i)) + (len(customs[i]) if customs else 0)
        if count == 0:
            raise UsageError(f"`orders`: output {i + 1} has no regressor; raise na or nb")
        if count > MAX_REGRESSORS:
            raise UsageError(
                f"`orders`: output {i + 1} would have {count} regressors, at most "
                f"{MAX_REGRESSORS} are possible; lower na and nb"
            )


# ----------------------------------------------------------------------------- designs


def check_designs(rows: Sequence[Row], designs: Sequence[RowDesign]) -> None:
    """Refuse designs that do not belong to these regressors.

    Raises:
        ValueError: lengths or indices do not fit.
    """
    if designs and len(designs) != len(rows):
        raise ValueError("its designs are not those of its outputs")
    for row, d in zip(rows, designs, strict=False):
        lengths = {len(d.mean), len(d.scale), len(d.low), len(d.high)}
        inside = all(0 <= k < len(row) for t in d.terms for k in t)
        degrees = all(2 <= len(t) <= DEGREE for t in d.terms)
        projected = not d.flags or (
            len(d.projection) == len(row) and len({len(q) for q in d.projection}) == 1
        )
        if d.views:
            most = len(d.projection[0]) if d.projection else 0
            projected &= len(d.views) == len(d.flags) and len({len(v) for v in d.views}) == 1
            projected &= all(0 <= k < most for v in d.views for k in v)
        positive = all(s > 0.0 and np.isfinite(s) for s in d.scale)
        if lengths != {len(row)} or not (inside and degrees and projected and positive):
            raise ValueError("a design does not fit its regressors")
