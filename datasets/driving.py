"""How a robot is driven in a log with a hidden effect: PWM (left, right) [µs], shape (N, 2).

Every style keeps the tracks apart enough to tell them from each other, uses the whole range, both
directions and rest, and begins with one second at zero. ``driving`` is what a person with a
joystick does; the others are designed.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING or __package__:
    from sysid_datasets.effect_robot import DISTANCE, PWM_FULL, RADIUS
    from sysid_datasets.effect_twin import Driver
else:  # run as a file, from a checkout in which nothing is installed
    from effect_robot import DISTANCE, PWM_FULL, RADIUS
    from effect_twin import Driver

Pwm = NDArray[np.int64]
Style = Callable[[np.random.Generator, int, float], Pwm]
"""From a source of randomness, a number of samples and the time between them to commands."""

LEAD_IN = 1.0
"""Rest at the beginning [s]."""


def prbs(rng: np.random.Generator, samples: int, sample_time: float) -> Pwm:
    """Random telegraph signals: ±level, or level and zero, for 6 to 12 s, then another level.

    Six levels from 4500 to 19500 come in random order before any comes again.
    """

    def track() -> list[float]:
        values: list[float] = []
        deck: list[float] = []
        while len(values) < samples:
            deck = deck or rng.permutation(np.linspace(4500.0, 19500.0, 6)).tolist()
            level, low = deck.pop(), (-1.0, -1.0, 0.0)[int(rng.integers(3))]
            sense = 1.0 if rng.random() < 0.5 else -1.0
            clock = max(1, round(rng.uniform(0.3, 0.9) / sample_time))
            for _ in range(max(1, round(rng.uniform(6.0, 12.0) / sample_time / clock))):
                bit = 1.0 if rng.random() < 0.5 else low
                values += [sense * level * bit] * clock
        return values

    return _from_rest(track(), track(), samples, sample_time)


def steps(rng: np.random.Generator, samples: int, sample_time: float) -> Pwm:
    """Levels evenly over −20000 … 20000 in random order, one in six zero, for 0.5 to 2 s each."""

    def track() -> list[float]:
        deck = np.concatenate([np.linspace(-PWM_FULL, PWM_FULL, 40), np.zeros(8)])
        values: list[float] = []
        while len(values) < samples:
            for level in rng.permutation(deck).tolist():
                values += [level] * max(1, round(rng.uniform(0.5, 2.0) / sample_time))
        return values

    return _from_rest(track(), track(), samples, sample_time)


def multisine(rng: np.random.Generator, samples: int, sample_time: float) -> Pwm:
    """Sines from one period in the log to 1 Hz, falling as 1/√f; the tracks share no frequency."""
    seconds = samples * sample_time
    t = sample_time * np.arange(samples)
    waves = []
    for first in (1, 2):
        lines = np.arange(first, max(seconds, 4.0) + 1e-9, 2.0)[:, None] / seconds
        phases = rng.uniform(0.0, 2.0 * np.pi, (24, len(lines), 1))
        draws = (np.cos(2.0 * np.pi * lines * t + phases) / np.sqrt(lines)).sum(axis=1)
        peaks = np.abs(draws).max(axis=1)
        best = int(np.argmin(peaks))
        waves.append((PWM_FULL * draws[best] / peaks[best]).tolist())
    return _from_rest(waves[0], waves[1], samples, sample_time)


def pulses(rng: np.random.Generator, samples: int, sample_time: float) -> Pwm:
    """A pulse, rest, the opposite pulse, rest; heights and lengths at random, tracks in step."""
    left: list[float] = []
    right: list[float] = []
    while len(left) < samples:
        heights = rng.uniform(3000.0, PWM_FULL, 2) * rng.choice([-1.0, 1.0], 2)
        on = max(1, round(rng.uniform(0.8, 2.0) / sample_time))
        rest = max(1, round(rng.uniform(0.6, 1.5) / sample_time))
        for sense in (1.0, -1.0):
            left += [sense * float(heights[0])] * on + [0.0] * rest
            right += [sense * float(heights[1])] * on + [0.0] * rest
    return _from_rest(left, right, samples, sample_time)


def driving(rng: np.random.Generator, samples: int, sample_time: float) -> Pwm:
    """A joystick: forward and turn glide to a new place in 0.2 to 0.8 s and stay 0.4 to 2.5 s.

    One place in six is rest, one in three reverses; the glide is the minimum-jerk curve
    10s³ − 15s⁴ + 6s⁵ (Flash & Hogan 1985). Left is forward − turn, right forward + turn.
    """
    here = np.zeros(2)
    values: list[NDArray[np.float64]] = []
    while len(values) < samples:
        kind = rng.random()
        there = np.array([rng.uniform(0.15, 1.0), rng.uniform(-0.5, 0.5) * rng.integers(2)])
        if kind < 1.0 / 6.0:
            there = np.zeros(2)
        elif kind < 0.5:
            there[0] *= -math.copysign(1.0, here[0])
        elif kind < 0.6:
            there[0] = 0.0
            there[1] = rng.uniform(0.2, 0.9) * rng.choice([-1.0, 1.0])
        else:
            there[0] *= math.copysign(1.0, here[0])
        glide = max(1, round(rng.uniform(0.2, 0.8) / sample_time))
        s = np.arange(1, glide + 1)[:, None] / glide
        values += list(here + (there - here) * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5))
        values += [there] * round(rng.uniform(0.4, 2.5) / sample_time)
        here = there
    stick = np.array(values)
    tracks = PWM_FULL * np.clip(stick @ np.array([[1.0, 1.0], [-1.0, 1.0]]), -1.0, 1.0)
    return _from_rest(tracks[:, 0].tolist(), tracks[:, 1].tolist(), samples, sample_time)


STYLES: dict[str, Style] = {
    "prbs": prbs,
    "steps": steps,
    "multisine": multisine,
    "driving": driving,
    "pulses": pulses,
}


def speed_loop(reference: Pwm, gains: tuple[float, float], sample_time: float) -> Driver:
    """A PI controller per track that makes the readings follow K·reference/20000.

    PWM = 20000 (0.8 r/K + 0.6 e/K + 2 s⁻¹ ∫e dt/K), the integral frozen while the command is at
    its limit; r and e in rad/s, K the nominal gain of the track.
    """
    wanted = (reference / PWM_FULL * np.array(gains)).tolist()
    integral = [0.0, 0.0]

    def drive(k: int, readings: tuple[float, float]) -> list[float] | None:
        if k >= len(wanted):
            return None
        commands = []
        for i in (0, 1):
            error = wanted[k][i] - readings[i]
            grown = integral[i] + error * sample_time
            raw = (0.8 * wanted[k][i] + 0.6 * error + 2.0 * grown) / gains[i]
            if abs(raw) <= 1.0:
                integral[i] = grown
            commands.append(float(round(PWM_FULL * min(max(raw, -1.0), 1.0))))
        return commands

    return drive


def mission_loop(goal: tuple[float, float], sample_time: float) -> Driver:
    """The thesis's loop to a goal without obstacles; ends within 0.1 m of it.

    Odometry from the readings; V_ref = 0.6/(2 + 0.4/ρ) m/s; PI 2, 1.85 on speed in 0 … 1, the
    integral frozen at the limits; P 0.4 on yaw in ±0.3; PWM = 20000 (V ∓ ψ), clipped.
    """
    place = [0.0, 0.0, 0.0]
    memory = [0.0, 0.0, 0.0]

    def drive(k: int, readings: tuple[float, float]) -> list[float] | None:
        left, right = (RADIUS * w for w in readings)
        if k > 0:
            way = 0.25 * sample_time * (memory[1] + left + memory[2] + right)
            turn = 0.5 * sample_time * (memory[2] + right - memory[1] - left) / DISTANCE
            place[0] += way * math.cos(place[2] + 0.5 * turn)
            place[1] += way * math.sin(place[2] + 0.5 * turn)
            place[2] += turn
        memory[1], memory[2] = left, right
        away = (goal[0] - place[0], goal[1] - place[1])
        distance = math.hypot(*away)
        if distance <= 0.1:
            return None
        error = 0.6 / (2.0 + 0.4 / distance) - 0.5 * (left + right)
        speed = 2.0 * error + 1.85 * (memory[0] + error * sample_time)
        if 0.0 <= speed <= 1.0:
            memory[0] += error * sample_time
        turn = math.remainder(math.atan2(away[1], away[0]) - place[2], 2.0 * math.pi)
        speed, turn = min(max(speed, 0.0), 1.0), min(max(0.4 * turn, -0.3), 0.3)
        pair = (speed - turn, speed + turn)
        return [float(round(PWM_FULL * min(max(v, -1.0), 1.0))) for v in pair]

    return drive


def _from_rest(left: list[float], right: list[float], samples: int, sample_time: float) -> Pwm:
    rest = min(samples, round(LEAD_IN / sample_time))
    pwm = np.rint(np.column_stack([left[:samples], right[:samples]])).astype(np.int64)
    return np.concatenate([np.zeros((rest, 2), dtype=np.int64), pwm[: samples - rest]])
