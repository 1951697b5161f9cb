"""Designed inputs: within limits, better than random ones, the known one where one is known."""

import numpy as np
import pytest

from sysid.data.facts import LogFacts
from sysid.data.record import Record
from sysid.estimation.information.optimal_input import Limits, optimal_input
from sysid.estimation.information.sensitivity import information
from sysid.estimation.information.subject import Subject, subject_of_box
from sysid.structures.grey_box.file.physics import FilePhysics
from sysid.structures.grey_box.file.structure import FromFile
from sysid.structures.grey_box.physics import Sampling

GAIN = """
time: discrete
inputs: {u: }
states: {x: {known: true}}
parameters: {gain: {start: 2}}
equations: {x: gain*u}
outputs: {y: {equation: x}}
"""

LAG = """
inputs: {u: }
states: {x: {}}
parameters: {gain: {start: 2}, tau: {start: 0.5, bounds: [0.05, 20]}}
equations: {x: (gain*u - x)/tau}
outputs: {y: {equation: x}}
"""


def subject(text: str) -> Subject:
    s = FromFile(FilePhysics(1, 1, text), Sampling(0.1, 1))
    u = np.random.default_rng(1).uniform(-1.0, 1.0, (100, 1))
    y = s.simulate(s.physics.pack({}), u)
    return subject_of_box(
        s, LogFacts((Record(u, y + 1e-3 * np.sin(np.arange(100))[:, None], 0.1),))
    )


@pytest.mark.parametrize(("low", "high"), [(-1.0, 3.0), (-3.0, 1.0)])
def test_a_gain_is_shown_best_by_the_largest_input(low: float, high: float) -> None:
    s = subject(GAIN)
    limits = Limits(np.array([[low, high]]), np.array([[-10.0, 10.0]]))
    found = optimal_input(s, 40, limits, rounds=10)
    assert found.u.min() >= low
    assert found.u.max() <= high
    # ∂y/∂gain = u(t−1): the error is σ/‖u‖, least where |u| is 3 throughout but for the last
    best = s.noise[0] / np.sqrt(39 * 9.0)
    assert found.errors[0] == pytest.approx(best, rel=0.03)
    assert found.words == "switching sequence"


def test_a_design_beats_random_switching_and_says_what_it_reaches() -> None:
    s, samples = subject(LAG), 100
    limits = Limits(np.array([[-1.0, 1.0]]), np.array([[-3.0, 3.0]]))
    found = optimal_input(s, samples, limits, rounds=10)
    rng = np.random.default_rng(2)
    volumes = []
    for held in (0, 1, 2, 5, 10, 20):
        u = found.u
        if held:
            u = np.repeat(rng.choice([-1.0, 1.0], (samples // held, 1)), held, axis=0)
        covariance = information(s.slopes([u], [s.rest()]), 2).covariance
        volumes.append(np.sqrt(np.linalg.det(covariance)))
    # two time constants are the best time to hold: the search finds that
    assert volumes[0] < min(volumes[1:])
    assert volumes[0] < 0.7 * np.median(volumes[1:])
    again = optimal_input(s, samples, limits, rounds=10)
    assert np.array_equal(again.u, found.u)


def test_limits_of_outputs_are_kept() -> None:
    s = subject(LAG)
    narrow = Limits(np.array([[-1.0, 1.0]]), np.array([[-1.0, 1.0]]))
    found = optimal_input(s, 100, narrow, rounds=10)
    (y,) = s.runs([found.u], [s.rest()])
    assert np.abs(y).max() <= 1.2  # a tenth of the range beyond each end
    assert np.abs(y).max() > 0.9
