"""Short logs, and logs that judge themselves: one sentence about the log, not about the inside."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from quick_diagnosis import dead_zone_log, diagnose

from sysid.data.io import read_log
from sysid.data.record import Record
from sysid.errors import UsageError
from sysid.estimation.identify import Request, identify
from sysid.report.diagnosis_page import diagnosis_page


def oven(path: Path, samples: int, seed: int = 1) -> Path:
    """A heater of one input: ϑ(t) = 0.9 ϑ(t−1) + 4 P(t−1)."""
    rng = np.random.default_rng(seed)
    power = np.repeat(rng.uniform(0.0, 1.0, samples // 5 + 1), 5)[:samples]
    heat = np.zeros(samples)
    for k in range(1, samples):
        heat[k] = 0.9 * heat[k - 1] + 4.0 * power[k - 1]
    heat += 0.05 * rng.standard_normal(samples)
    return write_log(path, ["u_heater", "y_temperature"], [power, heat], 10.0)


@pytest.mark.parametrize("samples", [1, 5, 19, 20, 25, 30])
@pytest.mark.parametrize(
    "line",
    [["fit", "--split", "0.7"], ["fit", "--structure", "arx"], ["diagnose"], ["inspect"]],
    ids=" ".join,
)
def test_short_logs_get_one_sentence_about_the_log(
    samples: int, line: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    log = oven(Path("log.csv"), samples)
    done = run(capsys, line[0], log, *line[1:])
    assert "unexpected" not in done.err
    enough = {"arx": 21, "inspect": 20}  # a third of 30 is too few to judge on
    assert done.code == (0 if samples >= enough.get(line[-1], 31) else 1)
    if done.code and line != ["inspect"]:  # which prints every finding
        assert done.err.count("\n") == 1
        what = "1 row of numbers" if samples == 1 else f"{samples} samples"
        if line[1:] == ["--structure", "arx"] and samples == 20:
            what = "19 one-step errors are too few"  # the first sample has none
        else:
            assert "residual tests" not in done.err
        assert what in done.err
    if line == ["fit", "--split", "0.7"] and 20 <= samples < 29:
        assert "a split at 0.7" in done.err


@pytest.mark.parametrize("same", ["log.csv", "copy.csv", "spaced.csv"])
def test_a_log_does_not_judge_what_is_fitted_to_it(
    same: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    text = oven(Path("log.csv"), 200).read_text()
    Path("copy.csv").write_text(text)
    Path("spaced.csv").write_text(text.replace(",", ", "))
    orders = ["--structure", "arx", "--orders", "na=1 nb=1"]
    refused = run(capsys, "fit", "log.csv", "--val", same, *orders)
    assert refused.code == 2
    assert f"{same} " in refused.err
    assert "is estimation data" in refused.err
    assert not Path(".sysid/models").exists()
    other = oven(Path("other.csv"), 200, seed=2)
    assert run(capsys, "fit", "log.csv", "--val", other, *orders).code == 0


def test_a_page_leaves_out_the_pictures_a_short_log_has_no_rows_for(tmp_path: Path) -> None:
    log = read_log(dead_zone_log(tmp_path / "log.csv", samples=40))
    page = diagnosis_page(diagnose([log], None), "before", "after").html()
    assert "<svg" in page
    assert "Residual over" not in page


def test_two_stretches_of_one_log_may_judge_each_other() -> None:
    """``Record.split`` keeps the hash of the file: only a shared instant is forbidden."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], 40), 10)
    whole = Record(u, np.roll(u, 1) + 0.1 * rng.standard_normal(400), 0.1)
    first, last = whole.split(0.5)
    request = Request(structures=("arx",), orders="na=1 nb=1 nk=1")
    assert identify([first], [last], request).assessments[0].validation is not None
    with pytest.raises(UsageError, match="is estimation data"):
        identify([whole], [last], request)
