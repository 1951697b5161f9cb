"""State of a followed plant at one moment, and its changes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.documents import by_field, plain_object
from sysid.estimation.assessment.delta_method import Estimate
from sysid.estimation.assessment.step_response import StepResponse
from sysid.estimation.online.dead_zone import DeadZone
from sysid.estimation.online.excitation import Excitation
from sysid.fitting.uncertainty import unvisited
from sysid.structures.model import Model

SETTLED = 0.05
"""A number has settled when its standard error is below this share of it."""


@dataclass(frozen=True)
class LivePair:
    """What an input does to an output.

    Attributes:
        gain, time_constant: with their standard errors; beyond the dead zone where one is seen.
            The time constant of a response with several modes is the time to 63 % [s].
        dead_time: [s].
        dead_zone: of the input, where it is this output's drive and enough is known.
        settled: whether gain and time constant are known within SETTLED.
    """

    input: str
    output: str
    gain: Estimate
    time_constant: Estimate
    unit: str
    dead_time: float
    dead_zone: DeadZone | None
    settled: bool


@dataclass(frozen=True)
class Numbers:
    """Gain and time constant of a pair before a change, and after it as known now."""

    input: str
    output: str
    gain_before: Estimate
    gain_after: Estimate | None
    time_constant_before: Estimate
    time_constant_after: Estimate | None


@dataclass(frozen=True)
class LiveChange:
    """A change of the plant.

    Attributes:
        time: when, counted from the first row [s].
        within: within which that is known [s].
        seen: when it was seen [s].
        output: the output that showed it.
        chance: probability of a difference as large without a change.
        share: by how much of what the inputs do the output was altered.
    """

    time: float
    within: float
    seen: float
    output: str
    chance: float
    share: float
    numbers: tuple[Numbers, ...]


@dataclass(frozen=True)
class LiveParameter:
    """A parameter, its standard error (None where it is not determined) and its information."""

    name: str
    value: float
    std_error: float | None
    information: float
    unit: str


@dataclass(frozen=True)
class LiveState:
    """What a stream shows at one moment.

    Attributes:
        rows, seconds: taken in so far.
        since_change: rows since the last change.
        pairs: inputs and outputs.
        noise: standard deviation of the one-step error of each output.
        excitation: of each output's equation.
        changes: of the plant.
    """

    rows: int
    seconds: float
    since_change: int
    orders: Mapping[str, Any]
    pairs: tuple[LivePair, ...]
    parameters: tuple[LiveParameter, ...]
    noise: Mapping[str, float]
    excitation: tuple[Excitation, ...]
    changes: tuple[LiveChange, ...]

    @property
    def enough(self) -> bool:
        """Whether the excitation is enough for every output."""
        return bool(self.excitation) and all(e.enough for e in self.excitation)

    def to_json(self) -> dict[str, Any]:
        """All of it as a JSON object; numbers that are not finite are left to the writer."""
        excitation = [{**by_field(e), "enough": e.enough} for e in self.excitation]
        return plain_object(
            {**by_field(self), "excitation": excitation, "excitation_enough": self.enough}
        )


def time_constant(response: StepResponse) -> Estimate:
    """Of a response of one mode its time constant, of others the time to 63 % of a step.

    The slowest of several modes says little of how fast a plant is: a zero beside it may take most
    of it away.
    """
    only = len(response.time_constants) == 1 and response.oscillation is None
    return response.time_constants[0] if only else response.rise


def pair_of(r: StepResponse, zone: DeadZone | None) -> LivePair:
    """A pair as it is shown, with the dead zone of its input where that drives the output."""
    time = time_constant(r)
    known = [abs(e.std_error) <= SETTLED * abs(e.value) for e in (r.gain, time)]
    return LivePair(r.input, r.output, r.gain, time, r.unit, r.dead_time, zone, bool(all(known)))


def followed_by(change: LiveChange, now: Sequence[StepResponse]) -> LiveChange:
    """The change with the numbers after it."""
    after = {(r.input, r.output): r for r in now}
    numbers = []
    for n in change.numbers:
        r = after.get((n.input, n.output))
        before = (None, None) if r is None else (r.gain, time_constant(r))
        numbers.append(replace(n, gain_after=before[0], time_constant_after=before[1]))
    return replace(change, numbers=tuple(numbers))


def parameters_of(model: Model) -> tuple[LiveParameter, ...]:
    """The parameters of a model, with what is known of each."""
    unknown = {unvisited(d) for d in model.null_directions}
    parameters = []
    for p in model.parameter_table():
        known = bool(np.isfinite(p.std_error)) and p.name not in unknown
        information = 1.0 / p.std_error**2 if known and p.std_error > 0.0 else 0.0
        error = p.std_error if known else None
        parameters.append(LiveParameter(p.name, p.value, error, information, p.unit))
    return tuple(parameters)
