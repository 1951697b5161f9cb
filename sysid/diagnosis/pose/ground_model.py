"""Models with effects between tracks and ground, as ordinary models."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.effects.base import Place
from sysid.effects.catalogue import effect
from sysid.effects.ground import Ground
from sysid.errors import ModelError
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model


def with_ground(
    model: Model,
    ground: Ground,
    std_errors: Mapping[str, Mapping[str, Array]],
    tracks: tuple[int, int] = (0, 1),
) -> Model:
    """The model with effects of the vehicle; its outputs stay what they are.

    Args:
        std_errors: standard errors of these parameters, 0 where a parameter was not estimated; they
            are taken as uncorrelated with all others, because they come from other data (the pose).
        tracks: outputs of the left and of the right track.
    """
    if not ground:
        return model
    old = model.structure
    if not isinstance(old, Augmented) or old.ny != 2:
        raise ModelError(
            f"effects of the vehicle cannot be added to a {old.name} model of {old.ny} outputs; "
            "diagnose without `model`, so that the base is one linear core per track"
        )
    if any(effect(id).place is Place.POSE for id in old.effects):
        raise ModelError("the model has effects of the vehicle already; start from one without")
    structure = replace(old, effects=(*old.effects, *ground.effects))
    back = np.argsort(np.array(tracks))
    values, spreads, estimated = [], [], 0
    for id in ground.effects:
        e = effect(id)
        for side in (0,) if e.shared else back:
            for p in e.parameters:
                values.append(float(ground.parameters[id][p.name][side]))
                spread = float(std_errors.get(id, {}).get(p.name, np.zeros(2))[side])
                spreads.append(spread)
                estimated += spread > 0.0
    n = len(model.theta)
    covariance = np.zeros((n + len(values), n + len(values)))
    covariance[:n, :n] = model.covariance
    covariance[range(n, n + len(values)), range(n, n + len(values))] = np.square(spreads)
    parameters = structure.parameters(model.inputs, model.outputs)
    return replace(
        model,
        structure=structure,
        theta=np.concatenate([model.theta, values]),
        covariance=covariance,
        parameters=(*model.parameters, *parameters[n:]),
        n_estimated=model.n_estimated + estimated,
    )


def without_sensor_effects(model: Model) -> Model:
    """The model of the wheels themselves: without effects that change what is read only."""
    old = model.structure
    if not isinstance(old, Augmented):
        return model
    kept = tuple(id for id in old.effects if effect(id).place is not Place.READING)
    if kept == old.effects:
        return model
    structure = replace(old, effects=kept)
    names = {p.name for p in structure.parameters(model.inputs, model.outputs)}
    at = [k for k, p in enumerate(model.parameters) if p.name in names]
    return replace(
        model,
        structure=structure,
        theta=model.theta[at],
        covariance=model.covariance[np.ix_(at, at)],
        parameters=tuple(model.parameters[k] for k in at),
    )
