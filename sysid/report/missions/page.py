"""The page of a mission: how it ends and how surely, the way, and whether the model knows it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.plant.replay import outside_range
from sysid.report.missions.panels import (
    TRACKS,
    ShownRuns,
    distribution_panels,
    share_panels,
    signal_panels,
    way_panels,
)
from sysid.report.page import Check, Page, Section
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.spec import Mission
from sysid.structures.plant import Plant

FULL = 0.999 * PWM_FULL_SCALE
"""A command from which on the drive gives all it has [µs]."""


def mission_page(
    name: str,
    mission: Mission,
    result: MissionResult,
    plant: Plant | None = None,
    runs: ShownRuns | None = None,
    *,
    warnings: Sequence[str] = (),
    commands: Sequence[str] = (),
) -> Page:
    """The page of one nominal drive and, where there are any, of the runs around it.

    Args:
        plant: what drove, for the range that it was identified on.
        warnings: what to know before believing it.
        commands: what makes it again.
    """
    # whether its inputs are the commands of a mission's log
    tracks = plant is not None and {c.name for c in plant.inputs} <= {*TRACKS}
    known = plant if tracks else None
    sections = [
        Section("The way", way_panels(mission, result, runs)),
        Section("Over time", signal_panels(result, known)),
        *(() if runs is None else _of_runs(runs)),
        _commands(result, known),
        Section("Warnings", text=tuple(warnings) or ("None.",)),
        Section("Where it comes from", code=tuple(commands)),
    ]
    said = result.sentence if runs is None else runs.batch.sentence
    return Page(
        headline(name, result),
        said,
        tuple(verdict(result, known, runs)),
        tuple(s for s in sections if s.panels or s.text or s.rows or s.code),
    )


def headline(name: str, result: MissionResult) -> str:
    """How a mission ends, and when."""
    return f"{name}: {result.outcome.value} after {result.time_s:.1f} s"


def verdict(
    result: MissionResult, plant: Plant | None, runs: ShownRuns | None = None
) -> list[Check]:
    """Whether it arrives, keeps clear, and is driven where the model knows the robot."""
    well = result.outcome is Outcome.ARRIVED
    checks: list[Check] = [
        ("good" if well else "bad", f"Nominal drive: {result.sentence}"),
    ]
    if runs is not None:
        arrived = runs.batch.outcomes["arrived"]
        low, high = (100.0 * v for v in arrived.interval)
        words = f"{arrived.count} of {runs.batch.n} runs arrive (95 %: {low:.1f} to {high:.1f} %)."
        checks.append(("good" if arrived.count == runs.batch.n else "bad", words))
    if result.min_clearance_m is not None:
        near = result.min_clearance_m
        words = f"The robot's centre keeps {near:.2f} m from the nearest obstacle."
        checks.append(("good" if near > 0.0 else "bad", words))
    full = 100.0 * float(np.mean(_at_full_drive(result).any(axis=1)))
    if full > 0.0:
        checks.append(("note", f"A command is at full drive in {full:.1f} % of the time."))
    if plant is not None and len(plant.input_range):
        outside = 100.0 * float(np.mean(outside_range(plant, _u(plant, result)).any(axis=1)))
        if outside > 0.0:
            words = (
                f"In {outside:.1f} % of the time a command is outside what the plant was "
                "identified on: there it extrapolates."
            )
            checks.append(("bad", words))
        else:
            checks.append(("good", "All commands are within what the plant was identified on."))
    return checks


def _u(plant: Plant, result: MissionResult) -> Array:
    return np.column_stack([result.log[c.name] for c in plant.inputs])


def _at_full_drive(result: MissionResult) -> NDArray[np.bool_]:
    return np.asarray(np.abs(np.column_stack([result.log[n] for n in TRACKS])) >= FULL)


def _commands(result: MissionResult, plant: Plant | None) -> Section:
    """How far each command goes, and how long beyond what is known."""
    full = _at_full_drive(result).mean(axis=0)
    ranges = (
        dict(zip([c.name for c in plant.inputs], plant.input_range, strict=False)) if plant else {}
    )
    outside = (
        dict(zip(ranges, outside_range(plant, _u(plant, result)).mean(axis=0), strict=False))
        if plant is not None
        else {}
    )
    rows = []
    for k, name in enumerate(TRACKS):
        u = result.log[name]
        low, high = ranges.get(name, (np.nan, np.nan))
        rows.append((
            name,
            f"{u.min():.0f} to {u.max():.0f}",
            f"{low:.0f} to {high:.0f}" if name in ranges else "not known",
            f"{100.0 * outside[name]:.1f} %" if name in outside else "–",
            f"{100.0 * full[k]:.1f} %",
        ))  # fmt: skip
    heads = ("command", "in the mission [µs]", "identified on [µs]", "time outside",
             "time at full drive")  # fmt: skip
    return Section("Saturation and extrapolation", heads=heads, rows=tuple(rows))


def _of_runs(runs: ShownRuns) -> list[Section]:
    batch = runs.batch
    rows = tuple(
        (name, str(o.count), f"{100 * o.share:.3g} %",
         "{:.3g} to {:.3g} %".format(*(100 * v for v in o.interval)))
        for name, o in batch.outcomes.items()
    )  # fmt: skip
    matters = share_panels(batch)
    worst = tuple(
        (str(w.seed), w.outcome, "–" if w.time_s is None else f"{w.time_s:.1f}")
        for w in batch.worst
    )
    return [
        Section(f"{batch.n} runs", distribution_panels(batch),
                heads=("outcome", "runs", "share", "95 % interval"), rows=rows),
        Section("What matters", matters,
                ("Sobol's first-order shares, by regression on what was drawn.",))
        if matters
        else Section("What matters", text=("Too few runs to say it.",)),
        Section("Worst runs", heads=("seed", "outcome", "time [s]"), rows=worst),
    ]  # fmt: skip
