"""``sysid bench power``: battery and H-bridge before the robot drives."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import UsageError

from .. import reading, render, targets

if TYPE_CHECKING:
    from sysid.testbench.power.study import PowerBench


def power(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="CSV, Parquet or bag: battery's voltage and current at rest and under load, or a "
            "staircase of PWM with the motor's voltage, speed or current, or all in one.",
        ),
    ],
    full_current: Annotated[
        float | None,
        typer.Option(
            metavar="A", help="Current of both motors at full drive [the largest of the logs]."
        ),
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option(metavar="MISSION", help="Mission in which to fill in vehicle.supply: .yaml."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help="Write it for sysid diagnose --bench."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw data and fits: .svg or .png.")
    ] = None,
    units: reading.Units = None,
    pwm_max: reading.PwmMax = None,
    map: reading.Map = None,
    stamps: reading.Stamps = "auto",
    latency: reading.Latency = None,
    json: reading.Json = False,
) -> None:
    """Battery from rests and loads, H-bridge from a staircase of PWM, with standard errors.

    Open-circuit voltage, resistance and slow recovery apart; dead band, jump, drop and gain of each
    direction. What was measured can fill a mission's vehicle.supply and bound a diagnosis.
    """
    from sysid.data.documents import text
    from sysid.data.files import write_atomic
    from sysid.testbench.power.study import bench_power, write_supply

    targets.check_picture(plot)
    if output is not None:
        targets.check(output, "-o", new_folder=False)
        if output.suffix.lower() != ".json":
            raise UsageError(f"-o {output}: name a file that ends in .json")
    if to is not None and to.suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f"--to {to}: a mission file ends in .yaml")
    bags = reading.read_options(map=map, stamps=stamps, latency=latency)
    bench = bench_power(files, reading.units_of(units or []), pwm_max, full_current, bags)
    facts: dict[str, Any] = bench.summary()
    if output is not None:
        facts["file"] = write_atomic(output, text(facts))
    if to is not None:
        facts["mission"] = write_supply(to, bench)
    if plot is not None:
        from .pictures import draw_power

        draw_power(plot, bench)
        facts["plot"] = plot
    render.document(facts) if json else _show(bench, facts)


def _show(bench: "PowerBench", facts: dict[str, Any]) -> None:
    for sentence in facts["sentences"]:
        render.say(sentence)
    measured = bench.supply()
    if measured:
        render.table(
            ("vehicle.supply", "value", "std. error", "unit"),
            [
                (k, m.value, m.std_error, _UNITS.get(k, "of full drive"))
                for k, m in measured.items()
            ],
        )
    render.findings(bench.findings)
    for what, key in (("Bench file", "file"), ("Mission", "mission"), ("Picture", "plot")):
        if key in facts:
            render.say(f"{what}: {facts[key]}")


_UNITS = {"voltage": "V", "loss": "1/s"}
