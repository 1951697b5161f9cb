"""The public measured records and the protocol each is judged by.

The records lie beside the project, in ``../shared/data`` or in the folder named by
``SYSID_DATA``; they are read from there and never copied. Splits and figures follow the records'
own documentation; where no official test record is at hand, the split is stated here.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sysid_datasets import path as bundled

from sysid.criteria.fit import fit_percent, rmse, rrse
from sysid.data.io import read_log
from sysid.data.preprocess import Detrend
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Array, Record

ROOT = Path(__file__).resolve().parent.parent


def data_folder() -> Path | None:
    """Where the measured records are, or None."""
    named = os.environ.get("SYSID_DATA")
    folder = Path(named) if named else ROOT.parent / "shared" / "data"
    return folder if folder.is_dir() else None


@dataclass(frozen=True, eq=False)
class Trial:
    """One record with its protocol.

    Attributes:
        name: as the table calls it.
        train: experiments to choose and fit on.
        tests: name → experiments to judge on, in free run.
        skip: samples at the head of each test record left out (they may set the initial state).
        metric: ``rmse``, ``fit`` or ``rrse``.
        unit: unit of the figure, after multiplying by ``factor``.
        factor: from SI to that unit.
        least, aim: figures to reach, by test.
    """

    name: str
    train: tuple[Record, ...]
    tests: dict[str, tuple[Record, ...]]
    skip: int
    metric: str
    unit: str
    factor: float
    least: dict[str, float]
    aim: dict[str, float]

    @property
    def detrend(self) -> Detrend:
        """What published protocols remove: the means, except from a robot's log."""
        first = self.train[0]
        none = Detrend.none(first.nu, first.ny)
        return none if first.is_robot_log else Detrend.means(self.train)

    def figure(self, measured: list[Array], simulated: list[Array]) -> float:
        """The protocol's figure, mean over outputs."""
        with np.errstate(over="ignore", invalid="ignore"):
            compute = {"rmse": rmse, "fit": fit_percent, "rrse": rrse}[self.metric]
            value = float(np.mean(compute(measured, simulated, self.skip)))
        return value * self.factor


def _read(name: str, ts: float | None = None, **columns: tuple[str, ...]) -> Record:
    folder = data_folder()
    if folder is None:
        raise FileNotFoundError("no folder of measured records; set SYSID_DATA")
    return read_log(folder / name, ReadOptions(ts=ts, **columns))


def _ced(which: str) -> Trial:
    r = _read(f"ced/unif_{which}.csv")
    return Trial(
        f"CED {which}",
        (r.rows(0, 400),),
        {which: (r.rows(400, 500),)},
        10,
        "rmse",
        "V",
        1.0,
        {which: 0.12},
        {which: {"low": 0.095, "high": 0.085}[which]},
    )


def _tanks() -> Trial:
    est, val = _read("cascaded_tanks/est.csv"), _read("cascaded_tanks/val.csv")
    return Trial(
        "cascaded tanks",
        (est,),
        {"val": (val,)},
        50,
        "rmse",
        "V",
        1.0,
        {"val": 0.46},
        {"val": 0.40},
    )


def _silverbox() -> Trial:
    r = _read("silverbox/snls80mv.csv", ts=1 / 610.35)
    multisine = r.rows(40650, 127400)
    train, test = multisine.split(0.75)
    return Trial(
        "Silverbox",
        (train,),
        {"multisine": (test,), "arrow": (r.rows(100, 40575),)},
        50,
        "rmse",
        "mV",
        1e3,
        {"multisine": 0.40, "arrow": 0.60},
        {"multisine": 0.24, "arrow": 0.32},
    )


def _emps() -> Trial:
    train, test = _read("emps/train.csv").split(0.75)
    return Trial(
        "EMPS",
        (train,),
        {"last quarter": (test,)},
        0,
        "rmse",
        "mm",
        1e3,
        {"last quarter": 5.5},
        {"last quarter": 3.5},
    )


def _hoop() -> Trial:
    r = _read("hoop_motor/random_steps.csv")
    half = len(r) // 2
    parts = [r.rows(0, half).split(0.9), r.rows(half, len(r)).split(0.9)]
    return Trial(
        "hoop_motor",
        tuple(a for a, _ in parts),
        {"last tenths": tuple(b for _, b in parts)},
        0,
        "fit",
        "%",
        1.0,
        {"last tenths": 97.0},
        {"last tenths": 98.0},
    )


def _tacho() -> Trial:
    train, test = _read("tacho_motor/random_steps_10hz_2000.csv").split(0.75)
    return Trial(
        "tacho_motor",
        (train,),
        {"last quarter": (test,)},
        0,
        "fit",
        "%",
        1.0,
        {"last quarter": 96.0},
        {"last quarter": 97.5},
    )


def _damper() -> Trial:
    r = _read("mr_damper/damper.csv")
    return Trial(
        "MR damper",
        (r.rows(0, 2000),),
        {"rest": (r.rows(2000, len(r)),)},
        0,
        "rmse",
        "N",
        1.0,
        {"rest": 9.0},
        {"rest": 6.0},
    )


def _generator() -> Trial:
    r = _read("motor_generator/decim500.csv", ts=1.0)
    return Trial(
        "motor_generator",
        (r.rows(0, 500),),
        {"rest": (r.rows(500, 1000),)},
        0,
        "rrse",
        "RRSE",
        1.0,
        {"rest": 0.070},
        {"rest": 0.055},
    )


def _robot() -> Trial:
    names = ("multilevel", "prbs", "multisine", "forward_back", "rotation")
    logs = tuple(read_log(bundled(n)) for n in names)
    tests = {n: (read_log(bundled(f"{n}_val")),) for n in names}
    return Trial(
        "bundled robot", logs, tests, 0, "fit", "%", 1.0, {"multilevel": 91.5}, {"multilevel": 97.0}
    )


TRIALS: dict[str, Callable[[], Trial]] = {
    "ced-low": lambda: _ced("low"),
    "ced-high": lambda: _ced("high"),
    "tanks": _tanks,
    "silverbox": _silverbox,
    "emps": _emps,
    "hoop": _hoop,
    "tacho": _tacho,
    "damper": _damper,
    "generator": _generator,
    "robot": _robot,
}
