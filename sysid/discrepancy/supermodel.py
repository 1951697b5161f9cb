"""The super-model: every effect of the catalogue in one compiled simulation.

Absent effects sit at their null values, so that trying a candidate means freeing a few numbers
and never compiling a new model. Many candidates and starts are searched at once: a batched
Levenberg-Marquardt over the columns of one forward-mode Jacobian.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sysid.data.record import Array, Record
from sysid.effects.base import Effect
from sysid.structures.chain import Core, chain_step, rest_state

LANES = 24
"""Searches that run side by side in one call of the compiled simulation."""

COLUMNS = 12
"""Most numbers that one search estimates."""

PADDING = 512
"""Records are padded to multiples of this, so that one compilation serves many logs."""


@dataclass(frozen=True)
class Slot:
    """One number of the super-model.

    Attributes:
        owner: ``core`` or an effect's id.
        name: parameter name.
        track: index of the track, or -1 when all share it.
        null: value at which it does nothing (for the core: its place is taken by the base).
        lower, upper: bounds in physical units.
        scale: typical size, for the solver.
    """

    owner: str
    name: str
    track: int
    null: float
    lower: float
    upper: float
    scale: float


@dataclass(frozen=True, eq=False)
class Data:
    """Records prepared for the super-model, stacked with marks where a record begins.

    Attributes:
        drive: (M, tracks); y: (M, tracks); t, angle: time and angle; reset: 1 at a record's start;
        weight: 0 where a sample does not count, (M, tracks); start: speed at each reset.
    """

    drive: Array
    y: Array
    t: Array
    angle: Array
    reset: Array
    weight: Array
    dt: float


def prepare(records: Sequence[Record], scales: Array, delay: int) -> Data:
    """Stack records; ``scales`` are full drive per input, ``delay`` whole samples of dead time."""
    drive: list[Array] = []
    y: list[Array] = []
    t: list[Array] = []
    angle: list[Array] = []
    reset: list[Array] = []
    weight: list[Array] = []
    for r in records:
        d = r.u / scales
        shift = max(delay - 1, 0)
        if shift:
            d = np.vstack([np.repeat(d[:1], shift, axis=0), d[:-shift]])
        drive.append(d)
        y.append(r.y)
        t.append(r.dt * np.arange(len(r), dtype=np.float64))
        angle.append(np.cumsum(r.y, axis=0) * r.dt)
        first = np.zeros(len(r))
        first[0] = 1.0
        reset.append(first)
        weight.append(np.ones(r.y.shape))
    total = sum(len(r) for r in records)
    pad = -total % PADDING

    def joined(parts: Sequence[Array]) -> Array:
        whole = np.concatenate(parts)
        return np.concatenate([whole, np.zeros((pad, *whole.shape[1:]))])

    return Data(
        joined(drive),
        joined(y),
        joined(t),
        joined(angle),
        joined(reset),
        joined(weight),
        records[0].dt,
    )


class SuperModel:
    """All effects around cores of one order, for a number of tracks.

    Args:
        effects: those of the chain, in order.
        order: order of the core.
        tracks: number of tracks.
        speed: typical speed of each track, (tracks,).
        dt: sample time [s].
    """

    def __init__(
        self, effects: Sequence[Effect], order: int, tracks: int, speed: Array, dt: float
    ) -> None:
        self.effects, self.order, self.tracks = tuple(effects), order, tracks
        self.speed, self.dt = speed, dt
        self.slots = tuple(self._slots())
        self.place = {(s.owner, s.name, s.track): k for k, s in enumerate(self.slots)}

    def _slots(self) -> list[Slot]:
        found = []
        for i in range(self.tracks):
            v = float(self.speed[i])
            found.append(Slot("core", "gain", i, v, -1e3 * v, 1e3 * v, v))
            found += [
                Slot("core", f"f{k + 1}", i, 0.0, -10.0, 10.0, 0.1) for k in range(self.order)
            ]
            found += [
                Slot("core", f"b{k + 1}", i, 0.0, -100.0, 100.0, 0.1) for k in range(1, self.order)
            ]
        for e in self.effects:
            for i in (-1,) if e.shared else range(self.tracks):
                found += [self._effect_slot(e.id, p, i) for p in e.parameters]
        return found

    def _effect_slot(self, id: str, p: Any, track: int) -> Slot:
        v = float(np.mean(self.speed) if track < 0 else self.speed[track])
        factor = {"drive": 1.0, "speed": v, "dt": self.dt, "one": 1.0}[p.scaled_by]
        if p.unit == "1/speed":
            factor = 1.0 / v
        null = p.null * (v if p.scaled_by == "speed" and 0.0 < abs(p.null) < 1e3 else 1.0)
        size = max(abs(s) for s in p.starts) or 0.1
        return Slot(id, p.name, track, null, p.lower * factor, p.upper * factor, size * factor)

    @property
    def null(self) -> Array:
        """All slots at their null values."""
        return np.array([s.null for s in self.slots])

    def starts(self, e: Effect) -> list[dict[int, float]]:
        """Starting values of an effect on all tracks: slot → value."""
        found = []
        for k in range(max(len(p.starts) for p in e.parameters)):
            values = {}
            for i in (-1,) if e.shared else range(self.tracks):
                for p in e.parameters:
                    at = self.place[e.id, p.name, i]
                    share = p.starts[min(k, len(p.starts) - 1)]
                    size = max(abs(s) for s in p.starts) or 1.0
                    values[at] = share * self.slots[at].scale / size
            found.append(values)
        return found

    @cached_property
    def _compiled(self) -> tuple[Callable[..., Any], Callable[..., Any]]:
        from sysid.structures.compiled import jax_module

        jax = jax_module()
        jnp = jax.numpy
        effects, order, tracks, dt = self.effects, self.order, self.tracks, self.dt
        place = self.place

        def unpack(q: Any) -> tuple[Core, dict[str, dict[str, Any]]]:
            def row(name: str) -> Any:
                return jnp.stack([q[place["core", name, i]] for i in range(tracks)])

            f = jnp.stack([row(f"f{k + 1}") for k in range(order)])
            tail = [row(f"b{k + 1}") for k in range(1, order)]
            first = 1.0 + jnp.sum(f, axis=0) - (sum(tail) if tail else 0.0)
            core = Core(row("gain"), f, jnp.stack([first, *tail]))
            parameters = {
                e.id: {
                    p.name: jnp.stack(
                        [q[place[e.id, p.name, -1 if e.shared else i]] for i in range(tracks)]
                    )
                    for p in e.parameters
                }
                for e in effects
            }
            return core, parameters

        def readings(q: Any, data: dict[str, Any]) -> Any:
            core, parameters = unpack(q)

            def body(state: Any, x: dict[str, Any]) -> tuple[Any, Any]:
                fresh = rest_state(jnp, effects, core, x["y"])
                state = jax.tree.map(lambda a, b: jnp.where(x["reset"] > 0.0, a, b), fresh, state)
                return chain_step(
                    jnp, effects, core, parameters, state, x["drive"], x["t"], x["angle"], dt
                )

            zero = rest_state(jnp, effects, core, jnp.zeros(tracks))
            return jax.lax.scan(body, zero, data)[1]

        def normal(q: Any, E: Any, data: dict[str, Any]) -> tuple[Any, Any, Any]:
            """Cost, gradient and Gauss-Newton matrix over the columns of E."""

            def weighted(z: Any) -> Any:
                return jnp.sqrt(data["weight"]) * (data["y"] - readings(q + E @ z, data))

            zero = jnp.zeros(E.shape[1])
            J = jax.jacfwd(weighted)(zero)
            r = weighted(zero)
            J = jnp.where(jnp.isfinite(J), J, 0.0)
            cost = jnp.sum(r * r)
            g = jnp.einsum("nt,ntk->k", r, J)
            return jnp.where(jnp.isfinite(cost), cost, jnp.inf), g, jnp.einsum("ntk,ntl->kl", J, J)

        many = jax.jit(jax.vmap(normal, in_axes=(0, 0, None)))
        runs = jax.jit(jax.vmap(readings, in_axes=(0, None)))
        return many, runs

    def _arrays(self, data: Data, weight: Array | None = None) -> dict[str, Array]:
        return {
            "drive": data.drive,
            "y": data.y,
            "t": data.t,
            "angle": data.angle,
            "reset": data.reset,
            "weight": data.weight if weight is None else weight,
        }

    def run(self, q: Array, data: Data) -> Array:
        """Readings for parameter vectors q (lanes, slots), shape (lanes, M, tracks)."""
        arrays = {k: v for k, v in self._arrays(data).items() if k != "weight"}
        return np.asarray(self._compiled[1](np.atleast_2d(q), arrays))

    def search(
        self,
        q0: Array,
        free: Sequence[Sequence[int]],
        data: Data,
        weight: Array | None = None,
        iterations: int = 20,
    ) -> tuple[Array, Array]:
        """Levenberg-Marquardt from every row of ``q0`` over its own free slots, side by side.

        Bounds are kept by projection: a number on its bound whose gradient points outside is
        held for that step.

        Args:
            q0: starts, (lanes, slots).
            free: free slots of each lane, at most COLUMNS of them.
            data: records.
            weight: weight of each sample, (M, tracks).
            iterations: steps taken.

        Returns:
            (q (lanes, slots), cost (lanes,)).
        """
        many = self._compiled[0]
        arrays = self._arrays(data, weight)
        out_q, out_cost = [], []
        for low in range(0, len(q0), LANES):
            rows = list(range(low, min(low + LANES, len(q0))))
            lanes = rows + [rows[-1]] * (LANES - len(rows))
            q, cost = self._descend(
                many, arrays, q0[lanes].copy(), [list(free[k]) for k in lanes], iterations
            )
            out_q.append(q[: len(rows)])
            out_cost.append(cost[: len(rows)])
        return np.concatenate(out_q), np.concatenate(out_cost)

    def information(self, q: Array, free: Sequence[int], data: Data) -> Array:
        """Gauss-Newton matrix JᵀJ over the free slots in their own units, (n, n)."""
        E = np.zeros((LANES, len(self.slots), COLUMNS))
        for c, slot in enumerate(free):
            E[:, slot, c] = self.slots[slot].scale
        rows = np.repeat(q[None], LANES, axis=0)
        H = np.asarray(self._compiled[0](rows, E, self._arrays(data))[2][0])
        scale = np.array([self.slots[k].scale for k in free])
        n = len(free)
        return np.asarray(H[:n, :n] / np.outer(scale, scale))

    def _descend(
        self,
        many: Callable[..., Any],
        arrays: dict[str, Array],
        q: Array,
        free: list[list[int]],
        iterations: int,
    ) -> tuple[Array, Array]:
        lanes, slots = q.shape
        lower = np.array([s.lower for s in self.slots])
        upper = np.array([s.upper for s in self.slots])
        scale = np.array([s.scale for s in self.slots])
        E = np.zeros((lanes, slots, COLUMNS))
        index = np.full((lanes, COLUMNS), -1)
        for k, columns in enumerate(free):
            index[k, : len(columns)] = columns
            for c, slot in enumerate(columns):
                E[k, slot, c] = scale[slot]
        damping = np.full(lanes, 1e-2)
        cost, g, H = (np.array(a) for a in many(q, E, arrays))
        for _ in range(iterations):
            trial = q.copy()
            for k in range(lanes):
                trial[k] = _step(q[k], g[k], H[k], index[k], scale, lower, upper, damping[k])
            new_cost, new_g, new_H = (np.array(a) for a in many(trial, E, arrays))
            better = new_cost < cost
            gain = np.where(better, (cost - new_cost) / np.maximum(cost, 1e-300), 0.0)
            q[better], cost[better] = trial[better], new_cost[better]
            g[better], H[better] = new_g[better], new_H[better]
            damping = np.where(better, damping / 5.0, damping * 6.0)
            if np.all((better & (gain < 1e-7)) | (damping > 1e8)):
                break
        return q, cost


def _step(
    q: Array,
    g: Array,
    H: Array,
    index: Array,
    scale: Array,
    lower: Array,
    upper: Array,
    damping: float,
) -> Array:
    """One damped Gauss-Newton step of one lane, kept within the bounds."""
    columns = np.flatnonzero(index >= 0)
    slots = index[columns]
    outward = ((q[slots] <= lower[slots]) & (g[columns] > 0)) | (
        (q[slots] >= upper[slots]) & (g[columns] < 0)
    )
    columns, slots = columns[~outward], slots[~outward]
    out = q.copy()
    if not len(columns):
        return out
    A = H[np.ix_(columns, columns)]
    diagonal = np.maximum(np.diag(A), 1e-12 * max(float(np.max(np.diag(A))), 1e-300))
    step = np.linalg.lstsq(A + damping * np.diag(diagonal), -g[columns], rcond=None)[0]
    out[slots] = np.clip(q[slots] + scale[slots] * step, lower[slots], upper[slots])
    return out
