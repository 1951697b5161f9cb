"""Free runs of the chain, many side by side, by its ``step`` on NumPy arrays.

What the compiled kernel does, some hundred times slower: for machines without a C compiler, and as
the law by which the kernel is tested.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.effects.base import Effect
from sysid.structures.augmented.chain import (
    Core,
    Sample,
    first_speed,
    rest_state,
    step_with,
    with_constants,
)
from sysid.structures.augmented.kernel import Signals, rows_of


@dataclass(frozen=True, eq=False)
class Stepped:
    """The free run of a chain with the interface of ``Kernel``."""

    effects: tuple[Effect, ...]
    order: int
    tracks: int
    dt: float
    outputs: int = 0

    @property
    def rows(self) -> tuple[tuple[str, str], ...]:
        return rows_of(self.effects, self.order)

    def run(self, q: Array, null: Array, index: NDArray[np.int64], signals: Signals) -> Array:
        """Readings (batch, M, tracks); see ``Kernel.run``."""
        table = np.moveaxis(q[:, index], 1, 0)  # (rows, batch, tracks)
        acts = np.any(q != null, axis=0)
        owners = [owner for owner, _ in self.rows]
        acting = [
            e
            for e in self.effects
            if any(acts[at].any() for o, at in zip(owners, index, strict=True) if o == e.id)
        ]
        n = self.order
        f, tail = table[1 : n + 1], table[n + 1 : 2 * n]
        first = 1.0 + f.sum(axis=0) - tail.sum(axis=0)
        core = Core(table[0], f, np.concatenate([first[None], tail]))
        raw: dict[str, dict[str, Array]] = {}
        for (owner, name), row in zip(self.rows, table, strict=True):
            raw.setdefault(owner, {})[name] = row
        with np.errstate(all="ignore"):
            return self._run(acting, core, raw, signals)

    def _run(
        self,
        acting: Sequence[Effect],
        core: Core,
        raw: Mapping[str, Mapping[str, Array]],
        signals: Signals,
    ) -> Array:
        parameters = with_constants(np, acting, core, raw, self.dt)
        shape = core.gain.shape
        tracks, outputs = shape[-1], self.outputs or shape[-1]
        seen = np.arange(tracks) % outputs
        out = np.empty((len(signals.y), *shape[:-1], outputs))
        state, turned = rest_state(np, acting, core, np.zeros(shape)), np.zeros(shape)
        for m in range(len(out)):
            drive = np.broadcast_to(signals.drive[m], shape)
            counted, t, log = signals.counted[m][seen], signals.t[m], signals.log[m]
            if signals.reset[m] > 0.0:
                w = first_speed(acting, parameters, np.broadcast_to(signals.y[m][seen], shape))
                state = rest_state(np, acting, core, w, signals.moving[m] * drive)
                turned = np.broadcast_to(counted, shape)
            w = state[0][0]
            sample = Sample(drive, drive, t, turned, counted, log)
            state, read = step_with(
                np, acting, core, parameters, state, sample, self.dt, outputs < tracks
            )
            out[m] = read[..., :outputs]
            turned = turned + 0.5 * self.dt * (w + state[0][0])
        return np.moveaxis(out, 1, 0)
