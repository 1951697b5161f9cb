"""The group of commands ``sysid bench``."""

import typer

bench = typer.Typer(
    no_args_is_help=True,
    help="Characterise a robot's parts on the test bench: motor, inertia, power supply.",
)
