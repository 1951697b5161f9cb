"""Logs that are not read at once: the sums over blocks are those of the whole log in memory."""

from dataclasses import replace
from functools import reduce
from operator import add
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sysid.data.facts import LogFacts
from sysid.data.io import read_file, thinned
from sysid.data.reading.blocks import Blocks, large_log
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Record
from sysid.errors import DataError
from sysid.estimation.all_rows import AllRows, on_all_rows, pooled
from sysid.estimation.assessment.figures import figures
from sysid.estimation.identify import Request, identify
from sysid.estimation.pem import fit
from sysid.fitting.normal_equations import lag_gram
from sysid.structures.linear.families import ARX

N, DT, BLOCK, LAG = 6000, 0.01, 700, 3
FIRST_ORDER = ARX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
DIGITS = 1e-10
"""Relative: sums of 6000 products in another order."""


def frame(noise: float = 0.02) -> pd.DataFrame:
    draw = np.random.default_rng(2)
    u = np.repeat(np.round(draw.uniform(-3, 6, N // 20), 3), 20)
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = 0.9 * y[k - 1] + 0.2 * u[k - 1] + noise * draw.normal()
    return pd.DataFrame({"t": np.round(DT * np.arange(N), 3), "u": u, "y": np.round(y + 4.0, 5)})


def written(folder: Path, kind: str) -> tuple[Path, ReadOptions]:
    """The log in a file, and how it is read."""
    data, path = frame(), folder / f"log.{'parquet' if kind == 'parquet' else 'csv'}"
    if kind == "parquet":
        data.to_parquet(path, row_group_size=1234)
    elif kind == "no time":
        data[["u", "y"]].to_csv(path, index=False)
        return path, ReadOptions(ts=DT)
    elif kind == "epoch, titles":
        text = data.assign(t=data["t"] + 1.7e9).to_csv(index=False, float_format="%.5f")
        path.write_text(f"Logger 7\nrun 3\n{text}")
    elif kind == "semicolons":
        data.to_csv(path, index=False, sep=";", decimal=",")
    elif kind == "bad lines":
        rows = data.to_csv(index=False).splitlines()
        path.write_text("\n".join([*rows[:3000], "reset", *rows[3000:], "end"]) + "\n")
    elif kind == "gap":
        data.drop(index=range(3000, 3100)).to_csv(path, index=False)
    else:
        data.to_csv(path, index=False)
    return path, ReadOptions()


def opened(folder: Path, kind: str) -> tuple[Blocks, tuple[Record, ...]]:
    path, options = written(folder, kind)
    large = large_log(path, options, N // 2)
    assert large is not None
    assert large.rows == pytest.approx(N, rel=0.03)
    return large, read_file(path, options).records


@pytest.mark.parametrize(
    "kind",
    ["csv", "parquet", "no time", "epoch, titles", "semicolons", "bad lines", "gap"],
)
def test_sums_over_blocks_are_those_of_the_whole_log(kind: str, tmp_path: Path) -> None:
    large, whole = opened(tmp_path, kind)
    every = AllRows(large, whole[0].dt, BLOCK)
    blocks = list(every.records(LAG))
    assert len(blocks) > 5
    assert max(map(len, blocks)) < 1.2 * BLOCK + LAG
    got, wanted = reduce(add, (lag_gram([r], LAG) for r in blocks)), lag_gram(whole, LAG)
    assert got.samples == wanted.samples
    np.testing.assert_allclose(got.matrix, wanted.matrix, rtol=DIGITS)


@pytest.mark.parametrize("detrend", ["none", "level"])
def test_arx_of_a_log_in_blocks_is_arx_of_the_log(detrend: str, tmp_path: Path) -> None:
    large, whole = opened(tmp_path, "csv")
    log = thinned(replace(large, options=ReadOptions()), count=4, rows=500)
    facts = LogFacts(log.records, log.findings)
    request = Request(("arx", "oe"), "arx: na=1 nb=1 nk=1; oe: nb=1 nf=1 nk=1", detrend=detrend)
    stretches = identify(facts, (), request)
    judged = on_all_rows(stretches, facts, request, large, BLOCK)
    arx = next(a for a in judged.assessments if a.model.structure.name == "arx")
    wanted = fit(FIRST_ORDER, whole, detrend=detrend)
    np.testing.assert_allclose(arx.model.theta, wanted.theta, rtol=1e-8)
    error = np.sqrt(np.diag(arx.model.covariance) / np.diag(wanted.covariance))
    np.testing.assert_allclose(error, 1.0, atol=0.2)  # σ of a variance from 2000 samples: 3 %
    for a in judged.assessments:
        assert a.validation is not None
        assert a.validation.free_run.samples == N
        assert "all rows" in a.validation.free_run.data
    assert "arx was solved on all rows" in judged.reason


def test_figures_of_parts_are_those_of_the_whole(tmp_path: Path) -> None:
    _, (whole,) = opened(tmp_path, "csv")
    model = fit(FIRST_ORDER, [whole])
    parts = [whole.rows(0, 2500), whole.rows(2500, N)]
    got = pooled([figures(model, [p], "x") for p in parts])
    wanted = figures(model, parts, "x")
    assert got.samples == wanted.samples
    assert got.rmse["y"] == pytest.approx(wanted.rmse["y"], rel=1e-12)
    assert got.fit_percent["y"] == pytest.approx(wanted.fit_percent["y"], rel=1e-12)


def test_a_block_in_another_unit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    data = frame()
    data.loc[N // 2 :, "t"] = 2.0 * data.loc[N // 2 :, "t"]
    data.to_csv(path, index=False)
    large = large_log(path, ReadOptions(), N // 2)
    assert large is not None
    with pytest.raises(DataError, match=r"part 1 is sampled every 0\.0"):
        list(AllRows(large, DT, BLOCK).records())
