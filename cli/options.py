"""Options of commands, each declared once: as a parameter of its command, or as a field of a frozen
dataclass that several commands share.

::

    @dataclass(frozen=True)
    class Effort:
        trials: int = option("N", "Sets of gains to drive.", default=256)

    @command
    def tune(mission: Path = argument("MISSION", "A mission."), how: Effort = group(Effort)): ...

:func:`command` makes of it what typer reads. A dataclass with a method ``made`` gives the command
what that returns, as a rule an object of the library.
"""

import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from functools import partial
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

from sysid.errors import UsageError

Value = TypeVar("Value")
Parse = Callable[[Any], Any]


@dataclass(frozen=True)
class Declared:
    """What typer is told of a parameter.

    Attributes:
        parse: reads or checks a value that was given.
        advanced: whether only ``--help-all`` shows it.
    """

    kind: Callable[..., Any]
    names: tuple[str, ...]
    words: Mapping[str, Any]
    parse: Parse | None = None
    read_as: Any = None
    advanced: bool = False


def option(
    metavar: str | None,
    help: str,
    *names: str,
    default: Any = None,
    parse: Parse | None = None,
    kind: Any = None,
    advanced: bool = False,
    **more: Any,
) -> Any:
    """An option, called as its field or parameter unless names are given.

    Args:
        metavar: what stands for its value in the help; None for a flag.
        names: what is typed, such as ``-v`` and ``--val``.
        parse: what the command gets of a value that is not the default.
        kind: what typer reads where ``parse`` makes something else of it.
        advanced: whether only ``--help-all`` shows it.
        more: further words for typer, such as ``min``.
    """
    words = {"metavar": metavar, "help": help, **more}
    declared = Declared(typer.Option, names, words, parse, kind, advanced)
    return field(default=default, metadata={"declared": declared})


def flag(help: str, *names: str, **more: Any) -> Any:
    """An option without a value."""
    return option(None, help, *names, default=False, **more)


def argument(metavar: str | None, help: str, default: Any = MISSING, **more: Any) -> Any:
    """A value that is given by its place; needed unless it has a default."""
    declared = Declared(typer.Argument, (), {"metavar": metavar, "help": help, **more})
    return field(default=default, metadata={"declared": declared})


def in_panel(panel: str, advanced: bool = False) -> Callable[..., Any]:
    """:func:`option` in a panel of the help."""
    return partial(option, rich_help_panel=panel, advanced=advanced)


@dataclass(frozen=True)
class Group:
    """Options that become one object; of the fields of ``of`` those named in ``only``, or all.

    Attributes:
        hidden: whether only ``--help-all`` shows any of them.
    """

    of: type[Any]
    only: tuple[str, ...]
    hidden: bool = False

    def parameters(self) -> list[inspect.Parameter]:
        """The options as parameters."""
        hints = get_type_hints(self.of)
        wanted = self.only or tuple(f.name for f in fields(self.of))
        declared = {f.name: f for f in fields(self.of)}
        return [_parameter(name, hints[name], declared[name]) for name in wanted]

    def advanced(self) -> set[str]:
        """Names of the options that only ``--help-all`` shows."""
        of_class = {f.name: f for f in fields(self.of)}
        names = self.only or (*of_class,)
        return {*names} if self.hidden else _advanced((name, of_class[name]) for name in names)

    def built(self, values: Mapping[str, Any]) -> Any:
        """The object, of the values by their names."""
        declared = {f.name: f for f in fields(self.of)}
        made = self.of(**{n: _parsed(declared[n], v) for n, v in values.items()})
        return made.made() if hasattr(made, "made") else made


def group(of: type[Any], *only: str, hidden: bool = False) -> Any:
    """A parameter of a command that is made of the options of a dataclass."""
    return Group(of, only, hidden)


def changed(options: Any) -> dict[str, Any]:
    """The fields of a dataclass of options that are not at their defaults."""
    values = ((f, getattr(options, f.name)) for f in fields(options))
    return {f.name: value for f, value in values if value != f.default}


def command(function: Callable[..., None]) -> Callable[..., None]:
    """A command as typer reads it, of a function whose parameters are declared as options.

    A field that two groups share is one option, whose value both get. The names of the parameters
    that only ``--help-all`` shows stand in its attribute ``advanced``.
    """
    parameters: dict[str, inspect.Parameter] = {}
    advanced: set[str] = set()
    groups: dict[str, tuple[Group, list[str]]] = {}
    own: dict[str, Any] = {}
    for name, place in inspect.signature(function).parameters.items():
        if isinstance(place.default, Group):
            parts = place.default.parameters()
            groups[name] = place.default, [p.name for p in parts]
            parameters |= {p.name: p for p in parts}
            advanced |= place.default.advanced()
        else:
            own[name] = place.default
            parameters[name] = _parameter(name, function.__annotations__[name], place.default)
            advanced |= _advanced([(name, place.default)])

    def run(**given: Any) -> None:
        values = {name: _parsed(declared, given[name]) for name, declared in own.items()}
        for name, (parts, names) in groups.items():
            values[name] = parts.built({n: given[n] for n in names})
        function(**values)

    for name in ("__name__", "__doc__", "__module__"):
        setattr(run, name, getattr(function, name))
    run.__annotations__ = {p.name: p.annotation for p in parameters.values()}
    run.__signature__ = inspect.Signature([*parameters.values()])  # type: ignore[attr-defined]
    run.advanced = frozenset(advanced)  # type: ignore[attr-defined]
    return run


def _advanced(declared: "Iterable[tuple[str, Field[Any]]]") -> set[str]:
    return {name for name, field in declared if field.metadata["declared"].advanced}


def _parameter(name: str, kind: Any, declared: "Field[Any]") -> inspect.Parameter:
    told: Declared = declared.metadata["declared"]
    names = told.names
    if told.kind is typer.Option and not names:
        names = (f"--{name.replace('_', '-')}",)
    default = inspect.Parameter.empty if declared.default is MISSING else declared.default
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[told.read_as or kind, told.kind(*names, **told.words)],
    )


def _parsed(declared: "Field[Any]", value: Any) -> Any:
    parse = declared.metadata["declared"].parse
    return value if parse is None or value == declared.default else parse(value)


def pairs(
    given: Sequence[str],
    option: str,
    advice: str,
    read: Callable[[str], Value],
    *,
    sep: str | None = ",",
) -> dict[str, Value]:
    """``NAME=VALUE`` texts, as a rule several joined by commas, as name → value.

    Args:
        advice: what to write instead of a text that cannot be read.
        read: the value of a text; a ValueError refuses it.
    """
    values: dict[str, Value] = {}
    for pair in (p for item in given for p in (_split(item, sep) if sep else [item])):
        name, sign, text = (part.strip() for part in pair.partition("="))
        try:
            if not (name and sign and text):
                raise ValueError
            value = read(text)
        except ValueError:
            raise UsageError(f"{option} cannot read {pair.strip()!r}; write {advice}") from None
        if name in values:
            raise UsageError(f"{option} names {name} twice; write {advice}")
        values[name] = value
    return values


def _split(text: str, sep: str) -> list[str]:
    """Parts of a text; a comma in brackets is one of a name: ``a1[left,right]=0``."""
    return re.split(rf"{re.escape(sep)}(?![^\[]*\])", text)


def numbers(
    text: str, option: str, advice: str, sep: str = ",", count: int | None = None
) -> tuple[float, ...]:
    """Numbers with commas, or another sign, between them; so many of them where that is fixed."""
    try:
        found = tuple(float(word) for word in text.split(sep))
        if count not in (None, len(found)):
            raise ValueError
        return found
    except ValueError:
        raise UsageError(f"{option} cannot read {text!r}; write {advice}") from None


def one_of(given: str, allowed: Sequence[str], option: str) -> str:
    """``given`` in lower case if it is one of the allowed words."""
    if given.lower() not in allowed:
        raise UsageError(f"{option} is one of {', '.join(allowed)}, got {given!r}")
    return given.lower()
