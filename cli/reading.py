"""Options that commands with a LOG share, and --json, which every command has."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from .options import argument, changed, flag, in_panel, numbers, option, pairs

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions

LOGS = argument("LOG...", "CSV, Parquet, JSON, MATLAB or bag; several are several experiments.")
FULL = flag("Print everything, not only what fits a screen.")
JSON = flag("Print one JSON document.")
WORKSPACE = option("DIR", "Workspace folder [.sysid].", "-w", "--workspace", default=Path(".sysid"))


def stored_models(incomplete: str) -> list[str]:
    """Ids of the workspace that a shell may complete; that of another folder is not known there."""
    folder = WORKSPACE.default / "models"
    ids = sorted(path.stem for path in folder.glob("*.json"))
    return [id for id in ids if id.startswith(incomplete)]


def model(help: str) -> Any:
    """The option that names a model of the workspace."""
    return option("ID", help, "-m", "--model", autocompletion=stored_models)


def ids(metavar: str, help: str) -> Any:
    """The argument that names models of the workspace, which need not be given."""
    return argument(metavar, help, default=None, autocompletion=stored_models)


def _resolved(given: Sequence[str]) -> tuple[str, ...]:
    """With the whole paths of the files, so that a model can read its data from anywhere."""
    parts = (join.rpartition("=") for join in given)
    return tuple(f"{log}{sign}{Path(file).resolve()}" for log, sign, file in parts)


def _names(given: Sequence[str]) -> tuple[str, ...]:
    """``--input a,b --input c`` as (a, b, c)."""
    return tuple(name.strip() for item in given for name in item.split(","))


def periods(given: list[str]) -> dict[str, float]:
    """``["65536"]``, ``["enc=4096", "angle=none"]`` as column → period; an empty name for all."""
    by_column: dict[str, float] = {}
    for pair in (p for item in given for p in item.split(",")):
        name, sign, number = (part.strip() for part in pair.rpartition("="))
        try:
            period = 0.0 if number == "none" else float(number)
        except ValueError:
            period = -1.0
        if not 0.0 <= period < math.inf or (sign and not name):
            raise UsageError(
                f"--unwrap cannot read {pair!r}; write the number after which a counter starts "
                "over, such as 65536, NAME=65536, or NAME=none"
            )
        by_column[name] = period
    return by_column


band_of = partial(numbers, option="--band", advice="LOW:HIGH in Hz, e.g. 0.1:5", sep=":", count=2)


def seconds_to_trim(text: str) -> tuple[float, ...]:
    """``"2:1.5"`` as seconds to cut at the head and at the tail; ``"2"`` cuts the head only."""
    head, _, tail = text.partition(":")
    given = f"{head or 0}:{tail or 0}"
    return numbers(given, "--trim", "HEAD:TAIL in seconds, e.g. 2:1.5", ":", 2)


def _mapped(given: Sequence[str]) -> dict[str, str]:
    """Column → field of a bag, from texts and YAML files."""
    from sysid.data.bags.mapping import mapping_of

    return mapping_of(given)


_reading = in_panel("Reading the log")
_reading_more = in_panel("Reading the log", advanced=True)
_preparing = in_panel("Preparing the log", advanced=True)


@dataclass(frozen=True)
class Reading:
    """How to read a log: the library's ``ReadOptions`` as a line gives them."""

    inputs: list[str] | None = _reading(
        "NAME",
        "Input columns, a,b or repeated; none for a log without inputs [found by name].",
        "-u",
        "--input",
        parse=_names,
    )
    outputs: list[str] | None = _reading(
        "NAME", "Output columns, a,b or repeated [found by name].", "-y", "--output", parse=_names
    )
    time: str | None = _reading_more("NAME", "Time column, or either of a date and a time of day.")
    ts: float | None = _reading("SECONDS", "Sample time, where no column of the log is its clock.")
    units: list[str] | None = _reading(
        "NAME=UNIT",
        "Unit of a column in the file, converted to SI: omega_l=rpm, psi=deg, time=ms; for dates "
        "the order of day and month: date=dmy.",
        "--unit",
        parse=lambda given: pairs(given, "--unit", "NAME=UNIT such as omega_l=rpm", str),
    )
    pwm_max: float | None = _reading("VALUE", "Command at full drive in the file, e.g. 255.")
    delimiter: str | None = _reading_more("SIGN", "Delimiter, or tab [detected].")
    decimal: str | None = _reading_more("SIGN", "'.' or ',' [detected].")
    encoding: str | None = _reading_more(
        "NAME", "Encoding of a text, such as cp1252 or shift_jis [detected]."
    )
    resample: str = _reading_more(
        "POLICY",
        "Treatment of jitter, gaps and empty cells: auto, hold, refuse, fill or split.",
        default="auto",
    )
    unwrap: list[str] | None = _reading_more(
        "PERIOD",
        "Period of a counter that starts over, e.g. 65536 or NAME=4096; NAME=none keeps its "
        "jumps [detected].",
        parse=periods,
    )
    speed_of: list[str] | None = _reading_more(
        "NAME", "Output that is a position or counter; its speed is modelled.", parse=_names
    )
    held: str = _reading_more(
        "HOW",
        "Sensors slower than the log: auto reads the log at their rate, keep takes every row, N "
        "takes one sample every N rows.",
        default="auto",
    )
    join: list[str] | None = _reading_more(
        "FILE",
        "File with more columns of the same drive, such as a camera's pose, joined by time; "
        "LOG=FILE for one of several logs.",
        parse=_resolved,
    )
    join_offset: float | None = _reading_more(
        "SECONDS", "Time of the log minus time of the joined file [estimated from wheels and pose]."
    )
    map: list[str] | None = _reading_more(
        "NAME=/TOPIC.FIELD",
        "Column of a bag: omega_l=/joint_states.velocity[left], pose=/odom; repeatable, or a YAML "
        "file. `sysid inspect BAG` proposes a mapping.",
        parse=_mapped,
    )
    stamps: str = _reading_more(
        "WHICH",
        "Clock of a bag's topics: auto (the sender's if usable), header or received.",
        default="auto",
    )
    latency: list[str] | None = _reading_more(
        "HOW", "Latency of a bag's topics: remove (as estimated), or /topic=SECONDS.", parse=_names
    )
    strict: bool = _reading_more(
        None, "Refuse lines that are no rows of the table, instead of skipping.", default=False
    )
    missing: list[str] | None = _reading_more(
        "NUMBER",
        "Number that stands for a missing measurement, e.g. -999; none keeps all [detected].",
        parse=_names,
    )
    enable: str | None = _reading_more(
        "NAME",
        "Column that is 0 where the drive is released: those rows are left out; none keeps all "
        "[found by name].",
    )

    def made(self) -> "ReadOptions":
        """As the library takes them."""
        from sysid.data.reading.read_options import ReadOptions

        return ReadOptions(**changed(self))


@dataclass(frozen=True)
class Preparing:
    """What to do with a log that was read, before anything else."""

    trim: tuple[float, float] | None = _preparing(
        "HEAD:TAIL",
        "Seconds to cut from the start and end of each record, e.g. 2:1.5.",
        parse=seconds_to_trim,
        kind=str | None,
    )
    low_pass: float | None = _preparing("HZ", "Cut-off of a filter on all signals.")
    band: tuple[float, float] | None = _preparing(
        "LOW:HIGH",
        "Frequencies [Hz] that count: a filter on all signals, e.g. 0.1:5.",
        parse=band_of,
        kind=str | None,
    )
    decimate: int = _preparing("N", "Keep every N-th sample, of means of N.", default=1)
    remove_drift: bool = _preparing(
        None, "Take the slow drift of each output's level out.", default=False
    )

    def made(self) -> "Preparation":
        """As the library takes it."""
        from sysid.data.preparation import Preparation

        head, tail = self.trim or (0.0, 0.0)
        return Preparation(head, tail, self.low_pass, self.decimate, self.remove_drift, self.band)
