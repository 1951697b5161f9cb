"""The plant about whose parameters an experiment is asked, and slopes of its runs by them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Channel, Index, Record
from sysid.errors import UsageError
from sysid.fitting.problem import Allowed, Parameter
from sysid.methods.grey_box import cut_finely
from sysid.structures import special_runs
from sysid.structures.base import Structure
from sysid.structures.grey_box.runs import state_guess, tangents, trajectory
from sysid.structures.grey_box.structure import GreyBox, read_off
from sysid.structures.model import Model


@dataclass(frozen=True, eq=False)
class Subject:
    """A structure at some θ, and the noise of what is measured of it.

    Attributes:
        parameters: of θ; those that are fixed are not asked about.
        noise: standard deviation of each output's measurements, (ny,).
        dt: sample time [s].
        u_range, y_range: lowest and highest value of each input and output seen, (n, 2).
    """

    structure: Structure
    theta: Array
    parameters: tuple[Parameter, ...]
    noise: Array
    dt: float
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    u_range: Array
    y_range: Array

    @property
    def free(self) -> Index:
        """Entries of θ that are estimated, (n,) of int."""
        return np.flatnonzero(Allowed.by(self.parameters).free)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that are estimated."""
        return tuple(self.parameters[k].name for k in self.free)

    def state(self, u: Array, y: Array) -> Array:
        """Where a run begins that shall follow a record."""
        if isinstance(self.structure, GreyBox):
            return state_guess(self.structure, self.theta, u, y)
        samples = 3 * self.structure.n_states(self.theta)
        return self.structure.fitted_state(self.theta, u, y, samples)

    def rest(self) -> Array:
        """Where an experiment begins."""
        return special_runs.rest(self.structure, self.theta)

    def runs(self, inputs: Sequence[Array], states: Sequence[Array]) -> list[Array]:
        """ŷ (N, ny) of each."""
        if isinstance(self.structure, GreyBox):
            return trajectory(self.structure, self.theta, inputs, np.stack(states, axis=1))[1]
        pairs = zip(inputs, states, strict=True)
        return [self.structure.simulate(self.theta, u, x) for u, x in pairs]

    def slopes(self, inputs: Sequence[Array], states: Sequence[Array]) -> list[Array]:
        """∂ŷ/∂(free entries of θ, initial state where it is estimated) of each run, in standard
        deviations of the noise, (ny, N, n)."""
        s = self.structure
        scale = self.noise[:, None, None]
        if isinstance(s, GreyBox):
            moved = np.array(s.physics.estimated_states(), dtype=bool)
            wanted = np.isin(np.arange(len(self.theta)), self.free)
            both = np.concatenate([wanted, moved])
            found = tangents(s, self.theta, inputs, np.stack(states, axis=1), both)
            return [D[both].transpose(1, 2, 0) / scale for D in found]
        runs = self.runs(inputs, states)
        pairs = zip(inputs, runs, strict=True)
        return [s.gradients(self.theta, u, y)[:, :, self.free] / scale for u, y in pairs]


def subject_of_model(model: Model) -> Subject:
    """A fitted model as it is."""
    if not model.inputs:
        raise UsageError("a model without inputs has no experiment to ask about")
    n, offsets = len(model.inputs), model.detrend
    ranges = model.ranges if len(model.ranges) == n + len(model.outputs) else None
    if ranges is None:
        raise UsageError("the model does not say which range it was fitted in; fit it again")
    return Subject(
        model.structure,
        model.theta,
        model.parameters,
        np.sqrt(np.diag(model.noise_covariance)),
        model.dt,
        model.inputs,
        model.outputs,
        ranges[:n] - np.asarray(offsets.u_offset)[:, None],
        ranges[n:] - np.asarray(offsets.y_offset)[:, None],
    )


def subject_of_box(structure: GreyBox[Any], facts: LogFacts) -> Subject:
    """A grey box before any fit: its default constants, the noise and ranges of a log."""
    records = facts.records
    parameters = structure.parameters(records[0].inputs, records[0].outputs)
    theta = structure.physics.pack({})
    made = cut_finely(read_off(structure, records), [theta])
    noise = np.maximum(facts.noise, 1e-9 * np.ptp(_all(records, "y"), axis=0))
    return subject_at(made, theta, parameters, np.maximum(noise, 1e-300), records)


def subject_at(
    structure: Structure,
    theta: Array,
    parameters: tuple[Parameter, ...],
    noise: Array,
    records: Sequence[Record],
) -> Subject:
    """A structure at some θ, asked about the channels and ranges of records."""
    first = records[0]
    ranges = [
        np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
        for values in (_all(records, "u"), _all(records, "y"))
    ]
    return Subject(
        structure, theta, parameters, noise, first.dt, first.inputs, first.outputs, *ranges
    )


def _all(records: Sequence[Record], side: str) -> Array:
    return np.concatenate([getattr(r, side) for r in records])
