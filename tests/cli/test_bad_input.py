"""Whatever is wrong with the input: one sentence, the right exit code, and nothing harmed."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from bad_input_cases import assert_one_sentence
from command_line import Capture, contents, robot_log, robot_signals, run, write_log
from sysid_cli.app import main

ROWS = "\n".join(f"{k * 0.1:.1f},{(k * 7) % 5},{(k * 3) % 11}" for k in range(40)) + "\n"
"""A log's body: t, u, y."""


@dataclass(frozen=True)
class Bench:
    """A folder with good logs and a workspace that no failing command may touch."""

    root: Path

    @property
    def workspace(self) -> Path:
        """Holds an arx and an oe model and an exported plant."""
        return self.root / "good"

    def path(self, name: str) -> Path:
        """A file or folder of the bench."""
        return self.root / name


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    root = tmp_path_factory.mktemp("bench")
    robot_log(root / "robot.csv")
    robot_log(root / "other.csv", seed=2)
    signals = robot_signals()
    write_log(root / "slow.csv", list(signals), list(signals.values()), step=0.2)
    write_log(root / "one.csv", ["pwm_l", "omega_l"], [signals["pwm_l"], signals["omega_l"]])
    (root / "plain_file").write_text("not a folder")
    for name, text in FILES.items():
        (root / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    pd.DataFrame({"u": ["a", "b"] * 20, "y": np.arange(40.0)}).to_parquet(root / "text.parquet")
    few = pd.DataFrame({"t": [0.0, 0.1, 0.2], "u": [0.0, 1.0, 0.0], "y": [0.0, 0.0, 1.0]})
    few.set_index(pd.Index([5, 6, 7], name="y")).to_parquet(root / "index_named.parquet")
    good = root / "good"
    fit = ["fit", str(root / "robot.csv"), "--workspace", str(good), "--structure"]
    assert main([*fit, "arx", "--orders", "na=1 nb=1"]) == 0
    assert main([*fit, "oe", "--orders", "nb=1 nf=1"]) == 0
    assert main([*fit, "arx", "--orders", "na=2 nb=1"]) == 0
    assert main(["export", "--workspace", str(good)]) == 0
    for name, damage in DAMAGE.items():
        shutil.copytree(good, root / name)
        damage(root / name)
    return Bench(root)


def _models(workspace: Path) -> list[Path]:
    """All of them: one that can be read would be compared."""
    return sorted((workspace / "models").glob("*.json"))


def _overwrite_models(workspace: Path, text: str) -> None:
    for file in _models(workspace):
        file.write_text(text)


def _edit_plant(key: str, value: object) -> Callable[[Path], None]:
    def edit(workspace: Path) -> None:
        file = workspace / "plant" / "plant.json"
        content = json.loads(file.read_text())
        content[key] = value
        file.write_text(json.dumps(content))

    return edit


def _edit_model(workspace: Path) -> None:
    for file in _models(workspace):
        content = json.loads(file.read_text())
        del content["model"]["sample_time"]
        file.write_text(json.dumps(content))


DAMAGE: dict[str, Callable[[Path], None]] = {
    "model_no_json": lambda w: _overwrite_models(w, "{"),
    "model_no_model": lambda w: _overwrite_models(w, "[]"),
    "model_no_time": _edit_model,
    "index_damaged": lambda w: (w / "index.json").write_text('{"a": 1}'),
    "state_damaged": lambda w: (w / "state.json").write_text("[1, 2]"),
    "plant_no_json": lambda w: (w / "plant" / "plant.json").write_text("no json"),
    "plant_gone": lambda w: (w / "plant" / "plant.json").unlink(),
    "plant_schema": _edit_plant("schema", "other/9"),
    "plant_time": _edit_plant("sample_time", "soon"),
    "plant_list": lambda w: (w / "plant" / "plant.json").write_text("[]"),
}
"""Workspace → what was done to it."""

HEAD = "t,u,y\n"

FILES: dict[str, str | bytes] = {
    "good.yaml": "goal: [1, 0]\n",
    "only_time.csv": "t,index\n0,1\n1,2\n2,3\n",
    "text.csv": HEAD + ROWS.replace("0.5,0,4\n", "0.5,oops,4\n"),
    "text_robot.csv": "t,pwm_l,pwm_r,omega_l,omega_r\n"
    + "\n".join(f"{r},{r[4:]}" for r in ROWS.replace("0.5,0,4", "0.5,oops,4").split()),
    "mostly_holes.csv": HEAD + "".join(f"{k},,{k % 3}\n" for k in range(40)),
    "epoch.csv": HEAD + "".join(f"{1.7e12 + 100 * k:.0f},{k % 5},{k % 7}\n" for k in range(40)),
    "constant_input.csv": HEAD + "".join(f"{k},5,{k % 7}\n" for k in range(40)),
    "constant_output.csv": HEAD + "".join(f"{k},{k % 5},3\n" for k in range(40)),
    "short.csv": HEAD + ROWS[:40].rsplit("\n", 1)[0] + "\n",
    "far_date.csv": "time,u,y\n"
    + "".join(f"2024-01-01 00:00:{k:02d},{k % 3},{k % 5}\n" for k in range(40))
    + "9999-12-31 23:59:59,1,2\n",
    "zeros.csv": b"t,u,y\n0,1\x00,2\n",
    "old.xls": b"\xd0\xcf\x11\xe0" + bytes(60),
    "goal_missing.yaml": "start: [0, 0, 0]\n",
    "timeout.yaml": "goal: [1, 0]\ntimeout: soon\n",
    "broken.zip": b"PK\x03\x04" + bytes(60),
}


@dataclass(frozen=True)
class Case:
    """One wrong thing.

    Attributes:
        line: the command line; ``{x}`` stands for the path of x on the bench.
        code: exit code it deserves.
        named: what the sentence must name.
    """

    line: str
    code: int
    named: str


def _log(name: str, named: str, *more: str) -> Case:
    return Case(" ".join(["fit {" + name + "}", *more]), 1, named)


def _fit(options: str, named: str, code: int = 2) -> Case:
    return Case("fit {robot.csv} " + options, code, named)


def _mission(name: str, named: str) -> Case:
    return Case("simulate {" + name + "}", 1, named)


def _broken(workspace: str, command: str, named: str) -> Case:
    return Case(command + " --workspace {" + workspace + "}", 1, named)


ARX = "--structure arx --orders 'na=1 nb=1'"

CASES = (
    # logs: one of each way to end; what else may be wrong in a file stands in test_data_io_broken
    _log("only_time.csv", "only_time.csv"),
    _log("text.csv", "line 7, column u: 'oops'", "--strict"),
    _log("mostly_holes.csv", "column u"),
    Case("fit {epoch.csv} --unit t=rpm", 2, "t=rpm is not a unit of time"),
    _log("constant_input.csv", "input u never changes"),
    _log("constant_output.csv", "output y never changes"),
    _log("short.csv", "samples"),
    _log("zeros.csv", "zeros.csv"),
    _log("old.xls", "Excel"),
    _log("text.parquet", "column u: 'a'"),
    Case("fit {missing.csv}", 2, "missing.csv"),
    Case("fit", 2, "LOG"),
    Case("fit {robot.csv} {one.csv}", 1, "one.csv"),
    Case("inspect {text.csv} --strict", 1, "line 7, column u: 'oops'"),
    # options of fit; those of reading stand in test_cli_base, malformed orders in test_structures
    _fit("--structure arxx", "'arxx'"),
    _fit("--structure arx --orders 'na=1:99999999999 nb=1'", "up to 200"),
    _fit("--pwm-max 1e-300", "--pwm-max must be a positive number"),
    Case(f"fit {'n' * 300}.csv", 1, "File name too long"),
    Case(f"models --workspace {'n' * 300}", 1, "File name too long"),
    _log("index_named.parquet", "samples"),
    Case("fit {far_date.csv} --resample fill", 1, "split it at the gaps"),
    _fit("--structure arx --orders na=x", "'na=x'"),
    _fit("--structure arx --orders 'na=1 na=1:2 nb=1'", "na is given twice"),
    _fit("--structure arx --orders ''", "--orders is empty"),
    _fit("--structure arx --orders 'na=1 nz=1'", "'nz'"),
    _fit("--structure arx --orders 'na=4:1 nb=1'", "na=4:1"),
    _fit("--structure arx --orders 'na=1:90 nb=1:90'", "8100"),
    _fit("--structure arx,oe --orders 'nb=1 nk=1'", "--orders"),
    _fit("--orders 'na=1 nb=1'", "--structure"),
    _fit("--structure arx --orders 'na=150 nb=150'", "record", 1),
    _fit(f"{ARX} --split 1.5", "--split"),
    _fit(f"{ARX} --split 0", "--split"),
    _fit(f"{ARX} --split nan", "--split"),
    _fit(f"{ARX} --split half", "--split"),
    _fit(f"{ARX} --split 0.7 --val {{other.csv}}", "--val"),
    _fit(f"{ARX} --val {{one.csv}}", "one.csv", 1),
    _fit(f"{ARX} --val {{missing.csv}}", "missing.csv"),
    _fit(f"{ARX} --focus both", "'both'"),
    _fit(f"{ARX} --criterion best", "'best'"),
    _fit(f"{ARX} --detrend some", "'some'"),
    _fit(f"{ARX} --initial odd", "'odd'"),
    _fit(f"{ARX} --fix a1", "'a1'"),
    _fit(f"{ARX} --fix a1=x", "'a1=x'"),
    _fit(f"{ARX} --fix a1[omega_l,omega_l]=inf", "=inf'"),
    _fit(f"{ARX} --fix zz=1", "'zz'"),
    _fit(f"{ARX} --bound b1=0", "'b1=0'"),
    _fit(f"{ARX} --bound a1[omega_l,omega_l]=1:0", "a1[omega_l,omega_l]"),
    _fit(
        f"{ARX} --bound a1[omega_l,omega_l]=0:1 --fix a1[omega_l,omega_l]=5", "a1[omega_l,omega_l]"
    ),
    _fit(f"{ARX} --skip -1", "--skip"),
    _fit(f"{ARX} --skip few", "--skip"),
    _fit(f"{ARX} --skip 4000", "--skip"),
    _fit(f"{ARX} --horizon 1", "--horizon"),
    _fit(f"{ARX} --jobs 0", "--jobs"),
    _fit(f"{ARX} --workspace {{plain_file}}", "plain_file"),
    _fit(f"{ARX} --fast", "--fast"),
    Case("fti {robot.csv}", 2, "fti"),
    # compare, and what is damaged in a workspace; other commands stand in test_cli_base
    Case("compare nothing", 2, "'nothing'"),
    Case("compare arx", 2, "arx-"),
    Case("compare --criterion nice", 2, "'nice'"),
    Case("compare --val {missing.csv}", 2, "missing.csv"),
    Case("compare --val {one.csv}", 1, "one.csv"),
    Case("compare --val {slow.csv}", 1, "slow.csv"),
    Case("compare --workspace {nowhere}", 1, "sysid fit"),
    _broken("model_no_json", "compare", "arx-"),
    _broken("model_no_model", "compare", "arx-"),
    _broken("model_no_time", "compare", "arx-"),
    _broken("index_damaged", "compare", "index.json"),
    _broken("state_damaged", "export", "state.json"),
    # missions, one of each way to end (others: test_mission_spec), and plants
    _mission("goal_missing.yaml", "goal"),
    _mission("timeout.yaml", "timeout"),
    _mission("text_robot.csv", "line 7"),
    Case("simulate {good.yaml} --plant {broken.zip}", 1, "broken.zip"),
    Case("simulate {good.yaml} --plot path.bmp", 2, "path.bmp"),
    _broken("plant_no_json", "simulate {good.yaml}", "plant.json"),
    _broken("plant_gone", "simulate {good.yaml}", "plant"),
    _broken("plant_schema", "simulate {good.yaml}", "other/9"),
    _broken("plant_time", "simulate {good.yaml}", "plant"),
    _broken("plant_list", "simulate {good.yaml}", "plant"),
)


def _arguments(line: str, bench: Bench) -> list[str]:
    parts = re.findall(r"'([^']*)'|(\S+)", line)
    words = [quoted if quoted or not plain else plain for quoted, plain in parts]
    words = [re.sub(r"\{(.*?)\}", lambda m: str(bench.path(m[1])), w) for w in words]
    if "--workspace" not in words and words[0] in ("fit", "compare", "export", "simulate"):
        words += ["--workspace", str(bench.workspace)]
    return words


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda c: re.sub(r"[^\w.=-]+", " ", c.line).strip())
def test_bad_input_is_one_sentence_and_leaves_everything_as_it_was(
    case: Case, bench: Bench, capsys: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    before = contents(bench.root)
    result = run(capsys, *_arguments(case.line, bench))
    assert result.code == case.code, result.err
    assert_one_sentence(result.err, case.line)
    assert case.named in result.err, f"{case.named} is not named in: {result.err}"
    assert result.out == "", "a command that fails prints no result"
    assert contents(bench.root) == before
    assert contents(tmp_path) == {}


def test_the_table_is_as_long_as_promised() -> None:
    assert len(CASES) >= 60
    assert len({c.line for c in CASES}) == len(CASES)
