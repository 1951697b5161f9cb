"""The options that every command with a LOG shares, and the option every command has."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sysid.errors import UsageError

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.read_options import ReadOptions

_PANEL = "Reading the log"

Logs = Annotated[
    list[Path],
    typer.Argument(metavar="LOG...", help="CSV or Parquet; several are several experiments."),
]
Inputs = Annotated[
    list[str] | None,
    typer.Option(
        "--input",
        metavar="NAME",
        rich_help_panel=_PANEL,
        help="Input column; again (or a,b) for more. Found by name unless given.",
    ),
]
Outputs = Annotated[
    list[str] | None,
    typer.Option(
        "--output",
        metavar="NAME",
        rich_help_panel=_PANEL,
        help="Output column; again (or a,b) for more. Found by name unless given.",
    ),
]
Time = Annotated[
    str | None,
    typer.Option("--time", metavar="NAME", rich_help_panel=_PANEL, help="Time column."),
]
SampleTime = Annotated[
    float | None,
    typer.Option(
        "--ts",
        metavar="SECONDS",
        rich_help_panel=_PANEL,
        help="Sample time, where the log does not tell it.",
    ),
]
Units = Annotated[
    list[str] | None,
    typer.Option(
        "--unit",
        metavar="NAME=UNIT",
        rich_help_panel=_PANEL,
        help="Unit of a column in the file, e.g. omega_l=rpm; converted to SI.",
    ),
]
PwmMax = Annotated[
    float | None,
    typer.Option(
        "--pwm-max",
        metavar="VALUE",
        rich_help_panel=_PANEL,
        help="Command of full drive in the file, e.g. 255.",
    ),
]
Delimiter = Annotated[
    str | None,
    typer.Option(
        "--delimiter", metavar="SIGN", rich_help_panel=_PANEL, help="Found unless given; or tab."
    ),
]
Decimal = Annotated[
    str | None,
    typer.Option(
        "--decimal", metavar="SIGN", rich_help_panel=_PANEL, help="'.' or ','; found unless given."
    ),
]
Resample = Annotated[
    str,
    typer.Option(
        "--resample",
        metavar="POLICY",
        rich_help_panel=_PANEL,
        help="What to do about jitter, gaps and empty cells: auto, hold, refuse, fill or split.",
    ),
]

_PREPARING = "Preparing the log"
Trim = Annotated[
    str | None,
    typer.Option(
        "--trim",
        metavar="HEAD:TAIL",
        rich_help_panel=_PREPARING,
        help="Seconds to cut at the head and the tail of each record, e.g. 2:1.5.",
    ),
]
LowPass = Annotated[
    float | None,
    typer.Option(
        "--low-pass",
        metavar="HZ",
        rich_help_panel=_PREPARING,
        help="Filter inputs and outputs alike (zero phase) at this cut-off.",
    ),
]
Decimate = Annotated[
    int,
    typer.Option(
        "--decimate",
        metavar="N",
        rich_help_panel=_PREPARING,
        help="Keep every N-th sample, behind an anti-alias filter.",
    ),
]

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
WorkspaceRoot = Annotated[
    Path,
    typer.Option(
        "--workspace",
        metavar="DIR",
        help="Folder that holds models between commands.",
    ),
]
DEFAULT_WORKSPACE = Path(".sysid")


def read_options(
    inputs: list[str] | None = None,
    outputs: list[str] | None = None,
    time: str | None = None,
    ts: float | None = None,
    units: list[str] | None = None,
    pwm_max: float | None = None,
    delimiter: str | None = None,
    decimal: str | None = None,
    resample: str = "auto",
) -> "ReadOptions":
    """The options above as the library takes them.

    Raises:
        UsageError: an option cannot be.
    """
    from sysid.data.read_options import ReadOptions
    from sysid.data.timing import check_policy

    return ReadOptions(
        inputs=_names(inputs),
        outputs=_names(outputs),
        time=time,
        ts=ts,
        delimiter=delimiter,
        decimal=decimal,
        units=_units(units or []),
        pwm_max=pwm_max,
        resample=check_policy(resample),
    )


def preparation(trim: str | None, low_pass: float | None, decimate: int) -> "Preparation":
    """The preparing options as the library takes them.

    Raises:
        UsageError: an option cannot be.
    """
    from sysid.data.preparation import Preparation, parse_trim

    head, tail = parse_trim(trim) if trim is not None else (0.0, 0.0)
    return Preparation(head, tail, low_pass, decimate)


def _names(given: list[str] | None) -> tuple[str, ...]:
    """``--input a,b --input c`` as (a, b, c)."""
    return tuple(name.strip() for item in given or [] for name in item.split(","))


def _units(given: list[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for item in given:
        for pair in item.split(","):
            name, sign, unit = (part.strip() for part in pair.partition("="))
            if not (name and sign and unit):
                raise UsageError(
                    f"--unit cannot read {pair!r}; write NAME=UNIT such as omega_l=rpm"
                )
            if name in found:
                raise UsageError(f"--unit names {name} twice; give each unit once")
            found[name] = unit
    return found


def choice(given: str, allowed: list[str], option: str) -> str:
    """``given`` in lower case if it is one of the allowed words.

    Raises:
        UsageError: it is not.
    """
    if given.lower() not in allowed:
        raise UsageError(f"{option} is one of {', '.join(allowed)}, got {given!r}")
    return given.lower()
