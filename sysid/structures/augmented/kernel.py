"""The chain with any effects as one compiled free run: generated C around their recorded steps.

Every effect is recorded once, by calling its ``step`` with arrays that write down what is done to
them (``runners/trace``), as the exported C is. In a run those effects act of which some parameter
is away from its null value; absent ones cost nothing, so that trying another effect compiles
nothing.
"""

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.effects.base import Context, Effect, Place, TorquePart
from sysid.runners.native import library
from sysid.runners.trace.program import Program, assigned
from sysid.runners.trace.traced import TRACE, Traced, cells_of

_NUMBER = ctypes.POINTER(ctypes.c_double)

OF_CONTEXT = (
    *("w", "w_free", "b", "torque", "torque_other", "drive"),
    *("turned", "counted", "holds", "gain", "driven"),
)
"""Fields of ``Context`` with an entry a track, called alike in C."""

SIGNALS = ("drive", "y", "moving", "counted", "t", "log", "reset")


class _Data(ctypes.Structure):
    _fields_ = [*((name, _NUMBER) for name in SIGNALS), ("rows", ctypes.c_long)]


@dataclass(frozen=True, eq=False)
class Signals:
    """Records, one after the other, as a kernel takes them; all C-contiguous float64.

    Attributes:
        drive: commands in units of full drive, (M, tracks).
        y: measurements, of which the first of each record is where its run begins, (M, tracks).
        moving: share of its first command under which a record begins, (M, tracks).
        counted: angle integrated from the measurements before each, (M, tracks).
        t: time [s], (M,).
        log: which of several logs a row belongs to, (M,).
        reset: 1 at a record's start, (M,).
    """

    drive: Array
    y: Array
    moving: Array
    counted: Array
    t: Array
    log: Array
    reset: Array


@dataclass(frozen=True, eq=False)
class Kernel:
    """The free run of a chain, compiled.

    Attributes:
        rows: owner and name of each row of parameters (``rows_of``).
    """

    rows: tuple[tuple[str, str], ...]
    function: Any

    def run(self, q: Array, null: Array, index: NDArray[np.int64], signals: Signals) -> Array:
        """Readings (batch, M, tracks) for parameter vectors (batch, parameters).

        Args:
            null: where a parameter does nothing, (parameters,); NaN where it always acts.
            index: entry of the vector of each row and track, (rows, tracks).
        """
        q = np.ascontiguousarray(q)
        out = np.empty((len(q), *signals.y.shape))
        data = _Data(*(_pointer(getattr(signals, name)) for name in SIGNALS))
        data.rows = len(signals.y)
        places = index.ctypes.data_as(ctypes.POINTER(ctypes.c_long))
        self.function(
            len(q),
            q.shape[1],
            _pointer(q),
            _pointer(null),
            places,
            ctypes.byref(data),
            _pointer(out),
        )
        return out


def _pointer(values: Array) -> Any:
    return values.ctypes.data_as(_NUMBER)


@lru_cache(32)
def kernel(
    effects: tuple[Effect, ...], order: int, tracks: int, dt: float, outputs: int = 0
) -> Kernel:
    """The kernel of these effects, in the order in which they act, around cores of one order.

    Args:
        outputs: 1 where the tracks are the inputs of one machine; 0 for as many as tracks.

    Raises:
        ModelError: the step of an effect cannot be written as C.
        OSError: there is no C compiler.
    """
    function = library(source(effects, order, tracks, dt, outputs)).runs
    function.restype = None
    function.argtypes = [
        ctypes.c_long, ctypes.c_long, _NUMBER, _NUMBER, ctypes.POINTER(ctypes.c_long),
        ctypes.POINTER(_Data), _NUMBER,
    ]  # fmt: skip
    return Kernel(rows_of(effects, order), function)


def rows_of(effects: Sequence[Effect], order: int) -> tuple[tuple[str, str], ...]:
    """Owner and name of each row: gain, f_1 … f_n, b_2 … b_n, then effect after effect."""
    core = ["gain", *(f"f{k + 1}" for k in range(order)), *(f"b{k + 1}" for k in range(1, order))]
    return (
        *(("core", name) for name in core),
        *((e.id, p.name) for e in effects for p in e.parameters),
    )


def source(effects: Sequence[Effect], order: int, tracks: int, dt: float, outputs: int = 0) -> str:
    """The C source of a kernel."""
    row, constant, state = 2 * order, 0, 0
    functions, table = [], []
    for k, e in enumerate(effects):
        written = _Written(e, k, tracks, dt)
        functions.append(written.text)
        entries = (
            e.place.name, int(e.place is Place.TORQUE and e.part is TorquePart.DRIVE),
            row, len(e.parameters), constant, state,
            e.memory.states * tracks,
            *written.functions,
        )  # fmt: skip
        table.append(f"    {{{', '.join(map(str, entries))}}},")
        row += len(e.parameters)
        constant += written.constants * tracks
        state += e.memory.states * tracks
    sizes = {
        "TRACKS": tracks, "OUTPUTS": outputs or tracks, "ORDER": order, "ROWS": row,
        "EFFECTS": len(effects),
        "CONSTANTS": constant, "STATES": state,
    }  # fmt: skip
    defined = [f"#define {name} {value}" for name, value in sizes.items()]
    head = ["#include <math.h>", "#include <stddef.h>", *defined, f"#define DT {dt!r}", ""]
    text = (files("sysid.structures.augmented") / "chain.c").read_text(encoding="utf-8")
    text = text.replace("@EFFECTS@", "\n".join(functions)).replace("@TABLE@", "\n".join(table))
    return "\n".join(head) + text


class _Written:
    """An effect as C functions.

    Attributes:
        functions: names for the table: constants, step, rest, holds, undone; ``NULL`` without one.
        constants: numbers a track that do not change in a run.
    """

    def __init__(self, e: Effect, k: int, tracks: int, dt: float) -> None:
        self.effect, self.tracks, self.dt = e, tracks, dt
        self.functions: list[str] = []
        self.constants = 0
        self._names: tuple[str, ...] = ()
        self._texts: list[str] = []
        self._function(
            f"constants_{k}",
            "const double *p, const double *kept, double *k",
            self._constants if e.constants else None,
        )
        self._function(
            f"step_{k}",
            "const Context *c, const double *p, const double *k, double *s, double *signal",
            self._step,
        )
        self._function(
            f"rest_{k}",
            "const double *w, const double *d, double *s",
            self._rest if e.memory.states else None,
        )
        self._function(
            f"holds_{k}", "const double *p, double *out", self._holds if e.holds else None
        )
        self._function(
            f"undone_{k}", "const double *p, double *signal", self._undone if e.undone else None
        )
        self.text = "\n".join(self._texts)

    def _function(self, name: str, takes: str, body: Callable[[Program], list[str]] | None) -> None:
        if body is None:
            self.functions.append("NULL")
            return
        program = Program()
        lines = body(program)
        support = list(program.support("\n".join(lines)))
        head = f"static void {name}({takes}) {{"
        self._texts += [*support, head, *(f"    {line}" for line in lines), "}", ""]
        self.functions.append(name)

    def _array(self, program: Program, name: str, entries: int | None = None) -> Traced:
        cells = program.inputs(name, self.tracks if entries is None else entries)
        return Traced(cells_of(cells))

    def _parameters(self, program: Program) -> dict[str, Traced]:
        names = [p.name for p in self.effect.parameters]
        whole = self._array(program, "p", len(names) * self.tracks).reshape(-1, self.tracks)
        return {name: whole[i] for i, name in enumerate(names)}

    def _constants(self, program: Program) -> list[str]:
        assert self.effect.constants is not None
        kept = self._array(program, "kept")
        made = self.effect.constants(TRACE, self._parameters(program), self.dt, kept)
        self._names, self.constants = tuple(made), len(made)
        cells = [c for value in made.values() for c in self._of_tracks(value)]
        return [*program.lines(cells), *assigned("k", cells)]

    def _of_tracks(self, value: Any) -> list[Any]:
        """An entry a track of anything that broadcasts to it."""
        cells: list[Any] = np.broadcast_to(cells_of(value), (self.tracks,)).tolist()
        return cells

    def _step(self, program: Program) -> list[str]:
        e, tracks = self.effect, self.tracks
        parameters = self._parameters(program)
        whole = self._array(program, "k", len(self._names) * tracks).reshape(-1, tracks)
        parameters |= {name: whole[i] for i, name in enumerate(self._names)}
        states = self._array(program, "s", e.memory.states * tracks).reshape(-1, tracks)
        fields = {name: self._array(program, f"c->{name}") for name in OF_CONTEXT}
        t, log = (self._array(program, f"c->{name}", 1) for name in ("t", "log"))
        context = Context(self.dt, t, log=log, **fields)
        signal = self._array(program, "signal")
        after, memory = e.step(
            TRACE, signal, tuple(states[i] for i in range(e.memory.states)), parameters, context
        )
        moved = [c for value in memory for c in self._of_tracks(value)]
        out = self._of_tracks(after)
        lines = list(program.lines([*moved, *out]))
        return [*lines, *assigned("s", moved), *assigned("signal", out)]

    def _rest(self, program: Program) -> list[str]:
        e = self.effect
        w, d = self._array(program, "w"), self._array(program, "d")
        if e.memory.at_rest is not None:
            states = e.memory.at_rest(w, d)
        else:
            states = (d if e.place is Place.COMMAND else w,) * e.memory.states
        cells = [c for value in states for c in self._of_tracks(value)]
        return [*program.lines(cells), *assigned("s", cells)]

    def _holds(self, program: Program) -> list[str]:
        assert self.effect.holds is not None
        cells = self._of_tracks(self.effect.holds(self._parameters(program)))
        return [*program.lines(cells), *assigned("out", cells)]

    def _undone(self, program: Program) -> list[str]:
        assert self.effect.undone is not None
        reading = self._array(program, "signal")
        cells = self._of_tracks(self.effect.undone(reading, self._parameters(program)))
        return [*program.lines(cells), *assigned("signal", cells)]
