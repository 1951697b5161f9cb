"""Detection of changes of the plant: recent rows against all before, at a fixed false alarm rate.

For the window of the last w blocks, with R_w θ = z_w its own information and θ_o, R_o those of what
came before it, the difference d = z_w − R_w θ_o has, where nothing changed, the covariance
σ²(I + A Aᵀ), A = R_w R_o⁻¹, so that

    s = dᵀ (I + A Aᵀ)⁻¹ d / (n σ²)

is about 1 (Chow 1960 in information form; n coefficients). A plant that is not quite linear, or
noise with a memory, makes it larger without a change: what s was at the earlier windows of the same
length, κ on average over K of them, is its yardstick, and s/κ is compared with F(n, n K). While
there are few of that length, shorter ones serve beside them, and the largest κ of them counts.

The alarm rate of the whole stream, however long, is at most ``FALSE_ALARMS``: look number k, over
windows of all lengths, may use 6/π² FALSE_ALARMS/k² of it, whose sum is FALSE_ALARMS (union bound).
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.estimation.online.factor import Factor, triangle_of

FALSE_ALARMS = 0.01
"""Chance that a stream of any length in which nothing changes ever raises an alarm."""

WINDOWS = (1, 2, 4, 8, 16, 32)
"""Lengths of the windows in blocks: a large change is seen in one, a small one takes more."""

YARDSTICKS = 8
"""Earlier windows before an alarm may be raised, and from which shorter ones are not asked any
more: with fewer κ says nothing."""

RELEVANT = 0.05
"""Least share of what the inputs do to the output by which a change must alter it: a smaller one
is left to forgetting, else every real plant would change all day."""


@dataclass(frozen=True)
class Alarm:
    """A change that was seen.

    Attributes:
        blocks: the change lies about that many blocks back.
        probability: of a difference as large where nothing changed.
        window: length of the window that showed it, in blocks.
        statistic: s of that window.
        share: by how much of what the inputs do the output is altered.
    """

    blocks: int
    probability: float
    share: float
    window: int
    statistic: float


class ChangeWatch:
    """Watches one equation, block by block."""

    def __init__(self, driven: Sequence[int], budget: float = FALSE_ALARMS, looks: int = 0) -> None:
        """Args:
        driven: the coefficients that multiply inputs.
        budget: chance of ever raising a false alarm.
        looks: that were had before, and have used up their part of it.
        """
        self._driven = np.asarray(driven, dtype=np.intp)
        self._budget = budget
        self.looks = looks
        self._calm: dict[int, tuple[float, int]] = dict.fromkeys(WINDOWS, (0.0, 0))
        self._recent: dict[int, deque[tuple[int, float]]] = {w: deque() for w in WINDOWS}
        self._past: deque[tuple[Factor, Array]] = deque(maxlen=max(WINDOWS))
        self._blocks = 0

    def begin(self) -> None:
        self._past.clear()
        for recent in self._recent.values():
            recent.clear()  # they may hold the change
        self._blocks = 0

    def tolerate(self, alarm: Alarm) -> None:
        """What was no change is a yardstick like any other, at once and for its length."""
        total, count = self._calm[alarm.window]
        self._calm[alarm.window] = (total + alarm.statistic, count + 1)

    def before(self, blocks: int) -> Factor:
        return self._past[-blocks][0]

    def window(self, blocks: int) -> Array:
        """The triangle of the last blocks, (n + 1, n + 1)."""
        n = self._past[-1][0].n
        if blocks < 1:
            return np.zeros((n + 1, n + 1))
        return triangle_of(np.vstack([T for _, T in list(self._past)[-blocks:]]))

    def take(self, before: Factor, rows: Array) -> Alarm | None:
        """One block, and what was known before it.

        Args:
            before: of all rows before this block.
            rows: [φᵀ y] of the block, (m, n + 1).
        """
        self._past.append((before, triangle_of(rows)))
        self._blocks += 1
        for w in WINDOWS:
            if self._blocks % max(w // 2, 1) == 0 and self._blocks >= w:
                alarm = self._look(w)
                if alarm is not None:
                    return alarm
        return None

    def _look(self, w: int) -> Alarm | None:
        difference = self._difference(w)
        if difference is None:
            return None
        statistic, n, share = difference
        yardstick, windows = self._yardstick(w)
        if windows >= YARDSTICKS:
            from scipy.special import fdtrc

            self.looks += 1
            allowed = self._budget * 6.0 / np.pi**2 / self.looks**2
            chance = float(fdtrc(n, n * windows, statistic / yardstick))
            if chance < allowed and share >= RELEVANT:
                return Alarm(self._located(), chance, share, w, statistic)
        if self._blocks % w == 0:  # windows that do not overlap
            self._recent[w].append((self._blocks, statistic))
        return None

    def _yardstick(self, w: int) -> tuple[float, int]:
        """κ and over how many windows; never below 1, that of white noise."""
        # of windows that no window asked now, or of twice their length, holds
        for length, recent in self._recent.items():
            total, count = self._calm[length]
            while recent and recent[0][0] <= self._blocks - 2 * length:
                total, count = total + recent.popleft()[1], count + 1
            self._calm[length] = (total, count)
        worst, windows = 1.0, 0
        while w in self._calm and windows < YARDSTICKS:
            total, count = self._calm[w]
            windows += count
            worst = max(worst, total / count if count else 1.0)
            w //= 2
        return worst, windows

    def _located(self) -> int:
        """How many blocks ago a split lowers the errors most."""
        gains = {}
        for w in range(1, len(self._past) + 1):
            difference = self._difference(w)
            if difference is not None:
                gains[w] = difference[0]
        return max(gains, key=lambda w: gains[w])

    def _difference(self, w: int) -> tuple[float, int, float] | None:
        """s of a window, n, and the share of what the inputs do that it is; None if unknown."""
        from scipy.linalg import solve_triangular

        before = self._past[-w][0]
        n = before.n
        if before.weight <= 5 * n or not before.resolved():
            return None
        T = self.window(w)
        R, z = T[:-1, :-1], T[:-1, -1]
        worth = before.squared / before.weight
        variance = before.loss / (before.weight - n * worth)
        if not variance > 0.0:
            return None
        theta = solve_triangular(before.R, before.z)
        A = solve_triangular(before.R, R.T, trans="T").T
        d = z - R @ theta
        C = np.eye(n) + worth * A @ A.T
        statistic = float(d @ np.linalg.solve(C, d)) / (n * variance)
        drive = R[:, self._driven] @ theta[self._driven]
        surplus = float(d @ d) - variance * float(np.trace(C))
        effect = float(drive @ drive)
        share = np.sqrt(max(surplus, 0.0) / effect) if effect > 0.0 else np.inf
        return statistic, n, float(share)
