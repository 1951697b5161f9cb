"""Examples of a page, run in a folder of their own: what they print is what the page shows.

A console block holds commands behind ``$`` and what they print, results and warnings in the order
in which they appear at 80 columns; a line ``…`` stands for any lines. Ids of models and rounding
errors are not compared, numbers within :data:`CLOSE`.
"""

import contextlib
import io
import re
import runpy
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sysid_cli.app import main

CLOSE = 0.005
"""Share by which a number may differ: the last digits of a fit differ between processors."""

OMITTED = "…"
NOT_RUN = ("pip ", "cd ")
"""How commands begin that are not of the workbench."""

_FENCE = re.compile(r"^```(console|python|yaml)([^\n]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_OPENING = re.compile(r"# [^\n]*\n\n(```.*?^```\n\n?)*", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


@dataclass(frozen=True)
class Example:
    """A command or a script of a page, and the lines that the page shows of its output."""

    line: str
    shown: tuple[str, ...] = ()
    script: str = ""


def examples(page: Path, *, opening: bool = False) -> Iterator[Example]:
    """The console blocks with ``$``, the Python blocks and the named YAML blocks, in their order.

    A fence of YAML that is followed by a file's name writes that file.

    Args:
        opening: only those above the first paragraph.
    """
    whole = page.read_text(encoding="utf-8")
    if opening:
        whole = _OPENING.match(whole)[0]  # type: ignore[index]
    for kind, name, text in _FENCE.findall(whole):
        if kind == "python":
            yield Example("", script=text)
        elif kind == "yaml" and name.strip():
            yield Example(f"write {name.strip()}", script=text)
        elif kind == "console" and text.startswith("$ "):
            for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
                command, *shown = part.rstrip("\n").split("\n")
                yield Example(command, tuple(shown))


def printed(example: Example) -> list[str]:
    """What it prints in the current folder; it must end well."""
    words = shlex.split(example.line)
    if words[:1] == ["write"]:
        Path(words[1]).write_text(example.script, encoding="utf-8")
        return []
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(stream):
        if example.script:
            Path("example.py").write_text(example.script, encoding="utf-8")
            runpy.run_path("example.py")
            code = 0
        else:
            code = main(words[1:])
    assert code == 0, stream.getvalue()
    return [line.rstrip() for line in stream.getvalue().splitlines()]


def missing(shown: tuple[str, ...], lines: list[str]) -> list[str]:
    """The first stretch of shown lines that is not among those printed, in their order."""
    at = 0
    parts: list[list[str]] = [[]]
    for line in shown:
        if line.strip() == OMITTED:
            parts.append([])
        else:
            parts[-1].append(line.rstrip())
    for k, part in enumerate(parts):
        if not part:
            continue
        places = range(at, len(lines) - len(part) + 1)
        found = next((p for p in places if all(map(same, part, lines[p:]))), None)
        if found is None or (k == 0 and found != 0):
            return part
        at = found + len(part)
    return [] if not shown or not parts[-1] or at == len(lines) else ["(the end)"]


def same(shown: str, line: str) -> bool:
    """Whether two lines are the same but for ids, rounding errors and last digits."""
    a, b = _masked(shown), _masked(line)
    if _NUMBER.sub("0", a) != _NUMBER.sub("0", b):
        return False
    pairs = zip(_NUMBER.findall(a), _NUMBER.findall(b), strict=True)
    return all(abs(float(x) - float(y)) <= CLOSE * max(abs(float(x)), 1e-9) for x, y in pairs)


def _masked(line: str) -> str:
    line = re.sub(r"\b([a-z][a-z-]*)-[0-9a-f]{6}\b", r"\1-id", line)
    line = re.sub(r"\bp = \d[\d.e-]*", "p = …", line)
    return re.sub(r"\d[\d.]*e-1[3-9]\b", "…", line)


def drive(path: Path, seconds: float = 120.0, seed: int = 3) -> None:
    """A log of somebody else's robot: commands of ±255 with a dead zone of 25, speeds in rpm."""
    rng = np.random.default_rng(seed)
    n = round(seconds / 0.05)
    share = rng.uniform(-1.0, 1.0, (n // 12 + 1, 2))  # small commands more often than large ones
    levels = np.rint(250.0 * np.sign(share) * np.abs(share) ** 1.5).astype(int)
    command = np.repeat(levels, 12, axis=0)[:n]
    driven = np.sign(command) * np.maximum(np.abs(command) - 25.0, 0.0)
    speed = np.zeros((n, 2))
    for k in range(1, n):
        speed[k] = 0.85 * speed[k - 1] + 0.15 * np.array([0.52, 0.47]) * driven[k - 1]
    speed += rng.normal(0.0, 0.8, speed.shape)
    rows = [
        f"{0.05 * k:.2f},{command[k, 0]},{command[k, 1]},{speed[k, 0]:.2f},{speed[k, 1]:.2f},"
        f"{12.4 - 0.001 * k:.2f}"
        for k in range(n)
    ]
    head = "time [s],left_cmd,right_cmd,left_rpm,right_rpm,battery [V]"
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
