"""The nodes of a catkin package: built, run in lock-step under their own master, compared.

What is started here ends here: a master on a free port of 127.0.0.1 and two nodes.
"""

import os
import shutil
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np

from sysid import processes
from sysid.data.files import contents
from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.export.verification.runtimes import SECONDS, Result, run
from sysid.plant.selftest import reach
from sysid.plant.storage import Files

DRIVE = "ros/drive.csv"
"""The drive of Python, in the columns of the log that the robot's node writes."""

HEADER_FOLDERS = (Path("/usr/include"), *sorted(Path("/opt/ros").glob("*/include")))
"""Where Debian and ROS's own packages keep headers."""

HEADERS = {
    "ros/ros.h": "libroscpp-dev",
    "nav_msgs/Odometry.h": "libnav-msgs-dev",
    "geometry_msgs/Twist.h": "libgeometry-msgs-dev",
}
"""What the nodes include, and Debian's package that has it."""

COMMANDS = ("rosmaster", "rosversion", "catkin_find", "cmake", "c++")

TOLERANCE = 1e-6
"""Of each column's range: the heading crosses as a quaternion, time as whole nanoseconds."""

STARTS = 60.0
"""A master is there within a second; on a busy machine it may take this long [s]."""


class RosNodes:
    """The two nodes of ``ros/``, by the ROS 1 of this machine."""

    name = "ros"
    folders = ("ros",)

    def replay(self, folder: Path, files: Files, foreign: bool = False) -> Result:
        """Build them, drive the mission, and compare the robot's log with Python's."""
        if foreign:
            return Result(self.name, skipped="nodes of somebody else would need a network")
        lacking = lacks()
        if lacking:
            return Result(self.name, skipped=lacking)
        version = run(["rosversion", "roscpp"], folder).out.strip()
        if DRIVE not in files:
            return Result(self.name, version, skipped="the package has no nodes of ROS")
        try:
            nodes = built(folder / "ros", folder / "ros-build")
            worst = _error(nodes, folder, files[DRIVE])
        except ModelError as refused:
            return Result(self.name, version, failed=str(refused))
        return Result(self.name, version, worst, worst <= TOLERANCE)


def lacks() -> str:
    """What is not installed, in a few words; empty where all is there."""
    missing = [c for c in COMMANDS if shutil.which(c) is None]
    missing += [
        package
        for header, package in HEADERS.items()
        if not any(place.joinpath(header).is_file() for place in HEADER_FOLDERS)
    ]
    return f"{missing[0]} is not installed" if missing else ""


def built(package: Path, build: Path) -> Path:
    """Build a catkin package; the folder of its nodes, below ``build/devel``."""
    options = [
        f"-DCATKIN_DEVEL_PREFIX={build / 'devel'}",
        "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror",
    ]
    # catkin is a package of the system's Python
    python = "-DPYTHON_EXECUTABLE=/usr/bin/python3"
    for command in (
        ["cmake", "-S", str(package), "-B", str(build), python, *options],
        ["cmake", "--build", str(build), "-j2"],
    ):
        done = run(command, package)
        if done.code:
            said = [line for line in f"{done.err}\n{done.out}".splitlines() if "rror" in line]
            raise ModelError(f"the nodes do not build: {said[0].strip() if said else 'no word'}")
    binary = next((build / "devel" / "lib").rglob("robot_node"), None)
    if binary is None:
        raise ModelError("the nodes do not build: there is no robot_node")
    return binary.parent


@contextmanager
def own_master(home: Path) -> Iterator[Mapping[str, str]]:
    """A master of its own: the environment of processes that use it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    place = {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    environment = os.environ | place | {"ROS_HOME": str(home)}
    with running(["rosmaster", "--core", "-p", str(port)], home, environment):
        until = time.monotonic() + STARTS
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
                break
            except OSError:
                if time.monotonic() > until:
                    raise ModelError(f"rosmaster does not answer on port {port}") from None
                time.sleep(0.05)
        yield environment


@contextmanager
def running(
    command: list[str], folder: Path, environment: Mapping[str, str]
) -> Iterator[processes.Command]:
    """A process that has ended when this ends."""
    with processes.started(command, folder, environment) as one:
        try:
            yield one
        finally:
            one.terminate()  # a node that is asked to end leaves its master
            with suppress(processes.TooLong):
                one.wait(5.0)


def _error(nodes: Path, folder: Path, drive: bytes) -> float:
    """Largest error of a column of the robot's log in parts of its range."""
    log, expected = folder / "ros.csv", _rows(drive.decode("utf-8", "replace"), DRIVE)
    with own_master(folder) as environment, ExitStack() as both:
        words = {"robot": ["_lock_step:=true", f"_log:={log}"], "guidance": []}
        started = [
            both.enter_context(running([str(nodes / f"{n}_node"), *w], folder, environment))
            for n, w in words.items()
        ]
        until = time.monotonic() + SECONDS
        for name, one in zip(words, started, strict=True):
            try:
                code = one.wait(max(until - time.monotonic(), 0.0))
            except processes.TooLong:
                raise ModelError(f"{name}_node takes longer than {SECONDS:g} s") from None
            if code:
                raise ModelError(f"{name}_node ends with {code}")
    logged = _rows(contents(log).decode("utf-8", "replace") if log.is_file() else "", "its log")
    if logged.shape != expected.shape:
        raise ModelError(f"the nodes drive {len(logged)} samples, Python drives {len(expected)}")
    error = float(np.max(np.abs(logged - expected) / reach(expected)))
    return error if np.isfinite(error) else float("inf")


def _rows(text: str, where: str) -> Array:
    """The numbers of a log below its titles."""
    try:
        rows = np.array(
            [[float(v) for v in line.split(",")] for line in text.splitlines()[1:]], dtype=float
        )
    except ValueError:
        raise ModelError(f"{where} is damaged") from None
    if rows.ndim != 2 or not np.all(np.isfinite(rows)):
        raise ModelError(f"{where} is damaged or empty")
    return rows
