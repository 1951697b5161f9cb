"""Where the installed command begins: an interrupt ends it quietly while its parts still load."""

import sys


def main() -> int:
    """Run ``sysid`` with the words of the command line; return its exit code."""
    try:
        from .app import main as command

        return command()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return 130
