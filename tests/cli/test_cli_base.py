"""The command line: one sentence for every wrong use, one JSON document, quick help."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from plant_models import bench_model, robot_model, robot_record
from sysid_cli import app

from sysid.data import documents
from sysid.workspace.store import Workspace

NUMERIC = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "joblib", "yaml")
COMMANDS = (
    "inspect",
    "excite",
    "structures",
    "fit",
    "compare",
    "models",
    "export",
    "simulate",
    "diagnose",
)
MISSION = "goal: [1, 0]\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a log, a mission, a workspace with a model, and its exported plant."""
    monkeypatch.chdir(tmp_path)
    record = robot_record(300)
    header = "t,pwm_l,pwm_r,omega_l,omega_r"
    rows = np.column_stack([record.t, record.u, record.y])
    lines = [header, *(",".join(f"{v:.9g}" for v in row) for row in rows)]
    Path("log.csv").write_text("\n".join(lines) + "\n")
    dead = np.column_stack([record.t, record.u, record.y * [0, 1]])
    lines = [header, *(",".join(f"{v:.9g}" for v in row) for row in dead)]
    Path("constant.csv").write_text("\n".join(lines) + "\n")
    Path("mission.yaml").write_text(MISSION)
    Path("bad.yaml").write_text("goal: [1, 0]\nfuel: 3\n")
    Path("empty").mkdir()
    Path("bin.csv").write_bytes(bytes(range(256)))
    (tmp_path / "damaged" / "models").mkdir(parents=True)
    (tmp_path / "damaged" / "models" / "arx-000000.json").write_text("{")
    place = Workspace(Path(".sysid"))
    report = {"estimation": {"fit_percent": {"omega_l": 98.5, "omega_r": 98.25}}}
    place.remember("latest", [place.save(robot_model("oe"), report).id])
    from sysid.export.package import write_package

    write_package(robot_model("oe"), place.plant_dir)
    return tmp_path


def ask(capsys: pytest.CaptureFixture[str], argv: Sequence[str]) -> tuple[int, str, str]:
    code = app.main(list(argv))
    out, err = capsys.readouterr()
    return code, out, err


def answer(capsys: pytest.CaptureFixture[str], *argv: str, code: int = 0) -> dict[str, object]:
    """The JSON document of a command that prints nothing else on stdout."""
    got, out, err = ask(capsys, [*argv, "--json"])
    assert got == code, err

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    document = json.loads(out, parse_constant=refuse)
    assert isinstance(document, dict)
    return document


# Wrong use ----------------------------------------------------------------------------------------

WRONG: dict[str, tuple[str, int, str]] = {
    "unknown command": ("frobnicate", 2, "No such command 'frobnicate'"),
    "a near miss": ("exprt", 2, "Did you mean 'export'?"),
    "unknown root option": ("--nope", 2, "No such option: --nope; see `sysid --help`"),
    "option of no command": ("models --nope", 2, "see `sysid models --help`"),
    "option without value": ("export --model", 2, "requires an argument"),
    "inspect without log": ("inspect", 2, "Missing argument"),
    "inspect no such log": ("inspect nolog.csv", 2, "there is no file nolog.csv"),
    "inspect a near miss": ("inspect lag.csv", 2, "did you mean log.csv"),
    "inspect a folder": ("inspect empty", 2, "is a folder"),
    "inspect a binary": ("inspect bin.csv", 1, "bin.csv"),
    "inspect unknown input": ("inspect log.csv --input u", 2, "--input asks for 'u'"),
    "inspect empty input": ("inspect log.csv --input ''", 2, "an empty name"),
    "inspect unknown time": ("inspect log.csv --time when", 2, "--time asks for 'when'"),
    "inspect ts text": ("inspect log.csv --ts soon", 2, "--ts"),
    "inspect ts negative": ("inspect log.csv --ts -1", 2, "--ts must be a positive"),
    "inspect ts nan": ("inspect log.csv --ts nan", 2, "--ts must be a positive"),
    "inspect unit form": ("inspect log.csv --unit rpm", 2, "--unit cannot read 'rpm'"),
    "inspect unit unknown": ("inspect log.csv --unit omega_l=furlong", 2, "unknown unit"),
    "inspect unit nobody": ("inspect log.csv --unit q=rpm", 2, "--unit names 'q'"),
    "inspect unit twice": (
        "inspect log.csv --unit omega_l=rpm --unit omega_l=rad/s",
        2,
        "--unit names omega_l twice",
    ),
    "inspect pwm-max zero": ("inspect log.csv --pwm-max 0", 2, "--pwm-max must be a positive"),
    "inspect delimiter": ("inspect log.csv --delimiter abc", 2, "the delimiter must be"),
    "inspect decimal": ("inspect log.csv --decimal x", 2, "the decimal sign must be"),
    "inspect resample": ("inspect log.csv --resample maybe", 2, "maybe"),
    "inspect order zero": ("inspect log.csv --order 0", 2, "--order"),
    "excite without design": ("excite", 2, "Missing argument"),
    "excite unknown design": ("excite noise", 2, "'noise' is not one of"),
    "excite foreign option": ("excite prbs --levels 3", 2, "has no --levels"),
    "excite too loud": ("excite prbs --amplitude 30000", 2, "exceeds full drive"),
    "excite too short": ("excite steps --duration 0.1", 2, "too short"),
    "excite dt zero": ("excite prbs --dt 0", 2, "sample time must be positive"),
    "excite band falling": ("excite chirp --band 2 1", 2, "must rise"),
    "excite band of one": ("excite chirp --band 2", 2, "--band"),
    "excite negative seed": ("excite prbs --seed -1", 2, "--seed"),
    "excite tracks of one input": (
        "excite prbs --input u --tracks equal",
        2,
        "needs two inputs",
    ),
    "excite independent pulses": ("excite pulses --tracks independent", 2, "is impossible"),
    "excite into a folder": ("excite prbs -o empty", 2, "is a folder"),
    "excite below a file": ("excite prbs -o log.csv/x.csv", 2, "is not a folder"),
    "structures unknown": ("structures magic", 2, "no structure 'magic'"),
    "structures two": ("structures arx oe", 2, "unexpected extra argument"),
    "models unknown action": ("models burn", 2, "'burn' is not one of"),
    "models show what": ("models show", 2, "needs the ID"),
    "models list what": ("models list oe", 2, "takes no ID"),
    "models show unknown": ("models show bj", 2, "no model 'bj'"),
    "models remove unknown": ("models remove bj", 2, "no model 'bj'"),
    "models outside": ("models show ../../etc/passwd", 2, "no model"),
    "models workspace file": ("models --workspace log.csv", 2, "is a file"),
    "models damaged": ("models --workspace damaged", 1, "arx-000000.json is damaged"),
    "root workspace file": ("--workspace log.csv models", 2, "is a file"),
    "export nothing": ("export --workspace none", 1, "run `sysid fit` first"),
    "export unknown": ("export --model bj", 2, "no model 'bj'"),
    "export onto a log": ("export -o log.csv", 2, "is a file"),
    "export here": ("export -o .", 2, "where you are"),
    "export over others": ("export -o damaged", 2, "not a plant package's"),
    "export over a zip": ("export -o other.zip", 2, "no plant package"),
    "simulate without mission": ("simulate", 2, "Missing argument"),
    "simulate without plant": (
        "simulate mission.yaml --workspace none",
        1,
        "run `sysid export` first",
    ),
    "simulate no such plant": ("simulate mission.yaml --plant nowhere", 1, "no plant package"),
    "simulate wrong plant": ("simulate mission.yaml --plant log.csv", 1, "nor an intact zip"),
    "simulate empty plant": ("simulate mission.yaml --plant empty", 1, "has no plant.json"),
    "simulate no such mission": ("simulate no.yaml", 1, "there is no file no.yaml"),
    "simulate unknown key": ("simulate bad.yaml", 1, "bad.yaml:2"),
    "simulate no such log": ("simulate no.csv", 2, "there is no file no.csv"),
    "simulate plot format": ("simulate mission.yaml --plot x.docx", 2, ".svg or .png"),
    "simulate log at a folder": ("simulate mission.yaml --log empty", 1, "empty"),
    "simulate log below a file": ("simulate mission.yaml --log log.csv/x.csv", 1, "log.csv"),
    "simulate onto itself": ("simulate log.csv --log log.csv", 2, "would overwrite"),
    "simulate onto the mission": (
        "simulate mission.yaml --log ./mission.yaml",
        2,
        "would overwrite",
    ),
    "simulate foreign log": ("simulate bench.csv", 2, "pwm_l"),
    "simulate other rate": ("simulate slow.csv", 1, "sampled every 0.2 s"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_use_ends_in_one_sentence(
    here: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    line, code, words = WRONG[kind]
    Path("other.zip").write_text("mine")
    Path("bench.csv").write_text("t,u,y\n" + "".join(f"{k / 10},{k % 3},{k}\n" for k in range(50)))
    slow = Path("log.csv").read_text().splitlines()
    Path("slow.csv").write_text("\n".join(slow[:1] + slow[1::2]) + "\n")
    before = {p: p.read_bytes() for p in Path(".sysid").rglob("*") if p.is_file()}
    argv = [part.replace("''", "") for part in line.split()]
    as_json = [argv[0], "--json", *argv[1:]] if argv[0] in COMMANDS else argv
    for asked in (argv, as_json):
        got, out, err = ask(capsys, asked)
        assert (got, out) == (code, "")
        assert words in err
        assert err.count("\n") == 1
        assert "Traceback" not in err
        assert len(err) < 700
    assert {p: p.read_bytes() for p in Path(".sysid").rglob("*") if p.is_file()} == before


@pytest.mark.parametrize("line", ["frobnicate", "inspect nolog.csv", "models --workspace damaged"])
def test_the_installed_command_fails_like_main(here: Path, line: str) -> None:
    command = [sys.executable, "-m", "sysid_cli.app", *line.split()]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode in (1, 2)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1


# The boundary -------------------------------------------------------------------------------------


def broken(*_: object, **__: object) -> None:
    raise ZeroDivisionError("two\nlines")


def test_the_unexpected_is_one_sentence_and_debug_shows_where(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Workspace, "all", broken)
    code, out, err = ask(capsys, ["models"])
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "ZeroDivisionError: two lines" in err
    assert "--debug" in err
    for argv in (["--debug", "models"], ["models", "--debug"]):
        code, out, err = ask(capsys, argv)
        assert code == 1
        assert "Traceback" in err
        assert "in broken" in err


def test_an_interrupt_ends_with_130(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Workspace, "all", interrupted)
    for argv in (["models"], ["--workspace", ".sysid", "models"]):
        code, out, err = ask(capsys, argv)
        assert code == 130
        assert out == ""
        assert "Traceback" not in err


def test_a_closed_pipe_is_quiet(here: Path) -> None:
    command = [sys.executable, "-m", "sysid_cli.app", "models", "show", "oe", "--json"]
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as gone:
        done = subprocess.run(command, stdout=gone, stderr=subprocess.PIPE, text=True, check=False)
    assert done.stderr == ""
    assert done.returncode in (0, 1)


def test_names_that_the_terminal_cannot_show_do_no_harm(here: Path) -> None:
    Path(".sysid").rename("grün µ")
    environment = dict(os.environ) | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    command = [sys.executable, "-m", "sysid_cli.app", "models", "--workspace", "grün µ"]
    for extra in (["show", "bj"], ["--json"]):
        done = subprocess.run([*command, *extra], capture_output=True, env=environment, check=False)
        assert b"Traceback" not in done.stderr
        (done.stdout + done.stderr).decode("ascii")
    assert json.loads(done.stdout)["models"][0]["path"].startswith("grün µ")


def test_threads_are_capped_unless_the_user_says_otherwise() -> None:
    code = (
        "import os, sys; from sysid_cli import app; app.main(['--help']); "
        "print(*(os.environ[n] for n in app._THREADS), file=sys.stderr)"
    )
    for given, seen in (({}, "1 1 1"), ({"OMP_NUM_THREADS": "2"}, "1 2 1")):
        plain = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=plain | given,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stderr.split("\n")[-2] == seen


@pytest.mark.parametrize("line", ["--help", "fit --help", "compare -h", "simulate --help", ""])
def test_help_imports_no_numeric_library(line: str) -> None:
    code = (
        f"import sys; from sysid_cli import app; code = app.main({line.split()!r}); "
        f"print([m for m in {NUMERIC!r} if m in sys.modules], file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "[]\n")
    assert "Usage: sysid" in done.stdout


def test_every_command_is_in_the_help_with_json(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = ask(capsys, ["--help"])
    for command in COMMANDS:
        assert f" {command} " in out
        code, page, _ = ask(capsys, [command, "--help"])
        assert code == 0
        assert "--json" in page


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    from sysid import __version__

    assert ask(capsys, ["--version"]) == (0, f"sysid {__version__}\n", "")


# What the commands say ----------------------------------------------------------------------------


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
    assert "cannot serve" in out


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
    shown = answer(capsys, "models", "show", "oe")
    assert shown["parameters"][0]["name"] == "b1[omega_l,pwm_l]"  # type: ignore[index]
    best = Workspace(Path(".sysid")).chosen(None).id
    assert answer(capsys, "models", "show", "best")["model"] == best
    code, out, _ = ask(capsys, ["models", "show", "oe"])
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
    assert answer(capsys, "export", "--model", "arx", "-o", "p.zip")["model"] == arx
    result = answer(capsys, "simulate", "mission.yaml", "--plant", "p.zip", "--log", "a/b.csv")
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


@pytest.mark.parametrize("line", ["fit log.csv", "compare", "simulate log.csv"])
def test_a_picture_never_makes_folders(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = ask(capsys, [*line.split(), "--plot", "new/folder/p.png"])
    assert (code, out) == (2, "")
    assert "the folder new/folder does not exist" in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
