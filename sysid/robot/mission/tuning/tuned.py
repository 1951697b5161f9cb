"""The result of a gain search: sets to choose from, the proposed one, and tuning rules."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sysid.data.documents import plain_object
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tuning.criteria import StepTest
from sysid.robot.mission.tuning.linear_loops import Margins


@dataclass(frozen=True)
class MarginRule:
    """Margins that a proposed set has where any set of the front has them.

    The usual least ones: half the gain or a twelfth of a turn of phase may be wrong.

    Attributes:
        gain: factor.
        phase_deg: [°].
    """

    gain: float = 2.0
    phase_deg: float = 30.0

    def kept(self, margins: Mapping[str, Margins]) -> bool:
        """Whether the loops of all axes keep them; loops without margins are not asked."""
        return all(
            m.stable and m.gain >= self.gain and m.phase_deg >= self.phase_deg
            for m in margins.values()
        )


SAFE = MarginRule()


@dataclass(frozen=True)
class GainSet:
    """One set of gains.

    Attributes:
        name: empty for a set of the front; else ``present`` or the rule it is from.
        criteria: the worst over the plants; None where there is none.
        margins: of speed and yaw with the estimated plant, where the law is linear.
        axes: whose gains a rule gives.
    """

    name: str
    gains: Mapping[str, float]
    criteria: Mapping[str, float | None]
    margins: Mapping[str, Margins]
    arrives: bool
    axes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Tuning:
    """What a search for gains came to.

    Attributes:
        front: sets of which none beats another in everything, the quickest to rise first.
        rules: gains from the plant alone, by rule.
        tried: criteria of every set that was driven and brought the robot to the goal.
        plants: each with so many plants, the estimated one among them.
    """

    mission: Mission
    front: tuple[GainSet, ...]
    proposed: int
    present: GainSet
    rules: tuple[GainSet, ...]
    test: StepTest
    tried: tuple[Mapping[str, float | None], ...]
    trials: int
    plants: int
    seed: int
    seconds: float
    notes: tuple[str, ...]

    @property
    def best(self) -> GainSet:
        return self.front[self.proposed]

    @property
    def extremes(self) -> dict[str, int]:
        """Members of the front that are best in one criterion, by what they are best in."""

        def worth(member: GainSet) -> dict[str, float]:
            c = {n: math.inf if v is None else v for n, v in member.criteria.items()}
            return {
                "quickest rise": c["rise_speed_s"] + c["rise_yaw_s"],
                "least overshoot": max(c["overshoot_speed"], c["overshoot_yaw"]),
                "shortest time": c["time_s"],
                "widest clearance": -c["min_clearance_m"],
                "least effort": c["effort"],
            }

        table = [worth(member) for member in self.front]
        best_rows = {w: min(range(len(table)), key=lambda k: table[k][w]) for w in table[0]}
        if self.best.criteria["min_clearance_m"] is None:  # no obstacles
            del best_rows["widest clearance"]
        return best_rows

    @property
    def sentence(self) -> str:
        named = ", ".join(f"{name} {value:g}" for name, value in self.best.gains.items())
        why = "nearest to the best of every criterion"
        if self.best.margins and SAFE.kept(self.best.margins):
            why += (
                f", with a gain margin of {SAFE.gain:g} and {SAFE.phase_deg:g}° of phase at least"
            )
        head = f"Proposed: {named}; of {len(self.front)} sets to choose from it is {why}."
        if self.best.margins and not SAFE.kept(self.best.margins):
            head += " No set of the front has the usual margins."
        speed, yaw = (self.best.criteria[f"error_{axis}"] for axis in ("speed", "yaw"))
        if speed is not None and yaw is not None:
            head += f" At the end of their steps V is off by {speed:.2g} % and ψ by {yaw:.2g} %."
        present, new = self.present.criteria["time_s"], self.best.criteria["time_s"]
        if not self.present.arrives:
            return f"{head} With the present gains the mission does not arrive."
        if present is None or new is None:
            return head
        if f"{present:.1f}" == f"{new:.1f}":
            return f"{head} The mission takes {new:.1f} s, as with the present gains."
        return f"{head} The mission takes {new:.1f} s, {present:.1f} s with the present gains."

    def summary(self) -> dict[str, Any]:
        """Everything but the sets that were beaten, as plain values for a JSON document."""
        best, steps = self.best, {"speed": self.test.speed, "turn": self.test.turn}
        names = ("proposed", "front", "present", "rules", "trials", "plants", "seed", "seconds")
        shown = {name: getattr(self, name) for name in (*names, "sentence")}
        chosen = {"gains": best.gains, "criteria": best.criteria, "margins": best.margins}
        return plain_object({**chosen, **shown, "steps": steps})
