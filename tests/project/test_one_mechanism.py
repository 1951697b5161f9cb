"""What has to be done with care is done in one place, which everything else calls."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

PLACES = {
    "second processes": (
        r"^\s*(import|from) (subprocess|multiprocessing|joblib)\b|ProcessPoolExecutor|os\.fork\(",
        {
            "sysid/processes.py",
            # joblib, whose calls are `tied`
            "sysid/robot/mission/batch/pool.py",
            "sysid/estimation/selection/select_structure.py",
        },
    ),
    "opening files": (
        r"(?<![\w.])(?<!def )open\(|os\.open\(|\.open\(\"r|\.read_bytes\(",
        {
            "sysid/data/files.py",
            "sysid/launcher.py",  # what a process may write to
            "sysid/data/following/lines.py",  # pipes and serial ports that are followed
            "sysid/workspace/store.py",  # its lock
            "sysid/export/fmu/archive.py",  # what the compiler made
            "cli/app.py",  # the null device
        },
    ),
    "replacing files": (
        r"os\.(replace|rename)\(|write_bytes\(|mkstemp|mkdtemp|\.rename\(new\)",
        {"sysid/data/files.py", "sysid/data/bags/writing.py"},
    ),
}


@pytest.mark.parametrize("what", PLACES)
def test_it_is_done_in_one_place(what: str) -> None:
    pattern, places = PLACES[what]
    seen = {
        path.relative_to(ROOT).as_posix()
        for folder in ("sysid", "cli")
        for path in ROOT.joinpath(folder).rglob("*.py")
        if re.search(pattern, path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert seen == places
