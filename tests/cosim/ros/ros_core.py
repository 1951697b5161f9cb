"""A roscore of a test's own: own port, own folder, and ended with the test."""

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from sysid.cosim.ros.node import Master, load_ros
from sysid.errors import ModelError

STARTS = 60.0
"""A busy machine takes tens of seconds for what an idle one does in two [s]."""


def ros_or_skip() -> None:
    """Skip where ROS 1 is not installed."""
    if shutil.which("roscore") is None:
        pytest.skip("roscore is not installed")
    try:
        load_ros()
    except ModelError as error:
        pytest.skip(str(error))


@contextmanager
def ros_core(folder: Path) -> Iterator[dict[str, str]]:
    """Environment of processes that use it; all that it started ends at the end."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    uri = f"http://127.0.0.1:{port}"
    own = {"ROS_MASTER_URI": uri, "ROS_IP": "127.0.0.1", "ROS_HOME": str(folder)}
    environment = os.environ | own
    core = subprocess.Popen(
        ["roscore", "-p", str(port)],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        until = time.monotonic() + STARTS
        while time.monotonic() < until:
            with suppress(ModelError):
                Master(uri).check()
                break
            time.sleep(0.1)
        yield environment
    finally:
        with suppress(ProcessLookupError):
            os.killpg(core.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            core.wait(10.0)
        with suppress(ProcessLookupError):
            os.killpg(core.pid, signal.SIGKILL)
        core.wait()
