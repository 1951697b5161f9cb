"""README.md of a plant package: the model card."""

from collections.abc import Mapping
from typing import Any

from sysid.data.unit_words import ratio
from sysid.plant.selftest import TOLERANCE
from sysid.structures.model import Model
from sysid.structures.orders import orders_text
from sysid.structures.physics import ground_effects


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
