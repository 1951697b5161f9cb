"""Encoders on both tracks: ticks are counted, and speeds come from the counts."""

import math
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field

from sysid.robot.mission.contracts import Scene, SensorInputs
from sysid.robot.mission.sensors.imperfect import AT_ONCE, ImperfectSensor, NotNegative, Reals
from sysid.robot.mission.settings import Positive
from sysid.runners.trees import chosen
from sysid.vehicle.kinematics import Real


class Counted(NamedTuple):
    """What encoders remember, left and right.

    Attributes:
        speeds: of the wheels at the sample before [rad/s].
        turned: angles of the wheels at the sample before [rad].
        before: angles of the wheels at the last instant [rad].
        counted: those angles with the errors of counting [rad].
        ticks: what the last measurement had.
        waiting: from the last measurement to the last instant [s].
    """

    speeds: Reals
    turned: Reals
    before: Reals
    counted: Reals
    ticks: Reals
    waiting: Real


class Encoders(ImperfectSensor):
    """Reads counts of ticks, ticks = ⌊φ/q + ½⌋ with q = 2π/ticks_per_turn, and speeds from them.

    A speed is that of the ticks since the last measurement, ω = q·Δticks/Δt: the mean over that
    time and not the speed of the instant. Ticks whose reading is lost are in the next one, so that
    none is lost; φ is the angle since t = 0, for which wheel speeds vary linearly between samples.
    Noise and bias act on the speed, as ticks that are counted wrongly; by default none is.

    1200 ticks are those of small gear motors: 12 a turn of the motor behind a gear of 100 : 1.

    Attributes:
        ticks_per_turn: of the wheel.
    """

    measured: ClassVar[tuple[str, ...]] = ("omega_l", "omega_r")
    adds_up: ClassVar[bool] = True

    ticks_per_turn: Annotated[float, Field(ge=1, le=1e9)] = 1200.0
    rate: Positive = 100.0
    noise: NotNegative = (0.0,)

    @property
    def names(self) -> tuple[str, ...]:
        """``omega_l``, ``omega_r`` [rad/s], ``ticks_l``, ``ticks_r``."""
        return (*self.measured, "ticks_l", "ticks_r")

    @property
    def tick(self) -> float:
        """The angle between two ticks q [rad]."""
        return 2.0 * math.pi / self.ticks_per_turn

    def variance(self, dt: float) -> tuple[float, ...]:
        """That of the base, and that of a difference of two rounded counts, q²/6, over T²."""
        counting = self.tick**2 / 6.0 / self.interval(dt) ** 2
        return tuple(variance + counting for variance in super().variance(dt))

    def begin(self, scene: Scene, xp: Any) -> Counted:
        """Nothing has turned; a count is in the middle between two ticks."""
        zero = (0.0, 0.0)
        return Counted(zero, zero, zero, zero, zero, 0.0)

    def measure(
        self, memory: Counted, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[Counted, Reals]:
        """The mean speeds since the last instant [rad/s]."""
        speeds = inputs.omega_l, inputs.omega_r
        turned = tuple(
            angle + 0.5 * (last + now) * dt
            for angle, last, now in zip(memory.turned, memory.speeds, speeds, strict=True)
        )
        time = xp.maximum(since, AT_ONCE)
        means = tuple((a - b) / time for a, b in zip(turned, memory.before, strict=True))
        return memory._replace(speeds=speeds, turned=turned), means

    def read(
        self, memory: Counted, measured: Reals, since: Real, now: Real, arrives: Real, xp: Any
    ) -> tuple[Counted, Reals]:
        counted = tuple(
            a + omega * since for a, omega in zip(memory.counted, measured, strict=True)
        )
        ticks = tuple(xp.floor(angle / self.tick + 0.5) for angle in counted)
        waited = memory.waiting + since
        time = xp.maximum(waited, AT_ONCE)
        speeds = tuple(
            (count - last) * self.tick / time
            for count, last in zip(ticks, memory.ticks, strict=True)
        )
        instant = memory._replace(before=memory.turned, counted=counted, waiting=waited)
        after = chosen(now, instant, memory, xp)
        after = chosen(arrives, after._replace(ticks=ticks, waiting=0.0), after, xp)
        return after, (*speeds, *ticks)
