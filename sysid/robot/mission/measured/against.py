"""A measured mission and its simulated runs in one call."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.data.record import Record
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.measured.drive import MeasuredDrive, nominal_command_begins
from sysid.robot.mission.measured.fan import Comparison, compared
from sysid.robot.mission.monte_carlo.paths import run_paths
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.variation import Spread, StartSpread
from sysid.structures.model import Model
from sysid.vehicle.kinematics import wrap_angle

RUNS = 400
"""Default number of runs of a fan: 200 say how wide it is, to 5 %, and 10 of the other 200
lie beyond the limit of the whole path."""


def against_runs(
    record: Record,
    mission: Mission,
    plants: Sequence[Model | SteppablePlant],
    runs: int = RUNS,
    seed: int = 0,
    vary: Sequence[str] | None = None,
) -> Comparison:
    """Drive a mission many times from where a measured drive of it began, and lay that over them.

    The start is measured, so it varies no more than its measurement is uncertain.

    Args:
        record: the log of the drive, with a pose.
        mission: what it drove; its ``vary`` says what else varies.
        plants: as of :func:`sysid.robot.mission.monte_carlo.runs.simulate_runs`.
        vary: names of what varies instead.

    Raises:
        DataError: the log holds no path.
        UsageError: a name or a number makes no sense.
        ModelError: the plant is none that could drive.
    """
    drive = MeasuredDrive.of(record)
    x, y, psi = drive.start.tolist()
    begins_there = mission.model_copy(update={"start": (x, y, float(wrap_angle(psi)))})
    setup = Setup.of(begins_there, plants, vary)
    spread = (Spread(sigma=float(e)) for e in drive.start_error)
    start = StartSpread(**dict(zip(("x", "y", "psi"), spread, strict=True)))
    setup = replace(setup, variation=setup.variation.model_copy(update={"start": start}))
    nominal = simulate(begins_there, setup.plant_variants[0].robot)
    comparison = compared(
        drive, run_paths(setup, runs, seed), nominal_command_begins(nominal), seed
    )
    notes = (*drive.notes(mission.start), *setup.notes(0, 0, runs))
    return replace(comparison, notes=notes)
