"""Write ``docs/commands.md`` from the commands themselves: python docs/generate_commands.py.

Arguments and options are read from the signatures of the functions that typer turns into
commands, which does not depend on typer's version. A test fails when the page is stale or when a
command or an option has no help.
"""

import inspect
import sys
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from sysid_cli.app import app

from sysid.report.markdown import table

PAGE = Path(__file__).resolve().parent / "commands.md"

HEAD = """# Commands

Written by `python docs/generate_commands.py` from the commands themselves: do not edit.

`sysid COMMAND --help`, or `sysid help COMMAND`, shows on one screen what is typed often, and
`--help-all` every option. Anywhere on a line `-q` leaves results and warnings only, `--debug` shows
where an error arose. `sysid -V` prints the version, `sysid -w DIR COMMAND` is the same as `-w DIR`
behind the command, `sysid --install-completion` lets the Tab key complete commands, options and
models. What `--json` prints is described in [files.md](files.md).

Exit codes: 0 done; 1 the data or the model cannot serve; 2 wrong use; 130 interrupted. A mission
that does not arrive is a result, not an error: its exit code is 0.
"""


@dataclass(frozen=True)
class Parameter:
    """One argument or option of a command.

    Attributes:
        names: what is typed: option names, or the argument's placeholder.
        value: placeholder of the option's value; empty for a flag.
        default: what it is when left out; empty where the help says it.
        panel: the group it is shown in.
        help: one sentence.
        argument: whether it is an argument rather than an option.
    """

    names: tuple[str, ...]
    value: str
    default: str
    panel: str
    help: str
    argument: bool


@dataclass(frozen=True)
class Command:
    """One command: name, help text, parameters in order."""

    name: str
    help: str
    parameters: tuple[Parameter, ...]


def commands() -> tuple[Command, ...]:
    """Every command in the order of ``sysid --help``."""
    found = []
    every = [("", registered) for registered in app.registered_commands]
    for group in app.registered_groups:
        assert group.typer_instance is not None
        every += [(f"{group.name} ", one) for one in group.typer_instance.registered_commands]
    for before, registered in every:
        function = registered.callback
        assert function is not None
        name = before + (registered.name or function.__name__.replace("_", "-"))
        found.append(Command(name, inspect.getdoc(function) or "", _parameters(function)))
    return tuple(found)


def page() -> str:
    """The text of ``commands.md``."""
    parts = [HEAD]
    for command in commands():
        arguments = [p for p in command.parameters if p.argument]
        options = [p for p in command.parameters if not p.argument]
        usage = " ".join(["sysid", command.name, *(p.names[0] for p in arguments), "[OPTIONS]"])
        parts.append(f"## {command.name}\n\n    {usage}\n\n{_markdown(command.help)}\n")
        if arguments:
            rows = [[f"`{p.names[0]}`", p.default, p.help] for p in arguments]
            parts.append(table(["argument", "default", "meaning"], rows))
        for panel in dict.fromkeys(p.panel for p in options):
            shown = [p for p in options if p.panel == panel]
            rows = [[_option(p), p.default, p.help] for p in shown]
            parts.append(table([panel or "option", "default", "meaning"], rows))
    return "\n".join(parts)


def _parameters(function: Callable[..., Any]) -> tuple[Parameter, ...]:
    hints = typing.get_type_hints(function, include_extras=True)
    found = []
    for name, parameter in inspect.signature(function).parameters.items():
        kind, info = _annotation(hints[name])
        argument = type(info).__name__ == "ArgumentInfo"
        required = parameter.default is inspect.Parameter.empty
        default = "" if required or parameter.default in (None, False) else parameter.default
        default = default.value if isinstance(default, Enum) else default
        if argument:
            names = (info.metavar or name.upper(),)
            if not required and not names[0].startswith("["):
                names = (f"[{names[0]}]",)
        else:
            names = _spelled(info) or (f"--{name.replace('_', '-')}",)
        value = info.metavar or name.upper()
        words = (info.help or "").strip()
        found.append(
            Parameter(
                names=names,
                value="" if kind is bool else value,
                default=f"`{default}`" if default != "" else "",
                panel=info.rich_help_panel or "",
                help=words,
                argument=argument,
            )
        )
    return tuple(found)


def _annotation(hint: Any) -> tuple[Any, Any]:
    """(type, typer's description) of ``Annotated[type, description]``."""
    kind, info = typing.get_args(hint)[:2]
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        kind = next(k for k in typing.get_args(kind) if k is not type(None))
    return kind, info


def _spelled(info: Any) -> tuple[str, ...]:
    """The option names given in the code; typer keeps the first one as a default value."""
    first = (info.default,) if isinstance(info.default, str) else ()
    return tuple(n for n in (*first, *(info.param_decls or ())) if n.startswith("-"))


def _option(p: Parameter) -> str:
    names = ", ".join(f"`{n}`" for n in p.names)
    return f"{names} {p.value}".strip()


def _markdown(text: str) -> str:
    """A docstring with its option names set as code."""
    words = [f"`{w}`" if w.startswith("--") else w for w in text.split(" ")]
    return " ".join(words)


def main(arguments: list[str]) -> int:
    """Write the page, or with ``--check`` say whether it is up to date."""
    if arguments == ["--check"]:
        fresh = PAGE.is_file() and PAGE.read_text(encoding="utf-8") == page()
        print("up to date" if fresh else "stale: run python docs/generate_commands.py")
        return 0 if fresh else 1
    PAGE.write_text(page(), encoding="utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
