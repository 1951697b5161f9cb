"""Could this log have shown it? Sizes fall with the noise; impossible ones are None."""

import numpy as np
import pytest
from plain_tracks import CHANNELS, DT, FULL, noise, simulate

from sysid.data.record import Array, Record
from sysid.diagnosis.base_model import fit_baseline
from sysid.diagnosis.search.detectable import detectable
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data
from sysid.effects.catalogue import chain_effects, effect

IDS = ("dead-zone", "input-saturation", "cross-coupling", "direction-asymmetry", "rate-limit")
EFFECTS = tuple(e for e in chain_effects() if e.id in IDS)


def sizes(u: Array, factor: float = 1.0) -> dict[str, float | None]:
    """What logs of a plain robot under these commands could have shown."""
    records = []
    for seed in (1, 2):
        y = simulate(u / FULL) + factor * noise(np.random.default_rng(seed), "white", len(u))
        records.append(Record(u=u, y=y, dt=DT, **CHANNELS))
    base = fit_baseline(records[:1], records[1:], EFFECTS)
    return detectable(base.search, base.model, [*IDS, "track-slip", "quantisation"])


def steps(same: bool) -> Array:
    """Levels of both signs for 0.5 to 1.5 s."""
    rng = np.random.default_rng(3)
    tracks = [
        np.repeat(np.rint(FULL * rng.uniform(-1, 1, 60)), rng.integers(10, 30, 60))[:580]
        for _ in range(2)
    ]
    return np.column_stack([tracks[0], tracks[0 if same else 1]])


def test_small_effects_show_on_rich_logs_and_need_more_size_in_more_noise() -> None:
    quiet, loud = sizes(steps(False)), sizes(steps(False), 4.0)
    assert quiet["track-slip"] is None
    for id in ("dead-zone", "cross-coupling", "direction-asymmetry", "quantisation"):
        small, large = quiet[id], loud[id]
        assert small is not None
        assert large is not None
        # steps of a coarse reading are as noise: seen only from about their own size on
        assert 0.0 < small < large < (1.0 if id == "quantisation" else 0.3)
    # a limit is the looser the easier it shows
    tightest, looser = loud["input-saturation"], quiet["input-saturation"]
    assert tightest is not None
    assert looser is not None
    assert looser > tightest > 0.5


def test_a_run_that_leaves_all_bounds_shows_its_effect_without_an_overflow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Warnings are errors here: the square of 1e200 had been one on the terminal."""
    u, run = steps(False), FullModel.run
    records = [
        Record(
            u, simulate(u / FULL) + noise(np.random.default_rng(k), "white", len(u)), DT, **CHANNELS
        )
        for k in (1, 2)
    ]
    base = fit_baseline(records[:1], records[1:], EFFECTS)

    def far(model: FullModel, q: Array, data: Data) -> Array:
        found = np.asarray(run(model, q, data))
        return found if found.shape[0] < 2 else np.where(np.abs(found) > 1.0, 1e200, found)

    monkeypatch.setattr(FullModel, "run", far)
    assert detectable(base.search, base.model, ["dead-zone"])["dead-zone"] is not None


def test_a_size_that_it_gives_would_be_found_about_there() -> None:
    u = steps(False)
    found = sizes(u)["dead-zone"]
    assert found is not None
    drive = u / FULL
    change = simulate(np.sign(drive) * np.maximum(np.abs(drive) - found, 0.0)) - simulate(drive)
    # what a new gain and time constant cannot follow is a part of the change; 0.90 asks for a
    # variance of 0.23 of the noise's
    assert 0.23 < np.mean(change**2) / 0.2**2 < 25.0


def test_equal_commands_hide_cross_coupling_and_two_levels_hide_a_dead_zone() -> None:
    assert sizes(steps(True))["cross-coupling"] is None
    two = sizes(np.where(steps(False) > 0.0, 10000.0, -10000.0))
    assert two["dead-zone"] is None
    assert two["input-saturation"] is None
    assert two["cross-coupling"] is not None


def test_slopes_have_a_column_for_each_free_number() -> None:
    u = steps(False)
    y = simulate(u / FULL) + noise(np.random.default_rng(1), "white", len(u))
    record = Record(u=u, y=y, dt=DT, **CHANNELS)
    base = fit_baseline([record], [record.rows(0, 300)], (effect("dead-zone"),))
    found = base.search.slopes(base.model, holdout=True)
    assert [s.shape for s in found] == [(300, 2, len(base.model.free))]
    gain = base.search.model.index["core", "gain", 0]
    column = found[0][:, 0, base.model.free.index(gain)]
    own = simulate(u[:300] / FULL)[:, 0] / 20.0
    assert np.corrcoef(column[10:], own[10:])[0, 1] > 0.999
