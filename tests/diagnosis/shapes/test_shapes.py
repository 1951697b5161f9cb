"""Shapes on tracks simulated from their own equation in fine steps: each is found at its place."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.base_model import fit_baseline, full_drive
from sysid.diagnosis.session import DiagnosisSession, noise_of
from sysid.diagnosis.shapes.fitted import fitted_shapes
from sysid.diagnosis.shapes.grading import FoundShape
from sysid.diagnosis.shapes.over_time import gain_step, lag_drift
from sysid.diagnosis.shapes.smoother import Fit
from sysid.diagnosis.shapes.track import Track, tracks_of
from sysid.effects.catalogue import chain_effects

DT, SUBSTEPS, SECONDS, NOISE, AT = 0.05, 10, 70.0, 0.08, 41.0
GAIN, TAU = 20.0, 0.25

Plant = Callable[[float, float, float, list[float]], tuple[float, float, float]]
"""(t, d, angle, memory) → command that acts, factor on the gain, load [rad/s]."""


def log(plant: Plant, slower: float = 1.0, seed: int = 1) -> Record:
    """One track τ ω̇ = g K d − L − ω behind steps of the command; τ times ``slower`` after AT."""
    rng = np.random.default_rng(seed)
    n, drive = round(SECONDS / DT), np.zeros(0)
    while len(drive) < n:
        level = rng.choice(np.linspace(-0.9, 0.9, 13))
        drive = np.append(drive, np.full(rng.integers(6, 40), level))
    speed = angle = 0.0
    memory, y = [float(drive[0])], np.zeros(n)
    for k in range(n):
        y[k] = speed
        for s in range(SUBSTEPS):
            t = k * DT + s * DT / SUBSTEPS
            d, factor, load = plant(t, float(drive[k]), angle, memory)
            tau = TAU * (slower if t > AT else 1.0)
            speed += DT / SUBSTEPS / tau * (factor * GAIN * d - load - speed)
            angle += DT / SUBSTEPS * speed
    y += NOISE * rng.standard_normal(n)
    u: Array = 20000.0 * drive[:n, None]
    channels = (Channel("pwm_l", "µs"),), (Channel("omega_l", "rad/s"),)
    return Record(u, y[:, None], DT, *channels, name="log.csv")


def play(t: float, d: float, angle: float, memory: list[float]) -> tuple[float, float, float]:
    memory[0] = min(max(memory[0], d - 0.12), d + 0.12)
    return memory[0], 1.0, 0.0


CASES: dict[str, tuple[Plant, float, str]] = {
    "gain steps": (lambda t, d, a, m: (d, 0.82 if t > AT else 1.0, 0.0), 1.0, "gain-step"),
    "load engages": (lambda t, d, a, m: (d, 0.77 if t > AT else 1.0, 0.0), 1.3, "plant-step"),
    "load steps": (lambda t, d, a, m: (d, 1.0, 2.0 if t > AT else 0.0), 1.0, "load-step"),
    "gain drifts": (lambda t, d, a, m: (d, 1.0 - 0.25 * np.sin(t / 22.0), 0.0), 1.0, "gain-drift"),
    "load drifts": (lambda t, d, a, m: (d, 1.0, 0.05 * t), 1.0, "load-drift"),
    "spring": (lambda t, d, a, m: (d, 1.0, 0.8 * a), 1.0, "linear-mode"),
    "hysteresis": (play, 1.0, "command-play"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_shape_is_found_at_its_place(case: str) -> None:
    plant, slower, id = CASES[case]
    (found,) = _found(log(plant, slower))
    assert found.id == id
    # what is left is noise, and what the base's first order leaves of a play or of a change
    assert found.share > 0.95
    if case == "gain steps":
        assert found.curve is not None
        # 1 %: 18 % of the gain against noise of 0.4 % of the speed, over some 500 samples
        assert found.curve.y[-1] == pytest.approx(82.0, abs=1.0)
        # the spacing of the times that are tried is 0.15 s at most
        assert found.curve.x[1] == pytest.approx(AT, abs=0.3)


@pytest.mark.parametrize("seed", range(3))
def test_a_linear_track_has_no_shape(seed: int) -> None:
    assert not _found(log(lambda t, d, a, m: (d, 1.0, 0.0), seed=seed))


def test_no_shape_is_fitted_through_a_core_that_runs_away() -> None:
    """A model without one of its effects may: its errors stay small where that effect bounds it."""
    record = log(lambda t, d, a, m: (d, 1.0, 0.0))
    base = fit_baseline([record], None, chain_effects())
    q = base.model.q.copy()
    q[base.search.model.index["core", "f1", 0]] = -1.3
    (track,) = tracks_of(base.search, replace(base.model, q=q))
    assert fitted_shapes([track], np.array([NOISE]), moves=True) == ()


def test_a_lag_that_drifts_leaves_the_level_where_it_is() -> None:
    """A load is no part of what moves the speed: at 60 % of humidity a slower lag was a drift."""
    track = replace(_track(), level=True)
    low, high = lag_drift(track), lag_drift(replace(track, speed=track.speed + 60.0))
    assert low is not None
    assert high is not None
    np.testing.assert_allclose(high.columns, low.columns, atol=1e-9)


def test_a_change_of_gain_is_a_share_of_the_torque() -> None:
    """A speed that feeds back divides the gain at rest before and after the change alike."""
    track = _track()
    own = np.zeros(track.own.shape[1])
    own[1] = 0.8  # beside one lag of the command: four fifths of the speed's own torque
    zero = np.zeros(len(track.drive))
    change = Fit(own, np.array([-0.27]), np.array([[1e-6]]), 1.0, zero, zero, 0.0)
    terms = gain_step(track)
    assert terms is not None
    words, curve = terms.says(change, 0, 1.0)
    assert "falls by 27 %" in words
    assert curve is not None
    assert curve.y[-1] == pytest.approx(73.0)


def test_of_a_base_that_does_not_settle_no_share_of_a_gain_is_said() -> None:
    track = _track()
    slow = replace(track, f=np.array([-np.exp(-1.0 / len(track.drive))]))
    assert track.settles
    assert not slow.settles
    terms = gain_step(slow)
    assert terms is not None
    own, zero = np.zeros(slow.own.shape[1]), np.zeros(len(slow.drive))
    change = Fit(own, np.array([-0.27]), np.array([[1e-6]]), 1.0, zero, zero, 0.0)
    words, curve = terms.says(change, 0, 1.0)
    assert "does not settle" in words
    assert "%" not in words
    assert curve is None


def _track() -> Track:
    base = fit_baseline([log(lambda t, d, a, m: (d, 1.0, 0.0))], None, chain_effects())
    (track,) = tracks_of(base.search, base.model)
    return track


def _found(record: Record) -> tuple[FoundShape, ...]:
    base = fit_baseline([record], None, chain_effects())
    session = DiagnosisSession(base, noise_of(base), full_drive([record]), 0)
    left = session.residual_structure(session.base.model)
    assert left is not None
    return session.proven_shapes(base.model, left)
