"""The commands of the bundled logs: arrays of PWM (left, right) [µs], shape (N, 2), every 0.1 s.

Every schedule begins with one second at zero, so that a log shows the rest it starts from.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Pwm = NDArray[np.int64]

RATE = 10
"""Commands in a second."""

LEAD_IN = np.zeros((RATE, 2), dtype=np.int64)

REGISTER = 7
"""Bits of the shift register behind ``prbs``; its sequence repeats after 2^7 - 1 = 127 bits."""


def pulses(levels: Sequence[int], signs: tuple[int, int], on: float, pause: float) -> Pwm:
    """For each level: a pulse, a pause, the opposite pulse, a pause.

    Args:
        levels: pulse heights [µs].
        signs: sense of each track in the first pulse: (1, 1) drives forward, (-1, 1) turns left.
        on: length of a pulse [s].
        pause: length of a pause [s].
    """
    sense = np.asarray(signs, dtype=np.int64)
    rest = np.zeros((round(pause * RATE), 2), dtype=np.int64)
    parts = [LEAD_IN]
    for level in levels:
        pulse = np.tile(level * sense, (round(on * RATE), 1))
        parts += [pulse, rest, -pulse, rest]
    return np.concatenate(parts)


def multilevel(
    rng: np.random.Generator,
    seconds: float,
    levels: int,
    rests: int,
    hold: tuple[float, float],
) -> Pwm:
    """Levels over the whole range in random order, held for random times, each track on its own.

    A track goes through ``levels`` values spaced evenly from -20000 to 20000 and ``rests`` zeros,
    shuffled, and through another shuffle when these end early: every part of the range is visited
    about equally often, the dead zone and the saturation included.

    Args:
        rng: source of the orders and times.
        seconds: length after the first second.
        levels: number of values.
        rests: number of zeros among them.
        hold: shortest and longest time at a value [s].
    """
    length = round(seconds * RATE)
    deck = np.rint(np.linspace(-20000, 20000, levels)).astype(np.int64)
    deck = np.concatenate([deck, np.zeros(rests, dtype=np.int64)])
    shortest, longest = (round(h * RATE) for h in hold)
    tracks = []
    for _ in range(2):
        runs: list[Pwm] = []
        while sum(map(len, runs)) < length:
            stays = rng.integers(shortest, longest + 1, len(deck))
            runs.append(np.repeat(rng.permutation(deck), stays))
        tracks.append(np.concatenate(runs)[:length])
    return np.concatenate([LEAD_IN, np.column_stack(tracks)])


def prbs(rng: np.random.Generator, level: int, clock: float, tap: int) -> Pwm:
    """One period of a maximum-length binary sequence, ±``level``; the right track half a period on.

    Shifted by half a period the sequence is all but uncorrelated with itself (-1/127) at every
    lag below half a period, so one sequence excites both tracks independently.

    Args:
        rng: source of the register's first content.
        level: height [µs].
        clock: time per bit [s].
        tap: second tap of the shift register, 6 (x⁷ + x⁶ + 1) or 4 (x⁷ + x⁴ + 1).
    """
    register = int(rng.integers(1, 2**REGISTER))
    bits = []
    for _ in range(2**REGISTER - 1):
        bits.append(register & 1)
        new = (register ^ (register >> (REGISTER - tap))) & 1
        register = (register >> 1) | (new << (REGISTER - 1))
    signs = 2 * np.array(bits, dtype=np.int64) - 1
    both = level * np.column_stack([signs, np.roll(signs, len(signs) // 2)])
    return np.concatenate([LEAD_IN, np.repeat(both, round(clock * RATE), axis=0)])


def multisine(
    rng: np.random.Generator, seconds: float, centre: int, amplitude: int, highest: float
) -> Pwm:
    """A sum of equal sines of random phase around ``centre``; the tracks share no frequency.

    The left track has the odd multiples of 1/``seconds``, the right one the even ones. Of 64 draws
    of the phases the one with the lowest crest factor is taken.

    Args:
        rng: source of the phases.
        seconds: length of the period [s].
        centre: mean command [µs].
        amplitude: largest excursion from it [µs].
        highest: highest frequency [Hz].
    """
    length = round(seconds * RATE)
    t = np.arange(length) / length
    tracks = []
    for first in (1, 2):
        lines = np.arange(first, highest * seconds + 1e-9, 2)
        phases = rng.uniform(0.0, 2.0 * np.pi, (64, len(lines), 1))
        waves = np.cos(2.0 * np.pi * lines[:, None] * t + phases).sum(axis=1)
        peaks = np.abs(waves).max(axis=1)
        best = int(np.argmin(peaks))
        tracks.append(np.rint(centre + amplitude * waves[best] / peaks[best]).astype(np.int64))
    return np.concatenate([LEAD_IN, np.column_stack(tracks)])
