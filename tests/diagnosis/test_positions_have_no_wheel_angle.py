"""A position that a spring or a weight holds integrates no command, and its sum is no angle."""

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.base_model import fit_baseline
from sysid.effects.catalogue import effect

EFFECTS = tuple(effect(id) for id in ("dead-zone", "gravity-load", "speed-ripple"))


@pytest.mark.parametrize(
    ("name", "unit", "offered"),
    [
        ("position", "rad", ("dead-zone",)),
        ("speed", "rad/s", ("dead-zone", "gravity-load", "speed-ripple")),
    ],
)
def test_waves_over_an_angle_are_offered_to_speeds(
    name: str, unit: str, offered: tuple[str, ...]
) -> None:
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-1.0, 1.0, 30), 20)
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        y[k] = 0.8 * y[k - 1] + 0.2 * u[k - 1]
    y += 0.01 * rng.standard_normal(len(u))
    log = Record(u[:, None], y[:, None], 0.02, (Channel("u", "V"),), (Channel(name, unit),))
    base = fit_baseline([log], None, EFFECTS)
    assert not base.on_rate
    assert tuple(e.id for e in base.search.model.effects if e in EFFECTS) == offered
