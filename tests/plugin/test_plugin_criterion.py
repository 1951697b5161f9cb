"""A criterion of another package ranks structures, and models that were fitted without it."""

import math
import shutil
from pathlib import Path

import pytest
from conftest import Installed

OLDER = Path(__file__).resolve().parents[1] / "data" / "0.1"
ARX, BJ = "arx-eba84e", "bj-476fc8"
SAMPLES = 280 - 2  # the first 70 % of 400, less those that BJ needs before the first it predicts


@pytest.mark.slow
def test_the_example_criterion_ranks_from_its_wheel(installed: Installed, tmp_path: Path) -> None:
    shutil.copytree(OLDER, tmp_path / "0.1")
    ask = ("compare", ARX, BJ, "--workspace", "workspace", "--criterion", "hannan-quinn")
    ranking = installed.document(*ask, folder=tmp_path / "0.1")
    assert ranking["best"] == BJ
    for line in ranking["ranking"]:  # from AIC, which punishes each parameter by 2
        more = 2.0 * math.log(math.log(SAMPLES)) - 2.0
        assert line["hannan-quinn"] == pytest.approx(line["aic"] + line["n"] * more, rel=1e-12)

    fit = ("fit", "log.csv", "--structure", "arx,oe", "--criterion", "hannan-quinn")
    fitted = installed.document(*fit, folder=tmp_path / "0.1")
    assert "its HANNAN-QUINN, from one-step errors" in fitted["reason"]
    assert fitted["criteria"]["aic"] < fitted["criteria"]["hannan-quinn"]
    assert fitted["order_search"]["criterion"] == "hannan-quinn"
