"""The accuracy rows of the gate: deterministic, each a free run on data that chose nothing.

Measured records lie beside the project, in ``../shared/data`` or the folder named by
``SYSID_DATA``; where they are not, their rows are skipped. Figures are those that the tool itself
shows: free run from a state estimated at the head of the test part.
"""

import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import sysid_datasets
from gate_judging import Skip, Value
from scipy.signal import lfilter
from sysid_datasets.hidden_logs import Request, hide

import sysid
from sysid.data.record import Array, Channel, Record
from sysid.estimation.assessment.figures import figures

Records = tuple[sysid.Record, ...]
Parts = tuple[Records, Records]
"""What is fitted, and what judges."""


@dataclass(frozen=True)
class Measured:
    """A measured record, divided as its authors or ``docs`` of the records say.

    Attributes:
        parts: reads and divides it.
        skip: samples at the head of the test part that do not count.
        factor: from the record's unit to that of ``gate.json``; None for the fit in percent.
        structures: what is fitted to it, orders searched: quick ones, and one that comes near to
            the best that is published where that takes seconds.
    """

    parts: Callable[[], Parts]
    structures: tuple[str, ...]
    skip: int = 0
    factor: float | None = 1.0


def read(file: str, ts: float | None = None) -> sysid.Record:
    """A measured record by its name inside the data folder.

    Raises:
        Skip: it is not there.
    """
    named = os.environ.get("SYSID_DATA")
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not (folder / file).is_file():
        raise Skip(f"no measured record {folder / file}; name their folder by SYSID_DATA")
    return sysid.read_log(folder / file, sysid.ReadOptions(ts=ts))


def share(file: str, part: float, ts: float | None = None) -> Parts:
    """The first ``part`` of a record, and the rest."""
    first, rest = read(file, ts).split(part)
    return (first,), (rest,)


def rows(
    file: str, train: tuple[int, int], test: tuple[int, int], ts: float | None = None
) -> Parts:
    """Two ranges of rows of a record."""
    whole = read(file, ts)
    return (whole.rows(*train),), (whole.rows(*test),)


def tanks() -> Parts:
    """Cascaded tanks: a record to fit, one to judge."""
    return (read("cascaded_tanks/est.csv"),), (read("cascaded_tanks/val.csv"),)


def silverbox() -> Parts:
    """Silverbox: three quarters of the multisine, and the rest of it."""
    first, rest = read("silverbox/snls80mv.csv", 1 / 610.35).rows(40650, 127400).split(0.75)
    return (first,), (rest,)


def hoop() -> Parts:
    """Hoop: one half drives forward, one backward; the last tenth of each judges."""
    whole = read("hoop_motor/random_steps.csv")
    half = len(whole) // 2
    parts = [r.split(0.9) for r in (whole.rows(0, half), whole.rows(half, len(whole)))]
    return tuple(a for a, _ in parts), tuple(b for _, b in parts)


CED = ((0, 400), (400, 500))
BLOCKS_AND_PRODUCTS = ("hammerstein-wiener", "wiener-hammerstein", "narmax")

MEASURED: Mapping[str, Measured] = {
    "ced-low": Measured(partial(rows, "ced/unif_low.csv", *CED), BLOCKS_AND_PRODUCTS, 10),
    "ced-high": Measured(partial(rows, "ced/unif_high.csv", *CED), BLOCKS_AND_PRODUCTS, 10),
    "tanks": Measured(tanks, ("bj", "hammerstein-wiener", "wiener-hammerstein"), 50),
    "silverbox": Measured(silverbox, ("oe", "hammerstein-wiener"), 50, 1e3),
    "emps": Measured(partial(share, "emps/train.csv", 0.75), ("arx", "armax"), factor=1e3),
    "hoop": Measured(hoop, ("oe", "hammerstein-wiener"), factor=None),
    "tacho": Measured(
        partial(share, "tacho_motor/random_steps_10hz_2000.csv", 0.75),
        ("armax", "hammerstein-wiener"),
        factor=None,
    ),
    "generator": Measured(
        partial(share, "motor_generator/decim500.csv", 0.5, 1.0), ("armax", "oe"), factor=None
    ),
    "damper": Measured(
        partial(rows, "mr_damper/damper.csv", (0, 2000), (2000, 3499)), ("oe", "armax")
    ),
    "dryer": Measured(
        partial(rows, "dryer/dryer.csv", (0, 300), (799, 900)),
        ("arx", "oe", "process"),
        factor=None,
    ),
    "winding": Measured(
        partial(share, "winding/winding.csv", 0.5), ("arx", "oe", "ss"), factor=None
    ),
    "arm": Measured(
        partial(share, "cdplayer_arm/cdplayer.csv", 0.5, 1.0), ("arx", "oe"), factor=None
    ),
    "ballbeam": Measured(
        partial(share, "ballbeam/ballbeam.csv", 0.5), ("armax", "oe"), factor=None
    ),
}

BUNDLED: Mapping[str, tuple[str, ...]] = {
    "prbs": ("arx", "oe"),
    "multisine": ("arx", "oe"),
    "multilevel": ("arx", "hammerstein-wiener"),
    "forward_back": ("arx", "oe"),
    "rotation": ("arx", "oe"),
}
"""The bundled robot's logs, each with the structures of its tour; ``…_val`` judges."""

HIDDEN: Mapping[str, tuple[str, ...]] = {
    "friction": ("coulomb-friction",),
    "nothing": (),
}
"""What is hidden in logs of 30 s; the diagnosis must name just that."""


def measured(name: str, structure: str) -> Value:
    """RMSE or fit on the test part, mean over the outputs, of a fit to the rest."""
    record = MEASURED[name]
    train, test = record.parts()
    simulated = sysid.FitOptions(focus=sysid.Focus.SIMULATION)  # as is judged
    model = sysid.fit(train, structure, options=simulated if structure == "narmax" else None)
    found = figures(model, test, "test", skip=record.skip)
    if record.factor is None:
        return found.mean_fit
    return record.factor * sum(found.rmse.values()) / len(found.rmse)


def bundled(name: str, structure: str) -> Value:
    """Fit [%] of a free run on the second log, as ``sysid fit LOG --val LOG_val`` shows it."""
    log, judge = (sysid.read_log(sysid_datasets.path(n)) for n in (name, f"{name}_val"))
    return figures(sysid.fit(log, structure), (judge,), "test").mean_fit


def names(hidden: str) -> Value:
    """Effects that a diagnosis names."""
    files = hide(Request(HIDDEN[hidden], seed=3, duration=30.0)).files
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        log, held = (sysid.read_log(Path(folder) / name) for name in ("est.csv", "val.csv"))
    return tuple(sorted(effect.id for effect in sysid.diagnose(log, held).effects))


def names_behind(hidden: str) -> Value:
    """The same of logs whose rows were written behind their command, as much firmware does."""
    files = hide(Request(HIDDEN[hidden], seed=3, duration=30.0)).files
    behind = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("est.csv", "val.csv"):
            (Path(folder) / name).write_text(files[name], encoding="utf-8")
            log = sysid.read_log(Path(folder) / name)
            behind.append(replace(log.rows(0, len(log) - 1), y=log.y[1:]))
    return tuple(sorted(effect.id for effect in sysid.diagnose(*behind).effects))


def _held(rng: np.random.Generator, n: int, least: int, most: int) -> Array:
    """Random levels of −1 … 1, each held for a random number of rows, (n,)."""
    counts = rng.integers(least, most, n // least)
    return np.repeat(rng.uniform(-1.0, 1.0, len(counts)), counts)[:n]


def fan(seconds: float) -> Value:
    """Effects named in a log of a fan that is off below 25 % and feels drag by the square, whatever
    unit its clock counts in."""
    rng = np.random.default_rng(19)
    duty, speed, y = np.rint(56.0 + 44.0 * _held(rng, 2400, 20, 90)), 0.0, np.zeros(2400)
    for k, u in enumerate(duty):
        y[k] = speed
        for _ in range(10):
            push = 14.0 * u if u >= 25.0 else 0.0
            speed = max(0.0, speed + 0.025 * (push - 2.4e-4 * speed**2 - 0.12 * speed))
    y = np.rint(np.maximum(y + rng.normal(0.0, 5.0, 2400), 0.0))
    log = Record(duty, y, seconds, (Channel("duty", "%"),), (Channel("speed", "rad/s"),))
    return tuple(sorted(effect.id for effect in sysid.diagnose(log).effects))


def car() -> Value:
    """The shape of a car that turns by its steering times its speed."""
    rng = np.random.default_rng(4)
    steering, throttle = _held(rng, 3000, 20, 80), 0.55 + 0.4 * _held(rng, 3000, 60, 150)
    lags = [lfilter([0.0, 1.0 - p], [1.0, -p], u) for p, u in ((0.97, throttle), (0.8, steering))]
    yaw = 2.0 * lags[0] * lags[1] + rng.normal(0.0, 0.01, 3000)
    channels = tuple(Channel(name) for name in ("steering", "throttle"))
    log = Record(np.column_stack([steering, throttle]), yaw, 0.02, channels, (Channel("yaw"),))
    return tuple(shape.id for shape in sysid.diagnose(log).shapes)


def greenhouse() -> Value:
    """The shape of a greenhouse by its flap alone; the weather is a column that is not used."""
    rng = np.random.default_rng(1)
    flap, pole = np.rint(50.0 + 50.0 * _held(rng, 2000, 60, 140)), np.exp(-1.0 / 60.0)
    weather = 12.0 + np.cumsum(rng.normal(0.0, 0.05, 2000))
    inside = lfilter([0.0, 1.0 - pole], [1.0, -pole], weather - weather[0] - 0.08 * flap) + 20.0
    measured = inside + rng.normal(0.0, 0.05, 2000)
    log = Record(flap, measured, 10.0, (Channel("flap", "%"),), (Channel("inside", "°C"),))
    seen = np.round(weather, 1)[:, None]
    found = sysid.diagnose(replace(log, unused=seen, unused_names=("weather",)))
    return tuple(shape.id for shape in found.shapes)


ROWS: Mapping[str, Callable[[], Value]] = {
    **{f"{n}/{s}": partial(measured, n, s) for n, x in MEASURED.items() for s in x.structures},
    **{f"{n}/{s}": partial(bundled, n, s) for n, each in BUNDLED.items() for s in each},
    **{f"names/{hidden}": partial(names, hidden) for hidden in HIDDEN},
    "names/friction-behind": partial(names_behind, "friction"),
    "names/fan": partial(fan, 0.25),
    "names/fan-in-minutes": partial(fan, 0.25 / 60.0),
    "shapes/car": car,
    "shapes/greenhouse": greenhouse,
}
"""Name → what computes it."""
