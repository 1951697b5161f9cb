"""``sysid bench power``: battery and H-bridge before the robot drives."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from .. import reading, render, targets
from ..options import argument, command, group, option

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.testbench.power.study import PowerBench


JSON = ".json"


def _checked(paths: list[Path]) -> list[Path]:
    for path in paths:
        if path.suffix.lower() not in (JSON, *targets.YAML):
            raise UsageError(f"-o {path}: name a file that ends in {JSON} or {targets.YAML[0]}")
        targets.check(path, "-o", new_folder=False)
    return paths


@command
def power(
    files: list[Path] = argument(
        "FILE...",
        "CSV, Parquet or bag: battery's voltage and current at rest and under load, or a "
        "staircase of PWM with the motor's voltage, speed or current, or all in one.",
    ),
    full_current: float | None = option(
        "A", "Current of both motors at full drive [the largest of the logs]."
    ),
    output: list[Path] | None = option(
        "FILE",
        "A .json for sysid diagnose --bench, or a mission (.yaml) in which to fill in "
        "vehicle.supply; repeatable.",
        "-o",
        parse=_checked,
    ),
    plot: Path | None = targets.picture("Draw data and fits: .svg or .png."),
    read: "ReadOptions" = group(reading.Reading, "units", "pwm_max", "map", "stamps", "latency"),
    json: bool = reading.JSON,
) -> None:
    """Characterise battery and H-bridge from logs of the bench.

    Open-circuit voltage, resistance and slow recovery apart; dead band, jump, drop and gain of each
    direction. What was measured can fill a mission's vehicle.supply and bound a diagnosis.
    """
    from sysid.data.documents import text
    from sysid.data.files import write_atomic
    from sysid.testbench.power.study import bench_power, write_supply

    bags = replace(read, units={}, pwm_max=None)
    bench = bench_power(files, read.units, read.pwm_max, full_current, bags)
    facts: dict[str, Any] = bench.summary()
    for path in output or ():
        if path.suffix.lower() == JSON:
            facts["file"] = write_atomic(path, text(facts))
        else:
            facts["mission"] = write_supply(path, bench)
    if plot is not None:
        from sysid.report.bench import draw_power

        draw_power(plot, bench)
        facts["plot"] = plot
    render.document(facts) if json else _show(bench, facts)


def _show(bench: "PowerBench", facts: dict[str, Any]) -> None:
    for sentence in facts["sentences"]:
        render.say(sentence)
    measured = bench.supply()
    if measured:
        render.table(
            ("vehicle.supply", "value", "± 95 %", "unit"),
            [
                (k, m.value, render.reach(m.std_error), _UNITS.get(k, "of full drive"))
                for k, m in measured.items()
            ],
        )
    render.findings(bench.findings)
    render.files(facts, file="Bench file", mission="Mission", plot="Picture")


_UNITS = {"voltage": "V", "loss": "1/s"}
