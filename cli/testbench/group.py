"""The group of commands ``sysid bench``."""

import typer

from ..command_help import Group

bench = typer.Typer(
    cls=Group,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Characterise motor, inertia and power supply.",
)
