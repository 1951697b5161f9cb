"""Work in a second process: there if it was started, here if not or if it has died."""

import os
import signal
from functools import partial

import pytest

from sysid import second_process
from sysid.second_process import SecondProcess


def own_process(name: str = "") -> int:
    return os.getpid()


def failing() -> None:
    raise ValueError("as it would here")


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)


def test_nothing_is_started_unless_asked_for() -> None:
    with SecondProcess(own_process) as second:
        assert second.call(own_process)() == os.getpid()


def test_one_core_starts_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    with SecondProcess(own_process) as second:
        second.start()
        assert second.call(own_process)() == os.getpid()


@pytest.mark.usefixtures("two_cores")
def test_what_is_called_runs_there_and_what_it_raises_is_raised_here() -> None:
    with SecondProcess(own_process) as second:
        second.start()
        there = second.call(partial(own_process, "x"))()
        assert there != os.getpid()
        second.start()  # once
        assert second.call(own_process)() == there
        with pytest.raises(ValueError, match="as it would here"):
            second.call(failing)()


@pytest.mark.usefixtures("two_cores")
def test_what_a_dead_process_leaves_is_done_here() -> None:
    with SecondProcess(own_process) as second:
        second.start()
        os.kill(second.call(own_process)(), signal.SIGKILL)
        assert second.call(own_process)() == os.getpid()
        assert second.call(own_process)() == os.getpid()


@pytest.mark.usefixtures("two_cores")
def test_a_system_that_lends_no_process_does_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError("no semaphores here")

    monkeypatch.setattr(second_process, "ProcessPoolExecutor", refused)
    with SecondProcess(own_process) as second:
        second.start()
        assert second.call(own_process)() == os.getpid()
