"""Controllers of P, PI, PD or PID along their axes: gains by the rules, and margins."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.control.linear import P
from sysid.robot.mission.settings import TunedSettings
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tuning.axes import Axis, answer
from sysid.robot.mission.tuning.gain_space import gain_of
from sysid.robot.mission.tuning.margins import Margins, SampledLoop
from sysid.robot.mission.tuning.rules import Gains, from_edge, from_lag, lag_model

_FLAT = {
    Axis.SPEED: {"kp": "kp_speed", "ki": "ki_speed", "kd": "kd_speed"},
    Axis.YAW: {"kp": "kp_yaw", "ki": "ki_yaw", "kd": "kd_yaw"},
}
"""How a controller of both axes at once names the gains of each."""

_PARTS = {
    frozenset({"kp"}): "p",
    frozenset({"kp", "ki"}): "pi",
    frozenset({"kp", "kd"}): "pd",
    frozenset({"kp", "ki", "kd"}): "pid",
}
"""The kind that gains make."""


class RuleGains(NamedTuple):
    """What a rule proposes.

    Attributes:
        axes: for which it has gains; the others keep the mission's.
        gains: of the controller, by name.
    """

    name: str
    axes: tuple[str, ...]
    gains: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class LinearLoops:
    """The loops of both axes around the estimated plant, as far as they are linear."""

    mission: Mission
    robot: SteppablePlant

    @cached_property
    def keys(self) -> Mapping[Axis, Mapping[str, str]]:
        """Names of kp, ki and kd of each axis whose law is of such gains alone."""
        control, by_axis = self.mission.control, {}
        if not isinstance(control, TunedSettings):
            return {}
        for axis in Axis:
            law = getattr(control, axis.value, None)
            if isinstance(law, P):
                by_axis[axis] = {n: f"{axis.value}.{n}" for n in law.gains}
            elif law is None:
                keys = {n: key for n, key in _FLAT[axis].items() if key in control.gains}
                if frozenset(keys) in _PARTS:
                    by_axis[axis] = keys
        return by_axis

    @cached_property
    def _answers(self) -> Mapping[Axis, SampledLoop]:
        geometry, period = self.mission.vehicle.geometry, self.mission.control.period
        return {a: SampledLoop.of(answer(self.robot, geometry, a), period) for a in self.keys}

    def margins(self, gains: Mapping[str, float]) -> dict[str, Margins]:
        """Margins of each axis whose law is linear; of the others there are none."""
        margins = {}
        for axis, names in self.keys.items():
            axis_gains = Gains(**{n: gains[key] for n, key in names.items()})
            law = getattr(self.mission.control, axis.value, None)
            axis_gains = replace(axis_gains, filter_time=float(getattr(law, "filter_time", 0.0)))
            margins[axis.value] = self._answers[axis].margins(axis_gains)
        return margins

    def stable(self, gains: Mapping[str, float]) -> bool:
        """Whether no linear loop is unstable; such a one swings between limits of the command."""
        return all(m.stable for m in self.margins(gains).values())

    def rules(self) -> tuple[RuleGains, ...]:
        """The gains that rules read off the plant, where they know the kind of a law."""
        period, geometry = self.mission.control.period, self.mission.vehicle.geometry
        by_rule: dict[str, dict[str, float]] = {}
        axes: dict[str, list[str]] = {}
        for axis, names in self.keys.items():
            kind = _PARTS[frozenset(names)]
            lag = lag_model(answer(self.robot, geometry, axis), period)
            sets = dict(from_lag(axis, lag))
            edge = self._answers[axis].edge()
            if edge is not None:
                sets["ziegler-nichols-edge"] = from_edge(*edge)
            for rule, kinds in sets.items():
                if kind in kinds:
                    axis_gains = {key: getattr(kinds[kind], n) for n, key in names.items()}
                    by_rule.setdefault(rule, {}).update(axis_gains)
                    axes.setdefault(rule, []).append(axis.value)
        control = self.mission.control
        whole = control.gains if isinstance(control, TunedSettings) else {}
        return tuple(
            RuleGains(
                rule, tuple(axes[rule]), {n: axis_gains.get(n, gain_of(control, n)) for n in whole}
            )
            for rule, axis_gains in by_rule.items()
        )
