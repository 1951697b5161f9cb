"""The slipping vehicle as estimated: numbers, what they are worth, and how they are shown."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.robot.calibration.geometry import SURE
from sysid.robot.calibration.numbers import Correlations, VehicleNumber, capital, derived
from sysid.robot.calibration.slip_model import AT, TERMS, Motion, Term
from sysid.vehicle.kinematics import Geometry

IDENTIFIABLE_SHARE = 0.1
"""A parameter is identifiable if less than this share of its prior uncertainty remains."""

ALIKE = 0.9
"""Numbers whose effects have such a cosine are one number to a log: a fifth of the noise would do
to change one for the other."""

INVERSE = {"effective_width": "effective_width"}
"""Numbers of the model that are one over what is shown."""


@dataclass(frozen=True, eq=False)
class SlipFit(Motion):
    """Numbers found, and what they are worth: a vehicle that slips about centres of rotation that
    its sides keep.

    Attributes:
        q: every number, in the order of ``TERMS``; lengths relative to those of ``geometry``.
        geometry: lengths that q multiplies.
        free: which of them are in the model.
        covariance: of all numbers; those that are not in the model as if each was added to it.
        if_added: what each number would be if it was added to the model; q for those that are in
            it.
        typical: typical errors of the increments, (3,) [m, m, rad].
        prior: what one would guess each number may be off by without a log.
        likeness: cosine of what every two optional numbers do to the increments beyond what all
            others can do, (n, n); 0 for the others.
    """

    q: Array
    geometry: Geometry
    free: tuple[int, ...]
    covariance: Array
    if_added: Array
    typical: Array
    prior: Array
    likeness: Array

    @property
    def std_errors(self) -> Array:
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def identifiable(self) -> tuple[bool, ...]:
        sure = self.std_errors < IDENTIFIABLE_SHARE * self.prior
        return tuple(bool(sure[k]) or (t.optional and k in self.free) for k, t in enumerate(TERMS))

    @property
    def terms(self) -> tuple[str, ...]:
        return tuple(TERMS[k].name for k in self.free if TERMS[k].optional)

    def like(self, k: int) -> tuple[int, ...]:
        """Optional numbers that would do nearly the same as this one on these logs."""
        row = np.abs(self.likeness[k])
        return tuple(j for j in range(len(TERMS)) if j != k and row[j] > ALIKE)

    def correlations(self) -> Correlations:
        free = list(self.free)
        covariance = self.covariance[np.ix_(free, free)]
        return Correlations.of([TERMS[k].name for k in free], covariance, INVERSE)

    def numbers(self, given: Geometry | None) -> tuple[VehicleNumber, ...]:
        """Every quantity, with the reason where it is not identifiable.

        Args:
            given: lengths that a person gave; None for none.
        """
        identifiable = dict(zip(AT, self.identifiable, strict=True))

        def follow(q: Array) -> Mapping[str, float]:
            more = {} if given is None else ratios(q, self.geometry, given)
            return {**centres(q, self.geometry), **more}

        outside = [k for k in range(len(TERMS)) if k not in self.free]
        joint = self.covariance.copy()
        joint[outside, outside] = 0.0  # the model goes without them
        numbers = [_number(self, k, t) for k, t in enumerate(TERMS)]
        for name, (value, error) in derived(follow, self.q, joint, 1e-4 * self.prior).items():
            unit, meaning, sources = _DERIVED[name]
            missing = " and ".join(n for n in sources if not identifiable[n])
            sentence = f"{capital(meaning)}."
            if missing:
                sentence = f"{name} is not identifiable from this log, because {missing} is not."
            numbers.append(VehicleNumber(name, value, error, unit, not missing, sentence))
        return tuple(numbers)

    def shares(self) -> dict[str, dict[str, Any]] | None:
        """The vehicle and its slip i = slip + turning |ω_R − ω_L|/(|ω_L| + |ω_R|) as sections of a
        mission; None where both sides roll alike and lose nothing in turns."""
        n = in_units(self.q, self.geometry)
        left, right, turning = n["radius_left"], n["radius_right"], n["slip_turning"]
        apart = abs(left - right) / self.geometry.r
        unlike = apart > SURE * float(np.hypot(*self.std_errors[:2]))
        if not (unlike or turning):
            return None
        mean = 0.5 * (left + right)
        motion: dict[str, Any] = {"kind": "slip"}
        if unlike:
            motion["slip"] = [1.0 - left / mean, 1.0 - right / mean]
        if turning > 0.0:
            motion["turning"] = min(turning, 0.9)
        return {"vehicle": {"r": mean, "B": n["effective_width"]}, "motion": motion}


def in_units(q: Array, geometry: Geometry) -> dict[str, float]:
    """Every number of the model in its unit, by name.

    Args:
        q: every number, radii and 1/width relative to the geometry's.
        geometry: lengths that q multiplies.
    """
    values = {t.name: float(v) for t, v in zip(TERMS, q, strict=True)}
    values["radius_left"] *= geometry.r
    values["radius_right"] *= geometry.r
    values["effective_width"] = geometry.B / values["effective_width"]
    return values


def centres(q: Array, geometry: Geometry) -> dict[str, float]:
    """Where the two sides' instantaneous centres of rotation lie from the point of the pose [m].

    Each side moves on the ground as if it turned about a point of its own beside the vehicle
    (Martínez et al. 2005): icr_x ahead of the point of the pose, icr_y to its left.
    """
    n = in_units(q, geometry)
    half = 0.5 * n["effective_width"]
    return {
        "icr_x": -n["marker_x"],
        "icr_y_left": half - n["marker_y"],
        "icr_y_right": -half - n["marker_y"],
    }


def ratios(q: Array, start: Geometry, given: Geometry) -> dict[str, float]:
    """What the lengths that act are in units of those that were given."""
    n = in_units(q, start)
    mean = 0.5 * (n["radius_left"] + n["radius_right"])
    width = n["effective_width"] / given.B
    return {
        "alpha_left": n["radius_left"] / given.r,
        "alpha_right": n["radius_right"] / given.r,
        "width_ratio": width,
        "turning_ratio": width * given.r / mean / max(1.0 - n["slip_turning"], 1e-3),
    }


_BESIDE = "distance of the {} side's centre of rotation to the left of that point"
_SIDES = ("effective_width", "marker_y")

_DERIVED: Mapping[str, tuple[str, str, tuple[str, ...]]] = {
    "icr_x": ("m", "distance of the axis of rotation ahead of the pose's point", ("marker_x",)),
    "icr_y_left": ("m", _BESIDE.format("left"), _SIDES),
    "icr_y_right": ("m", _BESIDE.format("right"), _SIDES),
    "alpha_left": ("1", "the left side's effective radius over the one given", ("radius_left",)),
    "alpha_right": ("1", "the right side's effective radius over the one given", ("radius_right",)),
    "width_ratio": ("1", "the effective width over the one given", ("effective_width",)),
    "turning_ratio": (
        "1",
        "wheel travel in a turn on the spot over that of the given lengths",
        ("effective_width", "radius_left", "radius_right"),
    ),
}
"""Unit, meaning, and the parameters that each quantity is derived from; it is identifiable if these
are."""


def _number(fit: SlipFit, k: int, term: Term) -> VehicleNumber:
    error, identifiable = float(fit.std_errors[k]), fit.identifiable[k]
    value = in_units(fit.if_added, fit.geometry)[term.name]
    if term.name in ("radius_left", "radius_right"):
        error *= fit.geometry.r
    elif term.name == "effective_width":
        error *= value / float(fit.if_added[k])
    amount = f"{value:.2g} ± {NORMAL * error:.2g}" + ("" if term.unit == "1" else f" {term.unit}")
    like = " and ".join(TERMS[j].name for j in fit.like(k))
    also = f" On this log {like} has nearly the same effect." if like else ""
    sentence = f"{capital(term.meaning)}.{also}"
    if not identifiable:
        kept = 100 * min(float(fit.std_errors[k] / fit.prior[k]), 1.0)
        sentence = (
            f"The log does not determine {term.meaning}: {amount} keeps {kept:.0f} % of the prior "
            f"uncertainty. What would determine it: {term.shown_by}.{also}"
        )
    elif k not in fit.free:
        sentence = (
            f"{capital(term.meaning)}: not significant on this log ({amount}), so the model omits "
            "it."
        )
    return VehicleNumber(term.name, value, error, term.unit, identifiable, sentence, k in fit.free)
