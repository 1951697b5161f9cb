"""The newest rows of a stream, kept for coloured noise and figures."""

from collections import deque

import numpy as np

from sysid.data.record import Array

MOST = 200_000
"""Rows kept of a stream: three minutes at 1 kHz, an hour at 50 Hz; 6 MB of four channels."""


class RowsKept:
    """Blocks of rows in uninterrupted stretches; the oldest blocks go first.

    Attributes:
        since: rows added since the beginning or since ``only_last``, kept or not.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[int, Array]] = deque()
        self._stretch = 0
        self._rows = 0
        self.since = 0

    def add(self, rows: Array) -> None:
        self._blocks.append((self._stretch, rows))
        self._rows += len(rows)
        self.since += len(rows)
        while self._rows - len(self._blocks[0][1]) >= MOST:
            self._rows -= len(self._blocks.popleft()[1])

    def interrupt(self) -> None:
        """What follows is a stretch of its own."""
        self._stretch += 1

    def only_last(self, rows: int) -> None:
        while self._blocks and self._rows - len(self._blocks[0][1]) >= rows:
            self._rows -= len(self._blocks.popleft()[1])
        if self._blocks and self._rows > rows:
            stretch, block = self._blocks[0]
            self._blocks[0] = (stretch, block[self._rows - rows :])
        self._rows = self.since = rows

    def pieces(self, waiting: Array, most: int | None = None, but: int = 0) -> list[Array]:
        """The stretches, the oldest first; ``waiting`` follows the last rows.

        Args:
            waiting: rows not added yet, (N, width).
            most: newest rows wanted, None for all that are kept.
            but: newest rows that are passed over.
        """
        blocks = [*self._blocks, *([(self._stretch, waiting)] if len(waiting) else [])]
        wanted, chosen = np.inf if most is None else most, []
        for stretch, block in reversed(blocks):
            if wanted <= 0:
                break
            if but:
                passed, but = min(but, len(block)), max(but - len(block), 0)
                block = block[: len(block) - passed]
            chosen.append((stretch, block))
            wanted -= len(block)
        by_piece: dict[int, list[Array]] = {}
        for stretch, block in reversed(chosen):
            by_piece.setdefault(stretch, []).append(block)
        return [np.concatenate(b) for b in by_piece.values()]
