"""Record: one experiment, with inputs, outputs, sample time and channels."""

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.data.column_words import is_drive, is_wheel_speed
from sysid.data.decision import Decision
from sysid.data.schema import Null
from sysid.errors import DataError
from sysid.outside_text import html_lines, html_table, name_of

Array = Annotated[NDArray[np.float64], Null()]
Index = NDArray[np.intp]
HARDLY = 1e-6
"""Weight of an error that a fit does not look at although nothing is wrong with its sample: it was
predicted from a replaced reading."""

PWM_FULL_SCALE = 20000.0
"""Pulse width at full drive [µs]; the drive d = PWM / PWM_FULL_SCALE lies in [-1, 1]."""


@dataclass(frozen=True)
class Channel:
    """A named signal with its unit and the factor that brought the file's numbers to that unit.

    Attributes:
        name: column name in the log.
        unit: unit of the numbers in the Record (SI, PWM in µs); empty when unknown.
        scale: value in ``unit`` = scale × value in the file (1 when nothing was converted).
        file_unit: unit of the numbers in the file, when it differs.
    """

    name: str
    unit: str = ""
    scale: float = 1.0
    file_unit: str = ""

    def __post_init__(self) -> None:
        for name in ("name", "unit", "file_unit"):  # in C, XML, HTML and on the terminal
            object.__setattr__(self, name, name_of(getattr(self, name)))

    @property
    def file_words(self) -> str:
        """The unit of the numbers in the file as one speaks of it: ``counts/s``, ``rpm``.

        A conversion such as ``counts=2048/rev`` or ``±255`` also says how large the unit is; in
        a sentence only the unit itself means what the number counts.
        """
        written = self.file_unit.removeprefix("-")
        if written.startswith("±"):
            return "count"
        ticks = re.fullmatch(r"(counts|ticks)(/s)?(=[^/]*)?(/[0-9.eE+]+)?(/rev)?(/s)?", written)
        if ticks:
            return ticks[1] + ("/s" if ticks[2] or ticks[6] else "")
        return written

    @property
    def to_file(self) -> tuple[float, str]:
        """(factor, unit): size in the file's unit = factor × value; (1, ``unit``) unconverted.

        A column whose sign was changed keeps the new one.
        """
        same = abs(self.scale) == 1.0 or not self.file_unit
        return (1.0, self.unit) if same else (1.0 / abs(self.scale), self.file_words)

    def worded(self, write: Callable[[float], str]) -> str:
        """``71.3 rpm (7.47 rad/s)``: in the file's unit, and SI; ``write`` takes the factor."""
        (factor, unit), si = self.to_file, f"{write(1.0)} {self.unit}".strip()
        return si if factor == 1.0 else f"{write(factor)} {unit} ({si})"


def frozen(values: ArrayLike, columns: int | None = None) -> Array:
    """Return a read-only float64 2-D copy of ``values`` (time first).

    Raises:
        DataError: the array is not 2-D (a 1-D array counts as one column), or does not have
            ``columns`` columns; the message names the expected and the received shape.
    """
    array = np.array(values, dtype=np.float64, order="C")
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or (columns is not None and array.shape[1] != columns):
        wanted = "(N, n)" if columns is None else f"(N, {columns})"
        raise DataError(f"expected an array of shape {wanted}, time first, got {array.shape}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Record:
    """One experiment: inputs, outputs and their sample time.

    Attributes:
        u: inputs, shape (N, nu), read-only.
        y: outputs, shape (N, ny), read-only.
        dt: sample time [s].
        inputs: the nu input channels; their names will do where they have no unit.
        outputs: the ny output channels, as well.
        pose: x [m], y [m], ψ [rad] per sample, shape (N, 3), or None.
        t0: time of the first sample [s].
        name: what to call the record in messages (the file's name).
        sha256: hash of the file, or of the arrays when there is no file.
        weights: how much the error at each output counts, shape (N, ny), 0 for a measurement or a
            disturbance that a robust fit has left out; None where all count fully.
        references: what the outputs were to be, shape (N, nr), in the file's units, or None. They
            only serve to see whether a controller was running.
        reference_names: their nr column names.
        still_references: names of set points in the file that never move.
        unused: columns that were chosen for nothing, (N, n), in the file's units, or None: what
            seems to change with time may go with one of them.
        since: what went before a piece of a longer record: seconds, and the integral of each
            output, (1 + ny,); None at the beginning of a record.
        read_as: what was decided when it was read, and how to decide otherwise.
        as_logged: the record before it was filtered or decimated, which smears instants: whether a
            controller was running is judged on it. None where nothing was.

    Raises:
        DataError: lengths differ, the sample time is not positive, or names do not fit.
    """

    u: Array
    y: Array
    dt: float
    inputs: tuple[Channel, ...] = ()
    outputs: tuple[Channel, ...] = ()
    pose: Array | None = None
    t0: float = 0.0
    name: str = "record"
    sha256: str = field(default="")
    weights: Array | None = None
    references: Array | None = None
    reference_names: tuple[str, ...] = ()
    still_references: tuple[str, ...] = ()
    unused: Array | None = None
    unused_names: tuple[str, ...] = ()
    since: Array | None = None
    read_as: tuple[Decision, ...] = ()
    as_logged: "Record | None" = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "u", frozen(self.u))
        put(self, "y", frozen(self.y))
        if len(self.u) != len(self.y):
            raise DataError(f"{self.name}: {len(self.u)} input samples, {len(self.y)} of output")
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise DataError(f"{self.name}: the sample time must be positive, got {self.dt}")
        put(self, "inputs", _named(self.inputs, self.nu, "u", self.name))
        put(self, "outputs", _named(self.outputs, self.ny, "y", self.name))
        if self.pose is not None:
            put(self, "pose", frozen(self.pose, 3))
        if self.weights is not None:
            put(self, "weights", frozen(self.weights, self.ny))
            if len(self.weights) != len(self.y):
                raise DataError(f"{self.name}: {len(self.weights)} weights for {len(self.y)} rows")
        if self.references is not None:
            put(self, "references", frozen(self.references, len(self.reference_names)))
            if len(self.references) != len(self.y):
                raise DataError(
                    f"{self.name}: {len(self.references)} samples of the reference, {len(self.y)} "
                    "of output"
                )
        if self.unused is not None:  # those of other samples are lost
            same = len(self.unused) == len(self.y)
            put(self, "unused", frozen(self.unused, len(self.unused_names)) if same else None)
        if not self.sha256:
            digest = hashlib.sha256(repr((self.u.shape, self.y.shape, self.dt)).encode())
            digest.update(self.u.tobytes())
            digest.update(self.y.tobytes())
            put(self, "sha256", digest.hexdigest())

    def __len__(self) -> int:
        return len(self.u)

    @property
    def nu(self) -> int:
        return int(self.u.shape[1])

    @property
    def ny(self) -> int:
        return int(self.y.shape[1])

    @property
    def t(self) -> Array:
        """Sample instants [s], shape (N,)."""
        return self.t0 + self.dt * np.arange(len(self), dtype=np.float64)

    @property
    def input_names(self) -> tuple[str, ...]:
        return tuple(c.name for c in self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        return tuple(c.name for c in self.outputs)

    @property
    def is_robot_log(self) -> bool:
        """Whether drives are commanded and wheel speeds measured: zero is then a physical zero.

        By what the columns were recognised as (``pwm_l``, ``left_pwm``, ``cmd_right``; ``omega_l``,
        ``rpmL``, ``v_left``) and their units, see ``column_words``.
        """
        return all(is_drive(c.name, c.unit) for c in self.inputs) and all(
            is_wheel_speed(c.name, c.unit) for c in self.outputs
        )

    @property
    def is_in_pulse_widths(self) -> bool:
        """Whether every input is PWM in µs, whose full drive is known."""
        return all(c.unit == "µs" for c in self.inputs)

    @property
    def full_drive_is_known(self) -> bool:
        """Whether commands are shares of a known full drive; else of the largest that was seen."""
        return self.is_robot_log and self.is_in_pulse_widths

    @property
    def reads_before_commands(self) -> bool:
        """Whether the measurements of a row are known to precede the command of that row.

        So log the robots whose columns this package names, PWM in µs and wheel speeds. Elsewhere a
        command may act on the measurements beside it, and what agrees in a row is no feedback.
        """
        return self.is_robot_log and self.is_in_pulse_widths

    @property
    def left_out(self) -> NDArray[np.bool_]:
        """Samples and outputs whose errors do not count, shape (N, ny)."""
        if self.weights is None:
            return np.zeros(self.y.shape, dtype=bool)
        return np.asarray(self.weights == 0.0)

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """Samples and outputs whose errors a fit looks at, shape (N, ny)."""
        if self.weights is None:
            return np.ones(self.y.shape, dtype=bool)
        return np.asarray(self.weights > HARDLY)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Samples whose errors count at every output, shape (N,)."""
        return np.asarray(~self.left_out.any(axis=1))

    @property
    def ordinary(self) -> NDArray[np.bool_]:
        """Samples whose errors count fully at every output, shape (N,)."""
        if self.weights is None:
            return np.ones(len(self), dtype=bool)
        return np.asarray(np.all(self.weights == 1.0, axis=1))

    def __repr__(self) -> str:
        names = f"{', '.join(self.input_names)} → {', '.join(self.output_names)}"
        return f"<Record {self.name}: {names}, {len(self)} samples, {self.dt:g} s>"

    def _repr_html_(self) -> str:
        signals = zip((*self.inputs, *self.outputs), np.hstack([self.u, self.y]).T, strict=True)
        rows = [(c.name, c.unit, f"{min(x):.4g}", f"{max(x):.4g}") for c, x in signals]
        return html_lines(repr(self)) + html_table(rows, ("channel", "unit", "least", "most"))

    def to_frame(self) -> Any:
        """A pandas ``DataFrame`` over time [s]: inputs, outputs and the pose, in the units here."""
        from pandas import DataFrame, Index

        columns = dict(
            zip((*self.input_names, *self.output_names), np.hstack([self.u, self.y]).T, strict=True)
        )
        if self.pose is not None:
            columns |= dict(zip(("x", "y", "psi"), self.pose.T, strict=True))
        return DataFrame(columns, index=Index(self.t, name="t"))

    def rows(self, start: int, stop: int) -> "Record":
        """The samples ``start`` ≤ k < ``stop`` as a record of their own (same hash, later t0)."""
        start, stop, _ = slice(start, stop).indices(len(self))
        part = self.mapped(lambda x: x[start:stop])
        return replace(part, t0=self.t0 + start * self.dt)

    def every(self, rows: int, phase: int = 0) -> "Record":
        """One sample every so many rows, from ``phase`` on: inputs are means until the next one.

        ū_k = (1/m) Σ_{i<m} u_{km+i} acts on a slow plant as the m inputs that it replaces did.
        """
        n = (len(self) - phase) // rows
        part = self.rows(phase, phase + n * rows)
        kept = part.mapped(lambda x: x[::rows], lambda x: block_means(x, rows))
        return replace(kept, dt=self.dt * rows)

    def averaged(self, rows: int) -> "Record":
        """Means of so many rows each; inputs and outputs alone."""
        u, y = block_means(self.u, rows), block_means(self.y, rows)
        dt = self.dt * rows
        return replace(self, u=u, y=y, dt=dt, pose=None, references=None, weights=None)

    def mapped(
        self, taken: Callable[[Array], Array], commanded: Callable[[Array], Array] | None = None
    ) -> "Record":
        """The record with all that it holds by sample put through a function, (N, n) → (M, n).

        Args:
            taken: of outputs, pose and weights.
            commanded: of inputs, references and unused columns; as ``taken`` unless given.
        """
        led = commanded or taken
        functions = {
            "u": led,
            "references": led,
            "unused": led,
            "y": taken,
            "pose": taken,
            "weights": taken,
        }
        held = {n: getattr(self, n) for n in functions}
        new: dict[str, Any] = {n: functions[n](x) for n, x in held.items() if x is not None}
        return replace(self, **new)

    def between(self, t_start: float, t_end: float) -> "Record":
        """The samples with ``t_start`` ≤ t < ``t_end`` [s]."""
        first = int(np.ceil((t_start - self.t0) / self.dt - 1e-9))
        last = int(np.ceil((t_end - self.t0) / self.dt - 1e-9))
        return self.rows(max(first, 0), max(last, 0))

    def split(self, fraction: float) -> tuple["Record", "Record"]:
        """The first ``fraction`` of the samples and the rest.

        Raises:
            DataError: ``fraction`` is not inside (0, 1) or leaves one part empty.
        """
        at = round(len(self) * fraction) if 0.0 < fraction < 1.0 else 0
        if not 0 < at < len(self):
            raise DataError(
                f"{self.name}: cannot split {len(self)} samples at {fraction}; "
                "give a fraction inside (0, 1)"
            )
        return self.rows(0, at), self.rows(at, len(self))

    def select(self, inputs: Sequence[str], outputs: Sequence[str]) -> "Record":
        """Only the named channels, in the given order.

        Raises:
            DataError: a name is not a channel of this record.
        """
        iu = [_index(n, self.input_names, self.name) for n in inputs]
        iy = [_index(n, self.output_names, self.name) for n in outputs]
        return replace(
            self,
            u=self.u[:, iu],
            y=self.y[:, iy],
            inputs=tuple(self.inputs[i] for i in iu),
            outputs=tuple(self.outputs[i] for i in iy),
            weights=None if self.weights is None else self.weights[:, iy],
            as_logged=self.as_logged and self.as_logged.select(inputs, outputs),
        )


def block_means(x: Array, rows: int) -> Array:
    """Means of so many rows each, (N, n) → (N // rows, n)."""
    n = len(x) // rows
    return np.asarray(x[: n * rows].reshape(n, rows, -1).mean(axis=1))


def names_of(records: Sequence[Record]) -> str:
    """The names of records, with parts of one log as ``log.csv parts 1 to 20``."""
    parts: dict[str, list[str]] = {}
    for name in dict.fromkeys(r.name for r in records):
        log, _, part = name.rpartition(" part ")
        parts.setdefault(log if part.isdigit() and log else name, []).append(part)
    called = []
    for log, of_log in parts.items():
        first, last = of_log[0], of_log[-1]
        many = f" parts {first} to {last}" if first != last else f" part {first}"
        called.append(f"{log}{many}" if last.isdigit() else log)
    return ", ".join(called)


def _named(
    channels: Sequence[Channel | str], n: int, letter: str, record: str
) -> tuple[Channel, ...]:
    if not channels:
        return tuple(Channel(letter if n == 1 else f"{letter}{i + 1}") for i in range(n))
    if len(channels) != n:
        raise DataError(f"{record}: {n} columns of {letter} but {len(channels)} channel names")
    return tuple(Channel(c) if isinstance(c, str) else c for c in channels)


def _index(name: str, names: tuple[str, ...], record: str) -> int:
    if name not in names:
        raise DataError(f"{record}: no channel {name!r}; there are {', '.join(names)}")
    return names.index(name)


PIECES = 4
"""Pieces of each record: enough to meet what changes within it, few enough to keep them long."""


def shortened(records: Sequence[Record], samples: int, parts: int = PIECES) -> tuple[Record, ...]:
    """At most ``samples`` samples in all, as evenly spread contiguous pieces of each record."""
    total = sum(len(r) for r in records)
    if total <= samples:
        return tuple(records)
    pieces: list[Record] = []
    for r in records:
        each = max(len(r) * samples // total // parts, 1)
        starts = [k * len(r) // parts for k in range(parts)]
        pieces += [r.rows(start, start + each) for start in starts]
    return tuple(pieces)
