"""What ``sysid inspect`` shows of a bag without a mapping: topics, and a line to paste."""

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
        found = read_contents(path)
        likely = propose(found)
    command = None if likely is None else command_of(path, likely)
    if json:
        proposal = None if likely is None else likely.summary() | {"command": command}
        render.document(found.summary() | {"proposal": proposal})
        return
    render.table(
        ("topic", "type", "messages", "Hz", "numbers that move"),
        [(t.name, t.kind, t.count, t.rate, _moving(t)) for t in found.topics],
        title=f"{found.where}: {len(found.topics)} topics, {found.length:.6g} s",
    )
    if likely is None or command is None:
        render.say("No topic looks like a reading that answers a command: name fields with --map.")
        return
    render.say(f"{likely.why}. A fit of it:")
    render.say(command)


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
