"""What a log can tell apart is said before anything is fitted."""

from pathlib import Path

import numpy as np
import pytest
from sysid_datasets import folder

import sysid
from sysid.data.record import Record
from sysid.diagnosis.isolability import isolability


@pytest.fixture(scope="module")
def levels() -> Record:
    return sysid.read_log(folder() / "devastator" / "multilevel.csv")


def two_levels(seed: int) -> Record:
    """One motor between two commands: every static curve is another gain."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.integers(0, 2, 80) * 1.0, 15)[:, None]
    y = np.zeros_like(u)
    for k in range(len(u) - 1):
        y[k + 1] = 0.8 * y[k] + 0.2 * 10.0 * u[k]
    return Record(u, y + 0.02 * rng.standard_normal(u.shape), 0.05)


def test_many_levels_tell_friction_from_a_saturated_command(levels: Record) -> None:
    found = isolability([levels])
    at = {id: k for k, id in enumerate(found.ids)}
    assert all(found.shown[at[id]] for id in ("stiction", "input-saturation", "inertial-coupling"))
    assert found.angles[at["stiction"], at["input-saturation"]] > 45.0
    np.testing.assert_allclose(found.angles, found.angles.T)
    friction = {frozenset(p.effects) for p in found.pairs}
    assert frozenset(("coulomb-friction", "input-saturation")) not in friction


def test_two_levels_show_no_static_curve() -> None:
    found = isolability([two_levels(0)])
    at = {id: k for k, id in enumerate(found.ids)}
    hidden = {id for id, k in at.items() if not found.shown[k]}
    assert {"concave-gain", "input-saturation"} <= hidden
    assert all(p.experiment for p in found.pairs)


def test_a_log_of_no_use_is_refused(tmp_path: Path) -> None:
    short = Record(np.ones((12, 1)), np.ones((12, 1)), 0.1)
    with pytest.raises(sysid.SysidError):
        isolability([short])
