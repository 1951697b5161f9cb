"""From a node of the search to an ordinary model: saved, compared, exported, simulated."""

from collections.abc import Sequence

import numpy as np

from sysid import __version__
from sysid.criteria.coloured import effective_sample_size
from sysid.criteria.information import information_criteria
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.discrepancy.naming import NamingSearch, Node
from sysid.effects.catalogue import effect
from sysid.errors import Termination
from sysid.structures.augmented import Augmented
from sysid.structures.model import Model, Provenance, Source


def effects_of(search: NamingSearch, node: Node) -> tuple[str, ...]:
    """The effects of the augmented structure: the base's level, then the accepted ones."""
    return (*(("load-bias",) if search.level else ()), *node.effects)


def slots_of(search: NamingSearch, node: Node) -> list[int]:
    """The slots of a node in the order of ``Augmented``'s θ."""
    m = search.model
    found = [k for k, s in enumerate(m.slots) if s.owner == "core"]
    for id in effects_of(search, node):
        e = effect(id)
        for track in (-1,) if e.shared else range(m.tracks):
            found += [m.place[id, p.name, track] for p in e.parameters]
    return found


def covariance_of(search: NamingSearch, node: Node) -> Array:
    """Covariance of the free slots: σ²(JᵀJ)⁻¹, widened by N/N_eff where errors are coloured."""
    H = search.model.information(node.q, node.free, search.data)
    errors = np.concatenate(node.errors)
    variance = float(np.mean(errors**2))
    share = min(
        effective_sample_size([e[:, [i]] for e in node.errors]) / len(errors)
        for i in range(errors.shape[1])
    )
    return np.asarray(variance * np.linalg.pinv(H, hermitian=True) / max(min(share, 1.0), 1e-3))


def model_of(
    search: NamingSearch,
    node: Node,
    scales: Array,
    delay: int,
    options: dict[str, object],
) -> Model:
    """The node as a Model with values, standard errors, figures and provenance."""
    records = search.estimation
    first = records[0]
    structure = Augmented(
        search.model.order,
        delay,
        tuple(float(s) for s in scales),
        first.dt,
        effects_of(search, node),
    )
    slots = slots_of(search, node)
    theta = node.q[slots]
    covariance = np.zeros((len(slots), len(slots)))
    free = covariance_of(search, node)
    at = {slot: i for i, slot in enumerate(node.free)}
    inside = [k for k, slot in enumerate(slots) if slot in at]
    index = [at[slots[k]] for k in inside]
    covariance[np.ix_(inside, inside)] = free[np.ix_(index, index)]
    errors = np.concatenate(node.errors)
    values = [np.concatenate([r.u for r in records]), np.concatenate([r.y for r in records])]
    return Model(
        structure=structure,
        theta=theta,
        covariance=covariance,
        parameters=structure.parameters(first.inputs, first.outputs),
        dt=first.dt,
        inputs=first.inputs,
        outputs=first.outputs,
        detrend=Detrend.none(first.nu, first.ny),
        noise_covariance=errors.T @ errors / len(errors),
        n_estimated=len(node.free),
        criteria=information_criteria(list(node.errors), len(node.free)),
        termination=Termination.CONVERGED_COST,
        ranges=np.array([(c.min(), c.max()) for block in values for c in block.T]),
        provenance=Provenance(_sources(records), {"made_by": "diagnose", **options}, __version__),
    )


def _sources(records: Sequence[Record]) -> tuple[Source, ...]:
    return tuple(Source(r.name, r.sha256, r.t0, len(r)) for r in records)
