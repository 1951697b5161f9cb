"""Late or out-of-order measurements: buffered, and used at their instant.

A measurement that comes ``d`` samples after the instant it is of is put into the sample ``d`` back,
and the filter runs again from there (replay). That gives, to the last bit, what the filter would
have given had the measurement come in time, at the price of ``d`` more steps at samples where one
comes; between them nothing is repeated. The memory is bounded by the longest delay of the sensors.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from sysid.robot.mission.navigation.flow import compiled, repeated
from sysid.runners.trees import mapped
from sysid.vehicle.kinematics import Real


class BufferedSample(NamedTuple):
    """What a filter is given for one sample.

    Attributes:
        dt: time since the sample before [s].
        drive: mean command of both tracks [drive].
        z: the values of each group of measurements for this sample, (m,) each; NaN where nothing
            came.
        fresh: which groups came now, (groups,); the others were used before.
    """

    dt: Real
    drive: Real
    z: tuple[Any, ...]
    fresh: Any


class History(NamedTuple):
    """The last samples, the newest last; leaves have them along axis 0.

    Attributes:
        beliefs: what the filter believed after each.
    """

    samples: BufferedSample
    beliefs: Any


Fuse = Callable[[Any, BufferedSample], tuple[Any, Any]]
"""From a belief and the next sample to the belief after it and figures that add up."""


def begun(belief: Any, empty: BufferedSample, longest: int, xp: Any) -> History | tuple[()]:
    """The history before the first sample; nothing where no measurement is ever late."""
    if longest == 0:
        return ()
    rows = longest + 2  # a belief before the oldest slot that may still change
    return History(*(mapped(lambda leaf: xp.array([leaf] * rows), t) for t in (empty, belief)))


def advanced(
    fuse: Fuse, history: History, sample: BufferedSample, delays: tuple[int, ...], xp: Any
) -> tuple[History, Any]:
    """Put a sample with all that came at it into the history.

    Args:
        history: before it.
        sample: the sample; measurements that are late stand in ``z`` as they came.
        delays: of each group [samples].

    Returns:
        The history whose newest belief is that of this sample, and the sum of the figures of all
        measurements that came at it.
    """
    came = [xp.isfinite(z).any() for z in sample.z]

    def shifted(rows: Any, new: Any) -> Any:
        return xp.concatenate([rows[1:], xp.array([new])])

    slots = mapped(shifted, history.samples, sample)
    samples = _with_measurements(slots, sample, came, delays, xp)
    beliefs = mapped(shifted, history.beliefs, newest(history))
    rows = len(samples.dt)
    # what is compiled replays all rows, whatever came: runs side by side differ in that
    came_late = (d for d, c in zip(delays, came, strict=True) if c)
    oldest = rows - 2 if compiled(xp) else max(came_late, default=0)
    first = rows - 1 - oldest

    def step(belief: Any, given: BufferedSample) -> tuple[Any, Any]:
        belief, figures = fuse(belief, given)
        return belief, (belief, figures)

    before = mapped(lambda leaf: leaf[first - 1], beliefs)
    _, (after, figures) = repeated(xp, step, before, samples, first)
    joined = mapped(lambda old, new: xp.concatenate([old[:first], new]), beliefs, after)
    return History(samples, joined), mapped(lambda leaf: leaf.sum(axis=0), figures)


def newest(history: History) -> Any:
    """The belief of the newest sample."""
    return mapped(lambda leaf: leaf[-1], history.beliefs)


def _with_measurements(
    samples: BufferedSample,
    sample: BufferedSample,
    came: list[Any],
    delays: tuple[int, ...],
    xp: Any,
) -> BufferedSample:
    """The slots with every measurement at the sample it is of, and marked there as fresh."""
    rows = len(samples.dt)
    index = xp.arange(rows)
    z, fresh = [], []
    for old, new, c, d in zip(samples.z, sample.z, came, delays, strict=True):
        here = index == rows - 1 - d
        # The newest row holds what came now, which for late measurements is not of now.
        kept = xp.where((index == rows - 1)[:, None], xp.nan, old)
        z.append(xp.where((here & c)[:, None], new, kept))
        fresh.append(here & c)
    return samples._replace(z=tuple(z), fresh=xp.array(fresh).T * 1.0)
