"""Follow a log or a topic, and keep the final model."""

import hashlib
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

from sysid.errors import DataError, UsageError
from sysid.workspace.store import Workspace

from .options import Following
from .view import View

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.estimation.identify import Identification, Request
    from sysid.estimation.online.follower import Follower, LogFeed
    from sysid.estimation.online.live_state import LiveState

POLL = 0.05
"""Seconds between two looks at a file: a person sees no delay, and a core is left alone."""


@dataclass(frozen=True, eq=False)
class Followed:
    """What following left behind.

    Attributes:
        found: the model, judged on the rows it stands on.
        log: those rows as a file.
        records: the same as read again.
    """

    found: "Identification"
    state: "LiveState"
    log: Path
    records: "tuple[Record, ...]"


def follow(
    logs: Sequence[Path],
    how: Following,
    request: "Request",
    read: "ReadOptions",
    workspace: Workspace,
    stop: list[int],
    quiet: bool,
) -> Followed:
    """Follow one log until it is to end, and make the model.

    Args:
        stop: of ``stopping``: following ends when something stands there.
    """
    from sysid.estimation.online.follower import Follower, LiveOptions

    options = LiveOptions(_orders(request), how.forgetting, how.false_alarms, request.detrend)
    feed = _feed(logs, read)
    view = View(feed.where, quiet)
    follower = Follower(feed, options)
    try:
        with view.shown():
            ending = _run(follower, how, view, stop)
    finally:
        feed.close()
    return _kept(follower, ending, request, workspace)


def check_alone(validation: Sequence[Path] | None, steps: "Preparation") -> None:
    """Refuse what looks at a finished log."""
    if validation or steps.to_json():
        raise UsageError(
            "`follow` takes rows as they arrive; omit `validation` and preparation options"
        )


def _orders(request: "Request") -> Any:
    """The orders asked for; what following cannot do is refused."""
    from sysid.estimation.identify import Request
    from sysid.fitting.options import FitOptions
    from sysid.structures.orders import parse_orders

    if request.structures not in ((), ("arx",)):
        raise UsageError(
            f"only arx can be followed row by row, got {request.structures[0]}; fit the finished "
            "log"
        )
    if replace(request.options, extra={}) != FitOptions():
        raise UsageError(
            "`follow` solves plain least squares; omit the search options, or fit the finished log"
        )
    if request.split is not None or request.criterion != Request().criterion:
        raise UsageError("`follow` takes every row as it arrives; omit `split` and `criterion`")
    return None if request.orders is None else parse_orders(request.orders.removeprefix("arx:"))


def _feed(logs: Sequence[Path], read: "ReadOptions") -> "LogFeed":
    from sysid.data.following.lines import lines_of
    from sysid.data.following.rows import check_followable
    from sysid.estimation.online.follower import LogFeed

    if len(logs) != 1:
        raise UsageError(f"one log can be followed at a time, got {len(logs)}; name one")
    check_followable(read)
    source = str(logs[0])
    if not _is_topic(source):
        if read.map:
            raise UsageError(
                f"{source} is a file: `map` does not apply; follow a topic, or name its columns"
            )
        return LogFeed(lines_of(source), read)
    from sysid.cosim.ros.topic_lines import TopicLines

    return LogFeed(TopicLines(source, read.map), replace(read, map={}))


def _is_topic(source: str) -> bool:
    """Whether a name is a topic's: it begins with a slash, and no folder could hold such a file."""
    path = Path(source)
    if not source.startswith("/") or path.exists() or path.suffix:
        return False
    return path.parent == Path("/") or not path.parent.is_dir()


def _run(follower: "Follower", how: Following, view: View, stop: list[int]) -> str:
    """Take rows until something ends it; how it ended, as a sentence."""
    began = last_row = monotonic()
    shown, changed, waited = began, False, False
    while True:
        rows, _ = follower.poll()
        now = monotonic()
        if rows:
            last_row, changed = now, True
        ending = _ending(how, stop, now - began, now - last_row, follower.feed.ended)
        if ending:
            follower.poll(last=True)
            return ending
        if now - shown >= how.every:
            shown = now
            if changed and follower.live is not None:
                units = {c.name: c.unit for c in follower.feed.reader.inputs}
                view.state(follower.live.state(), units)
                changed = False
            elif follower.live is None and not waited:
                follower.poll(last=True)  # a slow log: its first lines must do
                waited = follower.live is None
                if waited:
                    view.waiting()
        if not rows:
            sleep(POLL)


def _ending(how: Following, stop: list[int], seconds: float, idle: float, ended: bool) -> str:
    if stop:
        return "Ended by hand."
    if how.seconds is not None and seconds >= how.seconds:
        return f"Ended after {how.seconds:g} s."
    if how.idle is not None and idle >= how.idle:
        return f"Ended: no row has come for {how.idle:g} s."
    return "Ended: nothing more can come." if ended else ""


def _kept(follower: "Follower", ending: str, request: "Request", workspace: Workspace) -> Followed:
    """The model, and the rows it stands on as a log of the workspace."""
    from sysid.data.files import write_atomic
    from sysid.data.preparation import Preparation, read_prepared
    from sysid.estimation.online.follower import identification, kept_log

    if follower.live is None:
        raise DataError(f"{follower.feed.where}: no rows arrived; check the log's name")
    live = follower.live
    state = live.state()
    text, read = kept_log(live)
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    stem = Path(follower.feed.where.replace("/", "_")).stem.strip("_") or "stream"
    log = write_atomic(workspace.followed_dir / f"{stem}-{digest}.csv", text)
    records, _ = read_prepared([log], read, Preparation())
    extra = {
        **request.options.extra,
        "files": [str(log.resolve())],
        "read": read.to_json(),
        "prepare": {},
        "detrend": request.detrend,
        "followed": follower.feed.where,
        "forgetting": follower.options.forgetting,
    }
    options = replace(request.options, extra=extra)
    identified = identification(live, records, options, request.policy)
    return Followed(replace(identified, reason=ending), state, log, records)


@contextmanager
def stopping(wanted: bool) -> Iterator[list[int]]:
    """Ctrl-C, or a request to end, is noted here instead of tearing a row apart.

    A second one interrupts as usual: what is being written then is written whole, or not at all.
    """
    noted: list[int] = []
    before: dict[signal.Signals, Any] = {}

    def note(number: int, _frame: object) -> None:
        noted.append(number)
        for which, old in before.items():
            signal.signal(which, old)

    # outside the main thread whoever runs this ends it otherwise
    if wanted and threading.current_thread() is threading.main_thread():
        watched = signal.set_wakeup_fd(-1)  # nobody ends the process for a signal that was noted
        for which in (signal.SIGINT, signal.SIGTERM):
            before[which] = signal.signal(which, note)
    try:
        yield noted
    finally:
        for which, old in before.items():
            signal.signal(which, old)
        if before:
            signal.set_wakeup_fd(watched)
