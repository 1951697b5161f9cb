"""Options of many runs of a mission, and what ``sysid simulate --runs`` shows."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from .. import render, targets
from ..options import changed, option

if TYPE_CHECKING:
    from sysid.plant.package import Package
    from sysid.report.missions.panels import ShownRuns
    from sysid.robot.mission.batch.setup import Setup
    from sysid.robot.mission.contracts import SteppablePlant
    from sysid.robot.mission.monte_carlo.mission_runs import MissionRuns
    from sysid.robot.mission.spec import Mission
    from sysid.structures.model import Model
    from sysid.workspace.store import Workspace


@dataclass(frozen=True)
class Repeats:
    """How often a mission is driven, and what differs from run to run.

    Attributes:
        runs: None for one.
        seed: of the batch, of a run of it to replay, or of the noise of one run; None for 0.
        vary: names of what varies; None for what the mission says.
        scheduler: who runs them; None for this process.
        measured: log of a drive to lay over the runs; None for none.
    """

    runs: int | None = option("N", "Number of runs, each with its own draws.", "-n", "--runs")
    seed: int | None = option(
        "N",
        "Seed of the runs; without --runs, of the sensor noise or of the run to replay [0].",
        min=0,
    )
    vary: tuple[str, ...] | None = option(
        "LIST",
        "Quantities that vary; parameters, noise, start, obstacles, friction, soil, mass, models "
        "[as the mission says].",
        parse=lambda text: tuple(name.strip() for name in text.split(",")),
        kind=str | None,
    )
    scheduler: str | None = option(
        "WHO",
        "With --runs: processes, or the address of a Dask scheduler [threads].",
        advanced=True,
    )
    measured: Path | None = option(
        "LOG", "Log of a measured drive of this mission, with its pose, to compare with the runs."
    )

    def __post_init__(self) -> None:
        if self.vary is not None and (self.runs, self.seed, self.measured) == (None,) * 3:
            raise UsageError("--vary belongs to --runs, or to the --seed of one run; add one")
        if self.scheduler is not None and self.runs is None:
            raise UsageError("--scheduler belongs to --runs; add --runs")

    def refuse(self, why: str) -> None:
        """Refuse the options of many runs.

        Args:
            why: with ``{}`` for the option.
        """
        for name in changed(self):
            raise UsageError(why.format(f"--{name}"))


@dataclass(frozen=True, eq=False)
class Ride:
    """One run as it is driven.

    Attributes:
        mission: with its own start and obstacles.
        known: what control takes it for.
        warnings: what was assumed.
    """

    mission: "Mission"
    robot: "SteppablePlant"
    known: "SteppablePlant"
    warnings: tuple[str, ...]
    seed: int
    noise_seed: int


def candidates(
    place: "Workspace", package: "Package", mission: "Mission", how: Repeats
) -> "list[Model]":
    """The package's model and, where models vary, the others of the workspace of the same logs."""
    exported = package.model()
    varies = mission.vary.models if how.vary is None else "models" in how.vary
    if not varies:
        return [exported]
    logs = [d["sha256"] for d in package.description["data"]]
    models = [exported]
    for stored in place.all():
        other = stored.model
        same_plant = all(
            getattr(other, n) == getattr(exported, n) for n in ("dt", "inputs", "outputs")
        )
        same_theta = other.theta.tolist() == exported.theta.tolist()
        same_model = same_theta and other.structure == exported.structure
        if same_plant and not same_model and [d.sha256 for d in other.provenance.data] == logs:
            models.append(other)
    return models


def ride(mission: "Mission", package: "Package", models: "Sequence[Model]", how: Repeats) -> Ride:
    """One run: nominal with the noise of a small seed, or the run of a batch whose seed it is."""
    from sysid.robot.mission.batch.sampler import is_run_seed
    from sysid.robot.mission.tracks.compensation import nothing_to_undo
    from sysid.robot.mission.tracks.mapping import as_robot

    seed = how.seed or 0
    if how.vary is None and not is_run_seed(seed):
        robot, warnings = as_robot(package.plant(), mission)
        warnings += nothing_to_undo(robot, mission.control.compensate)
        return Ride(mission, robot, robot, warnings, seed, seed)
    from sysid.robot.mission.batch.setup import Setup

    setup = Setup.of(mission, models, how.vary)
    varied, robot, noise = setup.alone(seed)
    note = f"One run of a batch; drawn quantities: {', '.join(setup.varied) or 'no quantities'}."
    return Ride(varied, robot, setup.known(seed), (note, *setup.notes(0, 0, 1)), seed, noise)


def batch_of(
    path: Path, mission: "Mission", models: "Sequence[Model]", how: Repeats
) -> "tuple[Setup, MissionRuns]":
    """The mission driven many times."""
    from sysid.robot.mission.batch.setup import Setup
    from sysid.robot.mission.monte_carlo.runs import simulate_runs

    runs = how.runs or 0
    with render.progress(f"Driving {path.name}", runs) as advance:
        batch = simulate_runs(
            mission, models, runs, how.seed or 0, how.vary, how.scheduler, advance
        )
    return Setup.of(mission, models, how.vary), batch


def drive_many(
    path: Path, mission: "Mission", models: "Sequence[Model]", table: Path, how: Repeats
) -> "tuple[dict[str, Any], ShownRuns]":
    """Drive the mission many times; a row a run is written to ``table``; what a picture shows."""
    from sysid.report.missions.panels import shown_runs
    from sysid.robot.mission.monte_carlo.mission_runs import write_runs

    setup, batch = batch_of(path, mission, models, how)
    targets.make_folder(table, "-o")
    facts = {
        "runs": batch.summary(),
        "log": write_runs(batch, table),
        "warnings": list(batch.notes),
    }
    return facts, shown_runs(setup, batch)


def show_many(path: Path, facts: dict[str, Any], how: Repeats) -> None:
    """Tables, the sentence, and how to see a run again."""
    batch = facts["runs"]
    rows = [
        (name, o["count"], f"{100 * o['share']:.3g}",
         "{:.3g} to {:.3g}".format(*(100 * end for end in o["interval"])))
        for name, o in batch["outcomes"].items()
    ]  # fmt: skip
    render.table(("outcome", "runs", "%", "95 % interval"), rows, title=path.name)
    figures = (("time [s]", "time_s"), ("nearest obstacle [m]", "min_clearance_m"),
               ("off the goal [m]", "final_error_m"))  # fmt: skip
    quantiles = [
        (words, *(render.number(batch[key][q], 4) for q in ("p05", "p50", "p95")))
        for words, key in figures
        if batch[key]
    ]
    render.table(("", "5 %", "median", "95 %"), quantiles)
    _show_drivers(batch)
    render.say(batch["sentence"])
    worst = ", ".join(
        f"{w['seed']} ({w['outcome']}, {render.number(w['time_s'], 4)} s)" for w in batch["worst"]
    )
    render.say(f"Worst: {worst}")
    again = f" --vary {','.join(how.vary)}" if how.vary else ""
    first = batch["worst"][0]["seed"]
    render.command(f"Replay one: sysid simulate {path} --seed {first}{again}")
    show_files(facts)


def show_files(facts: dict[str, Any]) -> None:
    """Warnings, and what was written."""
    render.cautions(facts["warnings"])
    render.files(facts, log="Log", bag="Bag", plot="Picture", page="Page")


def _show_drivers(shares: dict[str, Any]) -> None:
    rest = "noise, and interactions" if "noise" in shares["vary"] else "interactions"
    columns = [
        {d["name"]: d["share_of_variance"] for d in shares[key]} | {rest: shares[unexplained]}
        for key, unexplained in (
            ("drivers", "unexplained_share"),
            ("drivers_of_final_error", "unexplained_share_of_final_error"),
        )
        if shares[unexplained] is not None
    ]
    if not columns:
        return
    names = list(columns[0])
    render.table(
        ("what matters", "time [%]", "off the goal [%]")[: 1 + len(columns)],
        [(n, *(f"{100 * c[n]:.1f}" for c in columns)) for n in names],
    )
