"""The example package as its users get it: built into a wheel, installed apart, run afresh."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "plugin"


@dataclass(frozen=True)
class Installed:
    """The folder that the wheel was installed to, and how to run sysid beside it.

    Attributes:
        site: the folder.
    """

    site: Path

    def sysid(self, *arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
        """Run the command line in a fresh process that finds the package."""
        code = "import sys; from sysid_cli.app import main; sys.exit(main(sys.argv[1:]))"
        return self.python("-c", code, *arguments, folder=folder)

    def python(self, *arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
        """Run Python in a fresh process that finds the package."""
        return _process(*arguments, folder=folder, path=self.site)

    def document(self, *arguments: object, folder: Path) -> dict[str, Any]:
        """Run a command with ``--json`` and read what it prints."""
        done = self.sysid(*arguments, "--json", folder=folder)
        assert done.returncode == 0, done.stderr
        found: dict[str, Any] = json.loads(done.stdout)
        return found


def _process(
    *arguments: object, folder: Path, path: Path | None = None
) -> subprocess.CompletedProcess[str]:
    more: Mapping[str, str] = {} if path is None else {"PYTHONPATH": str(path)}
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=folder,
        env=os.environ | more | {"PIP_NO_INDEX": "1", "PIP_DISABLE_PIP_VERSION_CHECK": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


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
        done = _process("-m", "pip", *step, folder=folder)
        assert done.returncode == 0, done.stdout + done.stderr
    return Installed(folder / "site")


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Path:
    """The package's source, importable in this process: for looking at one class of it."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    return EXAMPLE
