"""``sysid structures``: which models there are and when to take which."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import reading, render

if TYPE_CHECKING:
    from sysid.structures.base import Structure

_ORDERS = {
    "na": "past outputs in the equation",
    "nb": "input coefficients",
    "nc": "order of the noise's numerator",
    "nd": "order of the noise's denominator",
    "nf": "order of the denominator of each input",
    "nk": "input delay in samples (0: acts at once)",
}


def structures(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Everything about this one.")
    ] = None,
    json: reading.Json = False,
) -> None:
    """List the model structures, or describe one."""
    from sysid.structures.base import structure_class, structure_classes

    if name is None:
        known = [_facts(c) for c in structure_classes().values()]
        if json:
            render.document({"structures": known})
            return
        keys = ("name", "when", "equation")
        render.table(keys, [[s[k] for k in keys] for s in known], caption="sysid structures NAME")
        return
    facts = _facts(structure_class(name))
    if json:
        render.document(facts)
        return
    render.say(facts["title"], "bold")
    render.facts([(k, facts[k]) for k in ("equation", "when", "description", "noise_model")])
    rows = [(o["name"], o["meaning"], o["default"]) for o in facts["orders"]]
    render.table(("order", "meaning", "default"), rows)
    render.say(f"sysid fit LOG --structure {facts['name']} {facts['example']}")


def _facts(cls: "type[Structure]") -> dict[str, Any]:
    """What a user needs to know about a structure."""
    description = " ".join((cls.__doc__ or "").split())
    example = " ".join(f"{n}={1 if n == 'nk' else 2}" for n in cls.order_names)
    return {
        "name": cls.name,
        "title": cls.title,
        "when": cls.when,
        "equation": cls.equation,
        "description": description,
        "noise_model": "its own" if cls.has_noise_model else "none: errors are the output's own",
        "orders": [
            {
                "name": n,
                "meaning": _ORDERS.get(n, ""),
                "default": "1" if n == "nk" else "searched unless --orders gives it",
            }
            for n in cls.order_names
        ],
        "focus": ["prediction", "simulation"],
        "example": f'--orders "{example}"',
    }
