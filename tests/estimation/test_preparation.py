"""Preparation steps: stored, re-applied, refused when they cannot be."""

import numpy as np
import pytest

from sysid.data.preparation import Preparation
from sysid.data.record import Record
from sysid.data.schema import checked
from sysid.errors import UsageError


def record() -> Record:
    t = np.arange(1000) * 0.01
    return Record(np.sign(np.sin(t)), np.sin(t), 0.01)


def test_steps_survive_json_and_do_the_same_again() -> None:
    steps = Preparation(trim_start=1.0, trim_end=0.5, low_pass=5.0, decimate=4)
    again = checked(Preparation, steps.to_json())
    assert again == steps
    one, two = steps.apply(record()), again.apply(record())
    assert one.dt == pytest.approx(0.04)
    assert len(one) == 212  # whole groups of four in 1000 − 100 − 50
    assert one.y.tobytes() == two.y.tobytes()


def test_nothing_asked_is_nothing_done() -> None:
    r = record()
    assert Preparation().apply(r) is r
    assert Preparation().to_json() == {}


@pytest.mark.parametrize(
    "wrong", [{"trim_start": -1.0}, {"trim_end": float("nan")}, {"low_pass": 0.0}, {"decimate": 0}]
)
def test_impossible_numbers_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError, match=r"trimming needs|`low_pass` needs|`decimate` needs"):
        Preparation(**wrong)
