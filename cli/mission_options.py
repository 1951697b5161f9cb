"""Options of a log that was driven on a mission, declared once, as the library takes them."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.errors import ModelError, UsageError

from .options import flag, in_panel, pairs

if TYPE_CHECKING:
    from sysid.plant.package import Package
    from sysid.vehicle.kinematics import Geometry

accept_changes = partial(flag, "Take a plant package that was changed by hand.", advanced=True)
"""The flag of commands that take a plant package."""


@dataclass(frozen=True)
class Driven:
    """What is known of the drive that a log is of; None for what is not."""

    mission: Path | None
    package: "Package | None"
    geometry: "Geometry | None"


_driven = in_panel("On a log with a pose", advanced=True)


@dataclass(frozen=True)
class DriveOptions:
    """The drive that a log is of, as a line gives it."""

    mission: Path | None = _driven(
        "M.yaml", "Mission that the log was driven on; needed to name effects of the vehicle."
    )
    plant: Path | None = _driven(
        "PATH", "Plant package the mission was planned with: the model to diagnose."
    )
    geometry: str | None = _driven(
        "r=M,B=M",
        "Wheel or sprocket radius r and distance B of tracks or wheels in metres, "
        "r=0.30,B=1.08 [the mission's, else the bundled robot's; estimated where the pose "
        "contradicts these].",
    )
    accept_changes: bool = accept_changes()

    def made(self) -> Driven:
        """The drive as every option of it says."""
        if self.plant is not None and self.mission is None:
            raise UsageError("--plant needs --mission; give the mission of the log")
        for path, option in ((self.mission, "--mission"), (self.plant, "--plant")):
            if path is not None and not path.exists():
                raise UsageError(f"{path}: file not found; check {option}")
        lengths = None if self.geometry is None else given_lengths(self.geometry)
        if self.mission is not None:
            from sysid.robot.mission.spec import load_mission

            # refused before the minutes of a diagnosis
            stated = load_mission(self.mission).vehicle.given_geometry
            if lengths is not None and stated not in (None, lengths):
                raise UsageError(
                    f"{self.mission} gives r = {stated.r:g} m and B = {stated.B:g} m, but "
                    "--geometry differs; omit --geometry or correct the mission"
                )
        return Driven(self.mission, self._package(), lengths)

    def _package(self) -> "Package | None":
        if self.plant is None:
            return None
        from sysid.plant.package import read_package

        return read_package(self.plant, self.accept_changes)


def given_lengths(text: str) -> "Geometry":
    """The vehicle's lengths as ``--geometry`` gives them: both by number, or in a file."""
    from sysid.data.yaml_files.source import read_yaml
    from sysid.vehicle.kinematics import Geometry

    advice = "both lengths in metres, such as r=0.30,B=1.08"
    if Path(text).suffix in (".yaml", ".yml"):
        vehicle = read_yaml(Path(text)).values.get("vehicle")
        section = vehicle if isinstance(vehicle, dict) else {}
        given = {n: v for n, v in section.items() if isinstance(v, int | float)}
        where = f"{text}: its section vehicle"
    else:
        given, where = pairs([text], "--geometry", advice, float), ""
    lengths = {name.lower(): float(value) for name, value in given.items()}
    for name in ("r", "B"):
        if name.lower() not in lengths:
            raise UsageError(f"--geometry {where} gives no {name}; write {advice}")
    try:
        return Geometry(lengths["r"], lengths["b"])
    except ModelError as error:
        raise UsageError(f"--geometry {where}: {error}") from None
