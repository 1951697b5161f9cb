"""``sysid demo``: the bundled logs and missions in a folder, and five commands to try on them."""

import contextlib
import shlex
from pathlib import Path
from time import monotonic

import typer

from sysid.errors import UsageError

from . import reading, render
from .field_options import running
from .options import argument, command, flag

COMMANDS = (
    "sysid inspect prbs.csv",
    "sysid fit prbs.csv --val prbs_val.csv",
    "sysid export",
    "sysid simulate obstacles_6_3.yaml",
    "sysid diagnose multilevel.csv --val multilevel_val.csv",
)
"""The main job: a look at a log, models of it, the plant package, a drive, what is missing."""

FOLDERS = {
    "devastator": "",
    "missions": "",
    "bench": "bench",
    "vehicles": "vehicles",
    "equations": "equations",
}
"""Bundled kinds of files → the folder of the copy, where a name alone is quickest to type."""


@command
def demo(
    folder: Path = argument("[DIR]", "Folder for the files.", default=Path("sysid-demo")),
    run: bool = flag("Run the five commands there, too."),
    json: bool = reading.JSON,
) -> None:
    """Copy the bundled logs and missions, to try commands on.

    Files that are there already stay; one that was changed is not overwritten.
    """
    if run and json:
        raise UsageError("--run shows results; omit --json")
    copied = _copied(folder)
    if json:
        render.document({"folder": folder, "files": copied, "commands": COMMANDS})
        return
    render.say(
        f"{len(copied)} bundled files are in {folder}: logs, missions, bench, vehicles, equations."
    )
    if run:
        _run(folder)
        return
    render.say("To paste:")
    render.command(f"\n  cd {shlex.quote(str(folder))}")
    for line in COMMANDS:
        render.command(f"  {line}")


def _copied(folder: Path) -> list[str]:
    """Copy what is not there yet; the names of all."""
    from sysid_datasets import folder as bundled

    from sysid.data.files import contents, write_atomic

    sources = {
        folder / place / path.name: path
        for kind, place in FOLDERS.items()
        for path in sorted((bundled() / kind).iterdir())
        if path.suffix in (".csv", ".yaml")
    }
    present = {target for target in sources if target.exists()}
    for target in present:
        if contents(target) != contents(sources[target]):
            raise UsageError(f"{target} was changed; name another folder, or remove it")
    for place in {target.parent for target in sources}:
        place.mkdir(parents=True, exist_ok=True)
    for target, path in sources.items():
        if target not in present:
            write_atomic(target, contents(path))
    return [str(target.relative_to(folder)) for target in sources]


def _run(folder: Path) -> None:
    """Run the commands in the folder, one after the other, as a shell would.

    Raises:
        typer.Exit: one ended with another code than 0.
    """
    line = running().obj
    with contextlib.chdir(folder):
        for command in COMMANDS:
            render.command(f"\n$ {command}")
            started = monotonic()
            words = command.split()
            code = line.root.main(words[1:], words[0], standalone_mode=False, obj=line)
            if code:
                raise typer.Exit(code)
            render.note(f"({monotonic() - started:.1f} s)")
