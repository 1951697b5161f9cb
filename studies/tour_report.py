"""``tour.md`` and its pictures: the commands of the demo in a row on the bundled robot logs."""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import sysid_datasets
from sysid_cli.demo import COMMANDS

from sysid.data.io import read_logs
from sysid.diagnosis.diagnose import diagnose
from sysid.estimation.identify import Identification, Request, identify
from sysid.report.data_panels import fit
from sysid.report.missions.drives import draw_mission
from sysid.report.panels import PanelPicture, Shown
from sysid.report.plots import write_picture
from sysid.report.trace_panels import worst
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission
from sysid.robot.mission.tracks.mapping import as_robot

STEPS = (
    ("Look at the log", "Every check of the data, with what to do about what it finds.", None),
    (
        "Fit",
        "Four linear structures, orders searched on held-out parts of `prbs.csv`, then judged on "
        "`prbs_val.csv`, which chooses nothing.",
        "fit.svg",
    ),
    ("Export", "The best of them as a plant package, read back and checked.", None),
    (
        "Simulate",
        "The exported plant in closed loop, around four obstacles to (6, 3).",
        "mission.svg",
    ),
    (
        "Diagnose",
        "On a log of many levels the model is worse: what is missing from it?",
        "diagnosis.svg",
    ),
)
"""Of the commands of `sysid demo`: title, words, picture."""

HEAD = """# The tour

The commands of `sysid demo --run`. This is what a terminal of 80 columns shows, warnings
included. Two things are masked because they differ between machines: the six hexadecimal
digits of a model's id (a hash) are shown as `xxxxxx`, and the rounding error of the self-test as
`…e-15`.
"""


def write(folder: Path) -> Mapping[str, str]:
    """Draw the pictures into ``folder`` and return the tour."""
    _draw(folder)
    parts = [HEAD]
    with tempfile.TemporaryDirectory() as place:
        _output("sysid demo .", place)
        for command, (title, words, picture) in zip(COMMANDS, STEPS, strict=True):
            parts.append(f"## {title}\n\n{words}\n")
            parts.append(f"```console\n$ {command}\n{masked(_output(command, place))}```\n")
            if picture:
                parts.append(f"![{title}]({picture})\n")
    return {"tour.md": "\n".join(parts)}


def masked(text: str) -> str:
    """Terminal output without what differs between machines, and without blanks at line ends."""
    text = re.sub(r"\b(arx|armax|oe|bj|augmented)-[0-9a-f]{6}", r"\1-xxxxxx", text)
    text = re.sub(r"\d\.?\d*e-1[3-9]\b", "…e-15", text)
    return "".join(line.rstrip() + "\n" for line in text.splitlines())


def _output(command: str, place: str) -> str:
    """What a command prints, results and warnings in the order in which they appear."""
    words = [sys.executable, "-m", "sysid_cli.start", "-q", *command.split()[1:]]
    env = os.environ | {
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONIOENCODING": "utf-8",
        "LC_ALL": "C.UTF-8",
        "COLUMNS": "80",
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
    best = found.assessments[0].model
    shown = Shown(f"{best.structure.name} of prbs.csv", best)
    data = ", ".join(r.name for r in found.validation)
    panels = fit([shown], found.validation)
    write_picture(folder / "fit.svg", PanelPicture(shown.label, f"free run on {data}", panels))
    mission = load_mission(sysid_datasets.path("obstacles_6_3"))
    robot, _ = as_robot(found.assessments[0].model.plant(), mission)
    draw_mission(folder / "mission.svg", "obstacles_6_3", mission, simulate(mission, robot))
    logs = (read_logs([sysid_datasets.path(name)]) for name in ("multilevel", "multilevel_val"))
    missing = diagnose(*logs, model=found.assessments[0].model)
    where = worst(missing, 1, 1)
    title = "Where the model errs most, before and after the diagnosis"
    write_picture(folder / "diagnosis.svg", PanelPicture(title, "", where, columns=1))


def identified() -> Identification:
    """What ``sysid fit prbs.csv --val prbs_val.csv`` finds."""
    estimation = read_logs([sysid_datasets.path("prbs")])
    validation = read_logs([sysid_datasets.path("prbs_val")])
    return identify(estimation, validation, Request(jobs=2))
