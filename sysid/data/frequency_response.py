"""Frequency responses as data: measured by an analyser, estimated from a log, or of a model.

A ``.frd.csv`` has one row a frequency and a header such as

    # windows: 8
    f [Hz],u [µs] > y [rad/s] real,u [µs] > y [rad/s] imag,u [µs] > y [rad/s] error,y coherence

The first column is f [Hz] or w [rad/s]. A path, INPUT > OUTPUT, stands before the words real and
imag, or magnitude (or magnitude [dB]) and phase (degrees, or phase [rad]); without it there is one
path, u > y. The error is the standard error √E|Ĝ − G|²; where it is missing, coherence gives it:
|G| √((1 − γ²) / (K γ²)) of K windows (Bendat & Piersol 2010, table 9.6), K = 1 unless a comment
says so.
"""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from sysid.data.files import read_bytes, write_atomic
from sysid.data.record import Array, Channel
from sysid.errors import DataError, ModelError

if TYPE_CHECKING:
    from control import FrequencyResponseData

Complex = NDArray[np.complex128]
Route = tuple[Channel, Channel]
ENDING = ".frd.csv"


def python_control() -> Any:
    """The package ``control``."""
    try:
        import control
    except ImportError:
        raise ModelError(
            "python-control is not installed; install sysid-workbench[control]"
        ) from None
    return control


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Responses of outputs to inputs at some frequencies.

    Attributes:
        frequency: f [Hz], rising, (nf,).
        value: G(f), (nf, ny, nu).
        variance: E|Ĝ − G|², both parts together, (nf, ny, nu), or None where it is unknown.
        inputs, outputs: channels with their units.
        sample_time: [s] where it is the response of a sampled system, whose inputs are held.
        coherence: γ² of each output, (nf, ny), or None.
        name: what to call it in messages.

    Raises:
        DataError: shapes differ, a number is not finite, or the frequencies do not rise.
    """

    frequency: Array
    value: Complex
    variance: Array | None = None
    inputs: tuple[Channel, ...] = (Channel("u"),)
    outputs: tuple[Channel, ...] = (Channel("y"),)
    sample_time: float | None = None
    coherence: Array | None = None
    name: str = "frequency response"

    def __post_init__(self) -> None:
        nf, ny, nu = len(self.frequency), len(self.outputs), len(self.inputs)
        shapes = {"value": (nf, ny, nu), "variance": (nf, ny, nu), "coherence": (nf, ny)}
        for name, shape in shapes.items():
            given = getattr(self, name)
            if given is None:
                continue
            kept = np.array(given, dtype=np.complex128 if name == "value" else np.float64)
            if kept.shape != shape:
                raise DataError(f"{self.name}: {name} has shape {kept.shape} instead of {shape}")
            if not np.all(np.isfinite(kept)):
                raise DataError(f"{self.name}: {name} has numbers that are not finite")
            kept.setflags(write=False)
            object.__setattr__(self, name, kept)
        f = np.array(self.frequency, dtype=np.float64)
        f.setflags(write=False)
        object.__setattr__(self, "frequency", f)
        if f.ndim != 1 or not len(f) or not np.all(np.isfinite(f)) or f[0] < 0.0:
            raise DataError(f"{self.name}: frequencies must be numbers from 0 on, one a row")
        if np.any(np.diff(f) <= 0.0):
            row = int(np.flatnonzero(np.diff(f) <= 0.0)[0]) + 2
            raise DataError(f"{self.name}: frequencies must rise, but number {row} does not")

    @property
    def w(self) -> Array:
        """Angular frequencies [rad/s], (nf,)."""
        return 2.0 * np.pi * self.frequency

    def to_control(self) -> "FrequencyResponseData":
        """``control.FRD`` over rad/s, with the names of the channels.

        Raises:
            ModelError: python-control is not installed.
        """
        control = python_control()
        return control.FRD(
            np.moveaxis(self.value, 0, -1),
            self.w,
            self.sample_time or 0.0,
            inputs=[c.name for c in self.inputs],
            outputs=[c.name for c in self.outputs],
        )

    @classmethod
    def from_control(cls, frd: "FrequencyResponseData") -> Self:
        """Of a ``control.FRD``; it has no errors and no units."""
        sampled = float(frd.dt) if frd.dt and frd.dt is not True else None
        return cls(
            np.asarray(frd.frequency) / (2.0 * np.pi),
            np.moveaxis(np.asarray(frd.complex).reshape(frd.noutputs, frd.ninputs, -1), -1, 0),
            inputs=tuple(map(Channel, frd.input_labels)),
            outputs=tuple(map(Channel, frd.output_labels)),
            sample_time=sampled,
        )

    def write(self, path: str | Path) -> Path:
        """Write a ``.frd.csv`` that :func:`read_frequency_response` reads back exactly."""
        heads, columns = ["f [Hz]"], [self.frequency]
        for i, y in enumerate(self.outputs):
            for j, u in enumerate(self.inputs):
                path_name = f"{_labelled(u)} > {_labelled(y)}"
                heads += [f"{path_name} real", f"{path_name} imag"]
                columns += [self.value[:, i, j].real, self.value[:, i, j].imag]
                if self.variance is not None:
                    heads.append(f"{path_name} error")
                    columns.append(np.sqrt(self.variance[:, i, j]))
        if self.coherence is not None:
            heads += [f"{y.name} coherence" for y in self.outputs]
            columns += list(self.coherence.T)
        lines = [] if self.sample_time is None else [f"# sample time: {self.sample_time!r} s"]
        lines.append(",".join(f'"{h}"' if "," in h else h for h in heads))
        lines += [",".join(repr(float(x)) for x in row) for row in zip(*columns, strict=True)]
        return write_atomic(path, "\n".join(lines) + "\n")


def _labelled(channel: Channel) -> str:
    return f"{channel.name} [{channel.unit}]" if channel.unit else channel.name


_COLUMN = re.compile(
    r"^(?P<path>.*?)[\s:]*\b(?P<kind>real|re|imag|imaginary|im|magnitude|mag|gain|amplitude|phase|"
    r"angle|coherence|coh|error)\s*[\[(_]?(?P<unit>db|deg|degrees|°|rad)?[\])]?$",
    re.IGNORECASE,
)
_FREQUENCY = re.compile(
    r"^(?P<kind>f|freq|frequency|w|ω|omega)\s*[\[(_]?(?P<unit>hz|rad/s|rad_s)?[\])]?$",
    re.IGNORECASE,
)
_KINDS = {
    "re": "real", "im": "imag", "imaginary": "imag", "mag": "magnitude", "gain": "magnitude",
    "amplitude": "magnitude", "angle": "phase", "coh": "coherence",
}  # fmt: skip
_NOTE = re.compile(r"^#\s*(sample.?time|windows)\s*[:=]\s*([0-9.eE+-]+)", re.IGNORECASE)


def read_frequency_response(path: str | Path) -> FrequencyResponse:
    """Read a ``.frd.csv``; the module says what it may hold.

    Raises:
        UsageError: there is no such file.
        DataError: the header or a cell cannot be read; the line is named.
    """
    from sysid.data.reading.decoding import decode

    name = Path(path).name
    lines = decode(read_bytes(path), name)[0].splitlines()
    notes = {m[1].lower()[0]: m[2] for line in lines if (m := _NOTE.match(line))}
    kept = [(k, s) for k, s in enumerate(lines, 1) if s.strip() and not s.startswith("#")]
    try:
        delimiter = ";" if kept and ";" in kept[0][1] else ","
        table = list(csv.reader([s for _, s in kept], delimiter=delimiter))
    except csv.Error as error:
        raise DataError(f"{name} is no table of frequencies ({error})") from None
    if len(table) < 2:
        raise DataError(f"{name} has no rows; a frequency response has a header and rows below it")
    heads = [h.strip() for h in table[0]]
    numbers = [
        _numbers(row, len(heads), f"{name}, line {kept[k][0]}")
        for k, row in enumerate(table[1:], 1)
    ]
    columns = np.array(numbers).T
    found = _FREQUENCY.match(heads[0])
    if not found:
        raise DataError(f"{name}: the first column is {heads[0]!r}; it must be f [Hz] or w [rad/s]")
    angular = (found["unit"] or "").lower().startswith("rad") or (
        not found["unit"] and found["kind"].lower() in ("w", "ω", "omega")
    )
    paths, coherence = _by_path(heads[1:], columns[1:], name)
    inputs = tuple(dict.fromkeys(u for u, _ in paths))
    outputs = tuple(dict.fromkeys(y for _, y in paths))
    if missing := [(u, y) for u in inputs for y in outputs if (u, y) not in paths]:
        u, y = missing[0]
        raise DataError(f"{name}: the path {u.name} > {y.name} is missing; give every path")
    value = np.array([[_value(paths[u, y], name) for u in inputs] for y in outputs])
    errors = [[paths[u, y].get("error") for u in inputs] for y in outputs]
    alone = next(iter(coherence.values()), None) if len(outputs) == 1 else None
    gammas = [g for y in outputs if (g := coherence.get(y.name, alone)) is not None]
    gamma = np.array(gammas).T if len(gammas) == len(outputs) else None
    variance = None
    if all(e is not None for row in errors for e in row):
        with np.errstate(over="ignore"):
            variance = np.moveaxis(np.array(errors, dtype=np.float64) ** 2, -1, 0)
    elif gamma is not None and len(inputs) == 1:
        known = np.clip(gamma, 1e-6, 1.0 - 1e-9)[:, :, None]
        spread = (1.0 - known) / (known * _note(notes, "w", 1.0, name))
        with np.errstate(over="ignore"):
            variance = np.abs(np.moveaxis(value, -1, 0)) ** 2 * spread
    return FrequencyResponse(
        columns[0] / (2.0 * np.pi) if angular else columns[0],
        np.moveaxis(value, -1, 0),
        variance,
        inputs,
        outputs,
        _note(notes, "s", None, name),
        gamma,
        name,
    )


def _by_path(
    heads: Sequence[str], columns: Array, name: str
) -> tuple[dict[Route, dict[str, Any]], dict[str, Array]]:
    """The columns of each path by kind, and coherences by output."""
    paths: dict[Route, dict[str, Any]] = {}
    coherence: dict[str, Array] = {}
    for head, values in zip(heads, columns, strict=True):
        found = _COLUMN.match(head)
        if not found:
            raise DataError(
                f"{name}: the column {head!r} is no part of a response; name it real, imag, "
                "magnitude, phase, error or coherence, behind INPUT > OUTPUT where there are "
                "several paths"
            )
        kind, unit = found["kind"].lower(), (found["unit"] or "").lower()
        kind = _KINDS.get(kind, kind)
        if kind == "coherence":
            coherence[_channel(found["path"].rpartition(">")[2]).name] = values
            continue
        u, _, y = found["path"].rpartition(">")
        key = _channel(u or "u"), _channel(y or "y")
        if kind == "magnitude" and unit == "db":
            with np.errstate(over="ignore"):  # what is not finite is refused
                values = 10.0 ** (values / 20.0)
        if kind == "phase" and unit != "rad":
            values = np.radians(values)
        paths.setdefault(key, {})[kind] = values
    return paths, coherence


def _channel(text: str) -> Channel:
    """``speed [rad/s]`` as a channel."""
    name, _, unit = text.strip().removesuffix("]").partition("[")
    return Channel(name.strip(), unit.strip())


def _value(parts: dict[str, Array], name: str) -> Complex:
    if "real" in parts and "imag" in parts:
        return np.asarray(parts["real"] + 1j * parts["imag"])
    if "magnitude" in parts and "phase" in parts:
        with np.errstate(invalid="ignore"):
            return np.asarray(parts["magnitude"] * np.exp(1j * parts["phase"]))
    raise DataError(
        f"{name} has only {', '.join(parts)} of a path; it needs real and imag, or magnitude and "
        "phase"
    )


def _numbers(row: Sequence[str], count: int, where: str) -> list[float]:
    if len(row) != count:
        raise DataError(f"{where}: {len(row)} cells under a header of {count}")
    try:
        numbers = [float(cell) for cell in row]
    except ValueError as error:
        raise DataError(f"{where}: {str(error).partition(': ')[2]} is no number") from None
    if not all(map(math.isfinite, numbers)):
        raise DataError(f"{where}: a number is not finite")
    return numbers


def _note(notes: dict[str, str], key: str, otherwise: Any, name: str) -> Any:
    """The number of a comment line, which must be above 0."""
    if key not in notes:
        return otherwise
    try:
        number = float(notes[key])
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0.0):
        raise DataError(f"{name}: {notes[key]!r} in a comment line is no number above 0")
    return number
