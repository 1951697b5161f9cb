"""Read a small YAML file into plain values, with the line of each."""

import errno
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from sysid.data.files import contents
from sysid.errors import DataError

LARGEST_FILE = 100_000
"""A hand-written YAML file above this many bytes is something else."""
DEEPEST = 20
"""Brackets in brackets; the scanner's time grows with the square of the depth."""

Place = tuple[str | int, ...]
"""Where a value sits: keys and list positions from the top, e.g. ``("obstacles", 0)``."""


@dataclass(frozen=True)
class YamlSource:
    """The values of one YAML file and the line each of them stands on.

    Attributes:
        name: the file's name for messages.
        values: the mapping at the top of the file, made of dict, list, str, float, bool, None.
        lines: line number, counted from 1, of every place in ``values``.
        texts: line and column, counted from 1, at which the first character of each text stands.
    """

    name: str
    values: dict[str, Any]
    lines: dict[Place, int]
    texts: dict[Place, tuple[int, int]] = field(default_factory=dict)

    def where(self, place: Place) -> str:
        """Return ``file:line`` of a place, or of the nearest one around it that the file has."""
        while place and place not in self.lines:
            place = place[:-1]
        return f"{self.name}:{self.lines.get(place, 1)}"


class _Loader(yaml.SafeLoader):
    """SafeLoader that reads numbers as YAML 1.2 does: 1e-1 is a number, 1:30 and 0o17 are text."""


# A copy, because the table belongs to the class and SafeLoader must stay as it is. Dates, base-60
# and octal numbers go: nobody means them, and a date that does not exist fails when constructed.
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in table if tag.endswith((":null", ":bool"))]
    for first, table in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\Z"
        r"|[-+]?\.(?:inf|Inf|INF)\Z|\.(?:nan|NaN|NAN)\Z"
    ),
    list("-+.0123456789"),
)


def read_yaml(path: str | Path) -> YamlSource:
    """Read a YAML file whose top level is a mapping.

    Stricter than YAML: one document, text keys, no key twice, no anchors, aliases or tags.

    Returns:
        The values with their line numbers.
    """
    path = Path(path)
    name = path.name or str(path)
    return yaml_of(text_of(path), name)


def yaml_of(text: str, name: str) -> YamlSource:
    """``read_yaml`` of a text that was read before, called ``name`` in messages."""
    try:
        _refuse_excess(text, name)
        root = yaml.compose(text, Loader=_Loader)
        if root is None:
            raise DataError(
                f"{name}:1: the file is empty: write at least one key, e.g. goal: [1, 0]"
            )
        if not isinstance(root, yaml.MappingNode):
            raise DataError(
                f"{name}:{root.start_mark.line + 1}: this is not a mapping: "
                "write lines of the form key: value"
            )
        lines: dict[Place, int] = {}
        texts: dict[Place, tuple[int, int]] = {}
        values = _plain(root, (), YamlSource(name, {}, lines, texts), _Loader(""))
    except yaml.YAMLError as error:
        raise DataError(_syntax(error, text, name)) from None
    return YamlSource(name, values, lines, texts)


def shown(value: Any) -> str:
    """Return a value as a reader of the file would call it."""
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return f"{value} (a yes or no)"
    if isinstance(value, float):
        return f"{value:g}"
    text = value if isinstance(value, str) else repr(value)
    text = text if len(text) <= 40 else text[:37] + "..."
    return f"the text '{text}'" if isinstance(value, str) else text


def text_of(path: Path) -> str:
    """The text of a small file, for ``yaml_of``."""
    name = path.name or str(path)
    try:
        return contents(path, LARGEST_FILE).decode("utf-8-sig")
    except IsADirectoryError:
        raise DataError(f"{name} is a folder: give the YAML file in it") from None
    except FileNotFoundError:
        raise DataError(f"{path}: file not found") from None
    except UnicodeDecodeError as error:
        raise DataError(
            f"{name} is not a text file (byte {error.start} is not UTF-8): save it as UTF-8 text"
        ) from None
    except (OSError, ValueError) as error:
        if getattr(error, "errno", None) == errno.EFBIG:
            raise DataError(
                f"{name} is larger than 100 kB: this is not a hand-written YAML file"
            ) from None
        reason = getattr(error, "strerror", None) or str(error)
        raise DataError(f"{name} cannot be read ({reason}): check the path") from None


def _refuse_excess(text: str, name: str) -> None:
    """Refuse anchors, aliases, tags and deep nesting, which make small files expensive to read."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        mark = event.start_mark
        line = 1 if mark is None else mark.line + 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise DataError(
                f"{name}:{line}: anchors and aliases are not supported: write the value out"
            )
        tag = getattr(event, "tag", None)
        if tag is not None:
            raise DataError(f"{name}:{line}: the tag {tag} is not supported: remove it")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise DataError(f"{name}:{line}: brackets are nested too deep: flatten the file")


def _plain(node: yaml.Node, place: Place, to: YamlSource, loader: _Loader) -> Any:
    """Turn a composed node into plain values and note the line of every place on the way."""
    name, lines, mark = to.name, to.lines, node.start_mark
    lines.setdefault(place, mark.line + 1)
    if isinstance(node, yaml.SequenceNode):
        return [_plain(item, (*place, i), to, loader) for i, item in enumerate(node.value)]
    if not isinstance(node, yaml.MappingNode):
        quoted = isinstance(node, yaml.ScalarNode) and node.style in ("'", '"')
        to.texts[place] = (mark.line + 1, mark.column + 1 + quoted)
        return loader.construct_object(node)
    values: dict[str, Any] = {}
    for key_node, value_node in node.value:
        line = key_node.start_mark.line + 1
        key = key_node.value
        if not isinstance(key, str):
            raise DataError(f"{name}:{line}: a key must be a word: write key: value")
        if key in values:
            raise DataError(
                f"{name}:{line}: the key {key!r} appears a second time, first in line "
                f"{lines[(*place, key)]}: keep one of them"
            )
        lines[(*place, key)] = line
        values[key] = _plain(value_node, (*place, key), to, loader)
    return values


def _syntax(error: yaml.YAMLError, text: str, name: str) -> str:
    mark = getattr(error, "problem_mark", None)
    if mark is None:  # a reader error: characters that no YAML text has
        return f"{name}:1: the file holds control characters: it is not a YAML text file"
    line = mark.line + 1
    rows = text.splitlines()
    if "\t" in "".join(rows[mark.line : line])[: mark.column + 1]:
        return f"{name}:{line}: a tab indents this line: YAML allows only spaces"
    problem = getattr(error, "problem", None) or "this is not YAML"
    if "single document" in str(error):
        return f"{name}:{line}: a second document begins here: keep one document in the file"
    return f"{name}:{line}: {problem}: check the brackets, colons and indentation around this line"
