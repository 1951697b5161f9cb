"""Second processes end with the one that started them, and keep within their limits."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sysid import launcher, processes

linux = pytest.mark.skipif(sys.platform != "linux", reason="the limits are those of Linux")

KILLED = """
import os
import time
from multiprocessing import get_context
from pathlib import Path
from sysid import processes

if __name__ == "__main__":
    sleep = (os.getpid(), time.sleep, 60.0)
    worker = get_context("spawn").Process(target=processes.tied, args=sleep)
    worker.start()
    with processes.started(["sleep", "60"], Path({folder!r})) as command:
        while Path(f"/proc/{{command.pid}}/comm").read_text() != "sleep\\n":
            time.sleep(0.01)
        print(worker.pid, command.pid, flush=True)
        time.sleep(60.0)
"""


def lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@linux
def test_a_killed_process_leaves_none_behind(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(KILLED.format(folder=str(tmp_path)))
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        children = [int(word) for word in parent.stdout.readline().split()]
        assert len(children) == 2
        parent.send_signal(signal.SIGKILL)
    until = time.monotonic() + 10.0
    while any(map(lives, children)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(map(lives, children))


@linux
@pytest.mark.parametrize(
    ("attempt", "most"),
    [
        ("open('big', 'wb').truncate(1 << 30)", "File too large"),
        ("bytearray(4 << 30)", "MemoryError"),
        ("[open('/dev/null') for _ in range(300)]", "Too many open files"),
    ],
)
def test_a_command_keeps_within_limits(tmp_path: Path, attempt: str, most: str) -> None:
    done = processes.run([sys.executable, "-S", "-c", attempt], tmp_path, 20.0)
    assert done.code == 1
    assert most in done.err


def test_what_a_command_prints_without_end_is_cut(tmp_path: Path) -> None:
    done = processes.run(["sh", "-c", "yes | head -c 3000000; sleep 60 & exit 3"], tmp_path, 20.0)
    assert (done.code, len(done.out)) == (3, processes.MOST_PRINTED)  # and nobody waits for sleep
    with pytest.raises(TimeoutError):
        processes.run(["sleep", "60"], tmp_path, 0.2)


@linux
@pytest.mark.parametrize("code", ["import socket; socket.socket()", "import os; os.setsid()"])
def test_code_of_somebody_else_has_no_network_and_outlives_nobody(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = f"import os; os.fork() and os._exit(os.wait()[1] >> 8)\n{code}"  # no leader itself
    done = processes.run([sys.executable, "-S", "-c", code], tmp_path, 20.0, foreign=True)
    assert "PermissionError" in done.err
    monkeypatch.setattr(launcher, "_SYSTEMS", {})
    assert not launcher.close_network()  # then ``main`` does not become the command
