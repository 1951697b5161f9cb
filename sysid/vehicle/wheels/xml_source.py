"""Small XML files as plain elements with line numbers; entities are not expanded."""

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from sysid.data.files import read_bytes
from sysid.errors import DataError

LARGEST_FILE = 10_000_000
"""Files above this many bytes hold something else than a description."""
DEEPEST = 50
"""Elements in elements; descriptions of robots have some five."""


@dataclass
class XmlElement:
    """One element of a file.

    Attributes:
        line: where it begins, counted from 1.
        text: letters inside, without those of the children.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list["XmlElement"] = field(default_factory=list)
    text: str = ""

    def all(self, tag: str) -> list["XmlElement"]:
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> "XmlElement | None":
        """The first child of a name, if there is one."""
        return next(iter(self.all(tag)), None)


def read_xml(path: str | Path) -> XmlElement:
    """Read an XML file; a document type, and with it every entity, is refused.

    Returns:
        The element at the top.
    """
    path = Path(path)
    content = read_bytes(path)
    if len(content) > LARGEST_FILE:
        raise DataError(f"{path.name} is larger than 10 MB: this is no description of a robot")
    parser = expat.ParserCreate()
    open_elements: list[XmlElement] = []
    top: list[XmlElement] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = XmlElement(tag, attributes, parser.CurrentLineNumber)
        (open_elements[-1].children if open_elements else top).append(element)
        open_elements.append(element)
        if len(open_elements) > DEEPEST:
            raise DataError(f"{path.name}:{element.line}: elements are nested too deep")

    def end(_: str) -> None:
        open_elements.pop()

    def letters(text: str) -> None:
        open_elements[-1].text += text

    def refuse(*_: object) -> None:
        raise DataError(
            f"{path.name}:{parser.CurrentLineNumber}: a document type with its entities is not "
            "read: remove the line <!DOCTYPE …>"
        )

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = letters, refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        what = expat.ErrorString(error.code)
        raise DataError(
            f"{path.name}:{error.lineno}: this is not XML ({what}): correct this line"
        ) from None
    except (LookupError, ValueError):  # an encoding that is none, or bytes that are none of it
        raise DataError(
            f"{path.name}:1: the encoding of the file is not known: save it as UTF-8"
        ) from None
    return top[0]
