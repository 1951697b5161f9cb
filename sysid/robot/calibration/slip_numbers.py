"""Estimates of the slipping vehicle, as quantities with units and sentences."""

from collections.abc import Mapping

import numpy as np

from sysid.data.record import Array
from sysid.robot.calibration.numbers import Correlations, VehicleNumber, derived
from sysid.robot.calibration.slip_fit import SlipFit
from sysid.robot.calibration.slip_model import AT, TERMS, Term
from sysid.vehicle.kinematics import Geometry

_LENGTHS = ("radius_left", "radius_right", "effective_width")


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
    return {
        "alpha_left": n["radius_left"] / given.r,
        "alpha_right": n["radius_right"] / given.r,
        "width_ratio": n["effective_width"] / given.B,
        "turning_ratio": n["effective_width"]
        / given.B
        * given.r
        / mean
        / max(1.0 - n["slip_turning"], 1e-3),
    }


_DERIVED = {
    "icr_x": ("m", "distance of the axis of rotation ahead of the pose's point"),
    "icr_y_left": ("m", "distance of the left side's centre of rotation to the left of that point"),
    "icr_y_right": (
        "m",
        "distance of the right side's centre of rotation to the left of that point",
    ),
    "alpha_left": ("1", "the left side's effective radius over the one given"),
    "alpha_right": ("1", "the right side's effective radius over the one given"),
    "width_ratio": ("1", "the effective width over the one given"),
    "turning_ratio": (
        "1",
        "wheel travel in a turn on the spot over that of the given lengths",
    ),
}
_FROM = {
    "icr_x": ("marker_x",),
    "icr_y_left": ("effective_width", "marker_y"),
    "icr_y_right": ("effective_width", "marker_y"),
    "alpha_left": ("radius_left",),
    "alpha_right": ("radius_right",),
    "width_ratio": ("effective_width",),
    "turning_ratio": ("effective_width", "radius_left", "radius_right"),
}
"""Parameters that each quantity is derived from; it is identifiable if these are."""


def numbers_of(fit: SlipFit, given: Geometry | None) -> tuple[VehicleNumber, ...]:
    """Every quantity, with the reason where it is not identifiable.

    Args:
        given: lengths that a person gave; None for none.
    """
    identifiable = dict(zip((t.name for t in TERMS), fit.identifiable, strict=True))
    plain = [_number(fit, k, t) for k, t in enumerate(TERMS)]
    steps = 1e-4 * fit.prior

    def follow(q: Array) -> Mapping[str, float]:
        more = {} if given is None else ratios(q, fit.geometry, given)
        return {**centres(q, fit.geometry), **more}

    outside = [k for k in range(len(TERMS)) if k not in fit.free]
    joint = fit.covariance.copy()
    joint[outside, outside] = 0.0  # the model goes without them
    more = []
    for name, (value, error) in derived(follow, fit.q, joint, steps).items():
        unit, meaning = _DERIVED[name]
        determined = all(identifiable[n] for n in _FROM[name])
        sentence = f"{_capital(meaning)}."
        if not determined:
            missing = " and ".join(n for n in _FROM[name] if not identifiable[n])
            sentence = f"{name} is not identifiable from this log, because {missing} is not."
        more.append(VehicleNumber(name, value, error, unit, determined, sentence))
    return (*plain, *more)


def correlations_of(fit: SlipFit) -> Correlations:
    """How far errors of the numbers in the model go together."""
    free = list(fit.free)
    turned = np.ones(len(free))
    turned[free.index(AT["effective_width"])] = -1.0  # the model holds 1/width
    covariance = fit.covariance[np.ix_(free, free)] * np.outer(turned, turned)
    return Correlations.of([TERMS[k].name for k in free], covariance)


def _number(fit: SlipFit, k: int, term: Term) -> VehicleNumber:
    error = float(fit.std_errors[k])
    value = in_units(fit.added, fit.geometry)[term.name]
    if term.name in ("radius_left", "radius_right"):
        error *= fit.geometry.r
    elif term.name == "effective_width":
        error *= value / float(fit.added[k])
    identifiable, inside = fit.identifiable[k], k in fit.free
    return VehicleNumber(
        term.name,
        value,
        error,
        term.unit,
        identifiable,
        _sentence(term, fit, k, value, error),
        inside,
    )


def _sentence(term: Term, fit: SlipFit, k: int, value: float, error: float) -> str:
    unit = "" if term.unit == "1" else f" {term.unit}"
    like = " and ".join(TERMS[j].name for j in fit.like(k))
    also = f" On this log {like} has nearly the same effect." if like else ""
    if not fit.identifiable[k]:
        prior_share = min(float(fit.std_errors[k] / fit.prior[k]), 1.0)
        return (
            f"The log does not determine {term.meaning}: {value:.2g} ± {error:.2g}{unit} keeps "
            f"{100 * prior_share:.0f} % of the prior uncertainty. What would determine it: "
            f"{term.shown_by}.{also}"
        )
    if k not in fit.free:
        return (
            f"{_capital(term.meaning)}: not significant on this log ({value:.2g} ± "
            f"{error:.2g}{unit}), so the model omits it."
        )
    return f"{_capital(term.meaning)}.{also}"


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]
