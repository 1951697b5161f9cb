"""What is said where ROS, its master or the numbers of a message are not there."""

import socket
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from sysid.cosim.ros.node import Master, _append_system_packages
from sysid.cosim.ros.topic_lines import _reader
from sysid.errors import DataError, ModelError


def test_a_machine_without_ros(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"install Debian's packages ros-core python3-rospy"):
        _append_system_packages(folders=(tmp_path,))


def test_another_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rospy").mkdir()
    other = tmp_path / "python3.8"
    with pytest.raises(ModelError, match=r"system's Python 3\.8, and this is Python 3\.\d+"):
        _append_system_packages(other, (tmp_path,))


def test_the_packages_of_the_system_come_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rospy").mkdir()
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = [*sys.path]
    _append_system_packages(Path(sys.executable), (tmp_path,))
    assert sys.path[: len(before)] == before
    assert sys.path[-1] == str(tmp_path)


def test_nobody_or_a_stranger_where_the_master_should_be() -> None:
    with socket.socket() as listening:  # listens, and never answers
        listening.bind(("127.0.0.1", 0))
        free = f"http://127.0.0.1:{listening.getsockname()[1]}"
        with pytest.raises(ModelError, match="start roscore, or set ROS_MASTER_URI"):
            Master(free).check()
    with pytest.raises(ModelError, match="no ROS master answers at file:///nothing"):
        Master("file:///nothing").check()


def test_numbers_of_a_message_by_their_path() -> None:
    message = SimpleNamespace(data=[1, 2.5], twist=SimpleNamespace(linear=SimpleNamespace(x=3)))
    assert _reader("data[1]", "a/B")(message) == 2.5
    assert _reader("twist.linear.x", "a/B")(message) == 3.0
    for wrong in ("data[2]", "twist.linear", "nothing"):
        with pytest.raises(DataError, match=r"no number at .*rosmsg show a/B"):
            _reader(wrong, "a/B")(message)
