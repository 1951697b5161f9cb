"""Commands as processes of their own that share one start of Python; run as a script.

What a node does with rospy it can do once a process. Here the workbench is imported once, and every
command is a fork of that: input is a JSON list of steps on stdin, output a JSON document of what
each command left. Whatever happens, every process has ended when this one ends.
"""

import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from sysid_cli.app import main

from sysid.cosim.ros.node import master_here

LIMIT = 60.0
"""No command of the test takes this long [s], however busy the machine is."""


def start(arguments: list[str], folder: Path, name: str) -> int:
    """Fork a command; its streams go to files."""
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number, stream in ((1, "out"), (2, "err")):
            target = os.open(folder / f"{name}.{stream}", os.O_WRONLY | os.O_CREAT)
            os.dup2(target, number)
        code = main(arguments)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def ended(pid: int) -> int:
    """The exit code; a command that does not end is killed and gives the signal."""
    until = time.monotonic() + LIMIT
    while time.monotonic() < until:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.kill(pid, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def published(topic: str) -> None:
    """Wait until a node publishes a topic, and that much longer that a subscriber has it."""
    master, until = master_here(), time.monotonic() + LIMIT
    while time.monotonic() < until and not master.publishers(topic):
        time.sleep(0.05)
    time.sleep(0.5)


def play(steps: list[dict[str, Any]], folder: Path) -> dict[str, Any]:
    """Start, signal and wait as the steps say."""
    running: dict[str, int] = {}
    codes: dict[str, int] = {}
    try:
        for step in steps:
            name = step["name"]
            if "start" in step:
                running[name] = start(step["start"], folder, name)
            elif "signal" in step:
                os.kill(running[name], step["signal"])
            elif "meets" in step:
                published(step["meets"])
            else:
                codes[name] = ended(running.pop(name))
    finally:
        for pid in running.values():
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
    return {
        name: {
            "code": code,
            "out": (folder / f"{name}.out").read_text(),
            "err": (folder / f"{name}.err").read_text(),
        }
        for name, code in codes.items()
    }


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        json.dump(play(json.load(sys.stdin), Path(place)), sys.stdout)
