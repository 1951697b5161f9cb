"""The command line: one sentence for every wrong use, one JSON document, quick help."""

import importlib.machinery
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli_answers import ask
from sysid_cli import app, start

from sysid.workspace.store import Workspace

NUMERIC = (
    "numpy",
    "scipy",
    "pandas",
    "pyarrow",
    "matplotlib",
    "pydantic",
    "joblib",
    "yaml",
    "sysid.data.record",
)
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


# Wrong use ----------------------------------------------------------------------------------------

WRONG: dict[str, tuple[str, int, str]] = {
    "unknown command": ("frobnicate", 2, "No such command 'frobnicate'"),
    "a near miss": ("exprt", 2, "Did you mean 'export'"),
    "unknown root option": ("--nope", 2, "No such option: --nope; see `sysid --help`"),
    "option of no command": ("models --nope", 2, "see `sysid models --help`"),
    "option without value": ("export --model", 2, "requires an argument"),
    "inspect without log": ("inspect", 2, "Missing argument"),
    "inspect no such log": ("inspect nolog.csv", 2, "nolog.csv: file not found"),
    "inspect a near miss": ("inspect lag.csv", 2, "did you mean log.csv"),
    "inspect a folder": ("inspect empty", 2, "is a folder"),
    "inspect a binary": ("inspect bin.csv", 1, "bin.csv"),
    "inspect unknown input": ("inspect log.csv --input u", 2, "--input names 'u'"),
    "inspect empty input": ("inspect log.csv --input ''", 2, "an empty name"),
    "inspect unknown time": ("inspect log.csv --time when", 2, "--time names 'when'"),
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
    "inspect order zero": ("inspect log.csv --excitation 0", 2, "--excitation"),
    "excite without design": ("excite", 2, "Missing argument"),
    "excite unknown design": ("excite noise", 2, "'noise' is not one of"),
    "excite foreign option": ("excite prbs --levels 3", 2, "has no --levels"),
    "excite too loud": ("excite prbs --amplitude 30000", 2, "exceeds full drive"),
    "excite too short": ("excite steps --duration 0.1", 2, "too short"),
    "excite dt zero": ("excite prbs --ts 0", 2, "sample time must be positive"),
    "excite band falling": ("excite chirp --band 2:1", 2, "must rise"),
    "excite band of one": ("excite chirp --band 2", 2, "--band"),
    "excite negative seed": ("excite prbs --seed -1", 2, "--seed"),
    "excite tracks of one input": (
        "excite prbs --input u --tracks equal",
        2,
        "needs exactly two inputs",
    ),
    "excite independent pulses": ("excite pulses --tracks independent", 2, "is impossible"),
    "excite into a folder": ("excite prbs -o empty", 2, "is a folder"),
    "excite below a file": ("excite prbs -o log.csv/x.csv", 2, "is not a folder"),
    "structures unknown": ("structures magic", 2, "no structure 'magic'"),
    "structures two": ("structures arx oe", 2, "unexpected extra argument"),
    "models unknown action": ("models burn", 2, "'burn' is not one of"),
    "models remove what": ("models remove", 2, "needs the ID"),
    "models list what": ("models list oe", 2, "takes no ID"),
    "show unknown": ("show bj", 2, "no model 'bj'"),
    "models remove unknown": ("models remove bj", 2, "no model 'bj'"),
    "models outside": ("show ../../etc/passwd", 2, "no model"),
    "models workspace file": ("models --workspace log.csv", 2, "is a file"),
    "models damaged": ("models --workspace damaged", 1, "arx-000000.json is damaged"),
    "root workspace file": ("--workspace log.csv models", 2, "is a file"),
    "export nothing": ("export --workspace none", 1, "run `sysid fit` first"),
    "export unknown": ("export --model bj", 2, "no model 'bj'"),
    "export onto a log": ("export -o log.csv", 2, "is a file"),
    "export here": ("export -o .", 2, "is the current folder"),
    "export over others": ("export -o damaged", 2, "not a plant package's"),
    "export over a zip": ("export -o other.zip", 2, "is not a plant package"),
    "simulate without mission": ("simulate", 2, "Missing argument"),
    "simulate without plant": (
        "simulate mission.yaml --workspace none",
        1,
        "run `sysid export` first",
    ),
    "simulate no such plant": ("simulate mission.yaml --plant nowhere", 1, "no plant package"),
    "simulate wrong plant": ("simulate mission.yaml --plant log.csv", 1, "nor an intact zip"),
    "simulate empty plant": ("simulate mission.yaml --plant empty", 1, "has no plant.json"),
    "simulate no such mission": ("simulate no.yaml", 1, "no.yaml: file not found"),
    "simulate unknown key": ("simulate bad.yaml", 1, "bad.yaml:2"),
    "simulate no such log": ("simulate no.csv", 2, "no.csv: file not found"),
    "simulate plot format": ("simulate mission.yaml --plot x.docx", 2, ".svg, .png or .pdf"),
    "simulate log at a folder": ("simulate mission.yaml -o empty", 2, "empty"),
    "simulate log below a file": ("simulate mission.yaml -o log.csv/x.csv", 1, "log.csv"),
    "simulate onto itself": ("simulate log.csv -o log.csv", 2, "would overwrite"),
    "simulate onto the mission": (
        "simulate mission.yaml -o ./mission.yaml",
        2,
        "would overwrite",
    ),
    "simulate foreign log": ("simulate bench.csv", 2, "pwm_l"),
    "simulate other rate": ("simulate slow.csv", 1, "sampled every 0.2 s"),
}


@pytest.mark.slow
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
    command = [sys.executable, "-m", "sysid_cli.start", *line.split()]
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
    monkeypatch.setattr(Workspace, "readable", broken)
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

    monkeypatch.setattr(Workspace, "readable", interrupted)
    for argv in (["models"], ["--workspace", ".sysid", "models"]):
        code, out, err = ask(capsys, argv)
        assert code == 130
        assert out == ""
        assert "Traceback" not in err


@contextmanager
def as_before() -> Iterator[None]:
    """Signals are again what they were, and heard by nobody who would end the tests."""
    known = {s: signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)}
    hook = sys.unraisablehook
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for which, handler in known.items():
            signal.signal(which, handler)


def test_an_interrupt_before_the_command_is_loaded_is_quiet_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "sysid_cli.app")
    monkeypatch.setattr(importlib.machinery.SourceFileLoader, "exec_module", interrupted)
    with as_before():
        assert start.command(start.Ending()) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_a_request_to_end_is_an_interrupt(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:

    def asked(*_: object) -> int:
        signal.raise_signal(signal.SIGTERM)
        return 0

    monkeypatch.setattr(app, "main", asked)
    with as_before():
        assert start.command(start.Ending()) == 130
    assert capsys.readouterr().err == "interrupted\n"


DEAF = """
import os, signal, sys, threading, time, warnings
from sysid_cli import app, start

def deaf():
    warnings.warn("of a library")
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    while True:
        try:
            time.sleep(60.0)
        except KeyboardInterrupt:
            pass

app.main, start.PATIENCE, start.PROMPT = deaf, 0.1, 0.1
start.main()
"""


def test_a_command_that_hears_no_interrupt_ends_all_the_same_and_no_library_warns() -> None:
    """Solvers and compilers that run for minutes hear none."""
    done = subprocess.run(
        [sys.executable, "-c", DEAF], capture_output=True, text=True, check=False, timeout=60.0
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


def test_a_closed_pipe_is_quiet(here: Path) -> None:
    command = [sys.executable, "-m", "sysid_cli.start", "show", "oe", "--json"]
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as gone:
        done = subprocess.run(command, stdout=gone, stderr=subprocess.PIPE, text=True, check=False)
    assert done.stderr == ""
    assert done.returncode in (0, 1)


def test_names_that_the_terminal_cannot_show_do_no_harm(here: Path) -> None:
    Path(".sysid").rename("grün µ")
    environment = dict(os.environ) | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    command = [sys.executable, "-m", "sysid_cli.start", "models", "--workspace", "grün µ"]
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


@pytest.mark.parametrize("line", ["--help", "fit --help", "compare -h", "--version", ""])
def test_help_imports_no_numeric_library(line: str) -> None:
    code = (
        f"import sys; from sysid_cli import app; code = app.main({line.split()!r}); "
        f"print([m for m in {NUMERIC!r} if m in sys.modules], file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    # Typer itself checks the one value that it reads, --version, by pydantic
    assert (done.returncode, done.stderr) == (0, "['pydantic']\n" if "version" in line else "[]\n")
    assert ("sysid" if line == "--version" else "Usage: sysid") in done.stdout


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
