"""Criteria of gains: step responses of speed and yaw, and the mission itself."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sysid.data.level_crossing import first_crossing
from sysid.data.record import Array
from sysid.robot.mission.batch.figures import Driven, Figures
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.guidance.steps import Steps
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.settings import ControlSettings
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tuning.axes import Axis, answer
from sysid.robot.mission.tuning.rules import lag_model


@dataclass(frozen=True)
class StepRule:
    """How a controller is asked for steps.

    Attributes:
        turn: step of the yaw [rad], then back to as much on the other side (thesis 6.15): the
            reversal stays below a half turn, whose sense is open.
        reached: share of the top speed of the plant that is asked at most: above it the command is
            on its limit, whatever the gains.
        lags: time for an answer, in lags and dead times of the plant: a loop that needs more is
            slower than a fifth of the plant by itself.
        shortest: time for an answer at least [s]; below it a control period hardly fits.
    """

    turn: float = math.radians(60.0)
    reached: float = 0.8
    lags: float = 20.0
    shortest: float = 2.0


RULE = StepRule()


@dataclass(frozen=True)
class StepTest:
    """A step of the speed, then a step of the yaw, then its reversal, in one run.

    Attributes:
        speed: asked from the start on [m/s].
        turn: of the yaw [rad].
        yaw_at, back_at, until: instants of the step of the yaw, of its reversal, of the end [s].
    """

    speed: float
    turn: float
    yaw_at: float
    back_at: float
    until: float

    @classmethod
    def of(cls, mission: Mission, robot: SteppablePlant) -> "StepTest":
        """Steps that suit a mission and a plant.

        The speed is the largest that guidance asks for, or :attr:`StepRule.reached` of what the
        plant reaches. Times are whole control periods.
        """
        control, geometry = mission.control, mission.vehicle.geometry
        along, around = (answer(robot, geometry, axis) for axis in Axis)
        limits = [_limit(control, key) for key in ("v_cmd_max", "psi_cmd_max")]
        speed = min(mission.guidance.traits.top_speed, RULE.reached * limits[0] * abs(along.gain))
        waits = []
        for seen, way in ((along, 0.0), (around, 2 * RULE.turn / (limits[1] * abs(around.gain)))):
            lag = lag_model(seen, control.period)
            wait = max(RULE.shortest, way + RULE.lags * (lag.lag + lag.dead_time))
            waits.append(control.period * math.ceil(wait / control.period))
        yaw_at, back_at = waits[0], waits[0] + waits[1]
        return cls(speed, RULE.turn, yaw_at, back_at, back_at + waits[1])

    def mission(self, given: Mission) -> Mission:
        """The run of a mission's vehicle, laws and sensors, without goal and obstacles."""
        steps = Steps(
            speed=((0.0, self.speed),),
            yaw=((0.0, 0.0), (self.yaw_at, self.turn), (self.back_at, -self.turn)),
            until=self.until,
        )
        nothing: dict[str, object] = dict.fromkeys(
            ("obstacles", "walls", "polygons", "waypoints", "path"), ()
        )
        far = {"start": (0.0, 0.0, 0.0), "goal": (1e3, 0.0)}
        longer = {"timeout": self.until + 10 * given.control.period}
        return given.model_copy(update={**nothing, **far, **longer, "guidance": steps})


def _limit(control: object, key: str) -> float:
    """A limit of the commands; 1 is full drive, for controllers that have no such limit."""
    return float(getattr(control, key, 1.0)) if isinstance(control, ControlSettings) else 1.0


class Criteria(NamedTuple):
    """What sets of gains came to, one entry each, all of them to be made small but the clearance.

    Attributes:
        rise_speed_s, rise_yaw_s: from 10 to 90 % of the step [s]; infinite where 90 % are never
            reached.
        overshoot_speed, overshoot_yaw: beyond the step, of the yaw the larger one of step and
            reversal [%].
        error_speed, error_yaw: what is left to their references at the end of their steps, of the
            yaw the larger one of step and reversal [% of the step].
        time_s: of the mission [s].
        min_clearance_m: of the mission [m]; infinite without obstacles.
        effort: of the mission, ∫ (V_cmd² + ψ_cmd²) dt [s].
        arrives: whether the mission arrives, as 0 or 1.
    """

    rise_speed_s: Array
    rise_yaw_s: Array
    overshoot_speed: Array
    overshoot_yaw: Array
    error_speed: Array
    error_yaw: Array
    time_s: Array
    min_clearance_m: Array
    effort: Array
    arrives: Array

    def worst(self, plants: int) -> "Criteria":
        """The worst of each criterion over plants, where every set drove ``plants`` in a row."""

        def over(name: str) -> Array:
            table = getattr(self, name).reshape(-1, plants)
            better = name in ("min_clearance_m", "arrives")
            return np.asarray(table.min(axis=1) if better else table.max(axis=1))

        return Criteria(*(over(name) for name in self._fields))

    def of(self, k: int) -> dict[str, float | None]:
        """Those of one set, by name; None where there is none to be had."""
        values = {name: float(getattr(self, name)[k]) for name in NAMES}
        return {n: v if math.isfinite(v) else None for n, v in values.items()}

    @property
    def answers(self) -> Array:
        """Whether both steps reach 90 %, (K,)."""
        return np.asarray(np.isfinite(self.rise_speed_s) & np.isfinite(self.rise_yaw_s))

    def objectives(self, obstacles: bool) -> Array:
        """Rise, overshoot, time, effort and, with obstacles, less clearance: (K, 4 or 5).

        Of both axes the rises are added, and the larger overshoot counts. A rise without an end
        counts as :data:`NEVER`.
        """
        columns = [
            np.minimum(self.rise_speed_s + self.rise_yaw_s, NEVER),
            np.maximum(self.overshoot_speed, self.overshoot_yaw),
            self.time_s,
            self.effort,
        ]
        return np.stack([*columns, -self.min_clearance_m] if obstacles else columns, axis=1)


SHOWN = ("v", "psi")
"""Columns of the log that a step test looks at: forward speed [m/s] and yaw [rad]."""

NEVER = 1e6
"""A rise longer than any mission [s]."""

NAMES = tuple(name for name in Criteria._fields if name != "arrives")
"""Reported criteria."""


@dataclass(frozen=True)
class Resolution:
    """Negligible differences: about those between repeated drives.

    Attributes:
        rise: s, at least a control period.
        overshoot: %.
        time: share of the shortest.
        effort: share of the least.
        clearance: m.
    """

    rise: float = 0.1
    overshoot: float = 2.0
    time: float = 0.01
    effort: float = 0.02
    clearance: float = 0.02

    def of(self, objectives: Array, period: float) -> Array:
        """For every column of :meth:`Criteria.objectives`."""
        _, _, time, effort = objectives.min(axis=0)[:4]
        steps = [max(self.rise, period), self.overshoot, self.time * time, self.effort * effort]
        steps.append(self.clearance)
        return np.maximum(steps[: objectives.shape[1]], 1e-9)  # also for an effort of 0


def criteria(test: StepTest, answers: Driven, drives: Figures) -> Criteria:
    """The criteria of runs.

    The speed is measured by its reference. Of the yaw it is the change that counts, from where it
    was to as far as was asked: tracks that differ hold a controller without an integral a little
    off any reference, which is no overshoot.

    Args:
        answers: the runs of the test, with rows of :data:`SHOWN`.
        drives: of the mission with the same gains and plants.
    """
    t, (v, psi) = answers.t, np.moveaxis(answers.rows, 1, 0)
    first = t < test.yaw_at
    second = (t >= test.yaw_at) & (t < test.back_at)
    third = t >= test.back_at
    psi = np.unwrap(psi, axis=0)
    rise_speed, over_speed = _step(t[first], v[first] / test.speed)
    rise_yaw, over_step = _step(t[second], (psi[second] - psi[second][0]) / test.turn)
    _, over_back = _step(t[third], (psi[third][0] - psi[third]) / (2.0 * test.turn))
    failed = answers.figures.verdict != Verdict.ARRIVED  # whose numbers are none
    return Criteria(
        np.where(failed, np.inf, rise_speed),
        np.where(failed, np.inf, rise_yaw),
        over_speed,
        np.maximum(over_step, over_back),
        _left(v[first] / test.speed),
        np.maximum(_left(psi[second] / test.turn), _left(-psi[third] / test.turn)),
        drives.time_s,
        drives.min_clearance_m,
        drives.effort,
        (drives.verdict == Verdict.ARRIVED).astype(np.float64),
    )


def _step(t: Array, share: Array) -> tuple[Array, Array]:
    """Rise from 10 to 90 % [s] and overshoot [%] of answers in shares of their step, (T, K)."""
    with np.errstate(invalid="ignore"):
        rise = first_crossing(t, share, 0.9) - first_crossing(t, share, 0.1)
    return np.where(np.isnan(rise), np.inf, rise), 100.0 * np.maximum(
        0.0, np.max(share, axis=0) - 1.0
    )


def _left(share: Array) -> Array:
    """Steady-state error |1 − share| of the last tenth of answers (T, K), its mean, [%]."""
    return np.asarray(100.0 * np.abs(1.0 - share[-max(1, len(share) // 10) :].mean(axis=0)))
