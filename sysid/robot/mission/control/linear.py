"""P, PI, PD and PID along one axis, with filter, feed-forward and a choice of anti-windup.

Source: Åström and Hägglund, Advanced PID Control (2006), sections 3.2 to 3.5.
"""

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from sysid.robot.mission.axis import AxisInputs
from sysid.robot.mission.settings import AxisSettings, Gain, Search
from sysid.vehicle.kinematics import Real

AntiWindup = Literal["conditional", "back-calculation", "none"]

Share = Annotated[float, Field(ge=0, le=2)]
FilterTime = Annotated[float, Field(ge=0, le=60)]
TrackingTime = Annotated[float, Field(ge=1e-3, le=600)]

TINY = 1e-9
"""Keeps a gain of zero out of a divisor."""


class PIDState(NamedTuple):
    """What a PID remembers.

    Attributes:
        integral: of the error, times its gain [drive].
        asked: the last command before its limits [drive].
        rate: the filtered rate of the measured value.
    """

    integral: Real
    asked: Real
    rate: Real


class PIDTerms(NamedTuple):
    """The numbers of a PID in parallel form; a kind that lacks one leaves it at its default.

    Attributes:
        kp, ki, kd: gains on the error, its integral and the rate of the measured value.
        filter_time: T_f of the derivative's filter [s].
        feed_forward: F, share of the drive with which the plant keeps to what is asked.
        anti_windup: what keeps the integral from growing while the command is on a limit.
        tracking_time: T_t of back-calculation [s]; None for K_p/K_i.
    """

    kp: Real
    ki: Real = 0.0
    kd: Real = 0.0
    filter_time: Real = 0.0
    feed_forward: Real = 0.0
    anti_windup: AntiWindup = "none"
    tracking_time: Real | None = None


def pid_step(
    state: PIDState, inputs: AxisInputs, dt: Real, terms: PIDTerms, xp: Any
) -> tuple[PIDState, Real]:
    """Return the next state and the command [drive].

    d = sat(K_p e + I − K_d v̇_f + F d_h),  I ← I + K_i e T,  v̇_f ← v̇_f + T/(T_f + T)(v̇ − v̇_f)

    with d_h the drive with which the identified plant keeps to what is asked. The derivative acts
    on the measured value: a jump of the reference gives no kick. Back-calculation adds
    (d_acted − d_asked) T/T_t to the integral, d_acted as far as it is known of the instant before.

    Args:
        dt: T, time since then [s].
    """
    integral = state.integral
    if terms.anti_windup == "back-calculation":
        tracking_time = terms.tracking_time
        if tracking_time is None:
            tracking_time = terms.kp / xp.maximum(terms.ki, TINY)
        share = xp.minimum(dt / xp.maximum(tracking_time, TINY), 1.0)
        integral = integral + share * (inputs.applied - state.asked)
    rate = state.rate + dt / (terms.filter_time + dt) * (inputs.rate - state.rate)
    grown = integral + terms.ki * inputs.error * dt
    asked = terms.kp * inputs.error + grown
    asked = asked - terms.kd * rate + terms.feed_forward * inputs.wanted / inputs.plant.gain
    if terms.anti_windup == "conditional":
        grown = conditional(grown, integral, asked, (inputs.low, inputs.high), xp)
    return PIDState(grown, asked, rate), xp.clip(asked, inputs.low, inputs.high)


def conditional(
    grown: Real, before: Real, command: Real, limits: tuple[Real, Real], xp: Any
) -> Real:
    """The integral after conditional integration: what pushes beyond a limit is not added.

    Args:
        grown, before: the integral with and without this sample.
        command: before its limits.
    """
    low, high = limits
    return xp.where(
        command > high,
        xp.minimum(grown, before),
        xp.where(command < low, xp.maximum(grown, before), grown),
    )


class P(AxisSettings):
    """d = sat(K_p e + F d_h), d_h the drive with which the plant keeps to what is asked.

    Attributes:
        kp: on the error [drive per m/s, drive per rad].
        feed_forward: F, share of d_h; without it a speed falls far short of its reference.
    """

    kp: Annotated[Gain, Search(0.1, 10.0)] = 2.0
    feed_forward: Share = 1.0

    @property
    def uses_plant(self) -> bool:
        return self.feed_forward > 0.0

    def start(self, scene: Any, xp: Any) -> PIDState:
        return PIDState(0.0, 0.0, 0.0)

    def step(self, state: PIDState, inputs: AxisInputs, dt: Real, xp: Any) -> tuple[PIDState, Real]:
        keys = type(self).model_fields
        terms = PIDTerms(**{n: getattr(self, n) for n in PIDTerms._fields if n in keys})
        return pid_step(state, inputs, dt, terms, xp)


class PI(P):
    """P with an integral: d = sat(K_p e + I + F d_h).

    Attributes:
        ki: on the integral of the error [drive per m, drive per rad s].
        anti_windup: ``conditional`` adds nothing that pushes beyond a limit; ``back-calculation``
            leads back what did not act; ``none`` lets the integral grow.
        tracking_time: of back-calculation [s]; kp/ki where it is left out.
    """

    feed_forward: Share = 0.0
    ki: Annotated[Gain, Search(0.0, 10.0)] = 1.85
    anti_windup: AntiWindup = "conditional"
    tracking_time: TrackingTime | None = None


class PD(P):
    """P with a filtered derivative: d = sat(K_p e − K_d v̇_f + F d_h).

    Attributes:
        kd: on the rate of the measured value [drive per m/s², drive per rad/s].
        filter_time: time constant of the derivative's filter [s].
    """

    kd: Annotated[Gain, Search(0.0, 1.0)] = 0.05
    filter_time: FilterTime = 0.1


class PID(PI):
    """PI with a filtered derivative: d = sat(K_p e + I − K_d v̇_f + F d_h).

    Attributes:
        kd: on the rate of the measured value [drive per m/s², drive per rad/s].
        filter_time: time constant of the derivative's filter [s].
    """

    kd: Annotated[Gain, Search(0.0, 1.0)] = 0.05
    filter_time: FilterTime = 0.1


class YawP(P):
    """P of the yaw, with the thesis's gain (6.2)."""

    kp: Annotated[Gain, Search(0.05, 2.0)] = 0.4
    feed_forward: Share = 0.0


class YawPI(PI):
    """PI of the yaw: a little integral against tracks that differ."""

    kp: Annotated[Gain, Search(0.05, 2.0)] = 0.4
    ki: Annotated[Gain, Search(0.0, 1.0)] = 0.1


class YawPD(PD):
    """PD of the yaw: damped, so that it may be twice as strong."""

    kp: Annotated[Gain, Search(0.05, 2.0)] = 0.6
    feed_forward: Share = 0.0
    kd: Annotated[Gain, Search(0.0, 0.5)] = 0.05


class YawPID(PID):
    """PID of the yaw."""

    kp: Annotated[Gain, Search(0.05, 2.0)] = 0.6
    ki: Annotated[Gain, Search(0.0, 1.0)] = 0.1
    kd: Annotated[Gain, Search(0.0, 0.5)] = 0.05
