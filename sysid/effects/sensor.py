"""Effects of the sensor: they change the measurement, not the motion."""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Hints,
    Memory,
    Place,
    Signal,
    StartsFrom,
    State,
    Texts,
)
from sysid.effects.lag import lagging_reading
from sysid.effects.programmes import COASTING, LEVELS, RESTS, REVERSALS, TOP

P = Mapping[str, Signal]


def _lag(xp: Any, y: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s: last reading, last speed
    read = p["decay"] * s[0] + p["earlier"] * s[1] + p["now"] * y
    return read, (read, y)


def _saturation(xp: Any, y: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return xp.minimum(xp.maximum(y, -p["limit"]), p["limit"]), s


def _bias(xp: Any, y: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return y + p["bias"], s


EFFECTS = (
    Effect(
        "sensor-lag",
        "sensor",
        Place.READING,
        Texts(
            "λ ẏ = ω − y",
            "The measurement follows the speed with a lag: a filter in the sensor.",
            "Everything is smoothed and late.",
            "Fast reversals sampled fast.",
            by_hand="Two lags in a row can change places. Measure the speed in another way as well "
            "(a pose in the log, a camera), or turn the wheel by hand: only a lag of the sensor is "
            "seen there.",
        ),
        (EffectParameter("lag", "s", 0.0, 0.0, 40.0, (1.0, 6.0), in_samples=True),),
        _lag,
        lagging_reading,
        memory=Memory(
            2,
        ),
        hints=Hints(
            ties=("actuator-lag",),
            programmes=(REVERSALS, TOP),
            beyond_sampling=True,
            exchanges="lag",
        ),
    ),
    Effect(
        "unsigned-speed",
        "sensor",
        Place.READING,
        Texts(
            "y → |y|",
            "The sensor does not see the direction.",
            "No measurement is negative although the command reverses.",
            "Reversals.",
        ),
        (EffectParameter("on", "", 0.0, 0.0, 1.0, (1.0,), choice=True),),
        lambda xp, y, s, p, c: (y + p["on"] * (xp.abs(y) - y), s),
        hints=Hints(
            programmes=(REVERSALS, LEVELS),
            starts_from=StartsFrom.SIGNS,
            reverses=True,
        ),
    ),
    Effect(
        "sensor-saturation",
        "sensor",
        Place.READING,
        Texts(
            "y → clip(y, ±s)",
            "The sensor reads no more than its limit.",
            "Measurements pile up at one largest value.",
            "Full drive, compared with an independent measurement of speed.",
        ),
        (EffectParameter("limit", "speed", 1e6, 0.1, 2.0, (0.7, 0.9), choice=True),),
        _saturation,
        hints=Hints(
            ties=("input-saturation",),
            programmes=(TOP, COASTING),
            starts_from=StartsFrom.CLIP_LEVEL,
        ),
    ),
    Effect(
        "sensor-bias",
        "sensor",
        Place.READING,
        Texts(
            "y + b",
            "The sensor has an offset at standstill.",
            "The measurements do not return to zero.",
            "A rest of ten seconds.",
            by_hand="A load and a zero point shift every measurement alike. Hold the wheel for "
            "some seconds while the log runs: what is read then is the zero point, what is gone "
            "was the load.",
        ),
        (EffectParameter("bias", "speed", 0.0, -0.5, 0.5, (0.03, -0.03)),),
        _bias,
        undone=lambda y, p: y - p["bias"],
        hints=Hints(
            ties=("load-bias",),
            programmes=(RESTS, COASTING),
            level=True,
        ),
    ),
)


def _counted(xp: Any, y: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return y + p["share"] * (s[0] - y), (y,)


MOST_SAMPLED = 0.55
"""The latest that a log's making leaves a reading [samples]: a speed counted over a sample is half
of one late; the rest is for what the machine does within a sample (the inductance of a motor)."""

SAMPLING = Effect(
    "sampling-lag",
    "sensor",
    Place.READING,
    Texts(
        "y(k) = (1 − φ) ω(k) + φ ω(k − 1)",
        "Measurements up to half a sample late: a speed counted over a sample, or a command passed "
        "on between two measurements.",
        "Every response begins the same part of a sample late.",
        "Fast reversals.",
    ),
    (EffectParameter("share", "1", 0.0, 0.0, MOST_SAMPLED, (0.5,), at_limit=True),),
    _counted,
    memory=Memory(
        1,
        of_inputs=True,
    ),
)
"""How the log was made, no effect of the machine: searched beside effects and by the same rule, so
that neither takes what is the other's, and then held by the original model as by the one after. A
speed counted over a sample (ticks of an encoder, differenced) is the mean over it."""
