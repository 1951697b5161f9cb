"""Registry of structures: their names, and how a saved one is read."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le

from sysid.data.documents import plain_object
from sysid.data.schema import DAMAGED, STORED, checked
from sysid.errors import ModelError, UsageError
from sysid.extensions import loaded, points, unusable
from sysid.structures.base import NamedStructure, Structure
from sysid.structures.orders import require_orders

BUILT_IN = {
    "arx": "linear.families:ARX",
    "armax": "linear.families:ARMAX",
    "oe": "linear.families:OE",
    "bj": "linear.families:BJ",
    "ss": "state_space.innovations:StateSpace",
    "process": "continuous.process:Process",
    "tf": "continuous.transfer:ContinuousTransfer",
    "ar": "linear.families:AR",
    "arma": "linear.families:ARMA",
    "ma": "linear.families:MA",
    "narx-wavelet": "narx.structure:NarxWavelet",
    "narmax": "narmax.structure:NARMAX",
    "hammerstein-wiener": "blocks.hammerstein_wiener:HammersteinWiener",
    "wiener-hammerstein": "blocks.wiener_hammerstein:WienerHammerstein",
    "dc-motor": "grey_box.dc_motor.structure:DCMotor",
    "tanks": "grey_box.tanks:Tanks",
}
"""Module and class of the structures that come with the package, imported when asked for."""

MADE = {
    "augmented": "augmented.structure:Augmented",
    "ode": "grey_box.file.structure:FromFile",
}
"""Structures that a workflow or a file of equations makes, but that nobody fits by name."""

FILE_ENDINGS = (".yaml", ".yml")
"""Endings of files of equations, which are structures, too."""


def _load(place: str) -> type[NamedStructure]:
    module, name = place.split(":")
    structure: type[NamedStructure] = getattr(import_module(f"sysid.structures.{module}"), name)
    return structure


def structure_classes() -> dict[str, type[NamedStructure]]:
    """Every structure that can be fitted, by name: the built-in ones and those of other packages.

    Other packages register a class under the entry-point group ``sysid.structures``.
    """
    classes = {name: _load(place) for name, place in BUILT_IN.items()}
    for name, point in points("sysid.structures").items():
        if name not in classes:
            structure = loaded(point, "structure")
            if not (isinstance(structure, type) and issubclass(structure, NamedStructure)):
                raise unusable(point, "structure", "is not a subclass of NamedStructure")
            classes[name] = structure
    return classes


def structure_class(name: str) -> type[NamedStructure]:
    """The structure called ``name`` (case does not matter), or of a file of equations."""
    if name.endswith(FILE_ENDINGS):
        from sysid.structures.grey_box.file.structure import structure_of_file

        return structure_of_file(name)
    key = name.lower()
    if key in BUILT_IN:
        return _load(BUILT_IN[key])
    classes = structure_classes()
    if key not in classes:
        raise UsageError(f"no structure {name!r}; choose one of {', '.join(classes)}")
    return classes[key]


MAX_CHANNELS = 256
"""Largest number of inputs or of outputs in a file: beyond it a damaged number asks for memory."""


@dataclass(frozen=True)
class _Described:
    """What every structure says of itself in a file; the rest is its own."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    structure: str
    orders: Mapping[str, Any]
    nu: Annotated[int, Ge(0), Le(MAX_CHANNELS)]
    ny: Annotated[int, Ge(1), Le(MAX_CHANNELS)]
    settings: Mapping[str, Any] | None = None


def structure_to_json(structure: Structure) -> dict[str, Any]:
    """{structure, orders, settings, nu, ny}: what ``structure_from_json`` needs."""
    return plain_object(
        {
            "structure": structure.name,
            "orders": structure.order_values(),
            "settings": structure.settings(),
            "nu": structure.nu,
            "ny": structure.ny,
        }
    )


def _upgraded(raw: Mapping[str, Any]) -> Mapping[str, Any]:
    """What a file of an older version says, in the words of this one."""
    if raw["structure"] != "narx-wavelet":
        return raw
    options = raw["settings"]["options"]
    if options["estimator"] != "polynomial":
        return raw
    # of 0.1.0: no units, whatever kind they had been
    settings = {**raw["settings"], "options": {**options, "estimator": "wavelet"}}
    return {**raw, "settings": settings}


def structure_from_json(raw: Mapping[str, Any]) -> Structure:
    """Undo ``structure_to_json``.

    What was read must be written alike: no setting is passed over, none taken for another kind.
    """
    try:
        described = checked(_Described, raw, others=True)
        require_orders(described.orders)
        name = described.structure
        cls = _load(MADE[name]) if name in MADE else structure_class(name)
        raw = _upgraded(raw)
        structure = cls.from_json(raw)
        written = structure_to_json(structure)
        for key in ("nu", "ny", "settings"):
            if raw.get(key) and not _holds(written[key], raw[key]):
                raise ValueError(f"its {key} are not those of {name}")
        return structure
    except (*DAMAGED, UsageError) as error:
        raise ModelError(
            f"the model's structure cannot be read ({error}); install the package that has it, or "
            "fit the model again"
        ) from None


def _holds(written: Any, raw: Any) -> bool:
    """Whether all that a file says is written again; an older one may say less."""
    if isinstance(raw, dict):
        known = isinstance(written, dict) and raw.keys() <= written.keys()
        return known and all(_holds(written[k], v) for k, v in raw.items())
    if isinstance(raw, list | tuple):
        alike = isinstance(written, list) and len(written) == len(raw)
        return alike and all(map(_holds, written, raw))
    return (type(raw) is type(written) and raw == written) or (
        {type(raw), type(written)} == {int, float} and raw == written
    )


def require_readable(structure: Structure) -> None:
    """Refuse to write what would be read as another structure; ours are tested for that."""
    if type(structure).__module__.startswith("sysid."):
        return
    written = structure_to_json(structure)
    try:
        same = structure_to_json(structure_from_json(written)) == written
    except ModelError:
        same = False
    if not same:
        raise ModelError(
            f"{structure.name} is not read back as it is written: its from_json loses settings; "
            "the package that brings it must read there what its settings() returns"
        )
