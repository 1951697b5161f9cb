"""Plant packages: a fitted model as a folder or one zip that runs elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sysid.errors import ModelError
from sysid.plant import description, selftest
from sysid.plant.c_code import c_sources, why_no_c_code
from sysid.plant.content_hash import KEY, content_hash
from sysid.plant.model_card import model_card
from sysid.plant.storage import MARK, Files, read_member, read_members, write_files
from sysid.structures.model import Model
from sysid.structures.plant import Plant

CARD = "README.md"
C_FILES = ("c/plant.h", "c/plant.c", "c/selftest.c")
KNOWN = frozenset({MARK, selftest.NAME, CARD, *C_FILES})
"""Every file that a package may hold."""

HASHED = (selftest.NAME, *C_FILES)
"""Files beside plant.json that the hash of the content covers: all that a runtime takes."""

_NOTHING: Mapping[str, Any] = MappingProxyType({})


def package_files(model: Model, report: Mapping[str, Any] = _NOTHING, name: str = "") -> Files:
    """The files of a package by name: plant.json, selftest.csv, README.md and the C code.

    The same model and report give the same bytes. Without C code there is no ``c/``.

    Args:
        model: a fitted model.
        report: what ``fit`` had to say (its ``validation`` or ``estimation`` figures are kept).
        name: what to call the plant; the structure's name unless given.

    Raises:
        ModelError: the model has no input.
    """
    if not model.inputs:
        raise ModelError(
            f"{name or model.structure.name} has no input that could drive it: a plant needs one; "
            "fit a structure with inputs"
        )
    described = description.describe(model, report, name or model.structure.name)
    test = selftest.make_selftest(model)
    texts = {selftest.NAME: selftest.to_csv(test, model), CARD: model_card(model, described)}
    if not why_no_c_code(model):
        texts |= {f"c/{file}": text for file, text in c_sources(model, test, name).items()}
    files = {file: text.encode("utf-8") for file, text in texts.items()}
    described[KEY] = content_hash(described, {n: files[n] for n in HASHED if n in files})
    return {MARK: description.to_text(described).encode("utf-8"), **files}


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


class ChangedPackageError(ModelError):
    """A package's content is not what was exported; the sentence lacks how to accept it."""


@dataclass(frozen=True, eq=False)
class Package:
    """A plant package, read and checked.

    Attributes:
        where: the folder or zip, as it is named in sentences.
        description: the content of plant.json.
        notes: sentences about its hash: there is none, or what was changed was accepted.
    """

    where: str
    description: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    def plant(self) -> Plant:
        """The plant, made through the registry of structures.

        Raises:
            ModelError: the description is damaged, or its structure is not known here.
        """
        return description.to_plant(self.description, self.where)

    def model(self) -> Model:
        """The model, to be run on logs; standard errors are not part of a package.

        Raises:
            ModelError: the description is damaged, or its structure is not known here.
        """
        return description.to_model(self.description, self.where)


def read_package(path: str | Path, accept_changes: bool = False) -> Package:
    """Read a package and compare its content with the hash it was exported with.

    Packages of sysid 0.1.0 have no hash: they are read, and a note says that changes stay unseen.

    Args:
        path: a folder or a zip.
        accept_changes: take a package whose content was changed after the export, with a note.

    Raises:
        ChangedPackageError: the content was changed and that is not accepted.
        ModelError: there is no package, or it is damaged or of another schema.
    """
    described = read_description(path)
    if KEY not in described:
        return Package(
            str(path),
            described,
            (
                f"{path} has no hash of its content (it comes from an older version): whether it "
                "was changed after the export cannot be seen.",
            ),
        )
    if described[KEY] == content_hash(described, read_members(Path(path), HASHED)):
        return Package(str(path), described)
    changed = f"{path} was changed after it was exported: its content and its hash differ"
    if not accept_changes:
        description.to_plant(described, str(path))  # damage has a sentence of its own
        raise ChangedPackageError(f"{changed}; export it again")
    return Package(str(path), described, (f"{changed}; taken as it is.",))


def read_description(path: str | Path) -> dict[str, Any]:
    """The content of a package's plant.json, its hash not compared.

    Raises:
        ModelError: there is no package, or it is damaged or of another schema.
    """
    return description.from_text(read_member(Path(path), MARK), str(path))


def load_plant(path: str | Path, accept_changes: bool = False) -> Plant:
    """The plant of a package; see :func:`read_package` and :meth:`Package.plant`."""
    return read_package(path, accept_changes).plant()


def load_model(path: str | Path, accept_changes: bool = False) -> Model:
    """The model of a package; see :func:`read_package` and :meth:`Package.model`."""
    return read_package(path, accept_changes).model()
