"""What gets lost of a position is its own readings; a difference of two repeats by chance."""

import numpy as np

from sysid.data.record import Channel, Record
from sysid.diagnosis.integrating import rates
from sysid.diagnosis.samples import inspect_rates, inspect_samples

DT = 0.05


def position(samples: int = 2000) -> Record:
    """An axis that turns up to 200 rad, written with five digits as most files are."""
    rng = np.random.default_rng(2)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 40), 40)
    speed = np.convolve(u, 0.2 * 0.8 ** np.arange(40))[:samples] * 12.0
    y = 150.0 + DT * np.cumsum(speed) + 0.04 * rng.standard_normal(samples)
    y = np.array([float(f"{v:.5g}") for v in y])
    return Record(u[:, None], y[:, None], DT, (Channel("u", "V"),), (Channel("angle", "rad"),))


def test_differences_that_repeat_by_the_file_s_digits_are_no_dropouts() -> None:
    record = position()
    assert inspect_rates(rates([record], 1), [record], 1).lost == ()


def test_a_reading_that_is_lost_takes_both_rates_that_are_made_from_it() -> None:
    record = position()
    lost = np.arange(60, 1900, 45)
    y = record.y.copy()
    y[lost] = 0.0
    held = Record(record.u, y, DT, record.inputs, record.outputs)
    found = inspect_rates(rates([held], 1), [held], 1)
    assert found.ids == inspect_samples([held]).ids == ("dropouts",)
    (weights,) = found.weights
    rows = np.flatnonzero(weights[:, 0] == 0.0)
    # the rate in row k is that of sample k + 1, from samples k and k + 2
    assert set(rows) == set(lost) | set(lost - 2)


def test_readings_between_which_a_logger_has_drawn_lines_are_no_dropouts() -> None:
    rng = np.random.default_rng(4)
    fresh = np.cumsum(rng.uniform(0.004, 0.02, 700))  # a servo's bus, nowhere near the log's clock
    speed = 3.0 * np.sin(2.0 * fresh) + np.sin(0.7 * fresh**1.3)
    t = np.arange(1200) * 0.005
    y = np.interp(t, fresh, 0.024 * np.round(speed / 0.024))
    y[rng.random(1200) < 0.01] += 1e-6  # the last digit of the file
    record = Record(np.sign(y)[:, None], y[:, None], 0.005, (Channel("u", "V"),), (Channel("w"),))
    assert inspect_samples([record]).ids == ()
