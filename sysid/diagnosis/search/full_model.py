"""The full model: every effect of the catalogue in one compiled simulation.

Absent effects sit at their null values, so that trying a candidate means freeing a few parameters
and never compiling a new model. Candidates, starts and shifted copies for slopes run side by side.

A step with the whole catalogue takes thirty times as long as with one effect, while most items hold
one or two. So items are grouped by their acting effects, rounded up so that few simulations are
compiled. What has no memory of its own is computed for a whole record at once and is in all of
them; only the motion is stepped.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from sysid.data.record import Array, Index
from sysid.diagnosis.search.parameter_table import ParameterTable
from sysid.diagnosis.search.prepared import Data
from sysid.effects.base import Effect, Place
from sysid.structures.augmented.chain import (
    Core,
    Parameters,
    Sample,
    first_speed,
    over_time,
    rest_state,
    step_with,
    with_constants,
)

BATCH_SIZE = 16
"""Simulations that go in one call. More of them are no cheaper each and keep the second core
waiting; a smaller size for single runs would have to be compiled for itself, which takes longer
than it saves."""

KEPT = 128
"""Simulations that a process keeps compiled: those of some machines, of which each needs dozens."""

GROUP_PARAMETERS = 6
"""Parameters of the effects that are compiled together, one effect at least. Larger groups: fewer
simulations to compile (a third of a second each), slower ones."""


Call = tuple[tuple[bool, ...], Index]
"""For each group of effects whether one of it acts; items of a batch that go through one simulation
together, ``BATCH_SIZE`` at most."""


class FullModel(ParameterTable):
    """All effects around cores of one order, for a number of tracks."""

    def __init__(
        self, effects: Sequence[Effect], order: int, tracks: int, speed: Array, dt: float
    ) -> None:
        super().__init__(effects, order, tracks, speed, dt)
        before, inside, _ = stages(self.effects)
        self.groups = (*groups([e for e in before if not at_once(e)]), *groups(inside))
        owners = np.array([s.owner for s in self.parameters])
        self._group_masks = [np.isin(owners, [e.id for e in group]) for group in self.groups]
        self._compiled: dict[tuple[bool, ...], Callable[..., Any]] = {}
        self._ready: set[tuple[Any, ...]] = set()
        self._pool = ThreadPoolExecutor(os.cpu_count())  # a call keeps one core busy

    def run(self, q: Array, data: Data) -> Array:
        """Measurements for parameter vectors q (batch, parameters), shape (batch, M, tracks)."""
        q = np.atleast_2d(q)
        runs = np.empty((len(q), *data.y.shape))

        def one(call: Call) -> None:
            acting, at = call
            rows = q[at]
            fill = np.repeat(rows[-1:], BATCH_SIZE - len(rows), axis=0)
            run = self._readings(acting)(np.concatenate([rows, fill]), data.arrays)
            runs[at] = np.asarray(run)[: len(rows)]

        calls = self._calls(q)
        first, rest = self._first(calls, data)
        if len(calls) == 1:
            one(calls[0])
            return runs
        for some in (first, rest):  # two threads would both compile what neither has
            list(self._pool.map(one, some))
        return runs

    def _calls(self, q: Array) -> list[Call]:
        """Items of a batch parted by what acts in them."""
        acts = q != self.null
        needed = np.array([acts[:, mask].any(axis=1) for mask in self._group_masks], dtype=bool)
        sets, of = np.unique(needed.reshape(-1, len(q)).T, axis=0, return_inverse=True)
        calls: list[Call] = []
        for k, acting in enumerate(sets.tolist()):
            rows = np.flatnonzero(of.ravel() == k)
            parts = np.array_split(rows, -(-len(rows) // BATCH_SIZE))
            calls += [(tuple(acting), part) for part in parts]
        return calls

    def _first(self, calls: Sequence[Call], data: Data) -> tuple[list[Call], list[Call]]:
        """Calls of which each compiles something that no other of them does, and the others."""
        first: list[Call] = []
        rest: list[Call] = []
        for call in calls:
            kind = (call[0], data.y.shape)
            (rest if kind in self._ready else first).append(call)
            self._ready.add(kind)
        return first, rest

    def _readings(self, acting: tuple[bool, ...]) -> Callable[..., Any]:
        """(q (batch, parameters), data) → outputs (batch, M, tracks) with some groups, compiled."""
        if acting not in self._compiled:
            some = [e for on, group in zip(acting, self.groups, strict=True) if on for e in group]
            self._compiled[acting] = self.simulation(some)
        return self._compiled[acting]

    def simulation(self, some: Sequence[Effect]) -> Callable[..., Any]:
        """(q (batch, parameters), data) → outputs (batch, M, tracks) with some of the effects."""
        return _simulation(self.effects, self.order, self.tracks, self.dt, tuple(some))


@lru_cache(KEPT)
def _simulation(
    catalogue: tuple[Effect, ...], order: int, tracks: int, dt: float, some: tuple[Effect, ...]
) -> Callable[..., Any]:
    """``FullModel.simulation``; machines of one kind share it, whatever their typical speeds."""
    from sysid.runners.compiled import compiled

    table = ParameterTable(catalogue, order, tracks, np.ones(tracks), dt)
    whole_command, _, after = stages(catalogue)
    before = tuple(e for e in whole_command if e in some or at_once(e))
    inside = tuple(e for e in some if e not in whole_command)
    rows = _rows(table, (*before, *inside, *after))
    run = compiled(_readings(_Chain(before, inside, after, dt), order, rows))

    def simulated(q: Array, data: dict[str, Any]) -> Any:
        return run(np.ascontiguousarray(np.moveaxis(q[:, rows.indices], 1, 0)), data)

    return simulated


@dataclass(frozen=True, eq=False)
class _Chain:
    """Effects of the command, within the motion, and of what is read; sample time [s]."""

    before: tuple[Effect, ...]
    inside: tuple[Effect, ...]
    after: tuple[Effect, ...]
    dt: float


def _readings(chain: _Chain, order: int, rows: "_Rows") -> Callable[..., Any]:
    """(table (rows, batch, tracks), data) → measurements (batch, M, tracks).

    Signals are (M, batch, tracks) and parameters (batch, tracks): JAX takes three times as long to
    trace the same for one item and then to make items of it by ``vmap``.
    """
    from sysid.runners.compiled import jax_module, vectorised

    jax = jax_module()
    jnp, dt = vectorised(jax.numpy), chain.dt

    def readings(table: Any, data: dict[str, Any]) -> Any:
        core, raw = _unpacked(jax, order, rows, table)
        effects = (*chain.before, *chain.inside, *chain.after)
        parameters = with_constants(jnp, effects, core, raw, dt)
        names = ("drive", "t", "counted", "log", "moving", "y")
        drive, t, counted, log, moving, y = (data[name][:, None] for name in names)
        whole = Sample(drive, drive, t, jnp.zeros_like(drive), counted, log)
        first = data["first"][:, None, None]
        row = jnp.arange(len(first))[:, None, None]
        shape = table.shape[1:]

        def past(signal: Any, k: Any) -> Any:
            at = _broadcast(jnp, row - k.astype(row.dtype), shape)
            signal = _broadcast(jnp, signal, shape)
            earlier = jnp.take_along_axis(signal, jnp.maximum(at, first), axis=0)
            return earlier * jnp.where(at < first, moving, 1.0)

        acting = over_time(jnp, chain.before, parameters, drive, past, whole, dt)
        x = (drive, acting, y, moving, counted, t, data["reset"], log)
        read = _moved(jax, jnp, chain, core, parameters, x, shape)
        sums = dt * (jnp.cumsum(read, axis=0) - 0.5 * read)
        whole = replace(whole, turned=sums - sums[data["first"]] + counted[data["first"]])
        read = over_time(jnp, chain.after, parameters, read, past, whole, dt)
        return jnp.swapaxes(_broadcast(jnp, read, shape), 0, 1)

    return readings


def _moved(
    jax: Any,
    jnp: Any,
    chain: _Chain,
    core: Core,
    parameters: Parameters,
    x: tuple[Any, ...],
    shape: tuple[int, ...],
) -> Any:
    """Measurements (M, batch, tracks) of the motion, before what acts on them as a whole.

    Args:
        core, parameters: parameters (batch, tracks).
        x: drive, drive that acts, measurements, whether the record begins in motion, counted angle;
            then time, whether a record begins, and its log.
    """
    zero = jnp.zeros(shape)

    def body(carried: Any, x: tuple[Any, ...]) -> tuple[Any, Any]:
        drive, now, y, moving, counted = (_broadcast(jnp, signal, shape) for signal in x[:5])
        t, reset, log = x[5:]
        w, begins = first_speed(chain.after, parameters, y), reset > 0.0
        fresh = (rest_state(jnp, chain.inside, core, w, moving * now), counted)
        state, turned = jax.tree.map(lambda a, b: jnp.where(begins, a, b), fresh, carried)
        speed = state[0][0]
        sample = Sample(drive, now, t, turned, counted, log)
        state, reading = step_with(jnp, chain.inside, core, parameters, state, sample, chain.dt)
        return (state, turned + 0.5 * chain.dt * (speed + state[0][0])), reading

    start = (rest_state(jnp, chain.inside, core, zero, zero), zero)
    return jax.lax.scan(body, start, x)[1]


def _broadcast(jnp: Any, signal: Any, shape: tuple[int, ...]) -> Any:
    """A signal (…, items or 1, tracks or 1) with all items and tracks."""
    return jnp.broadcast_to(signal, (*signal.shape[:-2], *shape))


@dataclass(frozen=True, eq=False)
class _Rows:
    """Which parameters a simulation takes: one row a parameter.

    Attributes:
        indices: parameters of each row, (rows, tracks).
    """

    names: tuple[tuple[str, str], ...]
    indices: Index


def _rows(table: ParameterTable, effects: Sequence[Effect]) -> _Rows:
    """Rows of the core (gain, f, b but the first), then of each effect."""
    names = [("core", p.name) for p in table.parameters if p.owner == "core" and p.track == 0]
    names += [(e.id, p.name) for e in effects for p in e.parameters]
    shared = {e.id for e in effects if e.shared}
    tracks = range(table.tracks)
    indices = [[table.index[o, n, -1 if o in shared else i] for i in tracks] for o, n in names]
    return _Rows(tuple(names), np.array(indices))


def _unpacked(
    jax: Any, order: int, rows: _Rows, table: Any
) -> tuple[Core, dict[str, dict[str, Any]]]:
    """The core and the parameters of some effects, each (batch, tracks)."""
    lax = jax.lax
    each = [lax.squeeze(row, (0,)) for row in lax.split(table, (1,) * len(rows.names))]
    f, tail = each[1 : order + 1], each[order + 1 : 2 * order]
    stacked = jax.numpy.stack
    core = Core(each[0], stacked(f), stacked([1.0 + sum(f) - sum(tail, 0.0), *tail]))
    parameters: dict[str, dict[str, Any]] = {owner: {} for owner, _ in rows.names[2 * order :]}
    for (owner, name), row in zip(rows.names[2 * order :], each[2 * order :], strict=True):
        parameters[owner][name] = row
    return core, parameters


def groups(effects: Sequence[Effect]) -> tuple[tuple[Effect, ...], ...]:
    """Neighbours in the chain, as many as have ``GROUP_PARAMETERS`` between them."""
    grouped: list[tuple[Effect, ...]] = []
    for e in effects:
        last = grouped[-1] if grouped else ()
        if last and sum(len(one.parameters) for one in (*last, e)) <= GROUP_PARAMETERS:
            grouped[-1] = (*last, e)
        else:
            grouped.append((e,))
    return tuple(grouped)


def at_once(e: Effect) -> bool:
    """Whether an effect of the command looks at nothing but the command of the same sample."""
    return e.on_past is None and not e.states


def stages(
    effects: Sequence[Effect],
) -> tuple[tuple[Effect, ...], tuple[Effect, ...], tuple[Effect, ...]]:
    """Effects that act on the whole command before the motion, within it, and on what is read.

    Relies on the chain's order: within the command those with memory come last, within the
    reading first.
    """

    def free(e: Effect) -> bool:
        return e.on_past is not None or not e.states

    before = tuple(e for e in effects if e.place is Place.COMMAND and free(e))
    after = tuple(e for e in effects if e.place is Place.READING and free(e))
    return before, tuple(e for e in effects if e not in before and e not in after), after
