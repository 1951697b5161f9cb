"""Entry point of the installed command: an interrupt ends it at once, even while it loads."""

import gc
import os
import signal
import sys
import threading
import warnings

PATIENCE = 3.0
"""What a command may take to put things in order after an interrupt [s]: compilers and solvers do
not look up. What it leaves half done the next command removes."""

PROMPT = 0.5
"""How soon it is said that an interrupt was heard [s]."""

COLLECTION = (50_000, 50, 50)
"""How seldom Python looks for cycles. While libraries load nothing can be freed, and with its own
numbers it looks through all of them again and again: a tenth of the time of a short command."""


def main() -> int:
    """Run ``sysid`` with the words of the command line; its exit code.

    After an interrupt the process ends here: Python would wait for the threads of libraries, and
    end by the signal where it met one of them in code that a library makes as text.
    """
    gc.set_threshold(*COLLECTION)
    ending = Ending()
    if os.name == "posix":
        threading.Thread(target=ending.watch, args=(_heard(),), daemon=True).start()
    _silence_libraries()
    code = command(ending)
    if code == 130:
        os._exit(code)
    return code


def command(ending: "Ending") -> int:
    """Run one command; its exit code, 130 after an interrupt.

    A request to end (SIGTERM, from ``kill`` or from what supervises a service) ends it as Ctrl-C
    does, so that nodes leave their master and half-written files go.
    """
    for which in (signal.SIGINT, signal.SIGTERM):
        signal.signal(which, ending.begin)
    sys.unraisablehook = ending.lost
    try:
        from .app import main as run

        code = run()
    except KeyboardInterrupt:
        code = 130
    if code == 130 or ending.begun:
        ending.say()
        return 130
    ending.over = True
    return code


class Ending:
    """The end of a command that was interrupted; it is said once."""

    def __init__(self) -> None:
        self.begun = self.over = False
        self._said = threading.Event()

    def begin(self, number: int, frame: object) -> None:
        """Interrupt the main thread, once: a second Ctrl-C must not tear what puts things right."""
        if self.over:  # in what Python does at its end nobody takes an exception
            self.end()
        if not self.begun:
            self.begun = True
            raise KeyboardInterrupt

    def say(self) -> None:
        """Say that it was interrupted, whoever comes to it first."""
        if not self._said.is_set():
            self._said.set()
            sys.stderr.write("interrupted\n")
            sys.stderr.flush()

    def end(self) -> None:
        """End the process as it is."""
        self.say()
        os._exit(130)

    def lost(self, error: "sys.UnraisableHookArgs") -> None:
        """An exception that Python cannot pass on; an interrupt must not be lost so."""
        if error.exc_type is KeyboardInterrupt:
            self.end()

    def watch(self, heard: int) -> None:
        """End the process where the main thread does not: it may be deep in a library.

        Args:
            heard: descriptor on which the number of each signal arrives, whatever the main thread
                does.
        """
        while number := os.read(heard, 1):
            if number[0] in (signal.SIGINT, signal.SIGTERM):
                self._said.wait(PROMPT)
                self.say()
                threading.Event().wait(PATIENCE)
                self.end()


def _heard() -> int:
    """A descriptor on which signals arrive as bytes."""
    heard, written = os.pipe()
    os.set_blocking(written, False)
    signal.set_wakeup_fd(written, warn_on_full_buffer=False)
    return heard


def _silence_libraries() -> None:
    """Keep warnings and log lines of libraries off the screen; ``python -W`` shows them again."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA writes past Python
    os.environ.setdefault("PYTHONWARNINGS", "ignore")  # in processes that this one starts
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    import logging

    logging.lastResort = None


if __name__ == "__main__":
    sys.exit(main())
