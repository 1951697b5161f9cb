"""The example package, built and installed once for all tests of this folder."""

import shutil
from pathlib import Path

import pytest
from example_package import EXAMPLE, Installed, process


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The package from its wheel; built offline and with what is installed here."""
    folder = tmp_path_factory.mktemp("plugin")
    # A build writes beside the source.
    shutil.copytree(
        EXAMPLE, folder / "source", ignore=shutil.ignore_patterns("build", "*.egg-info")
    )
    build = ("wheel", "--no-build-isolation", "--no-deps", "-w", "wheels", "./source")
    target = ("install", "--no-deps", "--target", "site", "--find-links", "wheels")
    for step in (build, (*target, "sysid-example-plugin")):
        done = process("-m", "pip", *step, folder=folder)
        assert done.returncode == 0, done.stdout + done.stderr
    return Installed(folder / "site")


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Path:
    """The package's source, importable in this process: for looking at one class of it."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    return EXAMPLE
