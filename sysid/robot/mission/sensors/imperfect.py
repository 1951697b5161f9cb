"""Common errors of all sensors: rate, noise, bias, latency, drop-outs."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from functools import lru_cache
from statistics import NormalDist
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field, ValidationInfo, field_validator

from sysid.errors import ModelError
from sysid.robot.mission.contracts import Figures, Scene, SensorInputs, State
from sysid.robot.mission.settings import Positive, Settings
from sysid.vehicle.kinematics import Real

Reals = tuple[Real, ...]

Signed = tuple[Annotated[float, Field(ge=-1e6, le=1e6)], ...]
NotNegative = tuple[Annotated[float, Field(ge=0, le=1e6)], ...]
AboveZero = tuple[Positive, ...]
"""A figure of a sensor: one number for all that it measures, or one each."""

LONGEST_LATENCY = 5.0
"""[s] Position fixes over a radio link come tenths of a second late; more than this is a number
meant in milliseconds."""
Latency = Annotated[float, Field(ge=0, le=LONGEST_LATENCY)]
LONGEST_DELAY = 1000
"""Samples on their way at once; each of them costs time and memory at every sample."""
ROUNDING = 1e-9
"""k·dt and j/rate of one instant differ by rounding, in parts of themselves."""

AT_ONCE = 1e-9
"""[s] A time to divide by where none has passed, at t = 0; sums over it are nothing."""


class Remembered(NamedTuple):
    """What a sensor remembers.

    Attributes:
        bias: of each measured quantity, now.
        taken: the last instant at which it measured [s].
        late: measurements on their way, the next to come first.
    """

    memory: State
    bias: Reals
    taken: Real
    late: tuple[Reals, ...]


class ImperfectSensor(Settings):
    """Base of sensors: reading = rounded(limited(ideal + bias + σ·z)), at times, some time later.

    It measures at the instants j/rate, j = 0, 1, …: at the first sample of the plant at or after
    each; where it is faster than the plant, once a sample, of what came since the last one. With
    T = max(1/rate, dt), σ = noise/√T. The bias is b(0) = bias + bias_std·z,
    b(t + dt) = b(t) + bias_walk·√dt·z. Navigation does not know the bias.

    Fields of more than one quantity take one number for all of them or a list of one each; units
    are those of what is measured.

    Attributes:
        rate: measurements a second [Hz].
        noise: density of the white noise [unit/√Hz].
        bias: what it reads too much [unit].
        bias_std: standard deviation of the bias between runs [unit].
        bias_walk: random walk of the bias [unit/√s].
        dropout: probability that a measurement is lost, each for itself.
        latency: from measuring to arrival at navigation [s], rounded up to whole samples
            of the plant.
        saturation: largest size of what it can measure [unit]; None for no limit.
        resolution: step of the numbers that come out [unit]; 0 for none.
    """

    measured: ClassVar[tuple[str, ...]] = ()
    """What it measures with these figures, the first of its measurements."""
    adds_up: ClassVar[bool] = False
    """Whether its measurements are sums of what it measured, so that noise averages over the time
    since the last instant, however long that was."""

    rate: Positive
    noise: NotNegative
    bias: Signed = (0.0,)
    bias_std: NotNegative = (0.0,)
    bias_walk: NotNegative = (0.0,)
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.0
    latency: Latency = 0.0
    saturation: AboveZero | None = None
    resolution: NotNegative = (0.0,)

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Refuse a kind that does not say what it measures, where it is defined."""
        if not cls.measured or cls.measure is ImperfectSensor.measure:
            raise TypeError(f"the sensor {cls.__name__} needs `.measured` and `.measure()`")

    @field_validator(
        "noise", "bias", "bias_std", "bias_walk", "saturation", "resolution", mode="before"
    )
    @classmethod
    def _one_each(cls, value: Any, info: ValidationInfo) -> Any:
        if value is None and info.field_name == "saturation":
            return None
        numbers = tuple(value) if isinstance(value, list | tuple) else (value,)
        if len(numbers) not in {1, len(cls.measured)}:
            raise ValueError(
                f"{info.field_name} has {len(numbers)} numbers: give one, or one for each of "
                f"{', '.join(cls.measured)}"
            )
        return numbers

    # What navigation and the loop ask ------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        return self.measured

    @property
    def draws(self) -> int:
        """Noise and bias of each measured quantity, and whether the measurement is lost."""
        return 2 * len(self.measured) + 1

    def interval(self, dt: float) -> float:
        """Time between two measurements [s] where the plant's sample time is ``dt`` [s]."""
        return max(1.0 / self.rate, dt)

    def delay(self, dt: float) -> int:
        """Samples of the plant from the instant a measurement is of to navigation."""
        return math.ceil(self.latency / dt * (1.0 - ROUNDING) - ROUNDING)

    def variance(self, dt: float) -> tuple[float, ...]:
        """Variance of the white error of a measurement, in the order of ``measured`` [unit²]."""
        n, span = len(self.measured), self.interval(dt)
        figures = zip(each(self.noise, n), each(self.resolution, n), strict=True)
        return tuple(noise**2 / span + step**2 / 12.0 for noise, step in figures)

    def figures(self, dt: float) -> Mapping[str, Figures]:
        n = len(self.measured)
        columns = (
            self.measured,
            self.variance(dt),
            each(self.bias_std, n),
            each(self.bias_walk, n),
        )
        return {
            name: Figures(
                variance=variance,
                bias_variance=start**2,
                bias_drift=walk**2,
                interval=self.interval(dt),
                delay=self.delay(dt),
                dropout=self.dropout,
            )
            for name, variance, start, walk in zip(*columns, strict=True)
        }

    # What a kind of sensor says of itself ---------------------------------------------------------

    def begin(self, scene: Scene, xp: Any) -> State:
        """What its kind remembers at first."""
        return ()

    @abstractmethod
    def measure(
        self, memory: State, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[State, Reals]:
        """What it would measure without errors, asked at every sample of the plant.

        Args:
            since: time since it measured last [s]; 0 at first.
            dt: time since the sample before [s]; 0 at first.

        Returns:
            What its kind remembers now, and a value for each of ``measured``.
        """

    def read(
        self, memory: State, measured: Reals, since: Real, now: Real, arrives: Real, xp: Any
    ) -> tuple[State, Reals]:
        """The measurements of what was measured with errors.

        Args:
            since: time since it measured last [s]; 0 at first.
            now: whether this sample is an instant at which it measures.
            arrives: whether it is, and the measurement is not lost.

        Returns:
            What its kind remembers now, and the measurements in the order of ``names``.
        """
        return memory, measured

    # The errors -----------------------------------------------------------------------------------

    def start(self, scene: Scene, xp: Any) -> Remembered:
        """Nothing is on its way; the bias is drawn with the first sample.

        Raises:
            ModelError: the latency is too many samples of the plant.
        """
        delay = self.delay(scene.dt)
        if delay > LONGEST_DELAY:
            raise ModelError(
                f"the latency of {self.latency:g} s of {', '.join(self.names)} is {delay} samples "
                f"of the plant, and at most {LONGEST_DELAY} are allowed; shorten it, or use a "
                "plant of a "
                "longer sample time"
            )
        nothing = (xp.nan,) * len(self.names)
        bias = each(self.bias, len(self.measured))
        return Remembered(self.begin(scene, xp), bias, 0.0, (nothing,) * delay)

    def step(
        self, state: Remembered, inputs: SensorInputs, dt: Real, xp: Any
    ) -> tuple[Remembered, Reals]:
        """The measurements that come at this sample; NaN where none does."""
        n, draws = len(self.measured), inputs.draws
        since = inputs.t - state.taken
        now = self._measures(inputs, dt, xp)
        arrives = now & xp.logical_not(draws[2 * n] < _quantile(self.dropout))
        memory, ideal = self.measure(state.memory, inputs, since, dt, xp)
        bias = self._walked(state.bias, draws[n : 2 * n], dt, xp)
        span = self.interval(inputs.scene.dt)
        root = xp.sqrt(xp.maximum(since, AT_ONCE) if self.adds_up else span)
        noise = zip(ideal, bias, each(self.noise, n), draws[:n], strict=True)
        measured = tuple(value + b + density / root * z for value, b, density, z in noise)
        if self.saturation is not None:
            limits = zip(measured, each(self.saturation, n), strict=True)
            measured = tuple(xp.clip(value, -limit, limit) for value, limit in limits)
        memory, measurements = self.read(memory, measured, since, now, arrives, xp)
        measurements = tuple(xp.where(arrives, r, xp.nan) for r in self._rounded(measurements, xp))
        late = (*state.late, measurements)
        after = Remembered(memory, bias, xp.where(now, inputs.t, state.taken), late[1:])
        return after, late[0]

    def _measures(self, inputs: SensorInputs, dt: Real, xp: Any) -> Real:
        """Whether an instant j/rate lies after the sample before, up to this one."""
        if self.rate * inputs.scene.dt >= 1.0 - ROUNDING:
            return True
        count, before = inputs.t * self.rate, (inputs.t - dt) * self.rate
        slack = ROUNDING * (1.0 + count)
        return (xp.floor(count + slack) > xp.floor(before + slack)) | (dt == 0)

    def _walked(self, bias: Reals, draws: Any, dt: Real, xp: Any) -> Reals:
        """The bias at this sample; its spread from run to run is drawn at the first."""
        n = len(self.measured)
        if not any(self.bias_walk) and not any(self.bias_std):
            return bias
        root = xp.sqrt(dt)
        figures = zip(bias, each(self.bias_std, n), each(self.bias_walk, n), draws, strict=True)
        return tuple(b + xp.where(dt > 0, walk * root, std) * z for b, std, walk, z in figures)

    def _rounded(self, measurements: Reals, xp: Any) -> Reals:
        if not any(self.resolution):
            return measurements
        steps = (*each(self.resolution, len(self.measured)), *(0.0,) * len(measurements))
        pairs = zip(measurements, steps, strict=False)
        return tuple(step * xp.floor(r / step + 0.5) if step else r for r, step in pairs)


def each(figure: tuple[float, ...], count: int) -> tuple[float, ...]:
    """A figure for each of ``count`` quantities."""
    return figure if len(figure) == count else figure * count


@lru_cache
def _quantile(probability: float) -> float:
    """A standard normal number is below it with this probability."""
    return NormalDist().inv_cdf(probability) if probability > 0 else -math.inf
