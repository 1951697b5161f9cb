"""Noise of the sensors of a run: standard normal numbers, drawn outside the loop."""

import itertools
import zlib
from collections.abc import Iterator

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.loop import Loop

_BLOCK = 256
"""Samples drawn at once: one call of the generator for each would cost more than the loop."""


def generator(seed: int, name: str) -> np.random.Generator:
    """The stream of one sensor in the run of this seed; another sensor does not change it."""
    return np.random.default_rng((seed, zlib.crc32(name.encode())))


def sensor_draws(loop: Loop, seed: int) -> Iterator[tuple[list[float], ...]]:
    """The numbers of sample after sample, a row for each sensor of the loop; without end.

    Args:
        loop: whose sensors say how many numbers each of them needs.
        seed: of the run, at least 0.
    """
    if not loop.scene.sensors:
        return itertools.repeat(())
    streams = [generator(seed, name) for name in loop.scene.sensors]
    return _rows(streams, loop.draws)


def _rows(
    streams: list[np.random.Generator], counts: tuple[int, ...]
) -> Iterator[tuple[list[float], ...]]:
    while True:
        blocks = [block(s, n, _BLOCK).tolist() for s, n in zip(streams, counts, strict=True)]
        yield from zip(*blocks, strict=True)


def block(stream: np.random.Generator, count: int, samples: int) -> Array:
    """The next numbers of a stream, (samples, count): the same however they are divided."""
    return stream.standard_normal((samples, count))
