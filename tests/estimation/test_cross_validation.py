"""Block cross-validation against known truths."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.record import Record
from sysid.errors import DataError, UsageError
from sysid.estimation.pem import fit
from sysid.estimation.selection.cross_validation import cross_validate
from sysid.structures.registry import structure_class

NOISE = 0.1


def second_order(samples: int, seed: int) -> Record:
    rng = np.random.default_rng(seed)
    u = np.sign(rng.normal(size=samples))
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + NOISE * rng.normal(size=samples)
    return Record(u, y, 0.1)


def test_error_of_the_true_structure_is_the_noise() -> None:
    record = second_order(2000, 1)
    oe = structure_class("oe").from_orders({"nb": 2, "nf": 2, "nk": 1}, 1, 1)
    found = cross_validate(fit(oe, [record]), [record], folds=5)
    # 2000 samples: the noise's own RMSE is known to 1/√(2N) = 1.6 %, thrice that is allowed
    assert found.rmse["y"] == pytest.approx(NOISE, rel=0.05)
    assert found.failed == 0
    assert found.spread["y"] < 0.2 * NOISE


def test_a_missing_order_shows_and_a_needless_one_does_not_pay() -> None:
    records = [second_order(600, 2), second_order(600, 3)]
    errors = {}
    for n in (1, 2, 4):
        oe = structure_class("oe").from_orders({"nb": n, "nf": n, "nk": 1}, 1, 1)
        errors[n] = cross_validate(fit(oe, records), records, folds=3).rmse["y"]
    assert errors[1] > 5.0 * errors[2]
    # the needless order may gain by its extra initial states on each block, not by more than 1 %
    assert errors[4] > 0.99 * errors[2]


@pytest.mark.parametrize(("folds", "error"), [(1, UsageError), (40, DataError)])
def test_impossible_folds_are_refused(folds: int, error: type[Exception]) -> None:
    record = second_order(200, 4)
    arx = structure_class("arx").from_orders({"na": 2, "nb": 2}, 1, 1)
    with pytest.raises(error, match="folds"):
        cross_validate(fit(arx, [record]), [record], folds=folds)
