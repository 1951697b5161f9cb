"""The study of prediction intervals: its twins are what its table says of them."""

import numpy as np

from studies import prediction_intervals as study
from sysid.data.record import PWM_FULL_SCALE


def test_the_model_of_a_twin_inside_the_class_is_that_twin() -> None:
    case = study.CASES[0]
    twin = study.twin_of(case, 5)
    model = study.identified(case, twin, 5)
    truth = np.array([twin.b[0], -twin.a[0], twin.b[1], -twin.a[1]])
    errors = np.sqrt(np.diag(model.covariance))
    assert np.all(np.abs(model.theta - truth) < 4.0 * errors)  # one of 4000 is farther by chance


def test_twins_outside_are_not_linear() -> None:
    half = np.full(2, 0.5 * PWM_FULL_SCALE)
    for case in study.CASES:
        twin = study.twin_of(case, 1)
        moved = [twin.step(np.zeros(2), u)[0] for u in (half, 2.0 * half)]
        assert np.allclose(moved[1], 2.0 * moved[0]) == case.inside
    assert {c.inside for c in study.CASES} == {True, False}
