"""The model of the errors: silent on noise of any colour, loud on structure; and feedback."""

import numpy as np
import pytest
from plain_tracks import CHANNELS, DT, FULL, GAIN, POLE, SCALES, SIGMA, logged, noise, simulate
from sysid_datasets.driving import STYLES, speed_loop

from sysid.data.documents import plain
from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.diagnosis.validation.model_error import error_structure
from sysid.errors import DataError


def left(record: Record, clean: Array, extra: Array | None = None) -> tuple[float, float]:
    """(p-value, share) of the errors of the plain model, with an error of it added."""
    errors = record.y - clean + (0.0 if extra is None else extra)
    found = error_structure([record], [errors], [clean], np.array([SIGMA, SIGMA]), SCALES)
    return found.p_value, found.share


@pytest.mark.parametrize("kind", ["white", "ar", "walk"])
def test_noise_of_any_colour_is_not_structure(kind: str) -> None:
    trials = [left(*logged(list(STYLES)[s % 5], s, kind)) for s in range(4)]
    # nominal 1 %: one of four below 0.01 has a chance of 4 %, below 0.001 one of 0.4 %
    assert min(p for p, _ in trials) > 1e-3
    assert sum(p < 0.01 for p, _ in trials) <= 1


@pytest.mark.parametrize(
    ("name", "share"),
    [("dead-zone", 0.7), ("drag", 0.7), ("coupling", 0.7), ("bias", 0.7), ("delay", 0.6)],
)
def test_structure_is_found_with_its_share(name: str, share: float) -> None:
    record, clean = logged("steps", 3, "white")
    d = record.u / FULL
    extra = {
        "dead-zone": simulate(np.sign(d) * np.minimum(np.abs(d), 0.1)) * -1.0,
        "drag": -0.003 * clean * np.abs(clean),
        "coupling": -0.1 * simulate(d[:, ::-1]),
        "bias": np.full(clean.shape, 0.8),
        "delay": np.vstack([clean[:1], clean[:-1]]) - clean,
    }[name]
    # as a fitted model would: a change of its gain is not left in the errors
    if name != "bias":
        extra = extra - clean * np.sum(clean * extra, axis=0) / np.sum(clean**2, axis=0)
    p, found = left(record, clean, extra)
    assert p < 1e-6
    assert share < found <= 1.0


def test_a_ripple_over_the_wheels_angle_is_found() -> None:
    record, clean = logged("steps", 4, "white")
    angle = np.cumsum(record.y, axis=0) * DT
    ripple = 0.4 * np.sin(2.0 * np.vstack([angle[:1], angle[:-1]]) + 1.0)
    assert left(record, clean, ripple)[0] < 1e-6


def test_what_the_models_own_numbers_can_follow_is_no_structure() -> None:
    record, clean = logged("steps", 5, "white")
    errors = record.y - 0.95 * clean
    floor = np.array([SIGMA, SIGMA])
    refitted = error_structure([record], [errors], [0.95 * clean], floor, SCALES)
    given = error_structure(
        [record], [errors], [0.95 * clean], floor, SCALES, [np.zeros((len(record), 2, 0))]
    )
    assert refitted.p_value > 1e-3
    assert given.p_value < 1e-6
    assert plain(given.verdict("before"))["model"] == "before"


def test_samples_that_do_not_count_are_left_out() -> None:
    record, clean = logged("steps", 3, "white")
    d = record.u / FULL
    errors = record.y - clean
    errors[::50] = 100.0
    errors[:400] = 100.0
    masked = np.where(errors == 100.0, np.nan, errors)
    floor = np.array([SIGMA, SIGMA])
    assert error_structure([record], [masked], [clean], floor, SCALES).p_value > 1e-3
    missing = masked - 0.1 * simulate(d[:, ::-1])
    assert error_structure([record], [missing], [clean], floor, SCALES).p_value < 1e-6


def test_wrong_shapes_and_short_records_are_refused() -> None:
    record, clean = logged("steps", 6, "white")
    with pytest.raises(DataError, match="shapes"):
        error_structure([record], [clean[:, :1]], [clean], np.ones(2), SCALES)
    short = record.rows(0, 50)
    with pytest.raises(DataError, match="at least 100"):
        error_structure([short], [clean[:50]], [clean[:50]], np.ones(2), SCALES)


@pytest.mark.parametrize("style", ["steps", "driving", "multisine"])
@pytest.mark.parametrize("loop", [True, False])
def test_feedback_is_told_from_open_loop(style: str, loop: bool) -> None:
    rng = np.random.default_rng(11)
    n = 1500
    reference = STYLES[style](rng, n, DT)
    driver = speed_loop(reference, (float(GAIN[0]), float(GAIN[1])), DT)
    y, u, state = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(2)
    e = noise(rng, "white", n)
    for k in range(n):
        y[k] = state + e[k]
        command = driver(k, (float(y[k, 0]), float(y[k, 1]))) if loop else reference[k]
        u[k] = np.asarray(command, dtype=np.float64)
        state = POLE * state + GAIN * (1 - POLE) * u[k] / FULL
    assert LogFacts((Record(u=u, y=y, dt=DT, **CHANNELS),)).surely_closed_loop is loop
