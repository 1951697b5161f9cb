"""Entry point of the installed command: an interrupt ends it quietly, even while it loads."""

import signal
import sys


def main() -> int:
    """Run ``sysid`` with the words of the command line; return its exit code.

    A request to end (SIGTERM, from ``kill`` or from what supervises a service) ends it as Ctrl-C
    does, so that nodes leave their master and half-written files go.
    """
    signal.signal(signal.SIGTERM, _ended)
    try:
        from .app import main as command

        return command()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return 130


def _ended(number: int, frame: object) -> None:
    raise KeyboardInterrupt
