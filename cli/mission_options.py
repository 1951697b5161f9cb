"""Options of a log that was driven on a mission, declared once, as the library takes them."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.errors import ModelError, UsageError

from .options import flag, in_panel

if TYPE_CHECKING:
    from sysid.plant.package import Package
    from sysid.vehicle.kinematics import Geometry

accept_changes = partial(flag, "Take a plant package that was changed by hand.")
"""The flag of commands that take a plant package."""


@dataclass(frozen=True)
class Driven:
    """What is known of the drive that a log is of; None for what is not.

    Attributes:
        package: plant the mission was planned with.
        geometry: the vehicle's lengths.
    """

    mission: Path | None
    package: "Package | None"
    geometry: "Geometry | None"


_driven = in_panel("On a log with a pose")


@dataclass(frozen=True)
class DriveOptions:
    """The drive that a log is of, as a line gives it."""

    mission: Path | None = _driven(
        "M.yaml",
        "Mission that the log was driven on; needed to name effects of the vehicle.",
    )
    plant: Path | None = _driven(
        "PATH",
        "Plant package the mission was planned with: the model to diagnose.",
    )
    geometry: str | None = _driven(
        "r=M,B=M",
        "Wheel or sprocket radius r and distance B of tracks or wheels in metres, "
        "r=0.30,B=1.08 [the mission's, else the bundled robot's; estimated where the pose "
        "contradicts these].",
    )
    accept_changes: bool = accept_changes()

    def made(self) -> Driven:
        """The drive as every option of it says.

        Raises:
            ModelError: the plant package cannot be read.
            UsageError: a file is not there, or an option cannot be.
        """
        from sysid.plant.package import read_package

        if self.plant is not None and self.mission is None:
            raise UsageError("--plant needs --mission; give the mission of the log")
        for path, option in ((self.mission, "--mission"), (self.plant, "--plant")):
            if path is not None and not path.exists():
                raise UsageError(f"file not found: {path}; check the path after {option}")
        lengths = None if self.geometry is None else given_lengths(self.geometry)
        if self.mission is not None:
            from sysid.robot.mission.spec import load_mission

            load_mission(self.mission)  # refused before the minutes of a diagnosis
            if lengths is not None:
                _agree(lengths, self.mission)
        package = None if self.plant is None else read_package(self.plant, self.accept_changes)
        return Driven(self.mission, package, lengths)


def given_lengths(text: str) -> "Geometry":
    """The vehicle's lengths as ``--geometry`` gives them: both by number, or in a file.

    Raises:
        UsageError: they cannot be read.
    """
    from sysid.vehicle.kinematics import Geometry

    if Path(text).suffix in (".yaml", ".yml"):
        return _lengths_in(Path(text))

    lengths: dict[str, float] = {}
    for part in text.split(","):
        name, sign, value = (p.strip() for p in part.partition("="))
        key = {"r": "r", "b": "B"}.get(name.lower(), "")
        try:
            number = float(value)
        except ValueError:
            key = ""
        if not (key and sign) or key in lengths:
            raise UsageError(
                f"--geometry cannot read {part.strip()!r}; write both lengths once, in metres, "
                "such as r=0.30,B=1.08"
            )
        lengths[key] = number
    if len(lengths) < 2:
        raise UsageError(
            f"--geometry gives no {'B' if 'r' in lengths else 'r'}; write both lengths in metres, "
            "such as r=0.30,B=1.08"
        )
    try:
        return Geometry(lengths["r"], lengths["B"])
    except ModelError as error:
        raise UsageError(f"--geometry: {error}") from None


def _lengths_in(path: Path) -> "Geometry":
    """The lengths in the section ``vehicle:`` of a file, such as a mission."""
    from sysid.data.yaml_files.source import read_yaml
    from sysid.vehicle.kinematics import Geometry

    vehicle = read_yaml(path).values.get("vehicle")
    section = vehicle if isinstance(vehicle, dict) else {}
    lacking = [n for n in ("r", "B") if not isinstance(section.get(n), int | float)]
    if lacking:
        raise UsageError(f"--geometry {path}: its section vehicle gives no {lacking[0]} in metres")
    try:
        return Geometry(float(section["r"]), float(section["B"]))
    except ModelError as error:
        raise UsageError(f"--geometry {path}: {error}") from None


def _agree(lengths: "Geometry", mission: Path) -> None:
    """Refuse lengths that the mission gives otherwise."""
    from sysid.robot.mission.spec import load_mission

    of_mission = load_mission(mission).vehicle.given_geometry
    if of_mission is not None and of_mission != lengths:
        raise UsageError(
            f"{mission} gives r = {of_mission.r:g} m and B = {of_mission.B:g} m, but --geometry "
            "differs; omit --geometry or correct the mission"
        )
