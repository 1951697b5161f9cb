"""What each command says of a small log: readable text, and one JSON document."""

from pathlib import Path

import numpy as np
import pytest
from cli_answers import answer, ask
from plant_models import bench_model, robot_model

from sysid.data import documents
from sysid.workspace.store import Workspace

MISSION = "goal: [1, 0]\n"


def test_inspect(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = answer(capsys, "inspect", "log.csv", "log.csv")
    assert [r["name"] for r in found["records"]] == ["log.csv"] * 2  # type: ignore[attr-defined]
    first = found["records"][0]  # type: ignore[index]
    assert (first["samples"], first["sample_time_s"]) == (300, pytest.approx(0.1))
    assert [c["name"] for c in first["channels"]] == ["pwm_l", "pwm_r", "omega_l", "omega_r"]
    assert first["channels"][0]["unit"] == "µs"
    assert first["channels"][0]["max"] == 12000
    assert found["verdict"] in ("ok", "note", "warning")
    assert {"code", "severity", "sentence", "advice"} <= set(found["findings"][0])  # type: ignore[index]
    code, out, _ = ask(capsys, ["inspect", "log.csv"])
    assert code == 0
    assert "300 samples, one every 0.1 s, 30 s in all" in out


def test_inspect_of_a_constant_output_is_fatal(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = answer(capsys, "inspect", "constant.csv", code=1)
    assert found["verdict"] == "fatal"
    assert any("omega_l" in f["sentence"] for f in found["findings"] if f["severity"] == "fatal")  # type: ignore[attr-defined]
    code, out, _ = ask(capsys, ["inspect", "constant.csv"])
    assert code == 1
    assert "not usable" in out


def test_inspect_converts_units(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = answer(
        capsys, "inspect", "log.csv", "--unit", "omega_l=rpm,omega_r=rpm", "--pwm-max", "12000"
    )
    channels = found["records"][0]["channels"]  # type: ignore[index]
    assert channels[0]["max"] == pytest.approx(20000)
    assert channels[2]["file_unit"] == "rpm"
    assert channels[2]["scale"] == pytest.approx(2 * np.pi / 60)


@pytest.mark.parametrize("design", ["prbs", "multisine", "chirp", "steps", "pulses"])
def test_excite_writes_a_schedule(
    here: Path, capsys: pytest.CaptureFixture[str], design: str
) -> None:
    facts = answer(capsys, "excite", design)
    path = Path(str(facts["schedule"]))
    assert path.name == f"schedule_{design}.csv"
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    assert path.read_text().startswith("t,pwm_l,pwm_r\n")
    assert len(rows) == facts["samples"]
    assert np.max(np.abs(rows[:, 1:])) <= 20000
    code, out, _ = ask(capsys, ["excite", design, "-o", "again.csv"])
    assert code == 0
    assert Path("again.csv").read_bytes() == path.read_bytes()
    assert "Written to again.csv" in out


@pytest.mark.parametrize(("tracks", "sign"), [("equal", 1), ("opposite", -1)])
@pytest.mark.parametrize("design", ["prbs", "pulses"])
def test_excite_ties_the_tracks(
    here: Path, capsys: pytest.CaptureFixture[str], design: str, tracks: str, sign: int
) -> None:
    answer(capsys, "excite", design, "--tracks", tracks, "-o", "s.csv")
    rows = np.loadtxt("s.csv", delimiter=",", skiprows=1)
    assert np.any(rows[:, 2])
    np.testing.assert_array_equal(rows[:, 1], sign * rows[:, 2])
    assert "-0," not in Path("s.csv").read_text()


def test_structures(capsys: pytest.CaptureFixture[str]) -> None:
    known = answer(capsys, "structures")["structures"]
    assert {"arx", "armax", "oe", "bj"} <= {s["name"] for s in known}  # type: ignore[attr-defined]
    arx = answer(capsys, "structures", "ARX")
    assert arx["equation"] == "A(q) y(t) = B(q) u(t) + e(t)"
    assert [o["name"] for o in arx["orders"]] == ["na", "nb", "nk"]  # type: ignore[attr-defined]
    code, out, _ = ask(capsys, ["structures", "bj"])
    assert code == 0
    assert '--orders "nb=2 nc=2 nd=2 nf=2 nk=1"' in out
    code, out, _ = ask(capsys, ["structures"])
    assert code == 0
    assert "A(q) y(t)" in out


def test_models(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = Workspace(Path(".sysid")).save(bench_model("arx"), {}).id
    listed = answer(capsys, "models")["models"]
    oe, arx = listed  # type: ignore[misc]
    assert (oe["structure"], arx["model"]) == ("oe", other)
    assert oe["fit_percent"] == {"omega_l": 98.5, "omega_r": 98.25}
    shown = answer(capsys, "show", "oe")
    assert shown["parameters"][0]["name"] == "b1[omega_l,pwm_l]"  # type: ignore[index]
    best = Workspace(Path(".sysid")).chosen(None).id
    assert answer(capsys, "show", "best")["model"] == best
    code, out, _ = ask(capsys, ["show", "oe"])
    assert code == 0
    assert "b1[omega_l,pwm_l]" in out  # brackets are no markup
    assert answer(capsys, "models", "remove", "arx") == {"removed": other}
    code, out, _ = ask(capsys, ["models", "list"])
    assert code == 0
    assert other not in out
    assert "98.5, 98.25" in out


def test_the_workspace_can_be_named_before_or_after_the_command(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path(".sysid").rename("elsewhere")
    before = answer(capsys, "--workspace", "elsewhere", "models")
    after = answer(capsys, "models", "--workspace", "elsewhere")
    assert before == after
    assert len(after["models"]) == 1  # type: ignore[arg-type]
    both = answer(capsys, "--workspace", "nowhere", "models", "--workspace", "elsewhere")
    assert both == after
    assert not Path("nowhere").exists()


def test_export_and_simulate_in_a_row(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exported = answer(capsys, "export")
    assert exported["plant"] == str(Path(".sysid/plant"))
    assert exported["model"] == Workspace(Path(".sysid")).chosen(None).id
    there = {str(p.relative_to(".sysid/plant")) for p in Path(".sysid/plant").rglob("*")}
    assert {f for f in there if Path(".sysid/plant", f).is_file()} == set(exported["files"])  # type: ignore[call-overload]
    assert exported["selftest"]["max_error"] < 1e-10  # type: ignore[index]
    result = answer(capsys, "simulate", "mission.yaml", "--plot", "path.svg")
    assert result["outcome"] == "arrived"
    assert set(result["final"]) == {"x", "y", "psi"}  # type: ignore[call-overload]
    assert result["min_clearance_m"] is None
    assert result["path_length_m"] > 0.8  # type: ignore[operator]
    assert {"time_s", "max_deviation_m", "warnings"} <= set(result)
    log = Path(str(result["log"]))
    assert log == Path(".sysid/missions/mission.csv")
    assert log.read_text().startswith("t,pwm_l,pwm_r,omega_l,omega_r,x,y,psi,")
    assert Path("path.svg").read_text().startswith("<?xml")
    assert answer(capsys, "inspect", str(log))["records"]  # a log like any other


def test_export_to_a_zip_of_a_chosen_model(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arx = Workspace(Path(".sysid")).save(robot_model("arx"), {}).id
    for model in (("arx",), ("--model", "arx"), ("arx", "-m", "arx")):
        assert answer(capsys, "export", *model, "-o", "p.zip")["model"] == arx
    code, _, said = ask(capsys, ["export", "arx", "-m", "oe", "-o", "p.zip"])
    assert (code, "give one of them" in said) == (2, True)
    result = answer(capsys, "simulate", "mission.yaml", "--plant", "p.zip", "-o", "a/b.csv")
    assert result["outcome"] == "arrived"
    assert Path("a/b.csv").exists()
    code, out, _ = ask(capsys, ["export", "-o", "folder"])
    assert code == 0
    assert "Self-test" in out
    code, out, _ = ask(capsys, ["simulate", "mission.yaml", "--plant", "folder"])
    assert code == 0
    assert "arrived" in out
    assert "Log: " in out


def test_simulate_replays_a_log(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = answer(capsys, "simulate", "log.csv", "--plot", "fit.svg")
    # the record is the first half of the one the model was fitted to; noise σ = 0.05
    assert all(f > 98 for f in result["fit_percent"].values())  # type: ignore[attr-defined]
    assert result["rmse"] == {  # type: ignore[comparison-overlap]
        "omega_l": pytest.approx(0.05, rel=0.2),
        "omega_r": pytest.approx(0.05, rel=0.2),
    }
    assert result["initial_state"] == "rest"
    table = Path(str(result["log"])).read_text().splitlines()
    assert table[0] == "t,pwm_l,pwm_r,omega_l,omega_r,omega_l_sim,omega_r_sim"
    assert len(table) == 301
    assert answer(capsys, "inspect", str(result["log"]))["records"]
    timeless = "\n".join(line.partition(",")[2] for line in Path("log.csv").read_text().split())
    Path("timeless.csv").write_text(timeless + "\n")  # the plant's sample time is taken
    assert answer(capsys, "simulate", "timeless.csv")["rmse"] == result["rmse"]
    code, out, _ = ask(capsys, ["simulate", "log.csv"])
    assert code == 0
    assert "free run from rest" in out


def test_a_run_outside_the_domain_is_said(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = Path("log.csv").read_text().replace("12000", "18000")
    Path("loud.csv").write_text(text)
    result = answer(capsys, "simulate", "loud.csv")
    assert "pwm_l runs from -18000 to 18000" in result["warnings"][0]  # type: ignore[index]


def test_a_replayed_log_is_brought_to_the_units_of_the_plant(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from dataclasses import replace

    from sysid.export.package import write_package

    model = robot_model("oe")
    inputs = tuple(replace(c, scale=20000 / 255, file_unit="±255") for c in model.inputs)
    outputs = tuple(replace(c, scale=2 * np.pi / 60, file_unit="rpm") for c in model.outputs)
    write_package(replace(model, inputs=inputs, outputs=outputs), "p")
    t, *signals = np.loadtxt("log.csv", delimiter=",", skiprows=1).T
    file = np.column_stack([t, *(s * 255 / 20000 for s in signals[:2]),
                            *(s * 60 / (2 * np.pi) for s in signals[2:])])  # fmt: skip
    header = "t,pwm_l,pwm_r,omega_l,omega_r"
    np.savetxt("raw.csv", file, delimiter=",", header=header, comments="", fmt="%.12g")
    plain = answer(capsys, "simulate", "log.csv")
    raw = answer(capsys, "simulate", "raw.csv", "--plant", "p")
    assert raw["rmse"] == pytest.approx(plain["rmse"], rel=1e-6)  # the CSVs hold 9 digits


def test_documents_hold_plain_values_only() -> None:
    from enum import Enum

    class Kind(Enum):
        A = "a"

    value = {
        "nan": float("nan"),
        "inf": np.float64("inf"),
        "int": np.int64(3),
        "array": np.array([1.0, np.nan]),
        "path": Path("x"),
        "enum": Kind.A,
        "true": np.bool_(True),
        3: (1, None),
    }
    assert documents.plain(value) == {
        "nan": None,
        "inf": None,
        "int": 3,
        "array": [1.0, None],
        "path": "x",
        "enum": "a",
        "true": True,
        "3": [1, None],
    }
    with pytest.raises(TypeError, match="object"):
        documents.plain(object())


@pytest.mark.parametrize("line", ["simulate log.csv", "soil ice"])
def test_a_picture_never_makes_folders(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = ask(capsys, [*line.split(), "--plot", "new/folder/p.png"])
    assert (code, out) == (2, "")
    assert "the folder new/folder does not exist" in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
