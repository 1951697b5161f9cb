"""``sysid excite``: PWM schedules for informative logs."""

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from . import optimal, reading, render, targets
from .options import argument, changed, command, flag, group, option

if TYPE_CHECKING:
    from sysid.data.excitation import Schedule


class Design(StrEnum):
    """The kinds of schedule."""

    PRBS = "prbs"
    MULTISINE = "multisine"
    CHIRP = "chirp"
    STEPS = "steps"
    PULSES = "pulses"
    OPTIMAL = "optimal"


class Tracks(StrEnum):
    """How the two tracks are commanded relative to each other."""

    INDEPENDENT = "independent"
    EQUAL = "equal"
    OPPOSITE = "opposite"


@dataclass(frozen=True)
class Shape:
    """What a schedule looks like; each design has some of these."""

    duration: float | None = option("SECONDS", "Length.")
    dt: float = option("SECONDS", "Sample time.", "--ts", default=0.1)
    amplitude: float | None = option("US", "Largest command, PWM up to 20000 [µs].")
    clock: int | None = option("N", "prbs: shortest time at a level, in samples.", advanced=True)
    offset: float | None = option("US", "prbs, optimal: mean of the levels [µs].")
    band: tuple[float, float] | None = option(
        "LOW:HIGH", "multisine, chirp: frequencies [Hz].", parse=reading.band_of, kind=str | None
    )
    levels: int | None = option("N", "steps, pulses: number of levels.", advanced=True)
    hold: tuple[float, float] | None = option("MIN MAX", "steps: time a level is held [s].")
    on: float | None = option("SECONDS", "pulses: time each is driven.", advanced=True)
    pause: float | None = option("SECONDS", "pulses: time at rest between them.", advanced=True)
    odd: bool = flag("multisine: odd harmonics, to see distortions.")
    periods: int | None = option("N", "multisine: periods [1; with --odd 3].", min=1)
    seed: int | None = option("N", "prbs, multisine, steps, optimal: random seed.", min=0)

    def made(self) -> dict[str, Any]:
        """The options that were given, by the names of the designs' arguments."""
        return {"dt": self.dt, **changed(self)}


@command
def excite(
    design: Design = argument("|".join(Design), "Kind of schedule."),
    output: Path | None = targets.target("FILE", "CSV to write [schedule_DESIGN.csv]."),
    options: dict[str, Any] = group(Shape),
    tracks: Tracks | None = option("|".join(Tracks), "Of two tracks [independent; pulses: equal]."),
    names: list[str] | None = option("NAME", "Names of the inputs.", "-u", "--input"),
    model: str | None = reading.model("optimal: for which [the best model]."),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Write a PWM schedule that excites the plant well.

    The design optimal is made for a model: within the limits of its log, or those given, it looks
    for the switching sequence or multisine that leaves the smallest errors (D-optimal).
    """
    from sysid.data.excitation import write_schedule

    path = output or Path(f"schedule_{design.value}.csv")
    if design is Design.OPTIMAL:
        if tracks or names:
            raise UsageError("sysid excite optimal has no --tracks and no --input; omit them")
        stored = Workspace(workspace).chosen(model)
        schedule, promise = optimal.designed(stored, options)
        facts = _facts(schedule, design, write_schedule(schedule, path)) | promise
        render.document(facts) if json else optimal.show(facts)
        return
    if model is not None:
        raise UsageError(f"sysid excite {design.value} has no --model; it is for optimal")
    schedule = _schedule(design, options, tracks, tuple(names or ()))
    facts = _facts(schedule, design, write_schedule(schedule, path))
    render.document(facts) if json else _show(facts)


def _show(facts: dict[str, Any]) -> None:
    rows = [(c["name"], c["lowest"], c["highest"], c["crest_factor"]) for c in facts["inputs"]]
    heading = f"{facts['design']}: {facts['samples']} samples, {facts['duration_s']:g} s"
    render.table(("input", "lowest [µs]", "highest [µs]", "crest factor"), rows, heading)
    render.say(f"Written to {facts['schedule']}")


def _schedule(
    design: Design, options: dict[str, Any], tracks: Tracks | None, names: tuple[str, ...]
) -> "Schedule":
    """The schedule asked for; options that the design does not have are refused."""
    from inspect import signature

    import numpy as np

    from sysid.data.excitation import DESIGNS, ROBOT_INPUTS
    from sysid.data.record import Channel, frozen

    make: Any = DESIGNS[design.value]
    known = [p for p in signature(make).parameters if p not in ("names", "rotate", "tries")]
    for name in options:
        if name not in known:
            has = ", ".join("--ts" if k == "dt" else f"--{k}" for k in known)
            raise UsageError(f"sysid excite {design.value} has no --{name}; it has {has}")
    names = names or ROBOT_INPUTS
    natural = Tracks.EQUAL if design is Design.PULSES else Tracks.INDEPENDENT
    if tracks in (None, natural):
        schedule: Schedule = make(names=names, **options)
        return schedule
    if tracks is Tracks.INDEPENDENT or len(names) != 2:
        why = "has no independent tracks" if len(names) == 2 else "needs exactly two inputs"
        raise UsageError(f"sysid excite {design.value} --tracks {tracks} is impossible; it {why}")
    single = make(names=names[1:], **options)
    sense = np.array([-1.0 if tracks is Tracks.OPPOSITE else 1.0, 1.0])
    # + 0.0 turns −0 into 0
    both = frozen(single.u * sense + 0.0)
    twin: Schedule = replace(single, u=both, channels=tuple(Channel(n, "µs") for n in names))
    return twin


def _facts(schedule: "Schedule", design: Design, path: Path) -> dict[str, Any]:
    from sysid.data.excitation import crest_factor

    step = float(schedule.t[1] - schedule.t[0])
    return {
        "schedule": path,
        "design": design,
        "samples": len(schedule),
        "sample_time_s": step,
        "duration_s": len(schedule) * step,
        "inputs": [
            {
                "name": channel.name,
                "unit": channel.unit,
                "lowest": float(column.min()),
                "highest": float(column.max()),
                "crest_factor": crest_factor(column),
            }
            for channel, column in zip(schedule.channels, schedule.excited.T, strict=True)
        ],
    }
