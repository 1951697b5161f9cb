"""The root of the command line: its commands, and the one place where errors become sentences."""

import os
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from sysid.errors import SysidError

from . import (
    compare,
    demo,
    diagnose,
    excite,
    fit,
    forecast,
    inspect,
    look,
    models,
    plot,
    reduce,
    report,
    resample,
    sensitivity,
    show,
    structures,
)
from .command_help import Command, Group
from .cosim import node
from .exporting import export, verify
from .field_options import Line, every_command
from .missions import localize, plan, simulate, tune
from .testbench import motor, pendulum, power
from .vehicles import fit_vehicle, soil, vehicle

_HELP = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


bench = typer.Typer(
    cls=Group,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Characterise motor, inertia and power supply.",
)
app = typer.Typer(
    cls=Group,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=_HELP,
)
_COMMANDS: dict[str, tuple[Callable[..., None], ...]] = {
    "Data": (
        demo.demo,
        inspect.inspect,
        look.look,
        sensitivity.sensitivity,
        excite.excite,
    ),
    "Models": (
        fit.fit,
        compare.compare,
        show.show,
        plot.plot,
        forecast.forecast,
        report.report,
        diagnose.diagnose,
        reduce.reduce,
        resample.resample,
        models.models,
        structures.structures,
    ),
    "Deploy": (export.export, verify.verify),
    "Missions": (simulate.simulate, plan.plan, tune.tune, localize.localize, node.node),
    "Vehicle and bench": (fit_vehicle.fit_vehicle, vehicle.vehicle, soil.soil),
}
for _group, _commands in _COMMANDS.items():
    for _command in _commands:
        _class = plan.PlotMayStandAlone if _command is plan.plan else Command
        app.command(context_settings=_HELP, cls=_class, rich_help_panel=_group)(_command)
for _command in (motor.motor, pendulum.pendulum, power.power):
    bench.command(context_settings=_HELP, cls=Command)(_command)
app.add_typer(bench, name="bench", context_settings=_HELP, rich_help_panel="Vehicle and bench")

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Settings of NumPy's linear algebra, 1 unless they are set: more pay for large regressions."""

# typer carries its own click or uses an installed one, depending on its version; the base of
# BadParameter is that click's UsageError either way.
_WRONG_USE: type = typer.BadParameter.__bases__[0]


@app.callback(
    invoke_without_command=True,
    epilog="sysid help COMMAND shows its options, sysid COMMAND --help-all every one. Anywhere on "
    "a line: -q for results and warnings only, --debug to show where an error arose.",
)
def root(
    context: typer.Context,
    workspace: Annotated[
        Path | None,
        typer.Option("-w", "--workspace", metavar="DIR", help="Workspace folder [.sysid]."),
    ] = None,
    version: Annotated[bool, typer.Option("-V", "--version", help="Print the version.")] = False,
) -> None:
    """From a robot's log to a plant you can trust. To begin: sysid demo."""
    if workspace is not None:
        context.default_map = _everywhere(context.command, {"workspace": str(workspace)})
    if version:
        from sysid.version import __version__

        typer.echo(f"sysid {__version__}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code.

    0 done, 1 data or model not usable, 2 wrong use, 130 interrupted. Every failure is one sentence
    on stderr; ``--debug`` anywhere on the line shows the traceback instead.
    """
    arguments, flags = _flags(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in flags
    _prepare()
    try:
        whole = _whole()
        line = Line(whole, not flags.isdisjoint(_QUIET), _EVERY_OPTION in flags)
        command, name, arguments = _command_of(whole, arguments)
        code = command.main(arguments, name, standalone_mode=False, obj=line)
        sys.stdout.flush()  # a closed pipe must be noticed here, not when the interpreter ends
    except BrokenPipeError:
        return _pipe_closed()
    except (KeyboardInterrupt, typer.Abort):
        return 130  # the entry point says it, once
    except Exception as error:
        if debug:
            traceback.print_exc()
        return _failed(*_sentence(error))
    return code if isinstance(code, int) else 0


@cache
def _whole() -> Any:
    """All commands as typer makes them: 30 ms, which a caller of many lines pays once."""
    return typer.main.get_command(app)


_QUIET = {"-q", "--quiet"}
_EVERY_OPTION = "--help-all"
_FLAGS = {"--debug", _EVERY_OPTION, *_QUIET}
"""Flags that stand anywhere on a line, before ``--``."""


def _flags(words: Sequence[str]) -> tuple[list[str], set[str]]:
    """The line as its command reads it, and the flags of the line as a whole."""
    end = words.index("--") if "--" in words else len(words)
    own = [word for word in words[:end] if word not in _FLAGS]
    flags = _FLAGS.intersection(words[:end])
    asked = own[1:] if own[:1] == ["help"] else own
    if len(asked) < len(own) or _EVERY_OPTION in flags:
        asked = [*asked, "--help"]
    return [*asked, *words[end:]], flags


def _everywhere(group: Any, values: dict[str, str]) -> dict[str, Any]:
    """Defaults of every command below a group, those of a group within it one level down."""
    return {
        name: _everywhere(command, values) if hasattr(command, "commands") else values
        for name, command in group.commands.items()
    }


def _command_of(whole: Any, arguments: list[str]) -> tuple[Any, str, list[str]]:
    """The command a line asks for, its name and its own arguments.

    A line that begins with a command goes to it straight, not through the root: typer reads the
    root's options with pydantic, whose import would double the time of ``sysid fit --help``.
    """
    if not arguments:  # so asks a shell that completes a line, too
        return whole, "sysid", ["--help"]
    known = every_command(whole)
    for words in (2, 1):
        name = " ".join(arguments[:words])
        if name in known and len(arguments) >= words:
            return known[name], f"sysid {name}", arguments[words:]
    return whole, "sysid", arguments


def _sentence(error: Exception) -> tuple[str, int]:
    """The sentence for an exception, and the exit code."""
    if isinstance(error, SysidError):
        return str(error), error.exit_code
    if isinstance(error, _WRONG_USE):
        return _wrong_use(error), 2
    if isinstance(error, OSError) and error.strerror:
        what = error.filename or "the output"
        return f"{what} cannot be read or written ({error.strerror}); choose another place", 1
    if isinstance(error, MemoryError):
        return "out of memory; use less data or lower orders", 1
    detail = " ".join(str(error).split())
    what = f"{type(error).__name__}: {detail}" if detail else type(error).__name__
    advice = "run the command again with --debug and report the traceback"
    return f"unexpected error ({what}); {advice}", 1


def _wrong_use(error: Any) -> str:
    """The message of click as one sentence that names the command."""
    command = error.ctx.command_path if error.ctx is not None else "sysid"
    message = " ".join(error.format_message().split()).rstrip(".")
    message = message.replace("Value error, ", "").partition(", unable to parse")[0]
    message = message.replace("Input should", f"{_wrong_value(error)} should")
    return f"{message}; see `{command} --help`"


def _wrong_value(error: Any) -> str:
    """The value given, where the check of a number states only the value expected."""
    checks = getattr(error.__cause__, "errors", None)
    details = checks() if callable(checks) else []
    return repr(details[0]["input"]) if details and "input" in details[0] else "the value"


def _failed(sentence: str, code: int) -> int:
    from . import render

    try:
        render.error(" ".join(sentence.split()))
    except BrokenPipeError:
        return _pipe_closed()
    return code


def _pipe_closed() -> int:
    """The reader of the output has gone (``| head``): end silently, as other tools do."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nothing, stream.fileno())
    return 0


def _prepare() -> None:
    """Set what must be set before NumPy is imported or anything is printed.

    One BLAS thread: the matrices of a fit are small, and on a busy machine a second thread made
    a fit of 7 ms take 208 ms. A name that the terminal cannot show must not end a command.
    """
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")
