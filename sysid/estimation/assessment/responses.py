"""Curves that follow from a model, with standard errors: steps, frequencies, poles, statics.

Standard errors are those of the delta method, point by point: a band of ± 1.96 of them holds each
point of the truth with 95 %, not the whole curve.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.estimation.assessment.delta_method import NORMAL, delta_errors, delta_root
from sysid.estimation.assessment.step_response import (
    entry_of,
    response_to_step,
    settled_length,
    step_levels,
)
from sysid.structures.linear.base import LinearStructure
from sysid.structures.model import Model

POINTS = 200
"""Points of a curve: as many as a picture shows."""

LEVELS = 25
"""Constant inputs of a static curve."""

SHOWN = 1.5
"""A step is shown for so many times the time in which its slowest output settles."""

FAR = 1e6
"""Standard errors beyond which more of them say the same."""

CHI_SQUARED = 5.991
"""Of two degrees of freedom, 95 %."""

ROUND = 97
"""Points of an ellipse."""


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """What one input does to one output.

    Attributes:
        x: time [s], angular frequency [rad/s] or level of the input, (n,).
        y: response, (n,).
        error: its standard error, (n,); infinite where the data say nothing about it.
        note: what is special about it, such as the levels of the step; empty where nothing is.
    """

    input: str
    output: str
    x: Array
    y: Array
    error: Array
    note: str = ""


@dataclass(frozen=True, eq=False)
class FrequencyCurve:
    """Frequency response of one path.

    Attributes:
        w: angular frequencies [rad/s], (n,).
        response: G(e^{jωT}), complex, (n,).
        gain_error: standard error of ln |G|, (n,).
        phase_error: standard error of arg G [rad], (n,).
        root: of the covariance of (Re G, Im G), (n, 2, k): R Rᵀ.
    """

    input: str
    output: str
    w: Array
    response: NDArray[np.complex128]
    gain_error: Array
    phase_error: Array
    root: Array

    def bands(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Ends of the 95 % bands of |G| and of arg G [rad], (n,) each.

        The extremes over the ellipse (G − Ĝ)ᵀP⁻¹(G − Ĝ) = 1.96²: those of the delta method where G
        is large; of the phase the tangents from zero, exact for a normal Ĝ (Fieller 1954). Where
        the ellipse of both parts (χ² of two degrees of freedom) holds zero the phase may be any.
        """
        half, axes, _ = np.linalg.svd(np.nan_to_num(self.root, posinf=0.0), full_matrices=False)
        turn = np.linspace(0.0, 2.0 * np.pi, ROUND)
        circle = np.array([np.cos(turn), np.sin(turn)])[: axes.shape[1]]
        x, y = np.moveaxis(half @ (axes[:, :, None] * NORMAL * circle), 1, 0)
        points = self.response[:, None] + x + 1j * y
        size, angle = np.abs(points), np.angle(points / self.response[:, None])
        g = np.stack([self.response.real, self.response.imag], axis=1)
        axes = np.maximum(axes, 1e-9 * axes[:, :1] + 1e-300)
        beside = np.einsum("nik,ni->nk", half, g) / axes
        zero = np.sum(np.minimum(np.abs(beside), FAR) ** 2, axis=1) <= CHI_SQUARED
        gap = np.where(np.isfinite(self.root).all(axis=(1, 2)), 0.0, np.inf)
        low, high = np.where(zero, 0.0, size.min(axis=1)), size.max(axis=1)
        back = np.where(zero, -np.pi, angle.min(axis=1))
        ahead = np.where(zero, np.pi, angle.max(axis=1))
        phase = self.phase
        return (low - gap, high + gap), (phase + back - gap, phase + ahead + gap)

    @property
    def phase(self) -> Array:
        """arg G without jumps [rad]."""
        return np.asarray(np.unwrap(np.angle(self.response)))


@dataclass(frozen=True, eq=False)
class RootCloud:
    """Poles and zeros of a path in the z plane, (n,), with roots of their covariances (n, 2, k)."""

    input: str
    output: str
    poles: NDArray[np.complex128]
    pole_root: Array
    zeros: NDArray[np.complex128]
    zero_root: Array


def step_curves(
    model: Model, *, pulse: bool = False, seconds: float | None = None
) -> tuple[ResponseCurve, ...]:
    """Responses to a step of each input: of one unit for linear models, else to the largest seen.

    Args:
        pulse: respond to one sample of it instead.
        seconds: how long; until every output has settled unless given.
    """
    if not model.inputs:
        raise ModelError("the model has no inputs, so there is no step to respond to")
    share = None if model.structure.traits.linear else 1.0
    curves: list[ResponseCurve] = []
    for j, u in enumerate(model.inputs):
        start, level = step_levels(model, j, share)
        if level == start:
            continue
        length = _length(model, j, start, level, seconds)
        at = np.unique(np.linspace(0, length - 1, min(POINTS, length)).round().astype(int))

        def numbers(
            theta: Array,
            j: int = j,
            start: float = start,
            level: float = level,
            length: int = length,
            at: NDArray[np.int_] = at,
        ) -> Array:
            with np.errstate(all="ignore"):
                y = response_to_step(model, theta, j, start, level, length)
            if pulse:
                y = np.diff(y, axis=0, prepend=np.zeros((1, y.shape[1])))
            return np.asarray(y[at]).ravel()

        centre = numbers(model.theta)
        error = delta_errors(model, numbers, centre).reshape(len(at), -1)
        note = "" if share is None else f"{start:.4g} → {level:.4g}"
        y, t = centre.reshape(len(at), -1), at * model.dt
        curves += [
            ResponseCurve(u.name, c.name, t, y[:, i], error[:, i], note)
            for i, c in enumerate(model.outputs)
        ]
    return tuple(curves)


def _length(model: Model, j: int, start: float, level: float, seconds: float | None) -> int:
    if seconds is not None:
        return max(round(seconds / model.dt) + 1, 2)
    settled, whole = settled_length(model, j, start, level)
    return int(np.clip(SHOWN * settled / model.dt, 12, whole)) if np.isfinite(settled) else whole


def frequency_curves(model: Model, frequencies: Array | None = None) -> tuple[FrequencyCurve, ...]:
    """Frequency responses of every path of a linear model, with standard errors.

    d ln G = dG/G: its real part is the relative change of the gain, its imaginary part that of the
    phase, which needs no unwrapping.

    Args:
        frequencies: ω [rad/s]; 100 over three decades up to the Nyquist frequency unless given.
    """
    if not model.inputs:
        raise ModelError("the model has no inputs, so it has no frequency response")
    nyquist = np.pi / model.dt
    w = np.geomspace(1e-3, 0.999, 100) * nyquist if frequencies is None else np.array(frequencies)
    _, g = model.bode(w)
    structure = model.structure
    assert isinstance(structure, LinearStructure)  # bode has refused others
    paths = [
        (i, j)
        for i in range(len(model.outputs))
        for j in range(len(model.inputs))
        if np.any(g[:, i, j])
    ]

    def numbers(theta: Array) -> Array:
        response = structure.transfer(theta).response(w * model.dt)
        every = np.concatenate([response[:, i, j] for i, j in paths])
        return np.concatenate([every.real, every.imag])

    root = delta_root(model, numbers, numbers(model.theta))
    parts = root.reshape(2, len(paths), len(w), -1)
    curves = []
    for k, (i, j) in enumerate(paths):
        response = g[:, i, j]
        with np.errstate(all="ignore"):
            relative = (parts[0, k] + 1j * parts[1, k]) / response[:, None]
        curves.append(
            FrequencyCurve(
                model.inputs[j].name,
                model.outputs[i].name,
                w,
                response,
                np.sqrt(np.sum(relative.real**2, axis=1)),
                np.sqrt(np.sum(relative.imag**2, axis=1)),
                np.moveaxis(parts[:, k], 0, 1),
            )
        )
    return tuple(curves)


def root_clouds(model: Model) -> tuple[RootCloud, ...]:
    """Poles and zeros of every path of a linear model in the z plane, with their covariances.

    Of a root p of A(z) = Σ aₖ z^(n−k) dp = −Σ daₖ p^(n−k)/A′(p), so that only the covariance of the
    coefficients is found by differences.
    """
    if not isinstance(model.structure, LinearStructure) or not model.inputs:
        raise ModelError(f"{model.structure.name} has no poles and zeros of a path from an input")
    model = replace(model, structure=model.structure.held_near(model.theta))
    ny, nu = len(model.outputs), len(model.inputs)
    every = [(i, j) for i in range(ny) for j in range(nu)]
    entries = {key: entry_of(model, model.theta, *key) for key in every}
    paths = [(k, e) for k, e in entries.items() if e is not None and np.any(e[0])]

    def numbers(theta: Array) -> Array:
        found = [entry_of(model, theta, *key) for key, _ in paths]
        return np.concatenate([p for e in found if e is not None for p in e])

    root = delta_root(model, numbers, numbers(model.theta))
    clouds, at = [], 0
    for (i, j), (top, bottom) in paths:
        of_top = root[at : at + len(top)]
        of_bottom = root[at + len(top) : at + len(top) + len(bottom)]
        at += len(top) + len(bottom)
        zeros, poles = _roots(top, of_top), _roots(bottom, of_bottom)
        clouds.append(RootCloud(model.inputs[j].name, model.outputs[i].name, *poles, *zeros))
    return tuple(clouds)


def _roots(polynomial: Array, spread: Array) -> tuple[NDArray[np.complex128], Array]:
    """Roots that are not 0, and roots of their covariances, from those of the coefficients."""
    kept = np.flatnonzero(polynomial)
    if not len(kept):
        return np.zeros(0, dtype=np.complex128), np.zeros((0, 2, 1))
    part = slice(int(kept[0]), int(kept[-1]) + 1)
    a, da = polynomial[part], spread[part]
    roots = np.roots(a).astype(np.complex128)
    powers = roots[:, None] ** np.arange(len(a) - 1, -1, -1)
    with np.errstate(all="ignore"):
        moved = -(powers @ da) / np.polyval(np.polyder(a), roots)[:, None]
    return roots, np.stack([moved.real, moved.imag], axis=1)


def static_curves(model: Model) -> tuple[ResponseCurve, ...]:
    """Outputs at rest over each input held constant, the others at their base.

    For a motor that is its speed over the command, friction and limits included; for a
    Hammerstein–Wiener model its static curves times its gain.
    """
    if not model.inputs:
        raise ModelError("the model has no inputs, so it has no static curve")
    curves: list[ResponseCurve] = []
    for j, u in enumerate(model.inputs):
        low, high = model.ranges[j] if len(model.ranges) else (-1.0, 1.0)
        levels = np.linspace(float(low), float(high), LEVELS)
        start, level = step_levels(model, j, 1.0)
        settled, whole = settled_length(model, j, start, level)
        if not np.isfinite(settled):
            raise ModelError("the model does not settle, so it has no static curve")
        hold = int(np.clip(2.0 * settled / model.dt, 12, whole))
        steps = np.zeros((hold * LEVELS, len(model.inputs)))
        steps[:, j] = np.repeat(levels, hold)
        removed = model.detrend.remove_input(steps, np.zeros(len(steps)))

        def numbers(theta: Array, removed: Array = removed, hold: int = hold) -> Array:
            with np.errstate(all="ignore"):
                y = model.structure.simulate(theta, removed)
            return np.asarray(y[hold - 1 :: hold]).ravel()

        centre = numbers(model.theta)
        error = delta_errors(model, numbers, centre).reshape(LEVELS, -1)
        y = centre.reshape(LEVELS, -1) + np.asarray(model.detrend.y_offset)
        curves += [
            ResponseCurve(u.name, c.name, levels, y[:, i], error[:, i])
            for i, c in enumerate(model.outputs)
        ]
    return tuple(curves)


def main_paths(curves: Sequence[ResponseCurve], share: float = 0.02) -> list[ResponseCurve]:
    """Those that move their output by more than a share of what the strongest one does."""
    most: dict[str, float] = {}
    for c in curves:
        most[c.output] = max(most.get(c.output, 0.0), float(np.ptp(c.y)))
    return [c for c in curves if float(np.ptp(c.y)) >= share * most[c.output]]
