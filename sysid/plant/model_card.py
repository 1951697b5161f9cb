"""README.md of a plant package: the model card."""

from collections.abc import Iterator, Mapping
from importlib.resources import files
from string import Template
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
    before, core, after = described["blocks"]
    ins = ", ".join(c["name"] for c in described["inputs"])
    outs = ", ".join(c["name"] for c in described["outputs"])
    equations, traits = model.equations(), model.structure.traits
    return _fill(
        name=_cell(described["name"]),
        summary=f"{traits.title}, from {_cell(ins)} to {_cell(outs)}, one sample every "
        f"{described['sample_time']:.6g} s. {traits.equation}",
        dt=f"{described['sample_time']:.6g}",
        equations="\n".join(equations).replace("`", ""),
        input_offset=_offsets("subtracts", described["inputs"], before["offset"]),
        structure=core["structure"],
        orders=_cell(f"orders {orders_text(core['orders'])}" if core["orders"] else "no orders"),
        output_offset=_offsets("adds", described["outputs"], after["offset"]),
        parameters="\n".join(_parameter_rows(core["parameters"])),
        behaviour="\n".join(
            f"- {x}"
            for x in (*_behaviour(described, model.operating_point_sentence()), *_ground(model))
        ),
        fit="\n".join(_fit(described["fit"])),
        domain="\n".join(_domain_rows(described)),
        origin="\n".join(f"- {line}" for line in _origin(described)),
        warnings="\n".join(f"- {w}" for w in _warnings(model, described["warnings"])),
        usage=usage,
        folder="plant",
        tolerance=f"{TOLERANCE:g}",
    )


def _parameter_rows(parameters: list[dict[str, Any]]) -> Iterator[str]:
    for p in parameters:
        error = "fixed" if p["fixed"] else _number(p["std_error"], 3, "no information")
        yield f"| {_cell(p['name'])} | {_number(p['value'], 8)} | {error} | {_cell(p['unit'])} |"


def _ground(model: Model) -> Iterator[str]:
    effects = ground_effects(model.structure, model.theta).effects
    if effects:
        yield (
            f"The outputs are the speeds of the wheels. Between tracks and ground act "
            f"{', '.join(effects)}: the mission simulator applies them, the C code does not."
        )


def _behaviour(described: Mapping[str, Any], level: str) -> Iterator[str]:
    properties = described["properties"]
    if level:
        yield _cell(level)
    if "stable" in properties:
        yield "Stable." if properties["stable"] else "**Unstable**: its free run diverges."
    for pole in properties.get("poles", []):
        place = f"{pole['re']:.6g}" + (f" {pole['im']:+.6g}i" if pole["im"] else "")
        constant = pole.get("time_constant_s")
        slow = f", time constant {constant:.4g} s" if constant else ""
        yield f"Pole at {place}{slow}."
    for channel, gains in zip(
        described["outputs"], properties.get("static_gain", []), strict=False
    ):
        for source, gain in zip(described["inputs"], gains, strict=True):
            unit = ratio(channel["unit"], source["unit"])
            value = f"{_number(gain, 6, 'infinite')} {_cell(unit)}".rstrip()
            yield (
                f"Static gain from {_cell(source['name'])} to {_cell(channel['name'])}: {value}."
            )


def _fit(fit: Mapping[str, Any] | None) -> Iterator[str]:
    if fit is None:
        yield "No fit figures are stored with the model."
        return
    own_words = (
        "data that the fit did not see"
        if fit["on"] == "validation"
        else "the data it was fitted to"
    )
    facts = [f"{k.replace('_', ' ')}: {fit[k]}" for k in ("horizon", "initial_state") if k in fit]
    data = fit.get("data")
    named = data if isinstance(data, str) else ", ".join(map(str, data or []))
    yield f"On {fit['on']} data ({own_words}{', ' + _cell(named) if named else ''}); " + (
        _cell("; ".join(facts)) + "." if facts else "horizon not stored."
    )
    yield ""
    yield "| output | fit [%] | RMSE |"
    yield "|---|---:|---:|"
    errors = fit.get("rmse") or {}
    for name, percent in (fit.get("fit_percent") or {}).items():
        yield f"| {_cell(name)} | {_number(percent, 5)} | {_number(errors.get(name), 5)} |"


def _domain_rows(described: Mapping[str, Any]) -> Iterator[str]:
    for role in ("input", "output"):
        ranges = described["domain"][f"{role}s"]
        for channel in described[f"{role}s"]:
            low, high = ranges[channel["name"]] or (None, None)
            yield (
                f"| {_cell(channel['name'])} | {role} | {_cell(channel['unit'])} | "
                f"{_number(low, 6)} | {_number(high, 6)} |"
            )


def _origin(described: Mapping[str, Any]) -> Iterator[str]:
    for source in described["data"]:
        yield (
            f"Fitted to {_cell(source['name'])}, {source['samples']} samples from "
            f"t = {source['first']:.6g} s (sha256 `{source['sha256']}`)."
        )
    options = described["options"]
    if options:
        yield _cell("Options: " + ", ".join(f"{k} = {v}" for k, v in options.items()) + ".")
    yield described["termination"]["message"]
    for channel in (*described["inputs"], *described["outputs"]):
        if channel["scale"] != 1.0:
            yield (
                f"{_cell(channel['name'])} was converted from {_cell(channel['file_unit'])} in the "
                f"log to {_cell(channel['unit'])} here (× {channel['scale']:.9g})."
            )
    yield f"Generated by sysid {described['version']}."


def _warnings(model: Model, known: list[str]) -> Iterator[str]:
    yield from map(_cell, known)
    if model.detrend.u_slope is not None and model.detrend.u_slope.any():
        yield "A trend of the inputs in time was removed before the fit; the plant has none."
    if model.detrend.y_slope is not None and model.detrend.y_slope.any():
        yield "A trend of the outputs in time was removed before the fit; the plant has none."
    if not known:
        yield "The fit gave no warnings."


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


def _fill(**values: str) -> str:
    source = files("sysid.plant").joinpath("templates", "README.md").read_text(encoding="utf-8")
    return Template(source).substitute(values)
