"""Finding: one verdict on the data, in words, with what to do about it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from functools import wraps
from typing import ParamSpec

Arguments = ParamSpec("Arguments")


class Severity(IntEnum):
    """How much a finding matters; comparable, a larger one is worse."""

    OK = 0
    NOTE = 1
    WARNING = 2
    FATAL = 3

    @property
    def word(self) -> str:
        """The severity as printed and stored: ok, note, warning or fatal."""
        return self.name.lower()

    def to_json(self) -> str:
        return self.word


@dataclass(frozen=True)
class Finding:
    """What one check says.

    Attributes:
        code: the check's name, lower case with dashes; stable, for machines.
        severity: how much it matters.
        sentence: what was seen and where.
        advice: what to do; empty when there is nothing to do.
        channel: the channel concerned, or None.
        record: name of the record concerned; empty for all of them.
    """

    code: str
    severity: Severity
    sentence: str
    advice: str = ""
    channel: str | None = None
    record: str = ""

    @property
    def text(self) -> str:
        return f"{self.sentence} {self.advice}".strip()


def ok_unless(
    code: str, sentence: str
) -> Callable[[Callable[Arguments, Iterable[Finding]]], Callable[Arguments, list[Finding]]]:
    """Makes a check of what yields findings: where there are none it says the sentence."""

    def check_of(
        found: Callable[Arguments, Iterable[Finding]],
    ) -> Callable[Arguments, list[Finding]]:
        @wraps(found)
        def check(*args: Arguments.args, **kwargs: Arguments.kwargs) -> list[Finding]:
            return [*found(*args, **kwargs)] or [Finding(code, Severity.OK, sentence)]

        return check

    return check_of


def notes(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Sentences of the notes, each once: what was done to the data and asks for no action."""
    return tuple(dict.fromkeys(f.sentence for f in findings if f.severity is Severity.NOTE))


def warned(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Warnings and worse in words, with what to do, each once."""
    return tuple(dict.fromkeys(f.text for f in findings if f.severity >= Severity.WARNING))


def worst(findings: tuple[Finding, ...]) -> Severity:
    """The worst severity among the findings (OK when there are none)."""
    return max((f.severity for f in findings), default=Severity.OK)
