"""A model that a constant would beat is called not usable, with the number."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log

from sysid.estimation.assessment.advice import WORSE


def oven(path: Path, sign: float, seed: int) -> Path:
    """A heater and its temperature above ambient; its wire may be swapped on one day."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.0, 1.0, 60), 10)
    y = np.zeros(600)
    for k in range(599):
        y[k + 1] = 0.95 * y[k] + 2.0 * u[k]
    y = 60.0 + sign * (y - 20.0) + rng.normal(0.0, 0.05, 600)
    return write_log(path, ("heater", "temperature"), (u, y), 1.0)


@pytest.mark.parametrize(("sign", "said"), [(1.0, False), (-1.0, True)])
def test_a_fit_below_zero_is_said_to_be_useless(
    sign: float, said: bool, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    log, val = oven(tmp_path / "a.csv", 1.0, 1), oven(tmp_path / "b.csv", sign, 2)
    columns = ("--input", "heater", "--output", "temperature")
    orders = ("--structure", "arx", "--orders", "na=1 nb=1 nk=1")
    document = run(capsys, "fit", log, "--val", val, *columns, *orders, "--json").document
    fit = document["validation"]["fit_percent"]["temperature"]
    assert (fit < 0.0) is said
    useless = [w for w in document["warnings"] if "not usable in free run" in w]
    assert bool(useless) is said
    if said:
        assert useless[0] == document["warnings"][0]
        # the ratio of the errors is 1 − fit/100
        assert 1.0 - fit / 100.0 > WORSE
        assert f"errs {1.0 - fit / 100.0:.3g} times as much as the constant mean" in useless[0]
        assert "on the validation data" in useless[0]
