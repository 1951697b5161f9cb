"""plant.json: the description of a plant, written and read."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from sysid.data import documents
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel
from sysid.data.schema import DAMAGED, STORED, checked
from sysid.errors import ModelError, Termination
from sysid.structures.model import Model, Provenance
from sysid.structures.physics import ground_effects
from sysid.structures.registry import structure_from_json, structure_to_json
from sysid.version import __version__

SCHEMA = "sysid-plant/1"
BLOCKS = ("input_operating_point", "core", "output_operating_point")
"""Kinds of the blocks a signal passes, in order."""


def describe(model: Model, report: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The content of plant.json: blocks, channels, domain of validity, origin and fit.

    Args:
        report: what ``fit`` had to say; its ``validation``, else its ``estimation``, is kept.

    Returns:
        JSON-able values; numbers that are not finite are None.
    """
    names = (c.name for c in (*model.inputs, *model.outputs))
    ranges = dict(zip(names, model.ranges.tolist(), strict=False))  # a model may store none
    core = {
        "kind": "core",
        **structure_to_json(model.structure),
        "parameters": [
            {f.name: getattr(p, f.name) for f in fields(_StoredValue)}
            for p in model.parameter_table()
        ],
        "covariance": _lower_rows(model.covariance),
    }
    described = {
        "schema": SCHEMA,
        "name": name,
        "sample_time": model.dt,
        "inputs": model.inputs,
        "outputs": model.outputs,
        "blocks": [
            {"kind": BLOCKS[0], "offset": model.detrend.u_offset.tolist()},
            core,
            {"kind": BLOCKS[2], "offset": model.detrend.y_offset.tolist()},
        ],
        "domain": {
            "inputs": {c.name: ranges.get(c.name) for c in model.inputs},
            "outputs": {c.name: ranges.get(c.name) for c in model.outputs},
        },
        "properties": model.structure.properties(model.theta, model.dt),
        **_ground(model),
        "fit": _fit(report),
        "termination": {"code": model.termination.code, "message": model.termination.value},
        "data": model.provenance.data,
        "warnings": list(dict.fromkeys((*model.warnings, *report.get("warnings", ())))),
        # not where the logs lay on somebody's disk: their names and hashes are under data
        "options": {k: v for k, v in model.provenance.options.items() if k != "files"},
        "version": model.provenance.version or __version__,
    }
    finite: dict[str, Any] = documents.plain(described)
    return finite


def _lower_rows(matrix: Array) -> list[str]:
    """The lower triangle, a line a row: nine digits are more than a covariance is known to."""
    return [" ".join(f"{v:.9g}" for v in row[: k + 1]) for k, row in enumerate(matrix.tolist())]


def _symmetric(rows: tuple[str, ...], n: int) -> Array:
    """Undo ``_lower_rows``; zeros where a package of an older version has no rows."""
    lower = np.zeros((n, n))
    if rows and len(rows) != n:
        raise ValueError(f"its covariance has {len(rows)} rows for {n} parameters")
    for k, row in enumerate(rows):
        lower[k, : k + 1] = [float(v) for v in row.split()]
    return lower + np.tril(lower, -1).T


def _ground(model: Model) -> dict[str, Any]:
    """What stands between tracks and ground: effect → parameter → [left, right], in order."""
    ground = ground_effects(model.structure, model.theta)
    effects = {
        id: {name: v.tolist() for name, v in ground.parameters[id].items()} for id in ground.effects
    }
    return {"ground": effects} if effects else {}


def _fit(report: Mapping[str, Any]) -> dict[str, Any] | None:
    """The figures on validation data, on estimation data where there are none, and which."""
    parts = (p for p in ("validation", "estimation") if isinstance(report.get(p), Mapping))
    return next(({"on": part, **report[part]} for part in parts), None)


def from_text(text: bytes, where: str) -> dict[str, Any]:
    """Read plant.json as far as its schema."""
    try:
        raw = documents.parsed(text)
    except ValueError as error:
        raise ModelError(f"{where}: plant.json is damaged ({error}); export it again") from None
    if not isinstance(raw, dict) or "schema" not in raw:
        raise ModelError(f"{where}: plant.json names no schema; export the plant again")
    if raw["schema"] != SCHEMA:
        raise ModelError(
            f"{where}: plant.json has the schema {raw['schema']!r}, this version reads {SCHEMA}; "
            "export the plant again"
        )
    return raw


@dataclass(frozen=True)
class _PlantFile:
    """What plant.json holds that a runtime takes; see ``describe``, which writes it."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    sample_time: float
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    blocks: tuple[Mapping[str, Any], Mapping[str, Any], Mapping[str, Any]]
    domain: Mapping[str, Mapping[str, tuple[float, float] | None]]


@dataclass(frozen=True)
class _OperatingPoint:
    """The first or the last block: what is taken off the inputs, or added to the outputs."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    kind: str
    offset: tuple[float, ...]


@dataclass(frozen=True)
class _StoredValue:
    """A parameter in plant.json."""

    name: str
    value: float
    std_error: float | None
    unit: str
    fixed: bool


@dataclass(frozen=True)
class _Core:
    """The block in the middle, beside the structure's own keys."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    parameters: tuple[_StoredValue, ...]
    covariance: tuple[str, ...] = ()  # of 0.1.0, the first packages held none


def to_model(raw: Mapping[str, Any], where: str) -> Model:
    """The model of a package: what it runs like, and how well its parameters are known.

    Its noise is zero and it has no criteria; packages of older versions have no covariance either.
    """
    try:
        file = checked(_PlantFile, raw, others=True)
        if tuple(b.get("kind") for b in file.blocks) != BLOCKS:
            raise ValueError(f"its blocks must be {', '.join(BLOCKS)}")
        before, after = (checked(_OperatingPoint, file.blocks[k]) for k in (0, 2))
        core = checked(_Core, file.blocks[1], others=True)
        values = core.parameters
        structure = structure_from_json(file.blocks[1])
        if (structure.nu, structure.ny) != (len(file.inputs), len(file.outputs)):
            raise ValueError("its channels do not fit its structure")
        parameters = structure.parameters(file.inputs, file.outputs)
        if [p.name for p in values] != [p.name for p in parameters]:
            raise ValueError("its parameters do not fit its orders")
        domain = [file.domain["inputs"][c.name] for c in file.inputs]
        return Model(
            structure=structure,
            theta=np.array([p.value for p in values], dtype=np.float64),
            covariance=_symmetric(core.covariance, len(values)),
            parameters=tuple(
                replace(q, fixed=p.value) if p.fixed else q
                for q, p in zip(parameters, values, strict=True)
            ),
            dt=file.sample_time,
            inputs=file.inputs,
            outputs=file.outputs,
            detrend=Detrend(
                _offsets(before, len(file.inputs), "input"),
                _offsets(after, len(file.outputs), "output"),
            ),
            noise_covariance=np.zeros((len(file.outputs),) * 2),
            n_estimated=0,
            criteria={},
            termination=Termination.CLOSED_FORM,
            ranges=np.array([] if None in domain else domain, dtype=np.float64).reshape(-1, 2),
            provenance=Provenance(options={"package": where}),
        ).tried()
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from None
    except DAMAGED as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else error
        raise ModelError(f"{where}: plant.json is damaged ({what}); export it again") from None


def _offsets(point: _OperatingPoint, channels: int, side: str) -> Array:
    if len(point.offset) != channels:
        raise ValueError(f"{side} offsets: {channels} numbers expected")
    return np.array(point.offset, dtype=np.float64)
