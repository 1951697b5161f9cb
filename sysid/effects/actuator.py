"""Effects between the command and the motor: they change the drive d = u / full scale."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sysid.effects.base import (
    CommandPart,
    Context,
    Effect,
    EffectParameter,
    Hints,
    Law,
    Memory,
    Place,
    Signal,
    StartsFrom,
    State,
    Texts,
)
from sysid.effects.lag import ENDLESS, lagging_drive
from sysid.effects.programmes import (
    COASTING,
    LEVELS,
    ONE_AND_OTHER,
    RAMPS,
    REVERSALS,
    STAIRCASE,
    TOP,
)

P = Mapping[str, Signal]


def _dead_zone(xp: Any, d: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    width = xp.where(d >= 0.0, p["plus"], p["minus"])
    beyond = xp.maximum(xp.abs(d) - width, 0.0)
    jump = xp.where(beyond > 0.0, p["jump"], 0.0)
    return xp.sign(d) * (beyond + jump), s


def _saturation(xp: Any, d: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return xp.minimum(xp.maximum(d, -p["minus"]), p["plus"]), s


def _twist(xp: Any, d: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    if d.shape[-1] != 2:
        return d, s
    mean = 0.5 * (d[..., :1] + d[..., 1:])
    apart = d - mean
    # what is cut off is taken away: far limits then leave the last digit as it was
    over = mean - xp.minimum(xp.maximum(mean, -p["forward"]), p["forward"])
    over = over + apart - xp.minimum(xp.maximum(apart, -p["turning"]), p["turning"])
    kept = d - over
    # the larger side is brought to its limit, and the other one by the same share: the curve stays
    largest = xp.maximum(xp.abs(kept[..., :1]), xp.abs(kept[..., 1:]))
    return kept * xp.minimum(p["side"] / xp.maximum(largest, 1e-9), 1.0), s


LEAST_POWERED = 1e-9
"""Drive below which a power of it is held: none of it would be infinite."""


def _concave(xp: Any, d: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    size = xp.abs(d)
    bent = 1.0 - p["kappa"] * xp.where(p["cubic"] > 0.5, size * size, size)
    by_power = xp.maximum(size, LEAST_POWERED) ** p["power"]
    return d * xp.where(p["cubic"] > 1.5, by_power, bent), s


def _direction(xp: Any, d: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return xp.where(d < 0.0, p["rho"] * d, d), s


def _rate_limit(xp: Any, d: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # within the sample the drive is a ramp, then held: its mean acts, its end is remembered
    change = d - s[0]
    down = xp.where(p["two"] > 0.5, p["fall"], p["rate"])
    most = xp.where(change * s[0] < 0.0, down, p["rate"]) * c.dt
    limited = xp.minimum(xp.maximum(change, -most), most)
    lost = xp.abs(limited) / (2.0 * most)
    return s[0] + limited * (1.0 - lost), (s[0] + limited,)


def _lag(xp: Any, x: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    behind = x - s[0]
    return x - behind * p["late"], (s[0] + p["share"] * behind,)


def _between(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    """Whole and part samples of a delay, the part by what it leaves of a first-order motion.

    A held command that changes at the part θ of a sample acts for (1 − θ) of it, at its end, and
    of that less has died away: with α what is kept of the speed in a sample, the share of the old
    command is (α^(1 − θ) − α)/(1 − α), exactly. Where no such motion follows it is θ.
    """
    samples = xp.minimum(p["delay"] / dt, float(DELAY_LINE))
    whole = xp.floor(samples)
    part = samples - whole
    follows = (kept > NO_MOTION) & (kept < ENDLESS)
    base = xp.where(follows, kept, 0.5)
    share = (base ** (1.0 - part) - base) / (1.0 - base)
    return {"whole": whole, "old": xp.where(follows, share, part)}


def _delay(xp: Any, d: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s holds the last drives, newest first; a real delay mixes two neighbours of a held input
    line = (d, *s)
    samples = p["whole"] + p["old"]
    out = 0.0 * d
    for k, value in enumerate(line):
        out = out + value * xp.maximum(1.0 - xp.abs(samples - k), 0.0)
    return out, line[:-1]


def _out_of_dead_zone(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """d → sign(d)(δ± + |d| − j); of what lies within the jump, the nearer of 0 and j."""
    width = xp.where(d >= 0.0, p["plus"], p["minus"])
    size = xp.abs(d)
    beyond = width + xp.maximum(size - p["jump"], 1e-9)
    return xp.sign(d) * xp.where(size > 0.5 * p["jump"], beyond, 0.0)


CUBIC_STEPS = 12
"""Newton's steps on x − κ x³ = d; from x = d they come from one side and end at rounding, but for
the last percent before the most that there is."""


def _out_of_concave(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """The smaller x with x(1 − κ|x|) = d, or x(1 − κ x²) = d, beyond it the x that gives most; or
    x |x|^n = d."""
    kappa, size = p["kappa"], xp.abs(d)
    # the root as a quotient, which κ = 0 does not upset
    root = xp.sqrt(xp.maximum(1.0 - 4.0 * kappa * size, 0.0))
    bent = xp.minimum(2.0 * size / (1.0 + root), 0.5 / xp.maximum(kappa, 1e-9))
    most = 1.0 / xp.sqrt(3.0 * xp.maximum(kappa, 1e-9))
    x = xp.minimum(size, most)
    for _ in range(CUBIC_STEPS):
        slope = xp.maximum(1.0 - 3.0 * kappa * x * x, 1e-3)
        x = xp.minimum(x - (x * (1.0 - kappa * x * x) - size) / slope, most)
    rooted = xp.maximum(size, 1e-300) ** (1.0 / (1.0 + p["power"]))
    x = xp.where(p["cubic"] > 1.5, rooted, x)
    return xp.sign(d) * xp.where(p["cubic"] > 0.5, x, bent)


def _out_of_direction(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """d → d/ρ for d < 0."""
    return xp.where(d < 0.0, d / p["rho"], d)


NO_MOTION = 0.05
"""What is kept of the speed in a sample, below which a mean over the sample serves."""

DELAY_LINE = 20
"""Longest extra delay [samples]."""

INPUT_DELAY = Effect(
    "input-delay",
    "actuator",
    Place.COMMAND,
    Texts(
        "d(t − θ)",
        "The command takes effect later than in the model.",
        "Every response starts late by the same time, at all levels.",
        "Steps at irregular instants.",
    ),
    (
        EffectParameter(
            "delay",
            "s",
            0.0,
            0.0,
            float(DELAY_LINE),
            (1.5, 6.0),
            kinks=True,
            at_null=True,
            at_limit=True,
            in_samples=True,
        ),
    ),
    _delay,
    _between,
    memory=Memory(
        DELAY_LINE,
        of_inputs=True,
    ),
    hints=Hints(
        programmes=(REVERSALS, LEVELS),
        beyond_sampling=True,
    ),
)


_EDGE = EffectParameter(
    "plus",
    "drive",
    0.0,
    0.0,
    0.8,
    (0.08, 0.2, 0.4, 0.08, 0.2, 0.4),
    jumps=True,
    edge=1,
    at_null=True,
    measured_as="dead_band_forward",
)

_RATE = EffectParameter("rate", "drive/s", 1e12, 1e-5, 100.0, (), kinks=True)

EFFECTS = (
    INPUT_DELAY,
    Effect(
        "input-saturation",
        "actuator",
        Place.COMMAND,
        Texts(
            "d → clip(d, −s−, s+)",
            "Beyond some command the drive does not increase.",
            "Large commands of different size reach one and the same speed.",
            "Steps at 60, 80, 90 and 100 % of full drive in both directions.",
        ),
        (
            EffectParameter("plus", "drive", 1e3, 0.1, 0.999, (0.6, 0.8), kinks=True),
            EffectParameter("minus", "drive", 1e3, 0.1, 0.999, (0.6, 0.8), kinks=True),
        ),
        _saturation,
        inverse=lambda xp, d, p, c: _saturation(xp, d, (), p, c)[0],
        hints=Hints(
            ties=("sensor-saturation",),
            programmes=(TOP, LEVELS),
        ),
    ),
    Effect(
        "twist-limit",
        "actuator",
        Place.COMMAND,
        Texts(
            "(d_l + d_r)/2 → clip(·, ±f), (d_r − d_l)/2 → clip(·, ±t), or d → d min(1, s/max |d|)",
            "The drive limits forward speed and turning rate, not each side: a controller of its "
            "own takes the commands apart and puts them together again.",
            "A side falls short of its command, the more so the more the other one differs.",
            "Steps from slow to full drive: straight, turning on the spot, and both at once.",
        ),
        (
            EffectParameter("forward", "drive", 1e3, 0.05, 0.999, (0.4, 0.7, 0.4, 0.7), kinks=True),
            EffectParameter(
                "turning",
                "drive",
                1e3,
                0.05,
                0.999,
                (0.4, 0.7, 0.4, 0.7),
                kinks=True,
                at_limit=True,
            ),
            EffectParameter("side", "drive", 1e3, 0.05, 0.999, (0.6, 0.8, 0.6, 0.8), kinks=True),
            EffectParameter("keeps_curve", "", 0.0, 0.0, 1.0, (0.0, 0.0, 1.0, 1.0), choice=True),
        ),
        _twist,
        shared=True,
        couples=True,
        inverse=lambda xp, d, p, c: _twist(xp, d, (), p, c)[0],
        laws=(
            Law(("forward", "turning"), choices={"keeps_curve": 0.0}),
            Law(
                ("turning", "side"),
                choices={"keeps_curve": 1.0},
                sentence="Where a side would exceed its limit both are slowed down by the same "
                "share, and the curve stays.",
            ),
        ),
        hints=Hints(
            ties=("input-saturation", "cross-coupling", "inertial-coupling"),
            programmes=(ONE_AND_OTHER, TOP),
        ),
    ),
    Effect(
        "dead-zone",
        "actuator",
        Place.COMMAND,
        Texts(
            "d → sign(d)(max(|d| − δ±, 0) + j·[|d| > δ±])",
            "Small commands do nothing, larger ones are short by that much.",
            "No motion at small commands; steady speed is a straight line that misses zero.",
            "A slow staircase through zero in both directions.",
            between_edges="the edge of the dead zone and the jump there; only their difference is "
            "known.",
        ),
        (
            _EDGE,
            replace(_EDGE, name="minus", edge=-1, at_null=False, measured_as="dead_band_backward"),
            EffectParameter(
                "jump",
                "drive",
                0.0,
                0.0,
                0.8,
                (0.0, 0.0, 0.0, 0.08, 0.2, 0.4),
                jumps=True,
                measured_as="dead_band_jump",
            ),
        ),
        _dead_zone,
        inverse=_out_of_dead_zone,
        hints=Hints(
            ties=("coulomb-friction", "stiction", "dead-time"),
            programmes=(STAIRCASE, RAMPS, COASTING),
        ),
    ),
    Effect(
        "concave-gain",
        "actuator",
        Place.COMMAND,
        Texts(
            "d → d(1 − κ|d|), or d(1 − κ d²), or d|d|^n",
            "The static gain falls with the size of the command.",
            "Steady speed against command bends towards the command axis.",
            "Steps at many levels in both directions.",
            opposite="The static gain rises with the size of the command.",
        ),
        (
            EffectParameter("kappa", "1/drive", 0.0, -0.9, 0.95, (0.3, -0.2) * 2 + (0.0,) * 2),
            EffectParameter(
                "cubic", "", 0.0, 0.0, 2.0, (0.0,) * 2 + (1.0,) * 2 + (2.0,) * 2, choice=True
            ),
            EffectParameter("power", "", 0.0, -0.6, 2.0, (0.0,) * 4 + (1.0, -0.3)),
        ),
        _concave,
        inverse=_out_of_concave,
        laws=(
            Law(("kappa",), choices={"cubic": 0.0}),
            Law(
                ("kappa",),
                choices={"cubic": 1.0},
                sentence="It bends by the cube of the command, as the expo of a remote control "
                "makes it: small commands respond evenly.",
            ),
            Law(
                ("power",),
                choices={"cubic": 2.0},
                sentence="It is a power of the command, d|d|^n, as the thrust of a propeller or "
                "the light of a corrected lamp is: above 0 small commands do less than others.",
            ),
        ),
        command_part=CommandPart.STICK,
        hints=Hints(
            ties=("supply-sag",),
            programmes=(LEVELS, ONE_AND_OTHER, COASTING),
        ),
    ),
    Effect(
        "direction-asymmetry",
        "actuator",
        Place.COMMAND,
        Texts(
            "d → ρ d for d < 0",
            "The drive is stronger in one direction than in the other.",
            "Equal commands of either sign reach different speeds.",
            "Steps of equal size in both directions.",
        ),
        (EffectParameter("rho", "", 1.0, 0.3, 3.0, (0.85, 1.15)),),
        _direction,
        inverse=_out_of_direction,
        hints=Hints(
            programmes=(LEVELS, COASTING),
            reverses=True,
        ),
    ),
    Effect(
        "rate-limit",
        "actuator",
        Place.COMMAND,
        Texts(
            "|ḋ| ≤ r, or of another rate where |d| falls",
            "The drive cannot change faster than some rate.",
            "Large steps are ramps; small steps are not affected.",
            "Steps of very different size.",
        ),
        # a furnace is driven up in hours
        (
            replace(_RATE, starts=(0.4, 1.0, 3.0, 8.0, 1.0, 3.0)),
            replace(_RATE, name="fall", starts=(0.4, 1.0, 3.0, 8.0, 3.0, 1.0)),
            EffectParameter("two", "", 0.0, 0.0, 1.0, (0.0,) * 4 + (1.0,) * 2, choice=True),
        ),
        _rate_limit,
        command_part=CommandPart.CONTROLLER,
        memory=Memory(
            1,
        ),
        laws=(
            Law(("rate",), choices={"two": 0.0}),
            Law(
                ("rate", "fall"),
                choices={"two": 1.0},
                sentence="It speeds up at one rate and slows down at another, as the two ramps of "
                "a frequency converter are set.",
            ),
        ),
        hints=Hints(
            starts_from=StartsFrom.RAMPS,
            ties=("servo-speed-limit",),
            programmes=(TOP, REVERSALS),
        ),
    ),
    Effect(
        "actuator-lag",
        "actuator",
        Place.COMMAND,
        Texts(
            "λ ḋ′ = d − d′",
            "The drive follows the command with a lag of its own.",
            "Responses start smoothly instead of with a kink.",
            "Fast reversals sampled fast.",
        ),
        (EffectParameter("lag", "s", 0.0, 0.0, 40.0, (1.0, 6.0), in_samples=True),),
        _lag,
        lagging_drive,
        memory=Memory(
            1,
        ),
        hints=Hints(
            ties=("sensor-lag",),
            programmes=(REVERSALS, TOP),
            beyond_sampling=True,
            exchanges="lag",
        ),
    ),
)
