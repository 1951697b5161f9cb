"""Help of one screen by groups, flags that stand anywhere on a line, completion by the shell."""

import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
import typer
from cli_answers import ask
from sysid_cli.app import app
from sysid_cli.field_options import every_command

ROOT: Any = typer.main.get_command(app)
EVERY = every_command(ROOT)
SCREEN = 24
"""Lines of a terminal as it opens."""

GROUPS = ("Data", "Models", "Deploy", "Missions", "Vehicle and bench")
"""Groups of the commands, in the order of their use; every command belongs to one."""


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("name", EVERY)
def test_the_help_of_a_command_fits_a_screen(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, page, _ = ask(capsys, [*name.split(), "--help"])
    assert code == 0
    assert page.count("\n") <= SCREEN, page
    assert max(map(len, page.splitlines())) <= 80
    assert page == ask(capsys, ["help", *name.split()])[1]


@pytest.mark.parametrize("name", EVERY)
def test_help_all_shows_every_option_once(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ask(capsys, [*name.split(), "--help-all"])[1].replace(",", " ").split()
    for parameter in EVERY[name].params:
        if parameter.param_type_name == "option":
            assert all(word in words for word in parameter.opts), parameter.opts
    short = ask(capsys, [*name.split(), "-h"])[1]
    hidden = getattr(EVERY[name].callback, "advanced", ())
    assert (f"{len(hidden)} more options: sysid {name} --help-all" in short) is bool(hidden)


def test_commands_stand_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    page = ask(capsys, ["help"])[1]
    places = [page.index(f"\n{group}:\n") for group in GROUPS]
    assert places == sorted(places)
    for name, command in ROOT.commands.items():
        assert command.rich_help_panel in GROUPS
        line = next(row for row in page.splitlines() if row.startswith(f"  {name} "))
        sentence = (command.help or "").split("\n\n")[0].replace("\n", " ").rstrip(".")
        assert line.split(maxsplit=1)[1] == sentence, "shorten the first sentence of the command"


OF_EACH = {"-o": "what a command writes", "--plot": "plan draws into the workspace unasked"}
"""Options whose value differs in kind from command to command, and why."""


def test_one_word_has_one_meaning_in_all_commands() -> None:
    meanings: dict[str, set[tuple[bool, str]]] = defaultdict(set)
    spelled: dict[str, set[tuple[str, ...]]] = defaultdict(set)
    for command in EVERY.values():
        for p in command.params:
            if p.param_type_name == "option":
                long = max(p.opts, key=len)
                meanings[long].add((p.is_flag, p.metavar or ""))
                spelled[long].add(tuple(p.opts))
                for short in p.opts:
                    spelled[short].add(tuple(p.opts))
    twice = {o: m for o, m in meanings.items() if len(m) > 1 and o not in OF_EACH}
    assert not twice
    assert not {o: s for o, s in spelled.items() if len(s) > 1}


def test_a_missing_file_is_said_in_three_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for line in ("inspect drive.csv", "fit drive.csv", "diagnose drive.csv", "plan drive.yaml"):
        words = line.split()
        code, out, err = ask(capsys, words)
        assert (code in (1, 2), out, err) == (True, "", f"{words[1]}: file not found\n")


def test_quiet_leaves_the_result(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    full = ask(capsys, ["inspect", "log.csv"])[1]
    code, out, err = ask(capsys, ["inspect", "-q", "log.csv"])
    assert (code, err) == (0, "")
    assert "Read as:" in full
    assert out == full[full.index("log.csv: 300 samples") :]


def complete(line: str, folder: Path) -> list[str]:
    """What a shell offers for the last word of a line."""
    words = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
    done = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv[0] = 'sysid'; from sysid_cli.start import main"
         "; sys.exit(main())"],
        env=os.environ | words | {"_SYSID_COMPLETE": "complete_bash"},
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout.split()


def test_the_shell_completes_commands_options_and_models(here: Path) -> None:
    assert complete("sysid fi", here) == ["fit", "fit-vehicle"]
    assert "--criterion" in complete("sysid fit --cr", here)
    assert complete("sysid models ", here) == ["list", "remove"]
    (model,) = complete("sysid export --model ", here)
    assert (here / ".sysid" / "models" / f"{model}.json").is_file()
