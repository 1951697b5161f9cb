"""The Python column of the tables for users of other packages, row by row."""

import importlib
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid.data.frequency_response import FrequencyResponse

PAGES = Path(__file__).resolve().parents[2] / "docs"
CODE = r"(sysid|model)\.\w+[\w.]*(\(|$)"
NEEDS_FILES = {
    "sysid.load_plant(folder)",
    'sysid.read_log("x.csv", inputs="u", outputs="y")',
}
MODULES = ("sysid.estimation.reduction", "sysid.estimation.resampling")


def snippets(page: str) -> list[str]:
    """Calls and attributes in the last column that stand without an ellipsis."""
    found = []
    for line in (PAGES / page).read_text(encoding="utf-8").split("\n"):
        cells = [c.strip() for c in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) < 2:
            continue
        spans = re.findall(r"`([^`]+)`", cells[-1])
        found += [c for c in spans if re.match(CODE, c) and "…" not in c and c not in NEEDS_FILES]
    return found


ROWS = sorted({*snippets("from-matlab.md"), *snippets("from-python-control.md")})


@pytest.fixture(scope="module")
def names() -> dict[str, object]:
    """What the rows speak of: a log, models of it, and numbers."""
    for module in MODULES:
        importlib.import_module(module)
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], 200), 3)
    y = lfilter([0.0, 0.5, 0.2], [1.0, -1.2, 0.5], u) + 0.05 * rng.standard_normal(len(u))
    record = sysid.Record(u, y, dt=0.1, inputs=["u"], outputs=["y"])
    model, other = sysid.fit(record, "oe", "nb=2 nf=2 nk=1"), sysid.fit(record, "arx")
    folder = {"record": record, "z": record, "u": u, "y": y, "model": model, "n": 1, "K": 5}
    return {**folder, "m1": model, "m2": other, "Ts": 0.2, "sysid": sysid}


def test_the_tables_have_rows() -> None:
    assert len(ROWS) > 20


@pytest.mark.parametrize("row", ROWS)
def test_a_row_runs(row: str, names: dict[str, object], tmp_path: Path) -> None:
    if "_control" in row:
        control = pytest.importorskip("control")
        w = np.geomspace(0.1, 10.0, 60)
        frd = control.FRD(2.0 / (1.0 + 1j * w), w)
        names = {**names, "frd": frd, "FrequencyResponse": FrequencyResponse}
    script = tmp_path / "row.py"
    script.write_text(f"found = {row}\n", encoding="utf-8")
    assert runpy.run_path(str(script), init_globals=names)["found"] is not None
