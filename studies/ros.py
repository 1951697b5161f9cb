"""Mission 1 through two nodes of ROS 1, in Python and in C++, beside the run of one process.

Starts a roscore of its own on 127.0.0.1, builds the catkin package of ``sysid export --format ros``
by cmake, and drives every pair of nodes in lock-step and in real time; ends with 1 where a run in
lock-step differs by more than 1e-6, or one in real time by more than 0.3 s or 0.05 m. Needs ROS 1
with its headers (``libroscpp-dev``).
"""

import csv
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from studies.runner import ROOT, Study

STUDY = Study("ros", "ros.md")
SYSID = Path(sys.executable).with_name("sysid")
MISSION = ROOT / "datasets" / "missions" / "goal_1m.yaml"
FIT = ROOT / "datasets" / "devastator" / "prbs.csv"
LIMIT = 240.0

HEAD = """# Two nodes of ROS 1

Mission 1 (one metre straight ahead) with a plant of structure oe
fitted to `prbs.csv`. The end of the robot's own log, beside the run within one process. In
lock-step the robot waits for every answer: at most 1e-6 apart. In real time an answer comes a
sample late: at most 0.3 s and 0.05 m.

| guidance | robot | time | asked for | ends at [s] | x, y [m] | apart [s] | apart [m] |
|---|---|---|---|---:|---:|---:|---:|
"""

CASES = (
    ("Python", "Python", True, "references"),
    ("Python", "Python", True, "pwm"),
    ("C++", "C++", True, "references"),
    ("C++", "C++", True, "pwm"),
    ("Python", "C++", True, "references"),
    ("C++", "Python", True, "references"),
    ("Python", "Python", False, "references"),
    ("C++", "C++", False, "references"),
)


@contextmanager
def core(folder: Path) -> Iterator[dict[str, str]]:
    """A roscore that ends with the study."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    own = {
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_IP": "127.0.0.1",
        "ROS_HOME": str(folder / "home"),
    }
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    running = subprocess.Popen(
        ["roscore", "-p", str(port)], env=os.environ | own, start_new_session=True, **quiet
    )
    try:
        until = time.monotonic() + 60.0
        while time.monotonic() < until:
            with suppress(OSError):
                socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
                break
            time.sleep(0.2)
        time.sleep(1.0)
        yield os.environ | own
    finally:
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            running.wait(10.0)
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)
        running.wait()


def command(*words: object) -> None:
    """Run a command that must succeed."""
    subprocess.run([str(w) for w in words], check=True, timeout=LIMIT, stdout=subprocess.DEVNULL)


def built(folder: Path) -> None:
    """Build the nodes."""
    package, build = folder / "plant" / "ros", folder / "build"
    command("cmake", "-S", package, "-B", build, "-DPYTHON_EXECUTABLE=/usr/bin/python3")
    command("cmake", "--build", build)


def line(kind: str, role: str, lock: bool, level: str, log: Path, work: Path) -> Sequence[str]:
    """The command of a node."""
    if kind == "C++":
        nodes = next((work / "build").rglob("robot_node")).parent
        said = [f"_level:={level}"]
        if role == "robot":
            said += [f"_lock_step:={str(lock).lower()}", f"_log:={log}"]
        return [str(nodes / f"{role}_node"), *said]
    verb = "plant" if role == "robot" else "simulate"
    said = ["--lock-step"] if lock and role == "robot" else []
    place = ["--plant", str(work / "plant"), "--workspace", str(work / "w")]
    words = [str(SYSID), verb, str(MISSION), "--ros", "--topic-level", level, *place, *said]
    return [*words, "-o", str(log)]


def end_of(log: Path) -> tuple[float, float, float]:
    """t, x, y of the last row."""
    with log.open(encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    return float(last["t"]), float(last["x"]), float(last["y"])


def pair(case: tuple[str, str, bool, str], work: Path, environment: dict[str, str]) -> Path:
    """Drive with two nodes; the robot's log."""
    guidance, robot, lock, level = case
    logs = {role: work / f"{role}.csv" for role in ("robot", "guidance")}
    for log in logs.values():
        log.unlink(missing_ok=True)
    kinds = {"robot": robot, "guidance": guidance}
    running = [
        subprocess.Popen(
            line(kinds[role], role, lock, level, logs[role], work),
            env=environment,
            stdout=subprocess.DEVNULL,
        )
        for role in kinds
    ]
    try:
        for one in running:
            if one.wait(LIMIT):
                raise SystemExit(f"{one.args} ended with {one.returncode}")
    finally:
        for one in running:
            one.kill()
            one.wait()
    return logs["robot"]


def main() -> int:
    """Drive all pairs and write the table."""
    asked = STUDY.asked(__doc__)
    rows, failed = [], False
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        command(SYSID, "fit", FIT, "--structure", "oe", "--workspace", work / "w")
        formats = ("--format", "json,ros", "--controller", MISSION)
        command(SYSID, "export", "--workspace", work / "w", *formats, "-o", work / "plant")
        drive = ("--plant", work / "plant", "--workspace", work / "w", "-o", work / "one.csv")
        command(SYSID, "simulate", MISSION, *drive)
        built(work)
        t0, x0, y0 = end_of(work / "one.csv")
        rows.append(f"| one process | | | | {t0:g} | {x0:.4f}, {y0:.4f} | | |\n")
        with core(work) as environment:
            for case in CASES:
                t, x, y = end_of(pair(case, work, environment))
                late, far = abs(t - t0), math.hypot(x - x0, y - y0)
                failed |= late > (1e-6 if case[2] else 0.3 + 1e-6)
                failed |= far > (1e-6 if case[2] else 0.05)
                pace = "lock-step" if case[2] else "real"
                apart = f"{late:.2g} | {far:.1e}"
                ends = f"{t:g} | {x:.4f}, {y:.4f}"
                rows.append(f"| {case[0]} | {case[1]} | {pace} | {case[3]} | {ends} | {apart} |\n")
                print(rows[-1], end="", flush=True)
    STUDY.write(asked, HEAD + "".join(rows), "none")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
