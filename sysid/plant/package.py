"""Plant packages: a fitted model as a folder or one zip, put together, written and read back.

What a package holds besides its description is written by exporters, see ``sysid.export``.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.data import documents
from sysid.data.unit_words import ratio
from sysid.errors import ModelError
from sysid.plant import description, selftest
from sysid.plant.selftest import TOLERANCE
from sysid.plant.storage import MARK, Files, names_in, read_member, read_members, write_files
from sysid.structures.model import Model
from sysid.structures.orders import orders_text
from sysid.structures.physics import ground_effects
from sysid.structures.plant import Plant


def model_card(model: Model, described: Mapping[str, Any], usage: str) -> str:
    """The card as Markdown.

    Args:
        described: the content of plant.json (see ``description.describe``).
        usage: how to use what exporters wrote beside it, Markdown.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    place = Environment(
        loader=PackageLoader("sysid.plant"),
        autoescape=False,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    place.filters |= {"number": _number, "cell": _cell}
    core, fit = described["blocks"][1], described["fit"] or {}
    data, slopes = fit.get("data") or [], (model.detrend.u_slope, model.detrend.y_slope)
    moving = zip(("inputs", "outputs"), slopes, strict=True)
    return place.get_template("README.md").render(
        plant={**described, "fit": (fit and {"fit_percent": {}, "rmse": {}, **fit}) or None},
        core=core,
        traits=model.structure.traits,
        ins=", ".join(c["name"] for c in described["inputs"]),
        outs=", ".join(c["name"] for c in described["outputs"]),
        equations="\n".join(model.equations()).replace("`", ""),
        orders=orders_text(core["orders"]),
        offsets=_offsets,
        properties=described["properties"],
        level=model.operating_point_sentence(),
        ratio=ratio,
        ground=ground_effects(model.structure, model.theta).effects,
        data=data if isinstance(data, str) else ", ".join(map(str, data)),
        facts=[
            f"{k.replace('_', ' ')}: {fit[k]}" for k in ("horizon", "initial_state") if k in fit
        ],
        options=", ".join(f"{k} = {v}" for k, v in described["options"].items()),
        trends=[side for side, slope in moving if slope is not None and slope.any()],
        usage=usage,
        tolerance=TOLERANCE,
    )


def _offsets(verb: str, channels: list[dict[str, Any]], offsets: list[float]) -> str:
    if not any(offsets):
        return "nothing: zero is the operating point"
    named = zip(channels, offsets, strict=True)
    return f"{verb} " + ", ".join(
        _cell(f"{value:.6g} {c['unit']}".strip() + f" ({c['name']})") for c, value in named
    )


def _number(value: float | None, digits: int, missing: str = "–") -> str:
    return missing if value is None else f"{value:.{digits}g}"


def _cell(text: object) -> str:
    """Text that cannot break a table or a line of Markdown."""
    return " ".join(str(text).split()).replace("|", "\\|").replace("<", "&lt;")


KEY = "content_sha256"
"""Where plant.json holds the hash."""

CARD = "README.md"
FILES = "files"
"""Where plant.json lists the files that its hash covers beside itself: all that a runtime takes."""

MOST_FILES = 500
"""More files than any package has."""

SOURCES = frozenset({".c", ".cc", ".cpp", ".cxx", ".h", ".hh", ".hpp", ".ino", ".s", ".inc"})
"""Files that a compiler takes for sources."""

UNLISTED = (selftest.NAME, "c/plant.h", "c/plant.c", "c/selftest.c")
"""These files in packages of 0.1.0, which list none."""


def assembled(
    model: Model, described: Mapping[str, Any], test: selftest.SelfTest, files: Files, usage: str
) -> Files:
    """A package: plant.json, selftest.csv and README.md, and these files beside them.

    The same values give the same bytes.

    Args:
        described: what plant.json says of it, see ``description.describe``.
        files: what exporters wrote, by name inside the package.
        usage: how to use these files, Markdown for the model card.
    """
    outside = [name for name in files if not _is_inside(name)]
    if outside:
        raise ModelError(
            f"{outside[0]!r} is not a valid file name in a package; correct its exporter"
        )
    card = model_card(model, described, usage).encode("utf-8")
    covered = {selftest.NAME: selftest.to_csv(test, model).encode("utf-8"), **files}
    content = {**described, FILES: sorted(covered)}
    content[KEY] = content_hash(content, covered)
    return {MARK: documents.text(content).encode("utf-8"), CARD: card, **covered}


def content_hash(described: Mapping[str, Any], files: Mapping[str, bytes]) -> str:
    """SHA-256 of what a plant package says: plant.json without the hash itself, and its files.

    Of the canonical form, so that the way JSON is laid out and the ends of lines, which tools for
    versions and for zips change without asking, do not count.

    Args:
        files: the other files that count, by name.

    Returns:
        64 hexadecimal digits.
    """
    content = {k: v for k, v in described.items() if k != KEY}
    digests = {
        name: hashlib.sha256(data.replace(b"\r\n", b"\n")).hexdigest()
        for name, data in files.items()
    }
    canonical = json.dumps([content, digests], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()


def write(path: str | Path, files: Files) -> Path:
    """Write a package as a folder, or as one zip where ``path`` ends in ``.zip``.

    It appears whole or not at all, and replaces a package that is there already.
    """
    path = Path(path)
    try:
        replaced = _covered(read_description(path), str(path))
    except ModelError:
        replaced = UNLISTED
    return write_files(path, files, frozenset({MARK, CARD, *files, *replaced}))


@dataclass(frozen=True, eq=False)
class Package:
    """A plant package, read and checked.

    Attributes:
        where: the folder or zip, as it is named in sentences.
        notes: sentences about its hash: there is none, or what was changed was accepted.
    """

    where: str
    description: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    def plant(self) -> Plant:
        """The plant, made through the registry of structures."""
        return self.model().plant()

    def model(self) -> Model:
        """The model, to be run on logs or drawn many times within its standard errors."""
        return description.to_model(self.description, self.where)


def read_package(path: str | Path, accept_changes: bool = False) -> Package:
    """Read a package and compare its content with the hash it was exported with.

    Packages of sysid 0.1.0 have no hash: they are read, and a note says that changes stay unseen.

    Args:
        accept_changes: take a package whose content was changed after the export, with a note.
    """
    described = read_description(path)
    if KEY not in described:
        return Package(
            str(path),
            described,
            (f"{path} has no hash of its content, so later changes cannot be detected.",),
        )
    covered = _covered(described, str(path))
    if described[KEY] == content_hash(described, read_members(Path(path), covered)):
        return Package(str(path), described)
    changed = f"{path} was changed after it was exported: its content and its hash differ"
    if not accept_changes:
        description.to_model(described, str(path)).plant()  # damage has a sentence of its own
        raise ModelError(f"{changed}; export it again, or accept it with `accept_changes=True`")
    return Package(str(path), described, (f"{changed}; taken as it is.",))


def files_of(path: str | Path) -> Files:
    """The files of a package that its hash covers, and plant.json."""
    path = Path(path)
    described = read_description(path)
    covered = _covered(described, str(path))
    # in a folder people build and take notes; a zip holds what was exported
    there = _sources(path, covered) if path.is_dir() else names_in(path)
    strange = sorted(there - {MARK, CARD, *covered})
    if strange and FILES in described:
        raise ModelError(
            f"{path} holds {strange[0]!r}, which its plant.json does not list; remove it, or "
            "export the plant again"
        )
    return read_members(path, (MARK, *covered))


def _sources(path: Path, covered: tuple[str, ...]) -> frozenset[str]:
    """Sources in those places of a folder where the package has files, which a compiler may find
    before those that the hash covers; what builds write elsewhere is nobody's source."""
    places = {Path(name).parent for name in covered} - {Path()}
    return frozenset(
        (place / entry.name).as_posix()
        for place in places
        if path.joinpath(place).is_dir()
        for entry in path.joinpath(place).iterdir()
        if entry.suffix.lower() in SOURCES
    )


def read_description(path: str | Path) -> dict[str, Any]:
    """The content of a package's plant.json, its hash not compared."""
    return description.from_text(read_member(Path(path), MARK), str(path))


def load_plant(path: str | Path, accept_changes: bool = False) -> Plant:
    """The plant of a package; see :func:`read_package` and :meth:`Package.plant`."""
    return read_package(path, accept_changes).plant()


def load_model(path: str | Path, accept_changes: bool = False) -> Model:
    """The model of a package; see :func:`read_package` and :meth:`Package.model`."""
    return read_package(path, accept_changes).model()


def _covered(described: Mapping[str, Any], where: str) -> tuple[str, ...]:
    """Names of the files that the hash of a package covers."""
    names = described.get(FILES, list(UNLISTED))
    if not isinstance(names, list) or not all(map(_is_inside, names)):
        raise ModelError(f"{where}: plant.json is damaged (its list of files); export it again")
    if len(names) > MOST_FILES:
        raise ModelError(f"{where} lists {len(names)} files, more than a plant package holds")
    return tuple(names)


def _is_inside(name: object) -> bool:
    """Whether a name leads to a file inside the package it stands in, on every system."""
    if not isinstance(name, str) or set(name) & set("\\:\0"):
        return False
    return all(part not in ("", ".", "..") for part in name.split("/"))
