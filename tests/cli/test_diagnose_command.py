"""``sysid diagnose``: the story, the files, the document, the models kept, and what is refused."""

import json
import re
import sys
import types
from dataclasses import replace
from html.parser import HTMLParser
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import quick_diagnosis
from command_line import Capture, Run, contents, robot_log, run, write_log
from quick_diagnosis import dead_zone_log
from scipy.signal import lfilter
from sysid_cli.diagnose_files import write_results

from sysid.criteria.verdicts import ResidualReport, ResidualTest
from sysid.data.io import read_log
from sysid.diagnosis.diagnosis import Diagnosis
from sysid.diagnosis.validation.excess_error import ExcessError
from sysid.workspace.logs import StoredData
from sysid.workspace.store import Workspace

KEYS = {
    "verdict", "effects", "minor", "candidates", "where", "gap", "detectable",
    "next_experiments", "original_model", "augmented_model", "seconds",
}  # fmt: skip


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two logs, and an engine that need not search."""
    monkeypatch.chdir(tmp_path)
    dead_zone_log(tmp_path / "log.csv")
    dead_zone_log(tmp_path / "other.csv", seed=2)
    engine("diagnose", monkeypatch)
    return tmp_path


def engine(answer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the command get one of the quick answers."""
    stub = types.ModuleType("sysid.diagnosis.diagnose")
    stub.diagnose = getattr(quick_diagnosis, answer)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, stub.__name__, stub)


def test_exchanged_sides_are_paired_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Each output gets the command that it follows; the pose of exchanged wheels is not used."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.integers(-16, 17, size=(40, 2)), 15, axis=0) * 1000.0
    y = np.column_stack(
        [-lfilter([0, 1e-4], [1, -0.9], u[:, 1]), lfilter([0, 1e-4], [1, -0.9], u[:, 0])]
    )
    signals = [*u.T, *(y + 0.01 * rng.standard_normal(y.shape)).T, *(np.arange(600.0),) * 3]
    names = ["pwm_l", "pwm_r", "omega_l", "omega_r", "x", "y", "psi"]
    log = write_log(tmp_path / "log.csv", names, signals, 0.05)
    seen = []

    def stub(estimation: Any, *rest: Any, **facts: Any) -> Diagnosis:
        seen.extend(estimation)
        return quick_diagnosis.nothing(estimation, *rest, **facts)

    engine("diagnose", monkeypatch)
    monkeypatch.setattr(sys.modules["sysid.diagnosis.diagnose"], "diagnose", stub)
    warned = " ".join(run(capsys, "diagnose", log, "--workspace", tmp_path / "ws").err.split())
    (record,) = seen
    assert record.input_names == ("pwm_r", "pwm_l")
    assert record.pose is None
    assert "give --input pwm_r,pwm_l" in warned
    assert "--unit omega_l=-rad/s" in warned


def no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures take seconds; tests that look at something else go without."""
    monkeypatch.setattr("sysid.report.diagnosis_page.diagnosis_page", quick_diagnosis.no_page)


def diagnosed(capsys: Capture, *arguments: object) -> dict[str, Any]:
    """The document of a run with ``--json``."""
    return run(capsys, "diagnose", "log.csv", "--json", *arguments).document


class Ids(HTMLParser):
    """Ids, references and outside addresses of a page; open tags that nobody closes."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.outside: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("src", "href") and re.match(r"(https?:)?//", value or ""):
                self.outside.append(value or "")
        if tag not in ("meta", "link", "br", "img", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


# What it leaves behind ----------------------------------------------------------------------------


@pytest.mark.slow
def test_story_files_and_page(here: Path, capsys: Capture) -> None:
    told = run(capsys, "diagnose", "log.csv", "--full")
    assert told.code == 0, told.err
    titles = (
        "Where model and log disagree",
        "What is missing",
        "What was added",
        "How far the gap shrank",
    )
    heads = [told.out.index(f"\n{title}\n") for title in titles]
    assert heads == sorted(heads)
    for words in (
        "of the excess error of omega_",
        "dead-zone: actuator",
        "95 % interval",
        "cannot distinguish it from stiction",
        "of the error beyond the noise closed",
        "Next: sysid show | sysid compare | sysid export",
    ):
        assert words in told.out
    assert max(map(len, told.out.splitlines())) < 200
    folder = here / ".sysid" / "diagnosis"
    names = {p.name for p in folder.iterdir()}
    assert names == {"diagnosis.json", "index.html", "page.json", "next_1_dead-zone.csv"}
    rows = (folder / "next_1_dead-zone.csv").read_text().splitlines()
    assert rows == ["t,pwm_l,pwm_r", "0,0,0", "1,2000,2000", "2,0,0"]
    page = (folder / "index.html").read_text(encoding="utf-8")
    parser = Ids()
    parser.feed(page)
    assert parser.open == []
    assert parser.outside == []
    assert len(parser.ids) == len(set(parser.ids))
    referred = set(re.findall(r"url\(#([^)]+)\)|href=\"#([^\"]+)\"", page))
    assert {a or b for a, b in referred} <= set(parser.ids)
    shown = re.findall(r'class="panel"[^>]*aria-label="([^":]*)', page)
    assert page.count("<figure") == len(shown)
    for of in ("Excess error by regime", "omega_l", "omega_r", "Effects tried"):
        assert any(label.startswith(of) for label in shown), (of, shown)
    assert "next_1_dead-zone.csv" in page
    assert len(page) < 1_500_000


@pytest.mark.slow
@pytest.mark.parametrize("answer", ["nothing", "unexplained"])
def test_page_and_story_without_an_effect(
    answer: str, here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine(answer, monkeypatch)
    told = run(capsys, "diagnose", "log.csv", "-o", "out", "--full")
    assert told.code == 0, told.err
    said = {
        "nothing": ("Nothing is missing", "No effect is missing."),
        "unexplained": ("no effect of the catalogue explains it", "0.3 sin(pwm_l)"),
    }[answer]
    page = (here / "out" / "index.html").read_text(encoding="utf-8")
    for words in said:
        assert words in told.out
    assert said[0] in page
    document = json.loads((here / "out" / "diagnosis.json").read_text())
    assert document["original_model"] == document["augmented_model"]
    assert document["effects"] == []


def test_document(here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    no_page(monkeypatch)
    found = diagnosed(capsys, "--val", "other.csv", "-o", "out")
    assert found.keys() >= KEYS
    assert found == json.loads((here / "out" / "diagnosis.json").read_text())
    (effect,) = found["effects"]
    assert set(effect) == {
        "id", "stage", "channels", "parameters", "evidence", "indistinguishable", "sentence",
        "error_ratio_without", "remains",
    }  # fmt: skip
    assert set(effect["parameters"][0]) == {
        "name", "value", "std_error", "unit", "interval", "visited", "on_bound",
    }  # fmt: skip
    assert set(effect["evidence"]) == {"delta_bic", "p_value", "heldout_gain"}
    assert found["candidates"][0] == {"id": "dead-zone", "score": 0.9}
    assert {"region", "share_of_excess", "share_of_samples"} <= set(found["where"][0])
    gap = found["gap"]
    assert {"before", "after", "noise_floor", "closed_percent", "interval", "channels"} <= set(gap)
    assert set(gap["channels"]["omega_l"]) == {
        "rmse_before", "rmse_after", "noise_floor", "floor_interval",
    }  # fmt: skip
    assert gap["closed_percent"] > 95
    assert found["detectable"] == {"dead-zone": 0.01, "backlash": None}
    assert found["next_experiments"][0]["file"] == "next_1_dead-zone.csv"
    assert found["next_experiments"][1]["file"] == ""


def test_both_models_are_ordinary_models(
    here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    no_page(monkeypatch)
    found = diagnosed(capsys)
    ids = [found["original_model"], found["augmented_model"]]
    listed = run(capsys, "models", "--json").document["models"]
    assert [m["model"] for m in listed] == ids
    assert listed[1]["fit_percent"]["omega_r"] > 95
    ranked = run(capsys, "compare", *ids, "--val", "other.csv", "--json").document
    assert ranked["best"] == found["augmented_model"]
    exported = run(capsys, "export", "--json").document
    assert exported["model"] == found["augmented_model"], "what a diagnosis made is the newest"
    assert exported["selftest"]["max_error"] < 1e-6


def test_after_a_diagnosis_everything_is_ranked_on_its_held_out_log(
    here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    no_page(monkeypatch)
    fitted = ("--structure", "oe,arx", "--orders", "oe: nb=1 nf=1; arx: na=1 nb=1")
    run(capsys, "fit", "log.csv", *fitted)
    found = diagnosed(capsys, "--val", "other.csv")
    ranked = run(capsys, "compare", "--json").document
    assert ranked["data"] == "other.csv"
    assert len(ranked["ranking"]) == 4, "two fits, the baseline, the augmented model"
    assert ranked["best"] == found["augmented_model"]
    assert (ranked["excluded"], ranked["notes"]) == ([], [])


@pytest.mark.parametrize("what", ["dead zone", "nothing", "unexplained"])
def test_the_answer_fits_a_screen(
    what: str, here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    no_page(monkeypatch)
    monkeypatch.setenv("COLUMNS", "80")
    if what != "dead zone":
        engine(what, monkeypatch)
    told = run(capsys, "diagnose", "log.csv", "--val", "other.csv")
    lines = [*told.out.splitlines(), *told.err.splitlines()]
    assert len(lines) <= 24, told.out
    assert max(map(len, lines)) <= 80
    if what == "dead zone":  # 0.2 ± 1.96 × 0.001, and ten times the error without it
        assert re.search(r"1 dead-zone +omega_l +plus 0.200 \(0.198–0.202\) drive", told.out)
        assert "× 10" in told.out
        assert "\nLeft: less than 1 % of the error beyond the noise: done\n" in told.out


@pytest.mark.parametrize(
    ("p", "excess", "left"),
    [
        (0.5, None, "of the error beyond the noise: done"),
        (1e-9, None, "of the error beyond the noise; residuals: input FAIL"),
        (0.5, 0.07, "but no noise"),
    ],
)
def test_done_is_said_of_a_model_that_compare_passes(
    p: float, excess: float | None, left: str, here: Path, capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def stub(*given: Any, **facts: Any) -> Diagnosis:
        kinds = [
            ResidualTest(k, "omega", 9.0, 3, p, p > 0.01, 0.99, 1, "u", k == "independence", "…")
            for k in ("whiteness", "independence", "feedback")
        ]
        beyond = excess and ExcessError((("omega", "rad/s", excess, 1.0),))
        tests = ResidualReport((kinds[0],), (kinds[1],), (kinds[2],), 0.99)
        return replace(
            quick_diagnosis.diagnose(*given, **facts),
            tests=None if beyond else tests,
            excess_error=beyond or None,
        )

    no_page(monkeypatch)
    monkeypatch.setattr(sys.modules["sysid.diagnosis.diagnose"], "diagnose", stub)
    said = run(capsys, "diagnose", "log.csv", "--val", "other.csv").out
    assert f"\nLeft: less than 1 %{', ' if excess else ' '}{left}" in said
    if not excess:
        after = Workspace(here / ".sysid").load(diagnosed(capsys)["augmented_model"])
        assert after.report["residuals"]["passed"] == (p > 0.01)
        assert ("input FAIL" in run(capsys, "compare").out) == (p < 0.01)


@pytest.mark.slow
def test_a_mission_is_told_and_drawn(
    here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Paths and figures of a mission reach the story and the page; the engine gets the file."""
    (here / "mission.yaml").write_text("goal: [3, 1]\n")
    line = [[0.0, 0.0, 0.0], [1.0, 0.5, 0.2], [3.0, 1.0, 0.1]]
    path = {
        "mission": "mission.yaml",
        "sentence": "The path is off by 0.40 m before and by 20 mm after.",
        "open_loop": [{"record": "log.csv", "rms_before_m": 0.4, "rms_after_m": 0.02}],
        "closed_loop": {"measured": {"time_s": 12.0}, "before": {"time_s": 10.0}},
        "warnings": ["The mission cannot be driven by the model after."],
        "traces": [{"record": "log.csv", "measured": line, "before": line[:2], "after": line}],
    }
    asked: list[Path] = []

    def on_mission(*logs: Any, mission: Path, **facts: Any) -> Diagnosis:
        asked.append(mission)
        return replace(quick_diagnosis.nothing(*logs, **facts), path=path)

    monkeypatch.setattr(sys.modules["sysid.diagnosis.diagnose"], "diagnose", on_mission)
    told = run(capsys, "diagnose", "log.csv", "--mission", "mission.yaml", "--full")
    assert told.code == 0, told.err
    assert asked == [Path("mission.yaml")]
    assert "closed loop: time [s]" in told.out
    assert "off by 0.40 m before" in told.out
    page = (here / ".sysid" / "diagnosis" / "index.html").read_text(encoding="utf-8")
    assert "Path of log.csv" in page
    assert "cannot be driven by the model after" in page


@pytest.mark.slow
def test_sizes_on_the_page_have_their_unit(here: Path, capsys: Capture) -> None:
    assert run(capsys, "diagnose", "log.csv").code == 0
    page = Path(".sysid/diagnosis/index.html").read_text()
    assert ">0.01 of full drive</td>" in page


def test_diagnosed_models_say_what_they_were_judged_on(
    here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    no_page(monkeypatch)
    document = diagnosed(capsys, "--val", "other.csv")
    for id in (document["original_model"], document["augmented_model"]):
        stored = Workspace(Path(".sysid")).load(id)
        assert [Path(f).name for f in stored.report["judged_on"]["files"]] == ["other.csv"]
        records = StoredData().validation(stored)
        assert records is not None
        assert records[0].name == "other.csv"


def test_the_engine_takes_what_the_command_gives() -> None:
    from sysid.diagnosis.diagnose import diagnose

    assert {"estimation", "holdout", "model", "progress"} <= set(signature(diagnose).parameters)


# The model to diagnose ---------------------------------------------------------------------------


@pytest.mark.slow
def test_the_best_model_of_these_channels_is_compared_with_the_result(
    here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    no_page(monkeypatch)
    one = write_log(here / "single.csv", ["u", "y"], np.random.default_rng(1).normal(size=(2, 90)))
    fitted = run(
        capsys, "fit", "log.csv", "--structure", "oe", "--orders", "nb=1 nf=1 nk=1", "--json"
    ).document["model"]
    run(capsys, "fit", one, "--structure", "arx", "--orders", "na=1 nb=1 nk=1", "--json")
    # the baseline is the base: the workspace's best is only compared with the result
    first = diagnosed(capsys)
    assert first["original_model"] != fitted
    assert first["against"]["name"] == fitted
    assert set(first["against"]["rmse"]) == {"omega_l", "omega_r"}
    assert diagnosed(capsys, "--model", fitted)["original_model"] == fitted


def test_nothing_is_lost(here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """A page that cannot be written leaves the models, the logs and an older diagnosis alone."""
    no_page(monkeypatch)
    diagnosed(capsys)
    before = contents(here)

    def broken(*_: object) -> str:
        raise MemoryError

    monkeypatch.setattr("sysid.report.diagnosis_page.diagnosis_page", broken)
    assert run(capsys, "diagnose", "log.csv").code == 1
    after = contents(here)
    state = {k for k in after if "models/" in k or k.endswith("index.json")}
    assert {k: v for k, v in after.items() if k not in state} == {
        k: v for k, v in before.items() if k not in state
    }
    assert set(before) == set(after)


def test_the_page_of_a_stored_diagnosis_is_written_again(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same page from what was stored; links lead to its files from wherever it lies."""
    monkeypatch.chdir(tmp_path)
    record = read_log(dead_zone_log(tmp_path / "log.csv"))
    found = quick_diagnosis.diagnose([record], None)
    write_results(tmp_path / "d", found, "a", "b", [])
    page = (tmp_path / "d" / "index.html").read_text(encoding="utf-8")
    (tmp_path / "d" / "index.html").unlink()
    for named in ("d", "d/diagnosis.json"):
        assert run(capsys, "report", named).code == 0
        assert (tmp_path / "d" / "index.html").read_text(encoding="utf-8") == page
    assert run(capsys, "report", "d", "-o", "elsewhere.html").code == 0
    (link,) = set(re.findall(r'href="([^#"]+)"', (tmp_path / "elsewhere.html").read_text()))
    assert (tmp_path / link).exists()
    refused(run(capsys, "report", "d", "m.yaml"), 2, "one diagnosis alone")
    stored = (tmp_path / "d" / "page.json").read_text()
    (tmp_path / "d" / "page.json").write_text(stored.replace('"title"', '"headline"', 1))
    refused(run(capsys, "report", "d"), 1, "page.json: damaged", "sysid diagnose")
    (tmp_path / "d" / "page.json").unlink()
    refused(run(capsys, "report", "d"), 1, "No such file")


# What is refused ----------------------------------------------------------------------------------


def refused(told: Run, code: int, *words: str) -> None:
    assert told.code == code
    assert told.out == ""
    assert len(told.err.strip().splitlines()) == 1
    for w in words:
        assert w in told.err


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("log.csv --model oe-000000", 2, ("no model 'oe-000000'",)),
        ("missing.csv", 2, ("missing.csv: file not found",)),
        ("silent.csv", 1, ("output",)),
        ("log.csv --val log.csv", 2, ("must differ from the estimation log", "omit --val")),
        ("log.csv --plant plant", 2, ("--plant", "--mission")),
        ("log.csv --mission none.yaml", 2, ("none.yaml",)),
        ("log.csv -o log.csv", 2, ("is a file",)),
        ("index.html -o .", 2, ("could overwrite",)),
        ("log.csv --nope", 2, ("sysid diagnose --help",)),
    ],
)
def test_refusals(
    line: str, code: int, words: tuple[str, ...], here: Path, capsys: Capture
) -> None:
    write_log(here / "silent.csv", ["pwm_l", "pwm_r"], np.ones((2, 50)))
    dead_zone_log(here / "index.html")
    before = contents(here)
    refused(run(capsys, "diagnose", *line.split()), code, *words)
    assert contents(here) == before


def test_logs_of_different_channels_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    dead_zone_log(Path("log.csv"))
    write_log(Path("single.csv"), ["u", "y"], np.random.default_rng(1).normal(size=(2, 90)))
    refused(run(capsys, "diagnose", "log.csv", "--val", "single.csv"), 1, "single.csv has u -> y")


def test_a_model_of_other_channels_is_refused(
    here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = write_log(here / "single.csv", ["u", "y"], np.random.default_rng(1).normal(size=(2, 90)))
    line = ("fit", one, "--structure", "arx", "--orders", "na=1 nb=1 nk=1", "--json")
    other = run(capsys, *line).document["model"]
    refused(run(capsys, "diagnose", "log.csv", "--model", other), 1, "u", "y", "pwm_l")
    slow = robot_log(here / "slow.csv")  # another sample time
    line = ("fit", slow, "--structure", "arx", "--orders", "na=1 nb=1 nk=1", "--json")
    other = run(capsys, *line).document["model"]
    refused(run(capsys, "diagnose", "log.csv", "--model", other), 1, "0.1 s", "0.05 s")


@pytest.mark.slow
def test_empty_readings_are_dropouts(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for seed, name in ((1, "log.csv"), (2, "val.csv")):
        rng = np.random.default_rng(seed)
        drive = np.repeat(rng.uniform(-0.9, 0.9, (40, 2)), 20, axis=0)
        y = np.zeros_like(drive)
        for k in range(1, len(y)):
            y[k] = 0.8 * y[k - 1] + 0.2 * 20.0 * drive[k - 1]
        y += rng.normal(0.0, 0.1, y.shape)
        rows = ["t,pwm_l,pwm_r,omega_l,omega_r"]
        for k, (d, w) in enumerate(zip(drive, y, strict=True)):
            left = "" if k % 37 == 9 else f"{w[0]:.4f}"
            rows.append(f"{0.05 * k:.2f},{d[0] * 20000:.0f},{d[1] * 20000:.0f},{left},{w[1]:.4f}")
        Path(name).write_text("\n".join(rows) + "\n", encoding="utf-8")
    found = run(capsys, "diagnose", "log.csv", "--val", "val.csv", "--json").document
    assert [e["id"] for e in found["effects"]] == ["dropouts"]
    assert found["effects"][0]["channels"] == ["omega_l"]
    # one in 37 is 2.7 %, and no other reading counts as lost
    assert found["effects"][0]["parameters"][0]["value"] == pytest.approx(1 / 37, rel=0.1)
    told = run(capsys, "diagnose", "log.csv", "--val", "val.csv", "--full").out
    assert "Nothing: the model stays as it is" in told
    refused(run(capsys, "diagnose", "log.csv", "--resample", "refuse"), 1, "empty")
