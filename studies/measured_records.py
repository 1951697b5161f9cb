"""How the measured records of ``structures_on_data.md`` are read and divided.

The records themselves, and where they lie, are those of ``records.py``; this page shows all of them
to the linear structures, with the divisions that their authors name.
"""

from dataclasses import dataclass

from studies.records import data_folder
from sysid.data.io import read_log
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Record

DATA = data_folder()
"""The folder of the measured records, or None."""


@dataclass(frozen=True)
class Protocol:
    """One measured record and how it is divided into estimation and validation data.

    Attributes:
        name: what to call it.
        file: inside the data folder.
        what: the plant, and what makes it hard.
        division: the division in words.
        estimation, validation: rows (start, stop); shares of the record where they are fractions.
        skip: samples at the head of the validation data that do not count.
        other: the file of the validation data, where it is another one.
        ts: sample time [s], where the file does not tell it.
    """

    name: str
    file: str
    what: str
    division: str
    estimation: tuple[float, float]
    validation: tuple[float, float]
    skip: int = 0
    other: str = ""
    ts: float | None = None

    def read(self) -> tuple[Record, Record]:
        """The estimation and the validation data."""
        whole = read(self.file, self.ts)
        second = read(self.other, self.ts) if self.other else whole
        return _rows(whole, self.estimation), _rows(second, self.validation)


def available() -> bool:
    """Whether the measured records are there."""
    return DATA is not None and all((DATA / p.file).is_file() for p in PROTOCOLS)


def read(file: str, ts: float | None = None) -> Record:
    """One record by its name inside the data folder."""
    assert DATA is not None  # see available()
    return read_log(DATA / file, ReadOptions(ts=ts))


def _rows(record: Record, part: tuple[float, float]) -> Record:
    n = len(record)
    start, stop = (round(x * n) if isinstance(x, float) else x for x in part)
    return record.rows(start, stop)


def _shares(split: float) -> tuple[tuple[float, float], tuple[float, float]]:
    return (0.0, split), (split, 1.0)


PROTOCOLS = (
    Protocol(
        "hoop_motor",
        "hoop_motor/random_steps.csv",
        "DC motor with a hoop, u in ±1; the first half only drives forward, the second only "
        "backward; concave static gain, dead zone",
        "first 70 % / last 30 %",
        *_shares(0.7),
    ),
    Protocol(
        "tacho_motor",
        "tacho_motor/random_steps_10hz_2000.csv",
        "DC motor with a tachometer that clips at 5 V; dead zone, one direction only",
        "first 75 % / last 25 %",
        *_shares(0.75),
    ),
    Protocol(
        "motor_generator",
        "motor_generator/decim500.csv",
        "motor and generator, two-level input; sample time not published, counted as 1 s",
        "first half / second half",
        *_shares(0.5),
        ts=1.0,
    ),
    Protocol(
        "ced, low",
        "ced/unif_low.csv",
        "coupled electric drives: two motors and a belt, whose speed sensor has no sign",
        "first 400 / last 100 samples, 10 of them not counted",
        (0, 400),
        (400, 500),
        skip=10,
    ),
    Protocol(
        "ced, high",
        "ced/unif_high.csv",
        "the same at a higher level",
        "as before",
        (0, 400),
        (400, 500),
        skip=10,
    ),
    Protocol(
        "dryer",
        "dryer/dryer.csv",
        "hot-air dryer; practically linear, delay of three samples",
        "samples 1 … 300 / 800 … 900",
        (0, 300),
        (799, 900),
    ),
    Protocol(
        "cascaded_tanks",
        "cascaded_tanks/est.csv",
        "two tanks in cascade; square-root outflow, and the upper one overflows",
        "est.csv / val.csv, 50 samples not counted",
        (0.0, 1.0),
        (0.0, 1.0),
        skip=50,
        other="cascaded_tanks/val.csv",
    ),
    Protocol(
        "winding",
        "winding/winding.csv",
        "winding machine, 5 inputs and 2 outputs",
        "first half / second half",
        *_shares(0.5),
    ),
    Protocol(
        "cdplayer_arm",
        "cdplayer_arm/cdplayer.csv",
        "arm of a CD player, 2 inputs and 2 outputs, lightly damped",
        "first half / second half",
        *_shares(0.5),
        ts=1.0,
    ),
    Protocol(
        "mr_damper",
        "mr_damper/damper.csv",
        "magneto-rheological damper: hysteresis and saturation, which no linear model has",
        "first 2000 / last 1499 samples",
        (0, 2000),
        (2000, 3499),
    ),
    Protocol(
        "ballbeam",
        "ballbeam/ballbeam.csv",
        "ball on a beam, nearly a double integrator",
        "first half / second half",
        *_shares(0.5),
    ),
)
