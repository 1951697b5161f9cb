"""Effects that no catalogue lists: what an honest diagnosis must leave without a name.

Each overrides one hook of ``Outside`` and does nothing at size 0. Angles are the wheel's, in rad;
torques are in rad/s, as everywhere in ``effect_twin.py``.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Outside:
    """An effect that does nothing; the hooks of one fine step or one sample."""

    size: float = 0.0

    def extra_delay(self, t: float) -> float:
        """Dead time beyond the track's own at time t [s]."""
        return 0.0

    def stretch(self, drive: float) -> float:
        """Factor of the time constant under a drive."""
        return 1.0

    def torque(self, omega: float, angle: float, t: float, memory: list[float], h: float) -> float:
        """Torque against the track; ``memory`` are two numbers it may keep between steps."""
        return 0.0

    def release(self, chance: float, left: float, sample_time: float) -> float:
        """Seconds for which the gear slips, decided once a sample from a uniform number."""
        return 0.0


NONE = Outside()
"""No effect."""


@dataclass(frozen=True)
class SwingingDelay(Outside):
    """θ(t) = size (1 − cos(2π t/11 s))/2: a radio link that gets worse and better again."""

    def extra_delay(self, t: float) -> float:
        """As above [s]."""
        return self.size * 0.5 * (1.0 - math.cos(2.0 * math.pi * t / 11.0))


@dataclass(frozen=True)
class BoucWen(Outside):
    """Torque size·z, dz/dt = (ω − |ω| z)/8 rad: hysteresis that takes a turn to build up."""

    def torque(self, omega: float, angle: float, t: float, memory: list[float], h: float) -> float:
        """As above [rad/s]."""
        memory[0] += (omega - abs(omega) * memory[0]) * h / 8.0
        return self.size * memory[0]


@dataclass(frozen=True)
class CubicSpring(Outside):
    """Torque size·(q/10 rad)³, dq/dt = ω − q/4 s: a tether that hardens and creeps."""

    def torque(self, omega: float, angle: float, t: float, memory: list[float], h: float) -> float:
        """As above, at most three times ``size`` [rad/s]."""
        memory[0] += (omega - memory[0] / 4.0) * h
        return self.size * min(max((memory[0] / 10.0) ** 3, -3.0), 3.0)


@dataclass(frozen=True)
class BandedCogging(Outside):
    """±size while |sin angle/3| > 0.5, nothing in the bands between: a gear with bad sectors."""

    def torque(self, omega: float, angle: float, t: float, memory: list[float], h: float) -> float:
        """As above [rad/s]."""
        wave = math.sin(angle / 3.0)
        return math.copysign(self.size, wave) if abs(wave) > 0.5 else 0.0


@dataclass(frozen=True)
class DriveDependentLag(Outside):
    """τ (1 + size |d|): the more drive, the slower the track."""

    def stretch(self, drive: float) -> float:
        """As above."""
        return 1.0 + self.size * abs(drive)


@dataclass(frozen=True)
class SlippingGear(Outside):
    """At random the gear jumps out for ``size`` seconds, some six times a minute."""

    def release(self, chance: float, left: float, sample_time: float) -> float:
        """As above [s]."""
        return self.size if chance > 1.0 - 0.1 * sample_time and left <= 0.0 else max(left, 0.0)


@dataclass(frozen=True)
class PatchyFriction(Outside):
    """Torque ω·size·sin²(angle/40)·(1 − exp(−t/20 s)): drag by place that comes with warmth."""

    def torque(self, omega: float, angle: float, t: float, memory: list[float], h: float) -> float:
        """As above [rad/s]."""
        return omega * self.size * math.sin(angle / 40.0) ** 2 * (1.0 - math.exp(-t / 20.0))


@dataclass(frozen=True)
class Gusts(Outside):
    """Torque size·sin(2π t/7 s)·sin(2π t/3.1 s): a load from outside that keeps its own time."""

    def torque(self, omega: float, angle: float, t: float, memory: list[float], h: float) -> float:
        """As above [rad/s]."""
        return self.size * math.sin(2.0 * math.pi * t / 7.0) * math.sin(2.0 * math.pi * t / 3.1)


OUTSIDE: dict[str, tuple[type[Outside], tuple[float, float], str]] = {
    "other-1": (SwingingDelay, (0.25, 0.5), "delay that swings with time"),
    "other-2": (BoucWen, (3.0, 6.0), "Bouc-Wen hysteresis"),
    "other-3": (CubicSpring, (1.5, 4.0), "cubic spring that creeps"),
    "other-4": (BandedCogging, (2.0, 4.0), "cogging with dead bands"),
    "other-5": (DriveDependentLag, (2.0, 4.0), "time constant that grows with the drive"),
    "other-6": (SlippingGear, (0.4, 1.0), "gear that slips at random"),
    "other-7": (PatchyFriction, (0.6, 1.5), "drag by place and warmth"),
    "other-8": (Gusts, (2.0, 4.0), "load in a rhythm of its own"),
}
"""Ids: the effect, the range of its size, what it is."""
