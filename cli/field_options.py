"""Fields named in messages of the library, shown as options of the running command.

In a message fields stand in backticks as a script would give them: `` `ts` ``,
`` `stable=True` ``, `` `inputs='u', outputs=['a', 'b']` ``, `` `units={'t': 'ms'}` ``,
`` `structure_options['degree']` ``; a name in capitals stands for what the reader puts in, as in
`` `validation=LOG` ``. An option's parameter is called as the field it gives, so the declarations
of the commands are the only table.
"""

import ast
import re
import shlex
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import typer

from sysid.errors import UnclearColumnsError

_MARKED = re.compile(r"`([a-z_]+(?:[=\[][^`]*)?)`")

Given = tuple[str, list[str]]
"""A field, and what follows its option: a word, or several where it is given several times."""


@dataclass(frozen=True)
class Line:
    """What holds for a whole line: the root of all commands, and flags that stand anywhere on it.

    Attributes:
        quiet: whether only results and warnings are shown.
        every_option: whether help shows the options for experts, too.
    """

    root: Any
    quiet: bool = False
    every_option: bool = False


def running() -> Any:
    """The context of the command that runs, with its :class:`Line` as ``obj``; None without one."""
    # typer carries its own click or uses an installed one, depending on its version
    click = typer.Context.__mro__[1].__module__.rpartition(".")[0]
    return import_module(f"{click}.globals").get_current_context(silent=True)


def ask(ctx: Any, error: UnclearColumnsError) -> bool:
    """Ask for the columns that a log leaves open; whether there was anything to choose from."""
    open_sides = {
        side: families
        for side, families in (("inputs", error.inputs), ("outputs", error.outputs))
        if len(families) > 1 and side in ctx.params
    }
    for side, families in open_sides.items():
        every = ", ".join(f"{k} {' with '.join(f)}" for k, f in enumerate(families, 1))
        answer = typer.prompt(f"Which columns are the {side}? {every} (several: 1,2)", err=True)
        words = [word.strip() for word in answer.split(",")]
        numbers = {str(k): f for k, f in enumerate(families, 1)}
        ctx.params[side] = [n for word in words for n in numbers.get(word, (word,))]
    return bool(open_sides)


def without_signals(ctx: Any) -> list[str]:
    """The words of the line without options for inputs and outputs."""
    words, options = list(ctx.meta["sysid.words"]), options_of(ctx.command)
    names = [options[field] for field in ("inputs", "outputs") if field in options]
    for k in reversed(range(len(words))):
        if words[k] in names:
            del words[k : k + 2]
        elif words[k].startswith(tuple(f"{n}=" for n in names)):
            del words[k]
    return words


def with_options(text: str) -> str:
    """The text with its fields as options of the running command: `` `ts` `` as ``--ts``.

    Fields that the running command lacks are named with the first command that has them,
    `` `sysid fit --stable` ``; what no command has stays as it is.
    """
    return _MARKED.sub(_options, text) if "`" in text else text


def options_of(command: Any) -> dict[str, str]:
    """Field → option, as a command declares them."""
    return {p.name: max(p.opts, key=len) for p in command.params if p.opts[0].startswith("-")}


def every_command(group: Any) -> dict[str, Any]:
    """The commands of a group by what is typed; those of a group within it behind its name."""
    commands: dict[str, Any] = {}
    for name, command in group.commands.items():
        commands[name] = command
        if hasattr(command, "commands"):
            commands |= {
                f"{name} {inner}": inner_command
                for inner, inner_command in every_command(command).items()
            }
    return commands


def fields_in(marked: str) -> list[Given]:
    """The fields of what stands in backticks; none where it is no such thing."""
    try:
        call: Any = ast.parse(f"f({marked})", mode="eval").body
        return [_given(part) for part in (*call.args, *call.keywords)]
    except (SyntaxError, ValueError, AttributeError):
        return []


def _options(match: re.Match[str]) -> str:
    fields = fields_in(match[1])
    command, options = _declared({name for name, _ in fields})
    if not (fields and options):
        return match[0]
    options_text = " ".join(
        f"{options[name]} {word}".rstrip() for name, words in fields for word in words
    )
    return f"`sysid {command} {options_text}`" if command else options_text


def _declared(fields: set[str]) -> tuple[str, dict[str, str]]:
    """The options of the running command, else a command that has all the fields, and its."""
    context = running()
    if context is None:
        return "", {}
    others = {} if context.obj is None else every_command(context.obj.root)
    commands = {"": context.command, **others}
    every = ((name, options_of(command)) for name, command in commands.items())
    return next(((name, options) for name, options in every if fields <= options.keys()), ("", {}))


def _given(part: Any) -> Given:
    """One argument of a call, as options spell it.

    Raises:
        AttributeError, ValueError: it is no field.
    """
    if isinstance(part, ast.Name):
        return part.id, [""]
    if isinstance(part, ast.Subscript):
        return _plain(part.value), [_plain(part.slice)]
    value = part.value
    if isinstance(value, ast.Dict):
        pairs = zip(value.keys, value.values, strict=True)
        return part.arg, [shlex.quote(f"{_plain(key)}={_plain(item)}") for key, item in pairs]
    if isinstance(value, ast.Constant) and value.value is True:
        return part.arg, [""]  # a flag
    word = _plain(value)
    return part.arg, [word if isinstance(value, ast.Name) else shlex.quote(word)]


def _plain(value: Any) -> str:
    if isinstance(value, ast.Name):
        return value.id
    if isinstance(value, ast.Tuple | ast.List):
        return ",".join(map(_plain, value.elts))
    literal = ast.literal_eval(value)
    if literal is None:
        return "none"
    return f"{literal:.15g}" if isinstance(literal, float) else str(literal)
