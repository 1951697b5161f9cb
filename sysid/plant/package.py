"""Plant packages: a fitted model as a folder or one zip that runs elsewhere."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sysid.plant import description, selftest
from sysid.plant.c_code import c_sources, why_no_c_code
from sysid.plant.model_card import model_card
from sysid.plant.storage import MARK, Files, read_member, write_files
from sysid.structures.model import Model
from sysid.structures.plant import Plant

CARD = "README.md"
C_FILES = ("c/plant.h", "c/plant.c", "c/selftest.c")
KNOWN = frozenset({MARK, selftest.NAME, CARD, *C_FILES})
"""Every file that a package may hold."""

_NOTHING: Mapping[str, Any] = MappingProxyType({})


def package_files(model: Model, report: Mapping[str, Any] = _NOTHING, name: str = "") -> Files:
    """The files of a package by name: plant.json, selftest.csv, README.md and the C code.

    The same model and report give the same bytes. Without C code there is no ``c/``.

    Args:
        model: a fitted model.
        report: what ``fit`` had to say (its ``validation`` or ``estimation`` figures are kept).
        name: what to call the plant; the structure's name unless given.
    """
    described = description.describe(model, report, name or model.structure.name)
    test = selftest.make_selftest(model)
    texts = {
        MARK: description.to_text(described),
        selftest.NAME: selftest.to_csv(test, model),
        CARD: model_card(model, described),
    }
    if not why_no_c_code(model):
        texts |= {f"c/{file}": text for file, text in c_sources(model, test, name).items()}
    return {file: text.encode("utf-8") for file, text in texts.items()}


def write_package(
    model: Model, path: str | Path, report: Mapping[str, Any] = _NOTHING, name: str = ""
) -> Path:
    """Write a model as a plant package: a folder, or one zip where ``path`` ends in ``.zip``.

    The package appears whole or not at all, and replaces one that is there already.

    Returns:
        The path written.

    Raises:
        UsageError: something that is no package stands at ``path``.
        DataError: the place cannot be written.
    """
    return write_files(Path(path), package_files(model, report, name), KNOWN)


def read_description(path: str | Path) -> dict[str, Any]:
    """The content of a package's plant.json.

    Raises:
        ModelError: there is no package, or it is damaged or of another schema.
    """
    return description.from_text(read_member(Path(path), MARK), str(path))


def load_plant(path: str | Path) -> Plant:
    """The plant of a package, made through the registry of structures.

    Raises:
        ModelError: there is no package, it is damaged, or its structure is not known here.
    """
    return description.to_plant(read_description(path), str(path))


def load_model(path: str | Path) -> Model:
    """The model of a package, to be run on logs; standard errors are not part of it.

    Raises:
        ModelError: there is no package, it is damaged, or its structure is not known here.
    """
    return description.to_model(read_description(path), str(path))
