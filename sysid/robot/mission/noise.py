"""Noise of the sensors of a run: standard normal numbers, drawn outside the loop."""

import itertools
import zlib
from collections.abc import Iterator

import numpy as np

from sysid.robot.mission.loop import Loop

_BLOCK = 256
"""Samples drawn at once: one call of the generator for each would cost more than the loop."""


def generator(seed: int, name: str) -> np.random.Generator:
    """The stream of one sensor in the run of this seed; another sensor does not change it."""
    return np.random.default_rng((seed, zlib.crc32(name.encode())))


def sensor_draws(loop: Loop, seed: int) -> Iterator[tuple[list[float], ...]]:
    """The numbers of sample after sample, a row for each sensor of the loop; without end."""
    if not loop.scene.sensors:
        yield from itertools.repeat(())
    streams = [(generator(seed, name), s.draws) for name, s in loop.scene.sensors.items()]
    while True:
        blocks = [stream.standard_normal((_BLOCK, n)).tolist() for stream, n in streams]
        yield from zip(*blocks, strict=True)
