"""The example package as its users get it: installed from its wheel, run in a fresh process."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "plugin"


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
        return process(*arguments, folder=folder, path=self.site)

    def document(self, *arguments: object, folder: Path) -> dict[str, Any]:
        """Run a command with ``--json`` and read what it prints."""
        done = self.sysid(*arguments, "--json", folder=folder)
        assert done.returncode == 0, done.stderr
        found: dict[str, Any] = json.loads(done.stdout)
        return found


def process(
    *arguments: object, folder: Path, path: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder, offline, with one more place to import from."""
    more: Mapping[str, str] = {} if path is None else {"PYTHONPATH": str(path)}
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=folder,
        env=os.environ | more | {"PIP_NO_INDEX": "1", "PIP_DISABLE_PIP_VERSION_CHECK": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
