"""Entry point of the installed command: an interrupt ends it quietly, even while it loads."""

import os
import signal
import sys

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Settings of NumPy's linear algebra. Its matrices are small here: threads that wait for each other
cost more than they bring, and on a busy machine a fit takes many times as long (set them to more
for large regressions)."""


def main() -> int:
    """Run ``sysid`` with the words of the command line; return its exit code.

    A request to end (SIGTERM, from ``kill`` or from what supervises a service) ends it as Ctrl-C
    does, so that nodes leave their master and half-written files go.
    """
    signal.signal(signal.SIGTERM, _ended)
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    try:
        from .app import main as command

        return command()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return 130


def _ended(number: int, frame: object) -> None:
    raise KeyboardInterrupt
