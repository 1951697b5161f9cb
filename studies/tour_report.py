"""``tour.md`` and its pictures: the four commands in a row on the bundled robot logs."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import sysid_datasets

from sysid.data.io import read_logs
from sysid.estimation.identify import Identification, Request, identify
from sysid.estimation.selection.comparison import Contender, compare
from sysid.report.fits import draw_fit, draw_ranking
from sysid.report.missions.drives import draw_mission
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission
from sysid.robot.mission.tracks.mapping import as_robot

FILES = ("prbs.csv", "prbs_val.csv", "obstacles_6_3.yaml")

STEPS = (
    (
        "Look at the log",
        "Every check of the data, with what to do about what it finds.",
        "sysid inspect prbs.csv",
        None,
    ),
    (
        "Fit",
        "Four linear structures, orders searched on held-out parts of `prbs.csv`, then judged on "
        "`prbs_val.csv`, which chooses nothing.",
        "sysid fit prbs.csv --val prbs_val.csv",
        "fit.svg",
    ),
    (
        "Compare",
        "The same models on equal terms: one-step errors on the samples that all of them predict.",
        "sysid compare --criterion aic",
        "ranking.svg",
    ),
    (
        "Export",
        "The best of the comparison as a plant package, read back and checked.",
        "sysid export",
        None,
    ),
    (
        "Simulate",
        "The exported plant in closed loop, around four obstacles to (6, 3).",
        "sysid simulate obstacles_6_3.yaml",
        "mission.svg",
    ),
)

BEGIN, END = "<!-- the tour, written by make reports -->", "<!-- end of the tour -->"

HEAD = """# The tour

The four commands in a row, and a look at the log before them, in a folder with three bundled files:
`prbs.csv`, `prbs_val.csv` and `obstacles_6_3.yaml` of `datasets/`. This is what the terminal shows,
warnings included. Two things are masked because they differ between machines: the six hexadecimal
digits of a model's id (a hash) are shown as `xxxxxx`, and the rounding error of the self-test as
`…e-15`. The pictures are those of `--plot FILE`.
"""


def write(folder: Path) -> Mapping[str, str]:
    """Draw the pictures into ``folder`` and return the tour; README.md gets its short form."""
    _draw(folder)
    parts, short = [HEAD], []
    with tempfile.TemporaryDirectory() as place:
        for name in FILES:
            shutil.copy(sysid_datasets.path(name), place)
        for title, words, command, picture in STEPS:
            output = masked(_output(command, place))
            parts.append(f"## {title}\n\n{words}\n")
            parts.append(f"```console\n$ {command}\n{output}```\n")
            if picture:
                parts.append(f"![{title}]({picture})\n")
            if "inspect" not in command:
                tables = 0 if "compare" in command else 1
                short.append(f"```console\n$ {command}\n{shortened(output, tables)}```\n")
    readme = folder.parent / "README.md"
    return {
        "tour.md": "\n".join(parts),
        "../README.md": between_marks(readme.read_text(encoding="utf-8"), "\n".join(short)),
    }


def shortened(text: str, tables: int) -> str:
    """Output with its first ``tables`` tables only, and without equations, which are indented."""
    kept: list[str] = []
    seen = 0
    for line in text.splitlines():
        seen += line.startswith("┏")
        equation = line.startswith("  ") and "→" not in line
        if equation or (seen > tables and line[:1] in "┏┃┡│└"):
            kept += [] if kept[-1:] == ["…"] else ["…"]
        else:
            kept.append(line)
    return "".join(line + "\n" for line in kept)


def between_marks(page: str, text: str) -> str:
    """The page with ``text`` between its two marks."""
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{text}\n{END}{after}"


def masked(text: str) -> str:
    """Terminal output without what differs between machines, and without blanks at line ends."""
    text = re.sub(r"\b(arx|armax|oe|bj)-[0-9a-f]{6}", r"\1-xxxxxx", text)
    text = re.sub(r"\d\.?\d*e-1[3-9]\b", "…e-15", text)
    return "".join(line.rstrip() + "\n" for line in text.splitlines())


def _output(command: str, place: str) -> str:
    """What a command prints, results and warnings in the order in which they appear."""
    words = [sys.executable, "-m", "sysid_cli.start", *command.split()[1:]]
    env = os.environ | {
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONIOENCODING": "utf-8",
        "LC_ALL": "C.UTF-8",
    }
    done = subprocess.run(
        words,
        cwd=place,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"`{command}` ended with {done.returncode}:\n{done.stdout}")
    return done.stdout


def _draw(folder: Path) -> None:
    """The pictures of the tour, models called by their structure instead of by a hash."""
    found = identified()
    draw_fit(folder / "fit.svg", f"{found.assessments[0].model.structure.name} of prbs.csv", found)
    contenders = [
        Contender(a.model.structure.name, a.model, found.estimation, a.to_json())
        for a in found.assessments
    ]
    ranking = compare(contenders, "aic", None)
    draw_ranking(folder / "ranking.svg", ranking)
    mission = load_mission(sysid_datasets.path("obstacles_6_3"))
    robot, _ = as_robot(ranking.best.contender.model.plant(), mission)
    draw_mission(folder / "mission.svg", "obstacles_6_3", mission, simulate(mission, robot))


def identified() -> Identification:
    """What ``sysid fit prbs.csv --val prbs_val.csv`` finds."""
    estimation = read_logs([sysid_datasets.path("prbs")])
    validation = read_logs([sysid_datasets.path("prbs_val")])
    return identify(estimation, validation, Request(jobs=2))
