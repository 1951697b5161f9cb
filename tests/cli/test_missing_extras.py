"""Each extra that is not installed is named in one sentence; the rest goes on without it."""

import json
import sys
from pathlib import Path

import pytest
from command_line import Capture, run
from plant_models import robot_model

from sysid.errors import ModelError
from sysid.export.package import write_package

EXTRAS = {"h5py": "hdf5", "rosbags": "ros", "mujoco": "physics", "fmpy": "fmu", "libcosimpy": "fmu"}


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with a plant, a mission and something that is called like a bag."""
    folder = tmp_path_factory.mktemp("w")
    write_package(robot_model(), folder / "plant", formats=["json"])
    (folder / "m.yaml").write_text("goal: [1, 0]\n")
    (folder / "log.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    (folder / "log.mcap").write_bytes(b"\x89MCAP0\r\n")
    return folder


def without(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    """Python's own way of forbidding an import, of the parts that are loaded already, too."""
    loaded = [name for name in sys.modules if name.startswith(f"{package}.")]
    for name in (package, *loaded):
        monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.parametrize(
    ("package", "line"),
    [
        ("h5py", ("inspect", "log.h5")),
        ("rosbags", ("inspect", "log.mcap")),
        ("rosbags", ("fit", "log.mcap", "--map", "y=/a.b")),
        ("rosbags", ("simulate", "m.yaml", "--bag", "out.mcap")),
        ("mujoco", ("simulate", "m.yaml", "--motion", "multibody")),
    ],
)
def test_what_needs_an_extra_says_which(
    workspace: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
    package: str,
    line: tuple[str, ...],
) -> None:
    without(monkeypatch, package)
    monkeypatch.chdir(workspace)
    more = () if line[0] == "inspect" else ("--workspace", workspace)
    ended = run(capsys, *line, *more, "--json")
    told = " ".join(ended.err.split())
    assert ended.code in (1, 2)
    assert f"pip install 'sysid-workbench[{EXTRAS[package]}]'" in told
    assert told.count("sysid-workbench[") == 1
    assert "Traceback" not in told


def test_an_fmu_without_its_headers_is_one_sentence_and_verify_goes_on(
    workspace: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in ("fmpy", "libcosimpy"):
        without(monkeypatch, package)
    with pytest.raises(ModelError, match=r"sysid-workbench\[fmu\]"):
        write_package(robot_model(), workspace / "units", formats=["fmu"])
    assert not (workspace / "units").exists()
    ended = run(capsys, "verify", workspace / "plant", "--json")
    assert ended.code == 0
    skipped = {r["name"]: r["skipped"] for r in json.loads(ended.out)["runtimes"]}
    for name in ("FMPy", "libcosimpy"):
        assert skipped[name] == "fmpy is not installed: pip install 'sysid-workbench[fmu]'"
