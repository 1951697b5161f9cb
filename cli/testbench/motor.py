"""``sysid bench motor``: the constants of a motor from its experiments."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from .. import reading, render, targets

if TYPE_CHECKING:
    from sysid.testbench.motor.characterise import MotorBench


def motor(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="Tables of experiments and values: CSV, see docs/bench.md."
        ),
    ],
    known: Annotated[
        list[str] | None,
        typer.Option(
            "--known",
            metavar="NAME=VALUE",
            help="A constant known from elsewhere: R=3.1 or R=3.1±0.05.",
        ),
    ] = None,
    gear: Annotated[
        float | None,
        typer.Option("--gear", metavar="TURNS", help="Gear ratio: motor turns per output turn."),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="HOW",
            help="separate: one experiment at a time; joint: all at once; auto: joint if a drive "
            "log is given.",
        ),
    ] = "auto",
    pulses_per_turn: Annotated[
        float,
        typer.Option(
            "--pulses", metavar="N", help="Pulses of the sensor per turn of the output shaft."
        ),
    ] = 1.0,
    units: reading.Units = None,
    ts: Annotated[
        float | None,
        typer.Option("--ts", metavar="SECONDS", help="Sample time of the model [drive's, or 0.1]."),
    ] = None,
    inputs: Annotated[
        str | None,
        typer.Option("--input", metavar="NAME", help="The model's input [drive's, or voltage]."),
    ] = None,
    outputs: Annotated[
        str | None,
        typer.Option("--output", metavar="NAME", help="The model's output [drive's, or omega]."),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the characteristics: .svg or .png."),
    ] = None,
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
    json: reading.Json = False,
) -> None:
    """Characterise a DC motor: R, Kem, Kc, f, C0, J with errors, and a model of it."""
    from sysid.testbench.motor.characterise import MotorOptions, characterise_motor
    from sysid.testbench.motor.model import bench_model

    targets.check_picture(plot)
    options = MotorOptions(
        known=known_of(known or []),
        gear=gear,
        units=reading.units_of(units or []),
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


def known_of(given: list[str]) -> dict[str, tuple[float, float | None]]:
    """Constants as ``R=3.1`` or ``R=3.1±0.05``: value and standard error, None without one.

    Raises:
        UsageError: one has another form.
    """
    known = {}
    for pair in (p for item in given for p in item.split(",")):
        name, _, number = (part.strip() for part in pair.partition("="))
        value, _, error = number.replace("+-", "±").partition("±")
        try:
            known[name] = float(value), float(error) if error else None
        except ValueError:
            raise UsageError(f"--known cannot read {pair!r}; write R=3.1 or R=3.1±0.05") from None
    return known


def _show(bench: "MotorBench", facts: dict[str, Any]) -> None:
    from sysid.testbench.motor.experiments import CONSTANTS

    joint = {p["name"]: p for p in facts["joint"]["parameters"]}
    printed = any(p.published is not None for p in bench.parameters)
    heads = ["constant", "value", "± std. error", "all at once", "± std. error", "unit"]
    rows = []
    for p in bench.parameters:
        both = joint.get(p.name, {})
        row: list[object] = [
            p.name, p.value, render.number(p.std_error, 2), both.get("value"),
            render.number(both.get("std_error"), 2), p.unit,
        ]  # fmt: skip
        rows.append(row + ([p.published] if printed else []) + [CONSTANTS[p.name][1]])
    heads += ["thesis"] if printed else []
    render.table([*heads, "meaning"], rows, title="Motor")
    for p in bench.parameters:
        render.say(f"{p.name}: {p.reason}.")
    for note in bench.notes:
        render.warn(f"! {note}")
    if facts["model"] is None:
        render.warn("! No model: J is not known.")
    else:
        if plot := facts.get("plot"):
            render.say(f"Picture: {plot}")
        render.say(f"Kept as {facts['model']}. Next: sysid compare, sysid export.", "bold")
