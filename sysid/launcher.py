"""Start a command that ends with its parent and keeps within limits: ``launcher.py PARENT 0|1 …``.

A script of its own, without a module of the project: it runs in the new process, as
``python -I launcher.py PARENT FOREIGN COMMAND…``, and becomes the command. PARENT is the id of the
process that starts it; FOREIGN is 1 for code of somebody else, which gets no network and may write
below the current folder alone, as far as the system can (seccomp and Landlock of Linux).
"""

import ctypes
import os
import signal
import struct
import sys

REFUSED = 126
"""Exit code where the network cannot be closed, as of a shell that may not run a command."""

LIMITS = {
    "RLIMIT_AS": 8 << 30,  # an emulator reserves four of them
    "RLIMIT_DATA": 2 << 30,  # and its translated code takes one
    "RLIMIT_FSIZE": 64 << 20,
    "RLIMIT_NOFILE": 256,
    "RLIMIT_CPU": 240,
    "RLIMIT_CORE": 0,
}
"""Of the command: bytes of addresses, of memory, of a file; open files; seconds."""

_SYSTEMS = {
    "x86_64": (0xC000003E, (41, 109, 112, 425)),
    "aarch64": (0xC00000B7, (198, 154, 157, 425)),
}
"""Machine → its mark in a system call, and the numbers of the calls that are refused: ``socket``;
``setpgid`` and ``setsid``, by which a process would outlive the one that started it;
``io_uring_setup``, which opens sockets without the first."""

_X32 = 0x40000000  # other numbers of the same calls

_NO_NEW_PRIVILEGES, _SECCOMP, _DEATH_SIGNAL = 38, 22, 1
_REFUSE, _ALLOW, _KILL = 0x00050000 | 13, 0x7FFF0000, 0x80000000

_WRITING = 0x1FF2
"""Rights of Landlock to write, make and remove files."""


def main(parent: str, foreign: str, *command: str) -> int:
    """Become the command; the exit code where that is not possible."""
    if sys.platform == "linux":
        _libc().prctl(_DEATH_SIGNAL, int(signal.SIGKILL))
        if os.getppid() != int(parent):
            return REFUSED  # it ended before it could be waited for
    if os.name == "posix":
        import resource

        for name, most in LIMITS.items():
            hard = resource.getrlimit(getattr(resource, name))[1]
            value = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(getattr(resource, name), (value, value))
    if foreign == "1":
        if not close_network():
            return REFUSED
        keep_writing_within(".")
    return os.execvp(command[0], command)


def close_network() -> bool:
    """Refuse this process and its children every new socket; whether that could be done."""
    machine = os.uname().machine if sys.platform == "linux" else ""
    if machine not in _SYSTEMS:
        return False
    mark, refused = _SYSTEMS[machine]
    program = [
        (0x20, 0, 0, 4),  # the machine of the call
        (0x15, 1, 0, mark),
        (0x06, 0, 0, _KILL),
        (0x20, 0, 0, 0),  # its number
        (0x35, len(refused) + 1, 0, _X32),
        *((0x15, len(refused) - k, 0, number) for k, number in enumerate(refused)),
        (0x06, 0, 0, _ALLOW),
        (0x06, 0, 0, _REFUSE),
    ]
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *step) for step in program))
    filter_ = struct.pack("HxxxxxxP", len(program), ctypes.addressof(code))
    libc = _libc()
    if libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0) != 0:
        return False
    return int(libc.prctl(_SECCOMP, 2, filter_, 0, 0)) == 0


def keep_writing_within(folder: str) -> None:
    """Let this process and its children write below a folder and nowhere else, where Linux can."""
    libc = _libc()
    ruleset = libc.syscall(444, struct.pack("Q", _WRITING), ctypes.c_size_t(8), 0)
    if ruleset < 0:
        return
    for place, rights in ((folder, _WRITING), ("/dev/null", 0x2)):
        descriptor = os.open(place, os.O_PATH)
        libc.syscall(445, ruleset, 1, struct.pack("=Qi", rights, descriptor), 0)
        os.close(descriptor)
    libc.syscall(446, ruleset, 0)


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
