"""Options that commands with a LOG share, and --json, which every command has."""

import inspect
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import UsageError

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions


def in_panel(panel: str) -> Callable[..., Any]:
    """A function that declares options in a panel of the help: name, metavar, sentence.

    Further arguments, such as ``min``, go to typer.
    """

    def option(name: str, metavar: str | None, help: str, **more: Any) -> Any:
        return typer.Option(name, metavar=metavar, help=help, rich_help_panel=panel, **more)

    return option


_reading, _preparing = in_panel("Reading the log"), in_panel("Preparing the log")

Logs = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG...", help="CSV, Parquet, JSON, MATLAB or bag; several are several experiments."
    ),
]
Inputs = Annotated[
    list[str] | None,
    _reading(
        "--input",
        "NAME",
        "Input columns, a,b or repeated; none for a log without inputs [found by name].",
    ),
]
Outputs = Annotated[
    list[str] | None,
    _reading("--output", "NAME", "Output columns, a,b or repeated [found by name]."),
]
Time = Annotated[
    str | None,
    _reading("--time", "NAME", "Time column, or either of a date and a time of day."),
]
SampleTime = Annotated[
    float | None,
    _reading("--ts", "SECONDS", "Sample time, where no column of the log is its clock."),
]
Units = Annotated[
    list[str] | None,
    _reading(
        "--unit",
        "NAME=UNIT",
        "Unit of a column in the file, converted to SI: omega_l=rpm, psi=deg, time=ms; for dates "
        "the order of day and month: date=dmy.",
    ),
]
PwmMax = Annotated[
    float | None,
    _reading("--pwm-max", "VALUE", "Command at full drive in the file, e.g. 255."),
]
Delimiter = Annotated[
    str | None,
    _reading("--delimiter", "SIGN", "Delimiter, or tab [detected]."),
]
Decimal = Annotated[
    str | None,
    _reading("--decimal", "SIGN", "'.' or ',' [detected]."),
]
Encoding = Annotated[
    str | None,
    _reading("--encoding", "NAME", "Encoding of a text, such as cp1252 or shift_jis [detected]."),
]
Strict = Annotated[
    bool,
    _reading("--strict", None, "Refuse lines that are no rows of the table, instead of skipping."),
]
Resample = Annotated[
    str,
    _reading(
        "--resample",
        "POLICY",
        "Treatment of jitter, gaps and empty cells: auto, hold, refuse, fill or split.",
    ),
]
Unwrap = Annotated[
    list[str] | None,
    _reading(
        "--unwrap",
        "PERIOD",
        "Period of a counter that starts over, e.g. 65536 or NAME=4096; NAME=none keeps its "
        "jumps [detected].",
    ),
]
SpeedOf = Annotated[
    list[str] | None,
    _reading("--speed-of", "NAME", "Output that is a position or counter; its speed is modelled."),
]
Missing = Annotated[
    list[str] | None,
    _reading(
        "--missing",
        "NUMBER",
        "Number that stands for a missing measurement, e.g. -999; none keeps all [detected].",
    ),
]
Held = Annotated[
    str,
    _reading(
        "--held",
        "HOW",
        "Sensors slower than the log: auto reads the log at their rate, keep takes every row, N "
        "takes one sample every N rows.",
    ),
]
Join = Annotated[
    list[str] | None,
    _reading(
        "--join",
        "FILE",
        "File with more columns of the same drive, such as a camera's pose, joined by time; "
        "LOG=FILE for one of several logs.",
    ),
]
JoinOffset = Annotated[
    float | None,
    _reading(
        "--join-offset",
        "SECONDS",
        "Time of the log minus time of the joined file [estimated from wheels and pose].",
    ),
]
Map = Annotated[
    list[str] | None,
    _reading(
        "--map",
        "NAME=/TOPIC.FIELD",
        "Column of a bag: omega_l=/joint_states.velocity[left], pose=/odom; repeatable, or a YAML "
        "file. `sysid inspect BAG` proposes a mapping.",
    ),
]
Stamps = Annotated[
    str,
    _reading(
        "--stamps",
        "WHICH",
        "Clock of a bag's topics: auto (the sender's if usable), header or received.",
    ),
]
Latency = Annotated[
    list[str] | None,
    _reading(
        "--latency",
        "HOW",
        "Latency of a bag's topics: remove (as estimated), or /topic=SECONDS.",
    ),
]

Trim = Annotated[
    str | None,
    _preparing(
        "--trim", "HEAD:TAIL", "Seconds to cut from the start and end of each record, e.g. 2:1.5."
    ),
]
LowPass = Annotated[
    float | None,
    _preparing("--low-pass", "HZ", "Cut-off of a filter on all signals."),
]
Decimate = Annotated[
    int,
    _preparing("--decimate", "N", "Keep every N-th sample, of means of N."),
]
RemoveDrift = Annotated[
    bool,
    _preparing("--remove-drift", None, "Take the slow drift of each output's level out."),
]

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
WorkspaceRoot = Annotated[
    Path,
    typer.Option(
        "--workspace",
        metavar="DIR",
        help="Workspace folder with the stored models.",
    ),
]
DEFAULT_WORKSPACE = Path(".sysid")


def read_options(
    inputs: Inputs = None,
    outputs: Outputs = None,
    time: Time = None,
    ts: SampleTime = None,
    units: Units = None,
    pwm_max: PwmMax = None,
    delimiter: Delimiter = None,
    decimal: Decimal = None,
    encoding: Encoding = None,
    resample: Resample = "auto",
    unwrap: Unwrap = None,
    speed_of: SpeedOf = None,
    held: Held = "auto",
    join: Join = None,
    join_offset: JoinOffset = None,
    map: Map = None,
    stamps: Stamps = "auto",
    latency: Latency = None,
    strict: Strict = False,
    missing: Missing = None,
) -> "ReadOptions":
    """The options above as the library takes them; this signature is their one declaration.

    Raises:
        UsageError: an option cannot be.
    """
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.reading.timing import check_policy

    return ReadOptions(
        inputs=_names(inputs),
        outputs=_names(outputs),
        time=time,
        ts=ts,
        delimiter=delimiter,
        decimal=decimal,
        encoding=encoding,
        units=units_of(units or []),
        pwm_max=pwm_max,
        resample=check_policy(resample),
        unwrap=periods(unwrap or []),
        speed_of=_names(speed_of),
        held=held,
        join=tuple(_resolved(j) for j in join or []),
        join_offset=join_offset,
        map=mapped(map),
        stamps=stamps,
        latency=_names(latency),
        strict=strict,
        missing=_names(missing),
    )


def mapped(given: list[str] | None) -> dict[str, str]:
    """Column → field of a bag, from texts and YAML files."""
    if not given:
        return {}
    from sysid.data.bags.mapping import mapping_of

    return mapping_of(given)


def _resolved(join: str) -> str:
    """With the whole path of the file, so that a model can read its data from anywhere."""
    log, sign, file = join.rpartition("=")
    return f"{log}{sign}{Path(file).resolve()}"


def preparation(
    trim: Trim = None,
    low_pass: LowPass = None,
    decimate: Decimate = 1,
    remove_drift: RemoveDrift = False,
) -> "Preparation":
    """The preparing options as the library takes them; this signature is their one declaration.

    Raises:
        UsageError: an option cannot be.
    """
    from sysid.data.preparation import Preparation

    head, tail = seconds_to_trim(trim) if trim is not None else (0.0, 0.0)
    return Preparation(head, tail, low_pass, decimate, remove_drift)


def composed(
    **builders: Callable[..., Any],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command whose parameters named here are built from options of their own.

    ``@composed(read=read_options)`` puts the parameters of ``read_options`` in the place of the
    command's parameter ``read`` and hands the command what they build, so that options that
    several commands share are declared once.
    """

    def compose(command: Callable[..., None]) -> Callable[..., None]:
        declared = inspect.signature(command).parameters
        # what is built here names types that exist for the type checker only
        annotations = {n: a for n, a in command.__annotations__.items() if n not in builders}
        parameters: list[inspect.Parameter] = []
        for name, place in declared.items():
            if name in builders:
                parameters += _declared(builders[name])
            else:
                parameters.append(
                    place.replace(annotation=annotations[name], kind=inspect.Parameter.KEYWORD_ONLY)
                )

        def run(**given: Any) -> None:
            built = {
                name: build(**{p.name: given.pop(p.name) for p in _declared(build)})
                for name, build in builders.items()
            }
            command(**given, **built)

        run.__name__, run.__doc__, run.__module__ = (
            command.__name__,
            command.__doc__,
            command.__module__,
        )
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return run

    return compose


def _declared(build: Callable[..., Any]) -> list[inspect.Parameter]:
    """The options that a builder declares, with their typer annotations."""
    hints = {n: a for n, a in build.__annotations__.items() if n != "return"}
    return [
        p.replace(annotation=hints[p.name], kind=inspect.Parameter.KEYWORD_ONLY)
        for p in inspect.signature(build).parameters.values()
    ]


def _names(given: list[str] | None) -> tuple[str, ...]:
    """``--input a,b --input c`` as (a, b, c)."""
    return tuple(name.strip() for item in given or [] for name in item.split(","))


def units_of(given: list[str]) -> dict[str, str]:
    """``["omega_l=rpm,t=ms"]`` as column → unit.

    Raises:
        UsageError: a text cannot be read.
    """
    by_column: dict[str, str] = {}
    for item in given:
        for pair in item.split(","):
            name, sign, unit = (part.strip() for part in pair.partition("="))
            if not (name and sign and unit):
                raise UsageError(
                    f"--unit cannot read {pair!r}; write NAME=UNIT such as omega_l=rpm"
                )
            if name in by_column:
                raise UsageError(f"--unit names {name} twice; give each unit once")
            by_column[name] = unit
    return by_column


def periods(given: list[str]) -> dict[str, float]:
    """``["65536"]``, ``["enc=4096", "angle=none"]`` as column → period; an empty name for all.

    Raises:
        UsageError: a text cannot be read.
    """
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


def seconds_to_trim(text: str) -> tuple[float, float]:
    """``"2:1.5"`` as seconds to cut at the head and at the tail; ``"2"`` cuts the head only.

    Raises:
        UsageError: the text cannot be read.
    """
    head, _, tail = text.partition(":")
    try:
        return float(head or 0.0), float(tail or 0.0)
    except ValueError:
        raise UsageError(
            f"--trim cannot read {text!r}; write HEAD:TAIL in seconds, e.g. 2:1.5"
        ) from None


def choice(given: str, allowed: list[str], option: str) -> str:
    """``given`` in lower case if it is one of the allowed words.

    Raises:
        UsageError: it is not.
    """
    if given.lower() not in allowed:
        raise UsageError(f"{option} is one of {', '.join(allowed)}, got {given!r}")
    return given.lower()
