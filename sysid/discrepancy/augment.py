"""From a node of the search to an ordinary model: saved, compared, exported, simulated."""

from collections.abc import Sequence

import numpy as np

from sysid import __version__
from sysid.criteria.information import information_criteria
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.discrepancy.base_model import Base, full_drive
from sysid.discrepancy.batched_search import information
from sysid.discrepancy.diagnosis import Value
from sysid.discrepancy.evidence import effective_samples
from sysid.discrepancy.named_sets import Node
from sysid.effects.catalogue import CHANGED, effect
from sysid.errors import Termination
from sysid.structures.augmented import Augmented
from sysid.structures.model import Model, Provenance, Source

DRY = ("coulomb-friction", "stiction")


def effects_of(base: Base, node: Node) -> tuple[str, ...]:
    """The effects of the augmented structure: the base's level, then the accepted ones."""
    level = ("load-bias",) if base.level else ()
    return (*level, *(id for id in node.effects if id != CHANGED.id))


def slots_of(base: Base, node: Node) -> list[int]:
    """The slots of a node in the order of ``Augmented``'s θ."""
    m = base.search.model
    found = [k for k, s in enumerate(m.slots) if s.owner == "core"]
    for id in effects_of(base, node):
        e = effect(id)
        for track in (-1,) if e.shared else range(m.tracks):
            found += [m.place[id, p.name, track] for p in e.parameters]
    return found


def covariance_of(base: Base, node: Node) -> Array:
    """Covariance of the free slots, (n, n): σ²(JᵀJ)⁻¹ with σ² widened by N/N_eff track by track."""
    H = information(base.search.model, node.q, node.free, base.search.data)
    errors = np.concatenate(node.errors.estimation)
    variance = float(np.nanmean(errors**2))
    counted = np.maximum(np.isfinite(errors).sum(axis=0), 1)
    share = float(np.min(effective_samples(node.errors.estimation) / counted))
    return np.asarray(variance * np.linalg.pinv(H, hermitian=True) / max(min(share, 1.0), 1e-3))


def values_of(base: Base, node: Node, id: str) -> tuple[Value, ...]:
    """The numbers of an effect with standard errors; None where nothing was estimated."""
    m = base.search.model
    names = base.search.estimation[0].output_names
    unit = base.search.estimation[0].outputs[0].unit
    covariance = covariance_of(base, node) if node.free else np.zeros((0, 0))
    at = {slot: i for i, slot in enumerate(node.free)}
    units = {p.name: p.unit for p in effect(id).parameters} if id != CHANGED.id else {}
    found = []
    for k in m.of(id):
        slot = m.slots[k]
        tag = "" if slot.track < 0 else f"[{names[slot.track]}]"
        if k not in at and id != CHANGED.id and node.q[k] == slot.null and slot.track >= 0:
            continue
        error = float(np.sqrt(max(covariance[at[k], at[k]], 0.0))) if k in at else None
        words = units.get(slot.name, "").replace("speed", unit)
        found.append(Value(f"{slot.name}{tag}", float(node.q[k]), error, words))
        if id in DRY and slot.name in ("level", "excess"):
            # dry friction as the command that it takes: what a person with a robot turns up
            full = float(full_drive(base.parts.estimation)[slot.track]) / abs(
                node.q[m.place["core", "gain", slot.track]]
            )
            channel = base.search.estimation[0].inputs[slot.track]
            scaled = None if error is None else error * full
            found.append(
                Value(f"{slot.name}_command{tag}", float(node.q[k] * full), scaled, channel.unit)
            )
    return tuple(found)


def model_of(base: Base, node: Node) -> Model:
    """The node as a Model with values, standard errors, figures and provenance."""
    search = base.search
    records = search.estimation
    first = records[0]
    structure = Augmented(
        search.model.order,
        base.delay,
        tuple(float(s) for s in base.scales),
        first.dt,
        effects_of(base, node),
        base.given,
    )
    slots = slots_of(base, node)
    covariance = np.zeros((len(slots), len(slots)))
    if node.free:
        free = covariance_of(base, node)
        at = {slot: i for i, slot in enumerate(node.free)}
        inside = [k for k, slot in enumerate(slots) if slot in at]
        index = [at[slots[k]] for k in inside]
        covariance[np.ix_(inside, inside)] = free[np.ix_(index, index)]
    parts = _rows_together(node.errors.estimation)
    errors = np.concatenate(parts)
    values = [np.concatenate([r.u for r in records]), np.concatenate([r.y for r in records])]
    return Model(
        structure=structure,
        theta=node.q[slots],
        covariance=covariance,
        parameters=structure.parameters(first.inputs, first.outputs),
        dt=first.dt,
        inputs=first.inputs,
        outputs=first.outputs,
        detrend=Detrend.none(first.nu, first.ny),
        noise_covariance=errors.T @ errors / len(errors),
        n_estimated=len(node.free),
        criteria=information_criteria(parts, len(node.free)),
        termination=Termination.CONVERGED_COST,
        ranges=np.array([(c.min(), c.max()) for block in values for c in block.T]),
        provenance=Provenance(_sources(records), {"made_by": "diagnose"}, __version__),
    )


def _rows_together(errors: Sequence[Array]) -> list[Array]:
    """Errors of all outputs in rows of their own, (M, ny) a record.

    Slow sensors whose readings never share a row are put side by side in their order.
    """
    parts = [e[np.isfinite(e).all(axis=1)] for e in errors]
    if sum(map(len, parts)) > errors[0].shape[1]:
        return parts
    found = []
    for e in errors:
        columns = [c[np.isfinite(c)] for c in e.T]
        shortest = min(len(c) for c in columns)
        found.append(np.column_stack([c[:shortest] for c in columns]))
    return found


def _sources(records: Sequence[Record]) -> tuple[Source, ...]:
    return tuple(Source(r.name, r.sha256, r.t0, len(r)) for r in records)
