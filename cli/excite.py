"""``sysid excite``: PWM schedules for informative logs."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import UsageError

from . import reading, render, targets

if TYPE_CHECKING:
    from sysid.data.schedule import Schedule


class Design(StrEnum):
    """The kinds of schedule."""

    PRBS = "prbs"
    MULTISINE = "multisine"
    CHIRP = "chirp"
    STEPS = "steps"
    PULSES = "pulses"


class Tracks(StrEnum):
    """How the two tracks are commanded relative to each other."""

    INDEPENDENT = "independent"
    EQUAL = "equal"
    OPPOSITE = "opposite"


def shape(
    duration: Annotated[float | None, typer.Option(metavar="S", help="Length [s].")] = None,
    dt: Annotated[float, typer.Option(metavar="S", help="Sample time [s].")] = 0.1,
    amplitude: Annotated[
        float | None, typer.Option(metavar="US", help="Largest PWM, up to 20000 [µs].")
    ] = None,
    clock: Annotated[
        int | None, typer.Option(metavar="N", help="prbs: shortest time at a level, in samples.")
    ] = None,
    offset: Annotated[
        float | None, typer.Option(metavar="US", help="prbs: mean of the levels [µs].")
    ] = None,
    band: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="multisine, chirp: frequencies [Hz]."),
    ] = None,
    levels: Annotated[
        int | None, typer.Option(metavar="N", help="steps, pulses: number of levels.")
    ] = None,
    hold: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="MIN MAX", help="steps: time a level is held [s]."),
    ] = None,
    on: Annotated[
        float | None, typer.Option(metavar="S", help="pulses: time each is driven [s].")
    ] = None,
    pause: Annotated[
        float | None, typer.Option(metavar="S", help="pulses: time at rest between them [s].")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="prbs, multisine, steps: random seed.")
    ] = None,
) -> dict[str, Any]:
    """The options of the schedule that were given, by the names of the designs' arguments."""
    given = {
        "dt": dt, "duration": duration, "amplitude": amplitude, "clock": clock, "offset": offset,
        "band": band, "levels": levels, "hold": hold, "on": on, "pause": pause, "seed": seed,
    }  # fmt: skip
    return {name: value for name, value in given.items() if value is not None}


@reading.composed(options=shape)
def excite(
    design: Annotated[Design, typer.Argument(help="Kind of schedule.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help="CSV to write [schedule_DESIGN.csv]."),
    ] = None,
    *,
    options: dict[str, Any],
    tracks: Annotated[
        Tracks | None, typer.Option(help="Commands of the two tracks [independent; pulses: equal].")
    ] = None,
    names: Annotated[
        list[str] | None, typer.Option("--input", metavar="NAME", help="Names of the inputs.")
    ] = None,
    json: reading.Json = False,
) -> None:
    """Write a PWM schedule that excites the plant well."""
    from sysid.data.schedule import write_schedule

    path = output or Path(f"schedule_{design.value}.csv")
    targets.check(path, "-o")
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
    from dataclasses import replace
    from inspect import signature

    import numpy as np

    from sysid.data.excitation import DESIGNS, ROBOT_INPUTS
    from sysid.data.record import Channel, frozen

    make: Any = DESIGNS[design.value]
    known = [p for p in signature(make).parameters if p not in ("names", "rotate", "tries")]
    for name in options:
        if name not in known:
            raise UsageError(
                f"sysid excite {design.value} has no --{name}; it has "
                + ", ".join(f"--{k}" for k in known)
            )
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
    from sysid.data.schedule import crest_factor

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
