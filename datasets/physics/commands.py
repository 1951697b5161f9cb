"""Schedules of commands in −1 … 1, shape (N, drives), from a generator and a sample time.

Each begins at rest for a second. ``joystick`` is what a person does who drives two tracks; the
others are those of identification.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Schedule = Callable[[np.random.Generator, int, float, int], Array]
"""Of randomness, samples, the time between them [s] and the number of drives."""

REST = 1.0
"""At the beginning [s]."""


def steps(rng: np.random.Generator, samples: int, dt: float, drives: int) -> Array:
    """Levels over the whole range in random order, one in six at rest, each for 0.5 to 2.5 s."""
    return _holds(rng, samples, dt, drives, (0.5, 2.5), _level)


def binary(rng: np.random.Generator, samples: int, dt: float, drives: int) -> Array:
    """Two levels, ± one size a track, changed at random after 0.3 to 1.5 s."""
    size = rng.uniform(0.4, 0.9)
    return _holds(rng, samples, dt, drives, (0.3, 1.5), lambda r: size * r.choice([-1.0, 1.0]))


def white(rng: np.random.Generator, samples: int, dt: float, drives: int) -> Array:
    """A new level ten times a second, uniform."""
    return _holds(rng, samples, dt, drives, (0.1, 0.1), lambda r: r.uniform(-1.0, 1.0))


def autoregressive(rng: np.random.Generator, samples: int, dt: float, drives: int) -> Array:
    """Coloured noise with a correlation time of 0.8 s, clipped at full drive."""
    pole = np.exp(-dt / 0.8)
    out, last = np.zeros((samples, drives)), np.zeros(drives)
    for k in range(samples):
        last = pole * last + np.sqrt(1.0 - pole**2) * 0.5 * rng.standard_normal(drives)
        out[k] = last
    return _rested(np.clip(out, -1.0, 1.0), dt)


def random_walk(rng: np.random.Generator, samples: int, dt: float, drives: int) -> Array:
    """A walk that turns back at full drive: 0.35 in the root of a second."""
    paths = np.cumsum(0.35 * np.sqrt(dt) * rng.standard_normal((samples, drives)), axis=0)
    folded = np.abs((paths + 1.0) % 4.0 - 2.0) - 1.0
    return _rested(folded, dt)


def multisine(rng: np.random.Generator, samples: int, dt: float, drives: int) -> Array:
    """Twelve equal sines of random phase between 0.05 and 1.5 Hz; drives share no frequency."""
    t = np.arange(samples) * dt
    tracks = []
    for k in range(drives):
        lines = np.geomspace(0.05, 1.5, 12 * drives)[k::drives]
        wave = np.cos(2.0 * np.pi * np.outer(t, lines) + rng.uniform(0.0, 2.0 * np.pi, 12)).sum(1)
        tracks.append(0.95 * wave / np.abs(wave).max())
    return _rested(np.column_stack(tracks), dt)


def joystick(rng: np.random.Generator, samples: int, dt: float, drives: int) -> Array:
    """A person drives: forward and turn by thumb, smooth within 0.15 s, pauses, few reversals."""
    ways: list[Array] = []
    length = 0
    while length < samples:
        forward = rng.choice([0.0, 1.0, -0.6], p=[0.2, 0.65, 0.15]) * rng.uniform(0.25, 1.0)
        turn = rng.choice([0.0, 1.0, -1.0], p=[0.4, 0.3, 0.3]) * rng.uniform(0.1, 0.7)
        if rng.uniform() < 0.15:
            forward = turn = 0.0
        count = max(round(rng.uniform(0.4, 3.0) / dt), 1)
        ways.append(np.tile([forward, turn], (count, 1)))
        length += count
    stick = np.concatenate(ways)[:samples]
    pole = np.exp(-dt / 0.15)
    last = np.zeros(2)
    for k in range(samples):
        last = pole * last + (1.0 - pole) * stick[k]
        stick[k] = last
    both = np.clip(np.column_stack([stick[:, 0] - stick[:, 1], stick.sum(axis=1)]), -1.0, 1.0)
    both[np.abs(both) < 0.02] = 0.0
    return _rested(both[:, :drives], dt)


SCHEDULES: dict[str, Schedule] = {
    "steps": steps,
    "binary": binary,
    "white": white,
    "autoregressive": autoregressive,
    "random-walk": random_walk,
    "multisine": multisine,
    "joystick": joystick,
}


def _level(rng: np.random.Generator) -> float:
    if rng.uniform() < 1.0 / 6.0:
        return 0.0
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 1.0))


def _holds(
    rng: np.random.Generator,
    samples: int,
    dt: float,
    drives: int,
    times: tuple[float, float],
    level: Callable[[np.random.Generator], float],
) -> Array:
    tracks = []
    for _ in range(drives):
        values: list[float] = []
        while len(values) < samples:
            values += [level(rng)] * max(round(rng.uniform(*times) / dt), 1)
        tracks.append(values[:samples])
    return _rested(np.array(tracks).T, dt)


def _rested(commands: Array, dt: float) -> Array:
    commands[: round(REST / dt)] = 0.0
    return commands
