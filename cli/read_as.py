"""What reading the logs of a command decided, each with the option that decides otherwise."""

import sys
import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from . import render
from .field_options import with_options

if TYPE_CHECKING:
    from sysid.data.decision import Decision
    from sysid.data.logs.sensor_log import SensorLog
    from sysid.data.record import Record

WIDTH = 80
LINES = 5
"""Most lines shown; the document of --json has the rest."""


def decided(records: "Iterable[Record | SensorLog]", *more: "Decision") -> list[dict[str, str]]:
    """The decisions on every log, with its name, for a document.

    Args:
        records: the experiments as read; the parts that a log was cut into share its decisions.
        more: decisions on the data that were made after reading.
    """
    logs = {r.name.partition(" part ")[0]: r.read_as for r in records if r.read_as}
    return [
        {"log": name, **{key: with_options(text) for key, text in d.to_json().items()}}
        for name, by_log in logs.items()
        for d in (*by_log, *more)
    ]


def decisions_in_words(decisions: Sequence[dict[str, str]]) -> str:
    """Decisions in a sentence: those on the first log, on others where they differ."""
    parts: list[str] = []
    for d in decisions:
        text = f"{d['what']} {d['value']} ({d['change']})"
        if text not in parts:
            first = d["log"] == decisions[0]["log"]
            parts.append(text if first else f"in {d['log']} {text}")
    return f"Read as: {'; '.join(parts)}" if parts else ""


def show_decisions(decisions: Sequence[dict[str, str]]) -> None:
    """Print decisions in a few lines."""
    for line in textwrap.wrap(
        decisions_in_words(decisions),
        min(WIDTH, render.columns(sys.stdout) or WIDTH),
        subsequent_indent="  ",
        max_lines=LINES,
        break_on_hyphens=False,
    ):
        render.note(line)
