"""Commands and their groups as typer runs them: help of one screen, errors that name options.

``--help`` shows the options that are typed often, ``--help-all`` every one, by panels.
"""

import shlex
import sys
from typing import Any

from typer.core import TyperCommand, TyperGroup

from sysid.errors import SysidError, UnclearColumnsError

from .field_options import ask, with_options, without_signals

WIDEST_NAME = 26
"""Columns up to which the help of an option begins on its own line."""


class Command(TyperCommand):
    """A command whose errors name its own options, and which asks what a log leaves open."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Keep the words of the line, so that an error can say it with more options.

        A command without a workspace takes ``-w`` all the same: lines of a script may be alike.
        """
        if not any("--workspace" in p.opts for p in self.params):
            args = _without_workspace(args)
        ctx.meta["sysid.words"] = list(args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run it; a field that an error names becomes an option while the command is known."""
        try:
            return super().invoke(ctx)
        except UnclearColumnsError as error:
            if sys.stdin.isatty() and sys.stderr.isatty() and ask(ctx, error):
                return self.invoke(ctx)
            line = shlex.join([*ctx.command_path.split(), *without_signals(ctx)])
            error.args = (with_options(str(error)).replace("for example ", f"for example {line} "),)
            raise
        except SysidError as error:
            error.args = (with_options(str(error)),)
            raise

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """The usage, what it does, its arguments and options."""
        everything = ctx.obj is not None and ctx.obj.every_option
        advanced: frozenset[str] = getattr(self.callback, "advanced", frozenset())
        shown = [p for p in self.params if everything or p.name not in advanced]
        places = [_name(p) for p in self.params if p.param_type_name == "argument"]
        formatter.write_usage(ctx.command_path, " ".join([*places, "[OPTIONS]"]))
        text = self.help or ""
        _paragraphs(formatter, text if everything else text.partition("\n\n")[0])
        panels: dict[str, list[tuple[str, str]]] = {}
        for parameter in shown:
            panel = getattr(parameter, "rich_help_panel", None) if everything else None
            record = _name(parameter), _meaning(parameter, everything)
            panels.setdefault(panel or "", []).append(record)
        for panel, records in panels.items():
            _records(formatter, panel, records)
        if len(shown) < len(self.params):
            rest = f"{len(self.params) - len(shown)} more options"
            _paragraphs(formatter, f"{rest}: {ctx.command_path} --help-all")


class Group(TyperGroup):
    """Commands by what they are for."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """The usage, the commands by their groups, the options."""
        self.format_usage(ctx, formatter)
        _paragraphs(formatter, self.help or "")
        panels: dict[str, list[tuple[str, str]]] = {}
        width = max(map(len, self.commands))
        for name, command in self.commands.items():
            panel = getattr(command, "rich_help_panel", None) or ""
            text = command.get_short_help_str(formatter.width - width - 6).rstrip(".")
            panels.setdefault(panel, []).append((name.ljust(width), text))
        for panel, records in panels.items():
            _records(formatter, panel, records)
        options = [p for p in self.params if p.name != "show_completion"]
        if options:
            records = [(_name(p), _meaning(p, everything=True)) for p in options]
            _records(formatter, "Options", records)
        if self.epilog:
            _paragraphs(formatter, self.epilog)


def _without_workspace(words: list[str]) -> list[str]:
    kept: list[str] = []
    rest = iter(words)
    for word in rest:
        if word == "--":
            return [*kept, word, *rest]
        if word in ("-w", "--workspace"):
            if next(rest, None) is None:
                kept.append(word)
        elif not word.startswith(("-w", "--workspace=")):
            kept.append(word)
    return kept


def _name(parameter: Any) -> str:
    """What is typed: an argument's placeholder, or the spellings of an option and its value's."""
    if parameter.param_type_name == "argument":
        place = str(parameter.metavar or parameter.name.upper())
        return place if parameter.required or place.startswith("[") else f"[{place}]"
    value = "" if parameter.is_flag else parameter.metavar or parameter.name.upper()
    return f"{', '.join(parameter.opts)} {value}".rstrip()


def _meaning(parameter: Any, everything: bool) -> str:
    """The help of a parameter with its default; in short up to the first semicolon."""
    text = str(parameter.help or "")
    sentence, _, default = text.rstrip(".").partition(" [")
    if not everything:
        sentence = sentence.partition("; ")[0]
    given = parameter.default
    if not default and given not in (None, False, ()) and not callable(given):
        default = f"{getattr(given, 'value', given)}]"
    return f"{sentence} [{default}" if default else sentence


def _paragraphs(formatter: Any, text: str) -> None:
    formatter.write_paragraph()
    formatter.write_text(text)


def _records(formatter: Any, heading: str, records: list[tuple[str, str]]) -> None:
    if not heading:
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_dl(records, col_max=WIDEST_NAME)
        return
    with formatter.section(heading):
        formatter.write_dl(records, col_max=WIDEST_NAME)
