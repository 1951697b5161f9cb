"""PWM schedules that excite a plant: PRBS, multisine, chirp, steps, pulses; and their CSV files.

Every schedule starts and ends at zero so that the robot rests; times are on the grid k·dt, and
the PWM is rounded to whole µs, as the robot takes it. The same arguments give the same schedule.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.data.files import write_atomic
from sysid.data.record import PWM_FULL_SCALE, Array, Channel, frozen
from sysid.errors import UsageError
from sysid.outside_text import csv_text

REST = 1.0
"""Standstill before and after the excitation [s]."""
MAX_SAMPLES = 1_000_000
"""Longer schedules are refused."""


@dataclass(frozen=True, eq=False)
class Schedule:
    """What to send to the robot and when.

    Attributes:
        t: instants [s], shape (N,), read-only.
        u: PWM [µs] or what the channels say, shape (N, nu), read-only.
        channels: the nu input channels.
        active: first and one past the last row that is not the rest at the ends.
    """

    t: Array
    u: Array
    channels: tuple[Channel, ...]
    active: tuple[int, int]

    def __len__(self) -> int:
        return len(self.t)

    @property
    def excited(self) -> Array:
        """The rows between the rests, shape (M, nu)."""
        return self.u[slice(*self.active)]


def crest_factor(u: Array) -> float:
    """max|u| / rms(u): 1 for a binary signal, √2 for a sine; low is good (Ljung 1999, §13.3)."""
    rms = float(np.sqrt(np.mean(np.square(u))))
    return float(np.max(np.abs(u))) / rms if rms > 0 else float("inf")


def write_schedule(schedule: Schedule, path: str | Path) -> Path:
    """Write a schedule as CSV: ``t`` [s] and one column for each input, PWM in whole µs."""
    header = ",".join(("t", *(csv_text(c.name) for c in schedule.channels)))
    rows = (
        ",".join((f"{t:.9g}", *(str(int(v)) if v == int(v) else f"{v:.6g}" for v in row)))
        for t, row in zip(schedule.t, schedule.u, strict=True)
    )
    return write_atomic(path, "\n".join((header, *rows)) + "\n")


def sample_count(
    duration: float, dt: float, amplitude: float, offset: float, names: Sequence[str]
) -> int:
    """Number of samples of the excitation, after checking what all designs share."""
    if not names or len(set(names)) != len(names):
        raise UsageError("a schedule needs one or more inputs of different names")
    if not (np.isfinite(dt) and dt > 0):
        raise UsageError(f"the sample time must be positive, got {dt:g} s")
    if not (np.isfinite(duration) and duration >= 10 * dt):
        raise UsageError(f"a duration of {duration:g} s is too short at {dt:g} s a sample")
    if duration / dt > MAX_SAMPLES:
        raise UsageError(f"{duration:g} s at {dt:g} s a sample are over {MAX_SAMPLES} samples")
    if not (np.isfinite(amplitude) and np.isfinite(offset) and amplitude > 0):
        raise UsageError(f"the amplitude must be positive, got {amplitude:g} µs")
    if abs(offset) + amplitude > PWM_FULL_SCALE:
        reach = f"±{amplitude:g}" if offset == 0 else f"{offset:g} ± {amplitude:g}"
        raise UsageError(f"PWM of {reach} µs exceeds full drive, ±{PWM_FULL_SCALE:g} µs; lower it")
    return round(duration / dt)


def with_rests(u: Array, dt: float, names: Sequence[str]) -> Schedule:
    """Put the rests around an excitation and round it to whole µs."""
    n = max(1, round(REST / dt))
    still = np.zeros((n, u.shape[1]))
    # + 0.0 turns the −0 that rounding leaves into 0.
    whole = frozen(np.vstack([still, np.rint(u) + 0.0, still]))
    t = np.round(np.arange(len(whole)) * dt, 12)
    t.setflags(write=False)
    return Schedule(t, whole, tuple(Channel(n_, "µs") for n_ in names), (n, n + len(u)))


ROBOT_INPUTS = ("pwm_l", "pwm_r")


def prbs(
    duration: float = 60.0,
    dt: float = 0.1,
    amplitude: float = 12000.0,
    clock: int = 3,
    offset: float = 0.0,
    seed: int = 0,
    names: Sequence[str] = ROBOT_INPUTS,
) -> Schedule:
    """Pseudo-random binary sequences: maximal-length shift register, held for ``clock`` samples.

    A register of n bits repeats after 2^n − 1 clocks with autocorrelation 1 at lag 0 and
    −1/(2^n − 1) elsewhere. n is the smallest for which one period covers the duration. The inputs
    run the same sequence, shifted by a fraction of its period each: uncorrelated but for
    −1/(2^n − 1). (Ljung 1999, §13.3.)

    Args:
        duration: length of the excitation, without the rests [s].
        dt: sample time [s].
        amplitude: the levels are offset ± amplitude [µs].
        clock: samples a level is held at least; the band reaches to about 0.4/(clock·dt) Hz.
        offset: mean of the levels [µs].
        seed: chooses the start of the sequence.

    Raises:
        UsageError: an argument is out of range, or the levels exceed ±20000 µs.
    """
    count = sample_count(duration, dt, amplitude, offset, names)
    if clock < 1:
        raise UsageError(f"the clock of a PRBS must be 1 sample or more, got {clock}")
    from scipy import signal

    steps = -(-count // clock)
    bits = min(max(3, int(np.ceil(np.log2(steps + 1)))), 20)
    sequence = 2.0 * signal.max_len_seq(bits)[0] - 1.0
    first = int(np.random.default_rng(seed).integers(len(sequence)))
    shift = len(sequence) // max(len(names), 1)
    rows = np.arange(count) // clock
    u = np.column_stack(
        [sequence[(first + i * shift + rows) % len(sequence)] for i in range(len(names))]
    )
    return with_rests(offset + amplitude * u, dt, names)


def multisine(
    duration: float = 60.0,
    dt: float = 0.1,
    amplitude: float = 15000.0,
    band: tuple[float, float] = (0.0, 2.0),
    seed: int = 0,
    names: Sequence[str] = ROBOT_INPUTS,
    odd: bool = False,
    periods: int = 1,
) -> Schedule:
    """Sums of harmonics of 1/duration, each input on harmonics of its own, of low crest factor.

    u_i(t) = Σ_{k ∈ K_i} cos(2πkt/duration + φ_k); input i of m has every m-th harmonic inside the
    band, so that the inputs are orthogonal over the period and each frequency of the output belongs
    to one input. Phases start from Schroeder's φ_k = −πk(k−1)/n (1970, IEEE Trans.
    Inf. Theory 16) with a random linear part and the best of ``PHASE_SETS`` random sets is kept.
    (Pintelon & Schoukens 2012, §5.3.)

    Args:
        duration: one period [s].
        dt: sample time [s].
        amplitude: the largest |u| [µs].
        band: lowest and highest frequency [Hz]; the highest at most 1/(2·dt).
        seed: of the phases.
        odd: only odd harmonics, of every four of which one, drawn by chance, stays silent: what
            the output shows there and at even ones is distortion (odd-odd multisine).
        periods: how often it is repeated; distortions need two after the transient.
    """
    count = sample_count(duration, dt, amplitude, 0.0, names)
    low, high = band
    if not 0 <= low < high <= 0.5 / dt * (1 + 1e-9):
        raise UsageError(
            f"the band {low:g} to {high:g} Hz must rise inside 0 to {0.5 / dt:g} Hz, half the "
            "sampling rate"
        )
    top = min(int(np.floor(high * count * dt + 1e-9)), (count - 1) // 2)
    harmonics = np.arange(max(1, int(np.ceil(low * count * dt - 1e-9))), top + 1)
    m = len(names)
    rng = np.random.default_rng(seed)
    if odd:
        harmonics = harmonics[harmonics % 2 == 1]
        groups = [harmonics[k : k + 4] for k in range(0, len(harmonics), 4)]
        silent = [int(rng.choice(g)) for g in groups if len(g) == 4]
        harmonics = np.setdiff1d(harmonics, silent)
    if len(harmonics) < m:
        raise UsageError(
            f"the band {low:g} to {high:g} Hz holds {len(harmonics)} harmonics of "
            f"{1 / duration:.3g} Hz, fewer than the {m} inputs; widen it or drive longer"
        )
    if not 1 <= periods <= MOST_PERIODS:
        raise UsageError(f"a multisine has 1 to {MOST_PERIODS} periods, got {periods}")
    columns = [_low_crest(harmonics[i::m], count, rng) for i in range(m)]
    return with_rests(amplitude * np.tile(np.column_stack(columns), (periods, 1)), dt, names)


PHASE_SETS = 30
"""Random phase sets compared with Schroeder's."""

MOST_PERIODS = 1000
"""Repetitions of a multisine at most."""


def _low_crest(
    harmonics: np.ndarray[tuple[int], np.dtype[np.int64]],
    count: int,
    rng: np.random.Generator,
) -> Array:
    """The sum of cosines on ``harmonics`` of lowest crest factor among the tries, of peak 1."""
    n = len(harmonics)
    order = np.arange(1, n + 1)
    schroeder = -np.pi * order * (order - 1) / n
    best = np.zeros(count)
    lowest = np.inf
    for attempt in range(PHASE_SETS):
        turn = rng.uniform(0, 2 * np.pi)
        phases = schroeder + turn * order if attempt % 2 == 0 else rng.uniform(0, 2 * np.pi, n)
        spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
        spectrum[harmonics] = np.exp(1j * phases)
        wave = np.fft.irfft(spectrum, count)
        crest = crest_factor(wave)
        if crest < lowest:
            lowest, best = crest, wave / np.max(np.abs(wave))
    return best


def chirp(
    duration: float = 60.0,
    dt: float = 0.1,
    amplitude: float = 12000.0,
    band: tuple[float, float] = (0.05, 2.0),
    names: Sequence[str] = ROBOT_INPUTS,
) -> Schedule:
    """A sine of rising frequency for each input in turn, then all together.

    Inputs swept at once by one sine would be collinear, so the duration is cut into as many
    sweeps as there are inputs, each driving one of them, and a last one driving all; the frequency
    rises exponentially over a sweep.
    """
    count = sample_count(duration, dt, amplitude, 0.0, names)
    low, high = band
    if not 0 < low < high <= 0.5 / dt * (1 + 1e-9):
        raise UsageError(
            f"the band {low:g} to {high:g} Hz must rise inside 0 (excluded) to {0.5 / dt:g} Hz, "
            "half the sampling rate"
        )
    sweeps = 1 if len(names) == 1 else len(names) + 1
    part = count // sweeps
    if part * dt * low < 1.0:
        raise UsageError(
            f"a sweep of {part * dt:g} s does not hold one period of {low:g} Hz; drive longer or "
            "raise the lowest frequency"
        )
    from scipy import signal

    t = np.arange(part) * dt
    sweep = signal.chirp(t, low, t[-1], high, method="logarithmic", phi=-90)
    u = np.zeros((count, len(names)))
    for i in range(sweeps):
        driven = [i] if i < len(names) else list(range(len(names)))
        u[i * part : (i + 1) * part, driven] = sweep[:, None]
    return with_rests(amplitude * u, dt, names)


def steps(
    duration: float = 60.0,
    dt: float = 0.1,
    amplitude: float = 18000.0,
    levels: int = 9,
    hold: tuple[float, float] = (0.5, 3.0),
    seed: int = 0,
    names: Sequence[str] = ROBOT_INPUTS,
) -> Schedule:
    """Random levels held for random times, each input on its own: shows nonlinearity.

    Levels are evenly spaced over ±amplitude and drawn without replacement until all were used, so
    that the whole range is covered; the same level never follows itself.
    """
    count = sample_count(duration, dt, amplitude, 0.0, names)
    shortest, longest = hold
    if levels < 2:
        raise UsageError(f"steps need 2 levels or more, got {levels}")
    if not dt <= shortest <= longest:
        raise UsageError(
            f"the hold times {shortest:g} to {longest:g} s must rise from {dt:g} s, the sample time"
        )
    rng = np.random.default_rng(seed)
    grid = np.linspace(-amplitude, amplitude, levels)
    columns = [_random_levels(grid, count, dt, hold, rng) for _ in names]
    return with_rests(np.column_stack(columns), dt, names)


def _random_levels(
    grid: Array, count: int, dt: float, hold: tuple[float, float], rng: np.random.Generator
) -> Array:
    column = np.empty(count)
    at, last, bag = 0, -1, list[int]()
    while at < count:
        if not bag:
            bag = [int(i) for i in rng.permutation(len(grid))]
            if bag[-1] == last:
                bag.insert(0, bag.pop())
        last = bag.pop()
        length = max(1, round(rng.uniform(*hold) / dt))
        column[at : at + length] = grid[last]
        at += length
    return column


def pulses(
    dt: float = 0.1,
    amplitude: float = 20000.0,
    levels: int = 4,
    on: float = 3.0,
    pause: float = 2.0,
    rotate: bool = False,
    names: Sequence[str] = ROBOT_INPUTS,
) -> Schedule:
    """Forward – pause – backward – pause at rising levels: the thesis's experiments (§5.3).

    Args:
        dt: sample time [s].
        amplitude: the highest level [µs]; the others are even fractions of it.
        on, pause: length of a pulse and of a pause [s].
        rotate: drive the first input opposite to the others, so that the robot turns on the spot.
    """
    if levels < 1:
        raise UsageError(f"pulses need 1 level or more, got {levels}")
    sample_count(2 * levels * (on + pause), dt, amplitude, 0.0, names)
    n_on, n_pause = round(on / dt), round(pause / dt)
    if n_on < 1 or n_pause < 1:
        raise UsageError(f"pulses of {on:g} s and pauses of {pause:g} s are shorter than {dt:g} s")
    shape = np.concatenate([np.ones(n_on), np.zeros(n_pause), -np.ones(n_on), np.zeros(n_pause)])
    wave = np.concatenate([amplitude * (k + 1) / levels * shape for k in range(levels)])
    sense = np.ones(len(names))
    if rotate:
        sense[0] = -1.0
    return with_rests(wave[:, None] * sense, dt, names)


DESIGNS = {
    "prbs": prbs,
    "multisine": multisine,
    "chirp": chirp,
    "steps": steps,
    "pulses": pulses,
}
"""Name of a design → the function that makes its schedule."""
