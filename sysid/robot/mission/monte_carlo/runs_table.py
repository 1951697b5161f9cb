"""Many runs as a table with a row per run."""

from pathlib import Path

from sysid.data.files import write_atomic
from sysid.robot.mission.monte_carlo.mission_runs import MissionRuns

COLUMNS = (
    "seed", "outcome", "time_s", "x", "y", "psi", "path_length_m", "min_clearance_m",
    "max_deviation_m",
)  # fmt: skip


def write_runs(batch: MissionRuns, path: Path) -> Path:
    """Write a CSV with the figures of every run, numbers unrounded; empty where there is none.

    Args:
        path: the file; it appears complete or not at all.

    Raises:
        DataError: the file cannot be written there.
    """
    columns = [column.tolist() for column in batch.figures[1:]]
    lines = [",".join(COLUMNS)]
    for k, (seed, row) in enumerate(zip(batch.seeds, zip(*columns, strict=True), strict=True)):
        numbers = ("" if abs(v) == float("inf") or v != v else repr(v) for v in row)
        lines.append(",".join((str(seed), batch.figures.outcome(k), *numbers)))
    return write_atomic(path, ("\n".join(lines) + "\n").encode("ascii"))
