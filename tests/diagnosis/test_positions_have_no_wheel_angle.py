"""A position that a spring or a weight holds integrates no command: its sum is no angle, and what
would be drag of a speed is a stiffness."""

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.base_model import fit_baseline
from sysid.effects.catalogue import effect

EFFECTS = tuple(
    effect(id) for id in ("dead-zone", "coulomb-friction", "quadratic-drag", "gravity-load")
)


@pytest.mark.parametrize(
    ("name", "unit", "offered"),
    [
        ("position", "rad", ("dead-zone",)),
        ("speed", "rad/s", ("dead-zone", "gravity-load", "coulomb-friction", "quadratic-drag")),
    ],
)
def test_friction_drag_and_waves_over_an_angle_are_offered_to_speeds(
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
    ids = {e.id for e in EFFECTS}
    assert {e.id for e in base.search.model.effects} & ids == {*offered}


def test_a_temperature_under_commands_of_both_signs_keeps_its_offset() -> None:
    """A Peltier element heats and cools: degrees above zero are no sensor without a sign."""
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-1.0, 1.0, 40), 25)
    y = np.full(len(u), 24.0)
    for k in range(1, len(u)):
        y[k] = 24.0 + 0.95 * (y[k - 1] - 24.0) + 0.05 * (18.0 * u[k - 1] + 8.0 * u[k - 1] ** 2)
    y += rng.normal(0.0, 0.05, len(u))
    assert y.min() > 0.0
    log = Record(u[:, None], y[:, None], 0.5, (Channel("u", ""),), (Channel("plate", "degC"),))
    assert fit_baseline([log], None, EFFECTS).words.endswith("and an offset")
