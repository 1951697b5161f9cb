"""selftest.csv: inputs and the outputs that every runtime of a plant must reproduce."""

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sysid.data.preprocess import Detrend
from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.outside_text import csv_text
from sysid.plant.description import from_text, to_model
from sysid.plant.storage import MARK, read_member
from sysid.structures.model import Model
from sysid.structures.plant import Plant

NAME = "selftest.csv"
ROWS = 200
TOLERANCE = 1e-9
"""Largest error allowed, relative to the largest deviation of each output from its first value.

Two exact runtimes differ by rounding only, some 1e-16 a sample amplified by the plant's poles;
1e-9 leaves room for poles very near the unit circle and shows any real mistake."""

_HOLD = 8
"""Samples each level of the excitation is held."""
_REST = 5
"""Samples of rest at the operating point before it."""
_RUNAWAY = 1e6
"""An unstable plant's self-test ends where an output has moved by so many times its range."""


@dataclass(frozen=True, eq=False)
class SelfTest:
    """Rows that every runtime must reproduce from the state of rest.

    Attributes:
        t: instants [s], shape (N,).
        u: inputs, shape (N, nu).
        y: expected outputs, shape (N, ny).
    """

    t: Array
    u: Array
    y: Array

    def scale(self) -> Array:
        """What errors of each output are relative to, shape (ny,); 1 where it never moves."""
        moved = np.max(np.abs(self.y - self.y[0]), axis=0)
        return np.where(moved > 0, moved, 1.0)


def reach(values: Array) -> Array:
    """What errors of columns are relative to: how far each goes, 1 where it is always zero."""
    largest = np.max(np.abs(values), axis=0, initial=0.0)
    return np.where(largest > 0.0, largest, 1.0)


def make_selftest(model: Model) -> SelfTest:
    """Expected outputs by ``Model.simulate`` from rest, for levels that cover the domain.

    After some samples of rest the input j holds the levels lo + (hi − lo)·frac(½ + k/φʲ⁺¹), φ the
    root of φⁿᵘ⁺¹ = φ + 1: evenly spread over the box of inputs seen, different for every input,
    and the same on every machine. (Roberts 2018, the R-sequence.)
    """
    nu = len(model.inputs)
    middle = model.detrend.u_offset
    seen = model.ranges[:nu] if len(model.ranges) >= nu else np.column_stack([middle, middle])
    low, high = seen[:, 0], seen[:, 1]
    still = high <= low
    low, high = np.where(still, middle - 1, low), np.where(still, middle + 1, high)
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (nu + 1))
    k = np.maximum(np.arange(ROWS) - _REST, 0) // _HOLD
    # six digits, so that the last bit of a power function does not show in the levels
    part = np.round((0.5 + (k[:, None] + 1) * root ** -(np.arange(nu) + 1.0)) % 1.0, 6)
    u = low + (high - low) * part
    u[:_REST] = np.clip(middle, low, high)
    # trends in time belong to the data a model was fitted to, not to the plant
    steady = Detrend(model.detrend.u_offset, model.detrend.y_offset)
    with np.errstate(over="ignore", invalid="ignore"):
        y = replace(model, detrend=steady).simulate(u)
    y = y[: _usable(y, model)]
    t = model.dt * np.arange(len(y), dtype=np.float64)
    return SelfTest(t, u[: len(y)], y)


def _usable(y: Array, model: Model) -> int:
    """Number of rows before an unstable plant leaves the range of sensible numbers."""
    ny = y.shape[1]
    span = np.ptp(model.ranges[-ny:], axis=1) if len(model.ranges) >= ny else np.ones(ny)
    span = np.where(span > 0, span, 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        ran_away = ~np.all(np.abs(y - model.detrend.y_offset) <= _RUNAWAY * span, axis=1)
    first = int(np.argmax(ran_away)) if ran_away.any() else len(y)
    return max(first, 2)


def to_csv(test: SelfTest, model: Model) -> str:
    """The rows as CSV with 17 significant digits: t, inputs, outputs by name."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    writer.writerow(_header(model))
    for t, u, y in zip(test.t, test.u, test.y, strict=True):
        writer.writerow([f"{t:.12g}", *(f"{v:.17g}" for v in (*u, *y))])
    return lines.getvalue()


def _header(plant: Plant | Model) -> list[str]:
    return ["t", *(csv_text(c.name) for c in (*plant.inputs, *plant.outputs))]


def read_csv(text: bytes, plant: Plant, where: str) -> SelfTest:
    """Undo :func:`to_csv`."""
    damaged = f"{where}: {NAME} is damaged; export the plant again"
    try:
        header, *rows = csv.reader(io.StringIO(text.decode("utf-8")))
        values = np.array([[float(cell) for cell in row] for row in rows], dtype=np.float64)
    except (ValueError, csv.Error):
        raise ModelError(damaged) from None
    names = _header(plant)
    if header != names or values.shape != (len(rows), len(names)) or not len(rows):
        raise ModelError(damaged)
    if not np.all(np.isfinite(values)):
        raise ModelError(damaged)
    nu = len(plant.inputs)
    return SelfTest(values[:, 0], values[:, 1 : 1 + nu], values[:, 1 + nu :])


def run(plant: Plant, u: Array) -> Array:
    """The plant's outputs (N, ny) to inputs (N, nu), stepped sample by sample from rest."""
    state = plant.initial_state()
    y = np.zeros((len(u), len(plant.outputs)))
    for k, row in enumerate(u):
        state, y[k] = plant.step(state, row)
    return y


def selftest(path: str | Path) -> float:
    """Read a package back, step its plant through selftest.csv, return the largest error.

    Returns:
        max |y − y_expected| over all rows and outputs, in the outputs' units.
    """
    path = Path(path)
    plant = to_model(from_text(read_member(path, MARK), str(path)), str(path)).plant()
    test = read_csv(read_member(path, NAME), plant, str(path))
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.abs(run(plant, test.u) - test.y)
    worst = np.max(error, axis=0)
    relative = float(np.max(worst / test.scale()))
    if not relative <= TOLERANCE:  # NaN counts as a failure
        raise ModelError(
            f"{path} fails its self-test: the plant differs from {NAME} by {relative:.2g} of the "
            f"output's range, more than {TOLERANCE:g}; export it again"
        )
    return float(np.max(worst))
