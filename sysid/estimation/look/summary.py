"""Everything a log shows before a model, and what a person concludes from it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.checks.delay import Delay, estimate_delays
from sysid.data.record import Record
from sysid.errors import DataError
from sysid.estimation.look.distortion import Distortions, distortions
from sysid.estimation.look.frequency import FrequencyEstimate, local_polynomial
from sysid.estimation.look.impulse import MOST, ImpulseResponse, impulse_response

SETTLED = 0.05
"""A response has settled where what follows is below this share of the whole."""


@dataclass(frozen=True, eq=False)
class Path:
    """What one input does to one output.

    Attributes:
        gain, gain_error: of the response to a step, at its end.
        rise_s: until 63 % of it are reached, the delay included [s]; NaN where nothing is clear.
        settles: whether the response ends within the coefficients.
        delay: in samples, with its interval.
        trusted_hz: the frequency up to which the frequency response has a narrow band; 0: nowhere.
    """

    input: str
    output: str
    gain: float
    gain_error: float
    rise_s: float
    settles: bool
    delay: Delay
    trusted_hz: float


@dataclass(frozen=True, eq=False)
class Look:
    """A look at a log.

    Attributes:
        paths: output by output, input by input.
        impulses: one an output.
        frequency: by local polynomials.
        noise_share: standard deviation of what inputs do not explain over the output's, (ny,).
        distortions: of each output; None where the inputs are not periodic.
    """

    records: tuple[Record, ...]
    paths: tuple[Path, ...]
    impulses: tuple[ImpulseResponse, ...]
    frequency: FrequencyEstimate
    noise_share: tuple[float, ...]
    distortions: tuple[Distortions | None, ...]


def look(records: Sequence[Record], kernel: str | None = None) -> Look:
    """Impulse and frequency responses, delays, noise and distortions of logs.

    Args:
        records: experiments with the same channels.
        kernel: of the impulse response, TC, DC or SS; the likeliest when None.

    Raises:
        DataError: there are no inputs, or too few samples.
    """
    first = records[0]
    if not first.nu:
        raise DataError(f"{first.name}: there are no inputs to look at responses of")
    longest = max(len(r) for r in records)
    n = int(np.clip(longest // (4 * first.nu), 10, MOST // first.nu))
    delays = estimate_delays(records)
    frequency = local_polynomial(records)
    impulses = tuple(impulse_response(records, i, n, kernel) for i in range(first.ny))
    paths, shares = [], []
    for i, response in enumerate(impulses):
        spread = max(float(np.std(np.concatenate([r.y[:, i] for r in records]))), 1e-300)
        shares.append(response.noise / spread)
        paths += [
            _path(first, i, j, response, delays[i * first.nu + j], frequency)
            for j in range(first.nu)
        ]
    return Look(
        tuple(records),
        tuple(paths),
        impulses,
        frequency,
        tuple(shares),
        tuple(distortions(records, i) for i in range(first.ny)),
    )


def _path(
    r: Record, i: int, j: int, found: ImpulseResponse, delay: Delay, frequency: FrequencyEstimate
) -> Path:
    step, error = found.step[:, j], found.step_error[:, j]
    gain, uncertain = float(step[-1]), float(error[-1])
    tail = step[-max(len(step) // 10, 2) :]
    settles = bool(np.ptp(tail) < max(SETTLED * abs(gain), 2.0 * uncertain))
    clear = abs(gain) > 2.0 * uncertain
    reached = np.flatnonzero(step * np.sign(gain) >= (1.0 - np.exp(-1.0)) * abs(gain))
    rise = float(reached[0]) * r.dt if clear and len(reached) else float("nan")
    return Path(
        r.input_names[j],
        r.output_names[i],
        gain,
        uncertain,
        rise,
        settles,
        delay,
        frequency.trusted_up_to(i, j) / (2.0 * np.pi),
    )
