"""``sysid bench motor``: the constants of a motor from its experiments."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..options import argument, command, group, option, pairs

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.testbench.motor.characterise import MotorBench


def _value(text: str) -> tuple[float, float | None]:
    """``3.1±0.05`` as value and standard error, None without one."""
    value, _, error = text.replace("+-", "±").partition("±")
    return float(value), float(error) if error else None


@command
def motor(
    files: list[Path] = argument(
        "FILE...", "Tables of experiments and values: CSV, see docs/bench.md."
    ),
    known: dict[str, tuple[float, float | None]] | None = option(
        "NAME=VALUE",
        "A constant known from elsewhere: R=3.1 or R=3.1±0.05.",
        parse=partial(pairs, option="--known", advice="R=3.1 or R=3.1±0.05", read=_value),
        kind=list[str] | None,
    ),
    gear: float | None = option("TURNS", "Gear ratio: motor turns per output turn."),
    method: str = option(
        "HOW",
        "separate: one experiment at a time; joint: all at once; auto: joint if a drive "
        "log is given.",
        "--estimation",
        default="auto",
    ),
    pulses_per_turn: float = option(
        "N", "Pulses of the sensor per turn of the output shaft.", "--pulses", default=1.0
    ),
    read: "ReadOptions" = group(reading.Reading, "units"),
    ts: float | None = option("SECONDS", "Sample time of the model [drive's, or 0.1]."),
    inputs: str | None = option(
        "NAME", "The model's input [drive's, or voltage].", "-u", "--input"
    ),
    outputs: str | None = option(
        "NAME", "The model's output [drive's, or omega].", "-y", "--output"
    ),
    plot: Path | None = targets.picture("Draw the characteristics: .svg or .png."),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Characterise a DC motor: R, Kem, Kc, f, C0, J with errors."""
    from sysid.testbench.motor.characterise import MotorOptions, characterise_motor
    from sysid.testbench.motor.model import bench_model

    options = MotorOptions(
        known=known or {},
        gear=gear,
        units=read.units,
        pulses_per_turn=pulses_per_turn,
        method=method,
    )
    bench = characterise_motor(files, options)
    facts = bench.to_json()
    model = bench_model(bench, files, ts, (inputs, outputs))
    stored = None if model is None else Workspace(workspace).save(model, {"bench": bench.to_json()})
    if stored is not None:
        Workspace(workspace).remember("latest", [stored.id])
    facts |= {"model": None if stored is None else stored.id}
    if plot is not None:
        from sysid.report.bench import motor_picture
        from sysid.report.plots import write_picture

        write_picture(plot, motor_picture(bench))
        facts["plot"] = plot
    render.document(facts) if json else _show(bench, facts)


def _show(bench: "MotorBench", facts: dict[str, Any]) -> None:
    from sysid.testbench.motor.experiments import CONSTANTS

    joint = {p["name"]: p for p in facts["joint"]["parameters"]}
    heads = ["constant", "value", "± 95 %", "all at once", "± 95 %", "unit"]
    rows = []
    for p in bench.parameters:
        both = joint.get(p.name, {})
        rows.append([
            p.name, p.value, render.reach(p.std_error), both.get("value"),
            render.reach(both.get("std_error")), p.unit,
        ])  # fmt: skip
    render.table(heads, rows, title="Motor")
    for p in bench.parameters:
        render.say(f"{p.name}, {CONSTANTS[p.name][1]}: {p.reason}.")
    render.cautions(bench.notes)
    if facts["model"] is None:
        render.warn("! No model: J is not known.")
    else:
        render.files(facts, plot="Picture")
        render.say(f"Kept as {facts['model']}. Next: sysid compare, sysid export.", "bold")
