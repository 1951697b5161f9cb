"""What comes after a log: outputs predicted from its last samples, with errors that grow."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import DataError, ModelError, UsageError
from sysid.estimation.assessment.delta_method import NORMAL, delta_errors
from sysid.structures.model import Model
from sysid.structures.motion import initial_state_window

MOST_STEPS = 10_000
"""Longest forecast: its covariance is a matrix of so many rows."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """Outputs after an instant, predicted by a model.

    Attributes:
        record: the log, whose rows from ``first`` on are not used.
        first: row that the forecast begins with.
        t: instants [s], (steps,).
        u: inputs that were assumed, (steps, nu).
        y: outputs predicted, (steps, ny).
        error: their standard errors, of innovations and parameters together, (steps, ny).
        held: steps from which inputs keep the last value that is known.
    """

    record: Record
    first: int
    t: Array
    u: Array
    y: Array
    error: Array
    held: int

    @property
    def low(self) -> Array:
        """Lower ends of the 95 % intervals."""
        return self.y - NORMAL * self.error

    @property
    def high(self) -> Array:
        """Upper ends."""
        return self.y + NORMAL * self.error

    @property
    def measured(self) -> Array:
        """What the log holds of these instants, (steps, ny); NaN beyond its end."""
        out = np.full(self.y.shape, np.nan)
        after = self.record.y[self.first : self.first + len(out)]
        out[: len(after)] = after
        return out

    def table(self) -> str:
        """CSV: instants, inputs, outputs and the ends of their 95 % intervals."""
        inputs = [c.name for c in self.record.inputs]
        names = [f"{c.name}{end}" for c in self.record.outputs for end in ("", "_low", "_high")]
        ends = np.stack([self.y, self.low, self.high], axis=2).reshape(len(self.y), -1)
        rows = np.column_stack([self.t, self.u, ends])
        lines = [",".join(["t_s", *inputs, *names])]
        lines += [",".join("" if np.isnan(v) else f"{v:.9g}" for v in row) for row in rows]
        return "\n".join(lines) + "\n"


def forecast(model: Model, record: Record, steps: int, at: float | None = None) -> Forecast:
    """ŷ(T+k | T) for k = 1 … steps, with P_k = Σ_{l<k} h(l) Λ h(l)ᵀ + what θ's errors add.

    h(l), h(0) = I, are the responses of the outputs to an innovation and Λ is its covariance
    (Ljung 1999, §3.2). A model without a noise model has h(l) = 0 for l > 0: its bands do not grow.
    Inputs after T are those of the log, then its last ones.

    Args:
        at: the instant T of the last sample that is used [s]; the log's last one when None.

    Raises:
        ModelError: the log does not fit, or the model is not linear and looks at past outputs.
        UsageError: steps or the instant do not fit.
        DataError: too few samples before the instant.
    """
    model.check(record)
    structure = model.structure
    if structure.traits.has_noise_model and not structure.traits.linear:
        raise ModelError(
            f"{structure.name} is not linear: how its errors grow is not known. Fit arx, bj or ss "
            "for a forecast, or simulate it"
        )
    if not 1 <= steps <= MOST_STEPS:
        raise UsageError(f"`steps` must lie between 1 and {MOST_STEPS}, got {steps}")
    first = len(record)
    if at is not None:
        first = int(np.floor((at - record.t0) / record.dt + 1e-6)) + 1
        if not 1 <= first <= len(record):
            raise UsageError(
                f"`at`: {at:g} s lies outside the log, {record.t[0]:g} to {record.t[-1]:g} s"
            )
    least = structure.first_sample() + 2
    if first < least:
        raise DataError(f"a forecast needs {least} samples before it, here are {first}")
    end = max(first + steps, 0)
    known = record.u[:end]
    u = np.concatenate([known, np.repeat(known[-1:], end - len(known), axis=0)])
    y = np.concatenate([record.y[:first], np.repeat(record.y[first - 1 : first], steps, axis=0)])
    longer = Record(u, y, record.dt, record.inputs, record.outputs, t0=record.t0)
    plain = model.detrend.remove(longer)
    window = min(initial_state_window(structure, model.theta), first)

    def predicted(theta: Array) -> Array:
        answers = innovation_responses(model, theta, steps)
        e = structure.errors(theta, plain.u, plain.y, window)[first:]
        return np.asarray(plain.y[first:] - _convolved(answers, e))

    centre = predicted(model.theta)
    answers = innovation_responses(model, model.theta, steps)
    each = np.einsum("kij,jl,kil->ki", answers, model.noise_covariance, answers)
    variance = np.cumsum(each, axis=0) + _of_parameters(model, predicted, centre) ** 2
    return Forecast(
        record,
        first,
        longer.t[first:],
        u[first:],
        model.detrend.restore_output(centre, longer.t[first:]),
        np.sqrt(variance),
        max(len(record) - first, 0),
    )


def _of_parameters(model: Model, predicted: Callable[[Array], Array], centre: Array) -> Array:
    """Standard errors that those of θ cause, (steps, ny)."""
    with np.errstate(all="ignore"):
        error = delta_errors(model, lambda theta: predicted(theta).ravel(), centre.ravel())
    return error.reshape(centre.shape)


def innovation_responses(model: Model, theta: Array, steps: int) -> Array:
    """h(0) … h(steps − 1), (steps, ny, ny): the inverse of what errors make of outputs.

    Errors are linear in outputs, e = Σ g(l) y(t−l) + …, g(0) = I; h inverts g.
    """
    structure, ny = model.structure, len(model.outputs)
    if not structure.traits.has_noise_model:
        h = np.zeros((steps, ny, ny))
        h[0] = np.eye(ny)
        return h
    rest = structure.first_sample()
    u = np.zeros((rest + steps, structure.nu))
    nothing = structure.errors(theta, u, np.zeros((rest + steps, ny)), 0)[rest:]
    g = np.zeros((steps, ny, ny))
    for i in range(ny):
        pulse = np.zeros((rest + steps, ny))
        pulse[rest, i] = 1.0
        g[:, :, i] = structure.errors(theta, u, pulse, 0)[rest:] - nothing
    h = np.zeros_like(g)
    h[0] = np.linalg.inv(g[0])
    for k in range(1, steps):
        h[k] = -h[0] @ np.einsum("lij,ljk->ik", g[1 : k + 1], h[k - 1 :: -1][:k])
    return h


def _convolved(h: Array, e: Array) -> Array:
    """Σ_l h(l) e(t − l)."""
    out = np.zeros_like(e)
    for i in range(e.shape[1]):
        for j in range(e.shape[1]):
            if np.any(h[:, i, j]):
                out[:, i] += np.convolve(h[:, i, j], e[:, j])[: len(e)]
    return out
