"""Display while following: a live table, or a line now and then."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from .. import render

if TYPE_CHECKING:
    from rich.console import RenderableType

    from sysid.estimation.assessment.delta_method import Estimate
    from sysid.estimation.online.live_state import LiveChange, LivePair, LiveState

ZONE_WORDS = {"command": "in the command", "friction": "friction", "both": "command and friction"}
"""What a dead zone is, by its law."""


def with_error(value: float, error: float, unit: str = "") -> str:
    """``8.65e-4 ± 9e-6 µs``; a dash where there is no number, and no error where none is known."""
    text = render.number(value, 4)
    shown = (
        text if text == "–" or not error < float("inf") else f"{text} ± {render.reach(error, 1)}"
    )
    return f"{shown} {unit}".strip() if text != "–" else text


def zone_words(pair: "LivePair", unit: str) -> str:
    """The dead zone of a pair's input in a few words."""
    zone = pair.dead_zone
    if zone is None:
        return "–"
    if not zone.seen:
        return "none seen"
    return f"{with_error(zone.value, zone.std_error, unit)} ({ZONE_WORDS[zone.law]})"


def change_sentence(change: "LiveChange") -> str:
    """When the plant changed, what, and by how much."""
    moved = [
        f"{n.input} → {n.output}: gain {_moved(n.gain_before, n.gain_after)}, "
        f"time constant {_moved(n.time_constant_before, n.time_constant_after, 's')}"
        for n in change.numbers
        if n.output == change.output
    ]
    return (
        f"The plant changed at {change.time:.4g} s (± {change.within:.2g} s), seen in "
        f"{change.output}: {'; '.join(moved)}."
    )


def _moved(before: "Estimate", after: "Estimate | None", unit: str = "") -> str:
    """By how much a number changed, and from what to what; only what errors do not explain."""
    first = with_error(before.value, before.std_error)
    if after is None:
        return f"{first} before, not known yet after"
    ends = f"({first} → {with_error(after.value, after.std_error, unit)})"
    change = after.value - before.value
    if not abs(change) > SURELY * (before.std_error**2 + after.std_error**2) ** 0.5:
        return f"not significantly changed {ends}"
    share = 100.0 * abs(change / before.value) if before.value else float("inf")
    way = "falls" if abs(after.value) < abs(before.value) else "rises"
    return f"{way} by {share:.2g} % {ends}"


SURELY = 3.0
"""Standard errors by which a number must have moved to be said to have changed."""


def excitation_sentence(state: "LiveState") -> str:
    """Whether the excitation is enough, and if not what lacks."""
    poor = [e for e in state.excitation if not e.enough]
    if not poor:
        least = min(e.smallest for e in state.excitation)
        need = state.excitation[0].need
        return f"Excitation sufficient (least information {least:.3g}, needed {need:.3g})."
    return "Excitation not enough yet: " + " ".join(
        f"{e.output} {e.smallest:.3g} of {e.need:.3g}: {e.why}" for e in poor
    )


def line(state: "LiveState", units: dict[str, str]) -> str:
    """All of it in one line, for a file or a pipe."""
    pairs = [
        f"{p.input} → {p.output}: gain {with_error(p.gain.value, p.gain.std_error, p.unit)}, "
        f"time constant {with_error(p.time_constant.value, p.time_constant.std_error, 's')}, "
        f"dead zone {zone_words(p, units.get(p.input, ''))}"
        f"{', settled' if p.settled else ''}"
        for p in state.pairs
    ]
    return (
        f"{state.seconds:.4g} s, {state.rows} rows. "
        f"{'; '.join(pairs) or 'nothing moves yet'}. {excitation_sentence(state)}"
    )


def screen(state: "LiveState", units: dict[str, str], where: str) -> "RenderableType":
    """The table of a terminal."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(header_style="bold", title=f"{where}: {state.seconds:.1f} s, {state.rows} rows")
    headings = ("", "gain", "time constant [s]", "dead zone of the input", "settled")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    for p in state.pairs:
        table.add_row(
            Text(f"{p.input} → {p.output}"),
            Text(with_error(p.gain.value, p.gain.std_error, p.unit)),
            Text(with_error(p.time_constant.value, p.time_constant.std_error)),
            Text(zone_words(p, units.get(p.input, ""))),
            Text("yes" if p.settled else "not yet", style="green" if p.settled else "yellow"),
        )
    enough = Text(excitation_sentence(state), style="green" if state.enough else "yellow")
    noise = ", ".join(f"{n} {render.number(v, 3)}" for n, v in state.noise.items())
    said = [Text(f"One-step errors: {noise}.", style="dim"), enough]
    said += [Text(change_sentence(c), style="bold red") for c in state.changes]
    return Group(table, *said, Text("Ctrl-C ends following and keeps the model.", style="dim"))


class View:
    """Shows states as they come."""

    def __init__(self, where: str, quiet: bool) -> None:
        self._where, self._quiet = where, quiet
        self._shown = 0

    @contextmanager
    def shown(self) -> Iterator["View"]:
        """As long as this lasts a terminal shows the newest state."""
        with render.screen(not self._quiet) as draw:
            self._draw = draw
            yield self

    def waiting(self) -> None:
        if not self._quiet:
            render.warn(f"Waiting for {self._where} (Ctrl-C ends).")

    def state(self, state: "LiveState", units: dict[str, str]) -> None:
        if self._quiet:
            return
        if self._draw is not None:
            self._draw(screen(state, units, self._where))
            return
        for change in state.changes[self._shown :]:
            render.say(change_sentence(change), "bold")
        self._shown = len(state.changes)
        render.say(line(state, units))
