"""Runs of the super-model: lanes in which the same effects act share one compiled simulation.

An effect at its null value costs as much as one that acts. With all of the catalogue a step takes
thirty times as long as with one effect, while most lanes hold one or two. So lanes are parted by
the effects that act in them, rounded up to groups so that few simulations are compiled. Effects of
what is read that are computed for a whole record at once, and effects of the command that look at
one sample of it only, cost next to nothing and are in all of them: beside a dead zone all others
are tried with the simulations that were compiled to try them alone.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from sysid.data.record import Array, Index
from sysid.diagnosis.search.numbers import Numbers
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

LANES = 16
"""Simulations that go in one call. More of them are no cheaper each and keep the second core
waiting; a smaller size for single runs would have to be compiled for itself, which takes longer
than it saves."""

KEPT = 128
"""Simulations that a process keeps compiled: those of some machines, of which each needs dozens."""

GROUP_PARAMETERS = 6
"""Parameters of the effects that are compiled together, one effect at least. Larger groups: fewer
simulations to compile (a third of a second each), slower ones."""


@dataclass(frozen=True, eq=False)
class Call:
    """Lanes that go through one simulation together.

    Attributes:
        acting: for each group of effects, whether one of it acts.
        rows: the lanes, ``LANES`` at most.
    """

    acting: tuple[bool, ...]
    rows: Index


class Runs:
    """Simulates lanes of a super-model."""

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        before, inside, _ = stages(numbers.effects)
        self.groups = (*groups([e for e in before if not at_once(e)]), *groups(inside))
        owners = np.array([s.owner for s in numbers.slots])
        self._slots = [np.isin(owners, [e.id for e in group]) for group in self.groups]
        self._compiled: dict[tuple[bool, ...], Callable[..., Any]] = {}
        self._ready: set[tuple[Any, ...]] = set()
        self._pool = ThreadPoolExecutor(os.cpu_count())  # a call keeps one core busy

    def __call__(self, q: Array, data: Data) -> Array:
        """Readings for parameter vectors q (lanes, slots), shape (lanes, M, tracks)."""
        found = np.empty((len(q), *data.y.shape))

        def one(call: Call) -> None:
            rows = q[call.rows]
            fill = np.repeat(rows[-1:], LANES - len(rows), axis=0)
            run = self._readings(call.acting)(np.concatenate([rows, fill]), data.arrays)
            found[call.rows] = np.asarray(run)[: len(rows)]

        calls = self._calls(q)
        first, rest = self._first(calls, data)
        if len(calls) == 1:
            one(calls[0])
            return found
        for some in (first, rest):  # two threads would both compile what neither has
            list(self._pool.map(one, some))
        return found

    def _calls(self, q: Array) -> list[Call]:
        """Lanes parted by what acts in them."""
        acts = q != self.numbers.null
        needed = np.array([acts[:, slots].any(axis=1) for slots in self._slots], dtype=bool)
        sets, of = np.unique(needed.reshape(-1, len(q)).T, axis=0, return_inverse=True)
        found = []
        for k, acting in enumerate(sets.tolist()):
            rows = np.flatnonzero(of.ravel() == k)
            parts = np.array_split(rows, -(-len(rows) // LANES))
            found += [Call(tuple(acting), part) for part in parts]
        return found

    def _first(self, calls: Sequence[Call], data: Data) -> tuple[list[Call], list[Call]]:
        """Calls of which each compiles something that no other of them does, and the others."""
        first: list[Call] = []
        rest: list[Call] = []
        for call in calls:
            kind = (call.acting, data.y.shape)
            (rest if kind in self._ready else first).append(call)
            self._ready.add(kind)
        return first, rest

    def _readings(self, acting: tuple[bool, ...]) -> Callable[..., Any]:
        """(q (lanes, slots), data) → readings (lanes, M, tracks) with some groups, compiled."""
        if acting not in self._compiled:
            some = [e for on, group in zip(acting, self.groups, strict=True) if on for e in group]
            self._compiled[acting] = self.simulation(some)
        return self._compiled[acting]

    def simulation(self, some: Sequence[Effect]) -> Callable[..., Any]:
        """(q (lanes, slots), data) → readings (lanes, M, tracks) with some of the effects."""
        n = self.numbers
        return _simulation(n.effects, n.order, n.tracks, n.dt, tuple(some))


@lru_cache(KEPT)
def _simulation(
    catalogue: tuple[Effect, ...], order: int, tracks: int, dt: float, some: tuple[Effect, ...]
) -> Callable[..., Any]:
    """``Runs.simulation``; machines of one kind share it, whatever their typical speeds."""
    from sysid.fitting.compiled import compiled

    numbers = Numbers(catalogue, order, tracks, np.ones(tracks), dt)
    whole_command, _, after = stages(catalogue)
    before = tuple(e for e in whole_command if e in some or at_once(e))
    inside = tuple(e for e in some if e not in whole_command)
    rows = _rows(numbers, (*before, *inside, *after))
    run = compiled(_readings(_Chain(before, inside, after, dt), order, rows))

    def simulated(q: Array, data: dict[str, Any]) -> Any:
        return run(np.ascontiguousarray(np.moveaxis(q[:, rows.places], 1, 0)), data)

    return simulated


@dataclass(frozen=True, eq=False)
class _Chain:
    """Effects of the command, within the motion, and of what is read; sample time [s]."""

    before: tuple[Effect, ...]
    inside: tuple[Effect, ...]
    after: tuple[Effect, ...]
    dt: float


def _readings(chain: _Chain, order: int, rows: "_Rows") -> Callable[..., Any]:
    """(table (rows, lanes, tracks), data) → readings (lanes, M, tracks).

    Signals are (M, lanes, tracks) and numbers (lanes, tracks): JAX takes three times as long to
    trace the same for one lane and then to make lanes of it by ``vmap``.
    """
    from sysid.fitting.compiled import jax_module, vectorised

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
            at = _of_lanes(jnp, row - k.astype(row.dtype), shape)
            signal = _of_lanes(jnp, signal, shape)
            found = jnp.take_along_axis(signal, jnp.maximum(at, first), axis=0)
            return found * jnp.where(at < first, moving, 1.0)

        acting = over_time(jnp, chain.before, parameters, drive, past, whole, dt)
        x = (drive, acting, y, moving, counted, t, data["reset"], log)
        read = _moved(jax, jnp, chain, core, parameters, x, shape)
        sums = dt * (jnp.cumsum(read, axis=0) - 0.5 * read)
        whole = replace(whole, turned=sums - sums[data["first"]])
        read = over_time(jnp, chain.after, parameters, read, past, whole, dt)
        return jnp.swapaxes(_of_lanes(jnp, read, shape), 0, 1)

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
    """Readings (M, lanes, tracks) of the motion, before what acts on them as a whole.

    Args:
        jax, jnp: the module, and its functions of arrays.
        chain: what acts.
        core, parameters: numbers (lanes, tracks).
        x: drive, drive that acts, readings, whether the record begins in motion, counted angle;
            then time, whether a record begins, and its log.
        shape: lanes and tracks.
    """
    zero = jnp.zeros(shape)

    def body(carried: Any, x: tuple[Any, ...]) -> tuple[Any, Any]:
        drive, now, y, moving, counted = (_of_lanes(jnp, signal, shape) for signal in x[:5])
        t, reset, log = x[5:]
        w, begins = first_speed(chain.after, parameters, y), reset > 0.0
        fresh = (rest_state(jnp, chain.inside, core, w, moving * now), zero)
        state, turned = jax.tree.map(lambda a, b: jnp.where(begins, a, b), fresh, carried)
        speed = state[0][0]
        sample = Sample(drive, now, t, turned, counted, log)
        state, reading = step_with(jnp, chain.inside, core, parameters, state, sample, chain.dt)
        return (state, turned + 0.5 * chain.dt * (speed + state[0][0])), reading

    start = (rest_state(jnp, chain.inside, core, zero, zero), zero)
    return jax.lax.scan(body, start, x)[1]


def _of_lanes(jnp: Any, signal: Any, shape: tuple[int, ...]) -> Any:
    """A signal (…, lanes or 1, tracks or 1) with all lanes and tracks."""
    return jnp.broadcast_to(signal, (*signal.shape[:-2], *shape))


@dataclass(frozen=True, eq=False)
class _Rows:
    """Which slots a simulation takes: one row a number.

    Attributes:
        names: owner and name of each row.
        places: slots of each row, (rows, tracks).
    """

    names: tuple[tuple[str, str], ...]
    places: Index


def _rows(numbers: Numbers, effects: Sequence[Effect]) -> _Rows:
    """Rows of the core (gain, f, b but the first), then of each effect."""
    order = range(1, numbers.order + 1)
    core = ["gain", *(f"f{k}" for k in order), *(f"b{k}" for k in order[1:])]
    names = [("core", name) for name in core]
    names += [(e.id, p.name) for e in effects for p in e.parameters]
    shared = {e.id for e in effects if e.shared}
    tracks = range(numbers.tracks)
    places = [[numbers.place[o, n, -1 if o in shared else i] for i in tracks] for o, n in names]
    return _Rows(tuple(names), np.array(places))


def _unpacked(
    jax: Any, order: int, rows: _Rows, table: Any
) -> tuple[Core, dict[str, dict[str, Any]]]:
    """The core and the parameters of some effects, each (lanes, tracks).

    Args:
        jax: the module.
        order: of the core.
        rows: what the table holds.
        table: (rows, lanes, tracks).
    """
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
    found: list[tuple[Effect, ...]] = []
    for e in effects:
        last = found[-1] if found else ()
        if last and sum(len(one.parameters) for one in (*last, e)) <= GROUP_PARAMETERS:
            found[-1] = (*last, e)
        else:
            found.append((e,))
    return tuple(found)


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
