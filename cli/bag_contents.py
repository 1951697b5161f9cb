"""Topics of a bag without a mapping, and a command to paste, for ``sysid inspect``."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import render

if TYPE_CHECKING:
    from sysid.data.bags.contents import Topic
    from sysid.data.bags.proposal import Proposal

MOST_SHOWN = 6
"""Fields of a topic in the table; --json has all of them."""


def show_bag(path: Path, json: bool) -> None:
    """List the topics of a bag and propose a mapping."""
    from sysid.data.bags.contents import read_contents
    from sysid.data.bags.proposal import propose

    with render.progress(f"Looking into {path.name}"):
        contents = read_contents(path)
        proposed = propose(contents)
    command = None if proposed is None else command_of(path, proposed)
    if json:
        proposal = None if proposed is None else proposed.summary() | {"command": command}
        render.document(contents.summary() | {"proposal": proposal})
        return
    render.table(
        ("topic", "type", "messages", "Hz", "varying fields"),
        [(t.name, t.kind, t.count, t.rate, _moving(t)) for t in contents.topics],
        title=f"{contents.where}: {len(contents.topics)} topics, {contents.length:.6g} s",
    )
    if proposed is None or command is None:
        render.say("No measurement follows a command; map fields with --map.")
        return
    render.say(f"{proposed.why}. To fit it:")
    render.command(command)


def command_of(path: Path, proposal: "Proposal") -> str:
    """The line that fits a proposal, to be pasted."""
    words: list[Any] = ["sysid", "fit", path]
    for name, source in proposal.map.items():
        words += ["--map", f"{name}={source}"]
    for option, names in (("--input", proposal.inputs), ("--output", proposal.outputs)):
        words += [option, ",".join(names)] if names else []
    return shlex.join(str(w) for w in words)


def _moving(topic: "Topic") -> str:
    paths = [f.path or "(the number itself)" for f in topic.moving]
    more = f" and {len(paths) - MOST_SHOWN} more" if len(paths) > MOST_SHOWN else ""
    return ", ".join(paths[:MOST_SHOWN]) + more
