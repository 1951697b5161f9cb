"""One odd log through inspect, fit and diagnose, and what was wrong about the answers."""

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from odd_log import OddLog
from sysid_cli.app import main

WITHIN = 0.03
"""Share of a gain that nobody with a machine on the bench minds."""

ERRORS = 3.0
"""Standard errors within which an estimate is as good as it says."""


class Streams(NamedTuple):
    """What a command printed."""

    out: str
    err: str


@dataclass(frozen=True)
class Verdict:
    """What was wrong about one log, in sentences; and what was found."""

    faults: tuple[str, ...]
    gains: tuple[tuple[str, float, float, float], ...] = ()


def judge(
    log: OddLog, seed: int, folder: Path, printed: Callable[[], Any], fitted: str = ""
) -> Verdict:
    """Run the commands on one log made from a seed.

    Args:
        log: what to make and what to expect.
        seed: of its random numbers.
        folder: where its files go; the current folder.
        printed: returns and forgets what was printed since it was called last: (out, err).
        fitted: options of ``fit`` where the log asks for none.
    """
    path = log.make(np.random.default_rng([seed, len(log.name)]), folder)
    line = [str(path), *shlex.split(log.options)]
    faults: list[str] = []
    printed()
    code = main(["inspect", *line])
    said = "\n".join(printed())
    faults += _spoken("inspect", said, code, log.inspected, log.says, log.never)
    workspace = ["--workspace", str(folder / "ws")]
    options = shlex.split(log.fit_options or fitted)
    code = main(["fit", *line, *options, *workspace, "--full"])
    told = Streams(*printed())
    faults += _spoken("fit", "\n".join(told), code, log.code, log.fit_says, log.never)
    gains: tuple[tuple[str, float, float, float], ...] = ()
    if code == 0 and log.gains:
        models = sorted((folder / "ws" / "models").glob("*.json"))
        gains, wrong = _gains(log, _winner(told.out, models))
        faults += wrong
    if log.diagnosis:
        main(["diagnose", *line, "--workspace", str(folder / "wd")])
        said = "\n".join(printed())
        first, *others = log.diagnosis
        missing = next((x for x in said.splitlines() if x.startswith("Missing:")), "")
        if first not in missing or any(o in missing for o in others):
            faults.append(f"diagnose named {missing!r}, true is {first}")
    return Verdict(tuple(faults), gains)


def _spoken(command: str, said: str, code: int, wanted: int, says: str, never: str) -> list[str]:
    faults = []
    if code != wanted:
        faults.append(f"{command} ended with {code}, not {wanted}: {said[-300:]}")
    if not re.search(says, said):
        faults.append(f"{command} does not say {says!r}: {said}")
    faults += [f"{command} says {p!r}: {said}" for p in ("Traceback", never) if re.search(p, said)]
    return faults


def _winner(out: str, models: list[Path]) -> dict[str, Any]:
    """The stored model that the fit says it kept."""
    kept = re.search(r"Stored in \S*?([\w-]+)\.json|Saved ([\w-]+)\.", out)
    assert kept is not None, out
    path = next(m for m in models if m.stem in kept.groups())
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _gains(
    log: OddLog, stored: dict[str, Any]
) -> tuple[tuple[tuple[str, float, float, float], ...], list[str]]:
    steps = stored["report"]["step_response"]
    found, faults = [], []
    for (u, y), truth in log.gains.items():
        (step,) = [s for s in steps if (s["input"], s["output"]) == (u, y)]
        factor = step["file_factor"]
        value, error = factor * step["gain"]["value"], step["gain"]["std_error"]
        error = abs(factor) * (np.inf if error is None else error)
        found.append((f"{u} → {y}", value, float(error), truth))
        if abs(value - truth) > max(WITHIN * abs(truth), ERRORS * error):
            faults.append(f"gain {u} → {y} is {value:.5g} ± {error:.2g}, true is {truth:.5g}")
    return tuple(found), faults
