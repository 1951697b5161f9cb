"""Everything a log shows before a model, and what a person concludes from it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.checks.delay import Delay
from sysid.data.checks.nonlinearity import NONLINEAR, TRACE, NonlinearityTest
from sysid.data.facts import LogFacts
from sysid.data.record import Record
from sysid.data.unit_words import ratio
from sysid.errors import DataError
from sysid.estimation.look.distortion import Distortions, distortions
from sysid.estimation.look.frequency import FrequencyEstimate, frequency_response
from sysid.estimation.look.impulse import MOST, USUAL, ImpulseResponse, impulse_response

SETTLED = 0.05
"""A response has settled where what follows is below this share of the whole."""


LASTS = 6.0
"""Times to 63 % that a response is followed for."""

LEAST = 240
"""Steps that a record keeps at least."""


@dataclass(frozen=True, eq=False)
class Path:
    """What one input does to one output.

    Attributes:
        gain, gain_error: of the response to a step, at its end, in ``unit``.
        rise_s: until 63 % of it are reached, the delay included [s]; NaN where nothing is clear.
        settles: whether the response ends within the coefficients.
        delay: in samples, with its interval; None where the log is too short for it.
        trusted_hz: the frequency up to which the frequency response has a narrow band; 0: nowhere.
    """

    input: str
    output: str
    gain: float
    gain_error: float
    rise_s: float
    settles: bool
    delay: Delay | None
    trusted_hz: float
    unit: str

    @property
    def seen(self) -> bool:
        """Whether the gain is not zero for sure: beyond its 95 % interval."""
        return abs(self.gain) > 1.96 * self.gain_error


@dataclass(frozen=True, eq=False)
class Look:
    """A look at a log.

    Attributes:
        paths: output by output, input by input.
        impulses: one an output.
        frequency: by periods of the input, else by local models.
        noise_share: standard deviation of what inputs do not explain over the output's, (ny,).
        distortions: of each output; None where the inputs are not periodic.
        nonlinearity: of each output a test without periods; None where it cannot be made.
        integrals: outputs that integrate an input: their gain has no end.
        closed_loop: whether an input follows from an output: then responses are biased.
    """

    records: tuple[Record, ...]
    paths: tuple[Path, ...]
    impulses: tuple[ImpulseResponse, ...]
    frequency: FrequencyEstimate
    noise_share: tuple[float, ...]
    distortions: tuple[Distortions | None, ...]
    nonlinearity: tuple[NonlinearityTest | None, ...]
    integrals: tuple[str, ...]
    closed_loop: bool

    def bent(self, i: int) -> bool | None:
        """Whether an output is nonlinear for sure; None where the log does not tell."""
        d, test = self.distortions[i], self.nonlinearity[i]
        if d is not None and (np.isfinite(d.even) or np.isfinite(d.odd)):
            return d.even_seen or d.odd_seen
        if test is None:
            return None
        return test.p_value < NONLINEAR and test.share >= TRACE


def look(data: Sequence[Record] | LogFacts, kernel: str = USUAL) -> Look:
    """Impulse and frequency responses, delays, noise and distortions of logs.

    Args:
        data: experiments with the same channels, or what is already known of them.
        kernel: of the impulse response, TC, DC or SS.

    Raises:
        DataError: there are no inputs, or too few samples.
    """
    facts = LogFacts.of(data)
    records, first = facts.records, facts.records[0]
    if not first.nu:
        raise DataError(f"{first.name}: there are no inputs to look at responses of")
    frequency = frequency_response(records)
    delays = {(d.output, d.input): d for d in facts.delays or ()}
    tests = {t.output: t for t in facts.nonlinearity or ()}
    coarse, n = _in_view(facts)
    impulses = tuple(impulse_response(coarse, i, n, kernel) for i in range(first.ny))
    paths, shares = [], []
    for i, response in enumerate(impulses):
        y = first.output_names[i]
        spread = max(float(np.nanstd(np.concatenate([r.y[:, i] for r in coarse]))), 1e-300)
        shares.append(response.noise / spread)
        paths += [
            _path(first, i, j, response, delays.get((y, u)), frequency)
            for j, u in enumerate(first.input_names)
        ]
    return Look(
        records,
        tuple(paths),
        impulses,
        frequency,
        tuple(shares),
        tuple(distortions(records, i) for i in range(first.ny)),
        tuple(tests.get(y) for y in first.output_names),
        tuple(s.output for s in facts.integrals),
        facts.closed_loop,
    )


def _in_view(facts: LogFacts) -> tuple[list[Record], int]:
    """Records in steps of several samples where responses last longer than can be estimated.

    Returns:
        The records, and the number of coefficients of each response.
    """
    nu, dt = facts.records[0].nu, facts.records[0].dt
    most = MOST // nu
    lasting = max((s.time_constant or 0.0 for s in facts.speeds), default=0.0)
    step = max(int(np.ceil(LASTS * lasting / dt / most)), 1)
    longest = max(len(r) for r in facts.records)
    step = min(step, max(longest // LEAST, 1))
    records = [r.every(step) if step > 1 else r for r in facts.records]
    return records, int(np.clip(longest // step // (4 * nu), 10, most))


def _path(
    r: Record,
    i: int,
    j: int,
    found: ImpulseResponse,
    delay: Delay | None,
    frequency: FrequencyEstimate,
) -> Path:
    step, error = found.step[:, j], found.step_error[:, j]
    gain, uncertain = float(step[-1]), float(error[-1])
    tail = step[-max(len(step) // 10, 2) :]
    settles = bool(np.ptp(tail) < max(SETTLED * abs(gain), 2.0 * uncertain))
    clear = abs(gain) > 2.0 * uncertain
    u, y = r.inputs[j], r.outputs[i]
    reached = np.flatnonzero(step * np.sign(gain) >= (1.0 - np.exp(-1.0)) * abs(gain))
    rise = float(reached[0]) * found.dt if clear and len(reached) else float("nan")
    return Path(
        u.name,
        y.name,
        gain,
        uncertain,
        rise,
        settles,
        delay,
        frequency.trusted_up_to(i, j) / (2.0 * np.pi),
        ratio(y.unit or y.name, u.unit or u.name),
    )
