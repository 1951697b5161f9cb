"""What stands at a path may be a device that never ends, a pipe that nobody feeds, or a link."""

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from plant_models import robot_model

from sysid.data import files
from sysid.data.bags.opening import opened
from sysid.data.files import contents, read_bytes, settle, write_atomic
from sysid.data.yaml_files.source import read_yaml
from sysid.effects.measured import read_measured
from sysid.errors import SysidError, UsageError
from sysid.export.package import write_package
from sysid.plant.package import load_plant
from sysid.robot.mission.result import write_columns
from sysid.structures.model import Model
from sysid.testbench.motor.tables import read_bench_table
from sysid.vehicle.wheels.xml_source import read_xml
from sysid.workspace.store import Workspace

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no such files")

READERS: dict[str, Callable[[Path], object]] = {
    "log": read_bytes,
    "mission": read_yaml,
    "measured": read_measured,
    "bench": read_bench_table,
    "urdf": read_xml,
    "model": Model.load,
    "package": load_plant,
    "state": lambda path: Workspace(path.parent).all(),
    "bag": lambda path: opened(path).__enter__(),
}

WRITERS: dict[str, Callable[[Path], object]] = {
    "file": lambda path: write_atomic(path, "new\n"),
    "table": lambda path: write_columns({}, path),
    "package": lambda path: write_package(robot_model(), path),
    "zip": lambda path: write_package(robot_model(), path),
}


def place(folder: Path, kind: str, what: str) -> Path:
    """A device or a pipe, called as what it is taken for."""
    path = folder / {"bag": "x.bag", "zip": "x.zip", "state": "index.json"}.get(what, "x")
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    return path


@pytest.mark.parametrize("kind", ["device", "pipe"])
@pytest.mark.parametrize("reader", READERS)
def test_only_regular_files_are_read(tmp_path: Path, reader: str, kind: str) -> None:
    path = place(tmp_path, kind, reader)
    if reader == "bag":
        pytest.importorskip("rosbags")
    with pytest.raises(SysidError) as caught:
        READERS[reader](path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["device", "pipe"])
@pytest.mark.parametrize("writer", WRITERS)
def test_no_device_is_written_over(tmp_path: Path, writer: str, kind: str) -> None:
    path = place(tmp_path, kind, writer)
    before = os.lstat(path)
    with pytest.raises(UsageError, match=r"device or a pipe|is a file|no folder"):
        WRITERS[writer](path)
    assert os.lstat(path).st_ino == before.st_ino


def test_what_is_written_goes_through_links(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("there/file")
    for text in ("first\n", "second\n"):
        write_atomic(tmp_path / "link", text)
        assert (tmp_path / "there" / "file").read_text() == text
    assert (tmp_path / "link").is_symlink()


def test_no_link_leads_out_of_a_package(tmp_path: Path) -> None:
    package = write_package(robot_model(), tmp_path / "plant")
    shutil.move(package / "c" / "plant.c", package / "c" / "other")
    (package / "c" / "plant.c").symlink_to("other")
    load_plant(package)
    shutil.move(package / "c" / "other", tmp_path / "outside")
    (package / "c" / "plant.c").unlink()
    (package / "c" / "plant.c").symlink_to(tmp_path / "outside")
    with pytest.raises(SysidError, match="leads out of the package"):
        load_plant(package)


def test_bytes_are_counted_while_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What grows, or says that it holds nothing, as files of /proc do."""
    path = tmp_path / "file"
    path.write_bytes(bytes(1000))
    status = os.fstat

    def empty(descriptor: int) -> os.stat_result:
        real = list(status(descriptor))
        return os.stat_result([*real[:6], 0, *real[7:]])

    monkeypatch.setattr(files, "_BLOCK", 100)
    monkeypatch.setattr(os, "fstat", empty)
    assert contents(path, 1000) == bytes(1000)
    with pytest.raises(OSError, match="larger"):
        contents(path, 899)


def test_what_is_being_written_is_no_leftover(tmp_path: Path) -> None:
    with files.replacing(tmp_path / "file") as new:
        settle(tmp_path)
        new.write_text("whole\n")
    assert (tmp_path / "file").read_text() == "whole\n"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
