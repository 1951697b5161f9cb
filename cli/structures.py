"""``sysid structures``: the model structures, and when to use which."""

from typing import TYPE_CHECKING, Any

from . import reading, render
from .options import argument, command

if TYPE_CHECKING:
    from sysid.structures.base import NamedStructure

_TABLES = {
    "orders": ("name", "meaning", "default"),
    "options": ("name", "meaning"),
    "constants": ("name", "meaning", "unit", "estimated"),
}
"""Tables of a structure's description, and their columns."""


@command
def structures(
    name: str | None = argument("[NAME]", "Describe this structure.", default=None),
    json: bool = reading.JSON,
) -> None:
    """List the model structures, or describe one."""
    from sysid.structures.registry import structure_class, structure_classes

    if name is None:
        summaries = [_facts(c) for c in structure_classes().values()]
        if json:
            render.document({"structures": summaries})
            return
        keys = ("name", "when", "equation")
        render.table(
            keys, [[s[k] for k in keys] for s in summaries], caption="sysid structures NAME"
        )
        return
    facts = _facts(structure_class(name))
    if json:
        render.document(facts)
        return
    render.say(facts["title"], "bold")
    render.facts([(k, facts[k]) for k in ("equation", "when", "description", "noise_model")])
    for part, columns in _TABLES.items():
        if facts[part]:
            headings = (part.removesuffix("s"), *columns[1:])
            render.table(headings, [[row[k] for k in columns] for row in facts[part]])
    render.command(f"sysid fit LOG --structure {facts['name']} {facts['example']}".rstrip())


def _facts(cls: "type[NamedStructure]") -> dict[str, Any]:
    """Description of a structure for users."""
    from sysid.structures.grey_box.structure import GreyBox, constant_words

    description = " ".join((cls.__doc__ or "").split("Attributes:")[0].split()).replace("``", "")
    orders = " ".join(f"{n}={1 if n == 'nk' else 2}" for n in cls.traits.order_names)
    return {
        "name": cls.name,
        "title": cls.traits.title,
        "when": cls.traits.when,
        "equation": cls.traits.equation,
        "description": description,
        "noise_model": "its own" if cls.traits.has_noise_model else "none (output error)",
        "orders": [
            {
                "name": n,
                "meaning": cls.traits.order_words.get(n, ""),
                "default": "1" if n == "nk" else "searched without --orders",
            }
            for n in cls.traits.order_names
        ],
        "options": [{"name": n, "meaning": text} for n, text in cls.traits.options.items()],
        "constants": [dict(c) for c in constant_words(cls)] if issubclass(cls, GreyBox) else [],
        "focus": ["prediction", "simulation"],
        "example": f'--orders "{orders}"' if orders else "",
    }
