"""Options of structures as users type them: numbers, shares, choices, lists by output."""

from collections.abc import Mapping, Sequence

from sysid.errors import UsageError, argument

MARGIN = 0.15
"""How far beyond its training range an output may go in free run, as a share of that range: a
little, because a log seldom holds the very largest answer, and a map says nothing further out."""

Given = Mapping[str, str]


def whole_number(given: Given, name: str, low: int, high: int, structure: str) -> int | None:
    """An option that is a whole number; None where it is not given or ``auto``."""
    text = given.get(name, "auto").strip()
    if text == "auto":
        return None
    if not text.isdecimal() or not low <= int(text) <= high:
        raise UsageError(
            f"{argument(structure_options={name: text})}: {structure} needs a whole number from "
            f"{low} to {high}, or auto"
        )
    return int(text)


def choice(given: Given, name: str, known: Sequence[str]) -> str:
    """An option that is one of some words, the first unless given; UsageError for another."""
    text = given.get(name, known[0]).strip()
    if text not in known:
        option = argument(structure_options={name: text})
        raise UsageError(f"{option}: choose one of {', '.join(known)}")
    return text


def number(given: Given, name: str, usual: float, most: float, asked: str) -> float:
    """An option that is a number from 0 to ``most``, ``usual`` unless given.

    Args:
        asked: what to give, for the sentence about another.
    """
    text = given.get(name, str(usual))
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= most:
        raise UsageError(f"{argument(structure_options={name: text})}: give {asked}")
    return value


def margin(given: Given) -> float:
    """The option ``margin``."""
    return number(given, "margin", MARGIN, 10.0, f"a share from 0 to 10, such as {MARGIN}")


def by_output(text: str, name: str, ny: int, *, one_for_all: bool) -> list[list[str]]:
    """The entries of each output: outputs divided by semicolons, entries by commas.

    Args:
        text: the option's value; commas inside parentheses divide nothing, empty entries go.
        name: the option, for the sentence.
        one_for_all: whether one group may serve all outputs.
    """
    groups = text.split(";")
    if len(groups) == 1 and one_for_all:
        groups *= ny
    if len(groups) != ny:
        also = " or give one group for all" if one_for_all else ""
        raise UsageError(
            f"`structure_options[{name!r}]` names those of {len(groups)} outputs but there are "
            f"{ny}; divide the outputs by ;{also}"
        )
    return [_entries(group) for group in groups]


def _entries(group: str) -> list[str]:
    """Pieces between commas that are outside all parentheses."""
    parts, depth, piece = [], 0, ""
    for c in group:
        depth += (c == "(") - (c == ")")
        if c == "," and depth == 0:
            parts.append(piece)
            piece = ""
        else:
            piece += c
    return [p for p in (*parts, piece) if p.strip()]
