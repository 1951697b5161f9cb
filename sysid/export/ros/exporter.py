"""The format ``ros``: a catkin package of two nodes, one that guides and one that is the robot."""

import re
from collections.abc import Iterator, Mapping
from typing import ClassVar

from sysid.errors import ModelError
from sysid.export.base import Exporter, Source
from sysid.export.c.fields import Field
from sysid.export.c.loop.recorded_run import CLOSED, not_again, record_run
from sysid.export.c.loop.sources import law_sources, robot_lines
from sysid.export.c.precision import DOUBLE
from sysid.export.c.step import c_step, plant_sources
from sysid.export.templates import fill
from sysid.robot.mission.loop import Loop
from sysid.runners.trace.writing import number

_USAGE = """As two nodes of ROS 1, in a catkin package: link the folder `ros/` into the sources
of a catkin workspace and build; `ros/README.md` has the details.
"""

_TARGETS = {
    "README.md": "README.md",
    "package.xml": "package.xml",
    "CMakeLists.txt": "CMakeLists.txt",
    "mission.launch": "launch/mission.launch",
    "guidance_node.cpp": "src/guidance_node.cpp",
    "robot_node.cpp": "src/robot_node.cpp",
}

_CONTROLLER = {law: f"parameters_.{law}" for law in ("guidance", "control", "command")}
_ROBOT = {law: f"{law}_p_" for law in ("control", "command", "navigation", "motion")}


class Ros(Exporter):
    """``package.xml``, two nodes in C++ and the C of the loop and of the plant."""

    name: ClassVar[str] = "ros"
    title: ClassVar[str] = "ROS package"

    def files(self, source: Source) -> Mapping[str, str | bytes]:
        """The package."""
        loop = source.loop
        if loop is None:
            raise ModelError(
                "the format ros needs a mission, whose laws become the nodes; name one"
            )
        blocks, laws = law_sources(loop)
        why = not_again(loop, blocks)
        if why:
            raise ModelError(
                "the mission cannot be driven by nodes in C++: "
                + why.removeprefix("The mission ").partition(", so ")[0]
            )
        plant = plant_sources(
            source.model, c_step(source.model), source.selftest, source.name, DOUBLE.plant
        )
        code = {n: t for n, t in {**plant, **laws}.items() if not n.startswith("selftest")}
        package = "sysid_" + re.sub(r"[^a-z0-9]+", "_", source.name.lower()).strip("_")
        values = robot_lines(loop, blocks) | {
            "package": package,
            "plant": source.name,
            "timeout": number(loop.timeout),
            "sources": " ".join(f"src/laws/{n}" for n in sorted(code) if n.endswith(".c")),
        }
        made = {f"src/laws/{name}": text for name, text in code.items()}
        made["drive.csv"] = _drive(loop)
        for template, place in _TARGETS.items():
            structs = _CONTROLLER if template.startswith("guidance") else _ROBOT
            lines = [
                line
                for law, struct in structs.items()
                if law in blocks
                for line in _parameter_lines(law, struct, blocks[law].parameters)
            ]
            made[place] = fill(f"ros/{template}", **values, parameters="\n".join(lines))
        return dict(made)

    def usage(self) -> str:
        return _USAGE


def _drive(loop: Loop) -> str:
    """The log of Python's drive as the robot's node writes it, to compare with."""
    rows = record_run(loop).closed.tolist()
    lines = [",".join(map(repr, [k * loop.scene.dt, *row])) for k, row in enumerate(rows)]
    return "\n".join([",".join(("t", *CLOSED)), *lines]) + "\n"


def _parameter_lines(law: str, struct: str, parameters: tuple[Field, ...]) -> Iterator[str]:
    """Lines that take the numbers of a law from the parameters of the node."""
    for f in parameters:
        for k in range(max(f.size, 1)):
            place = f"{struct}.{f.name}" + (f"[{k}]" if f.size else "")
            key = f"{law}/{f.name}" + (f"_{k}" if f.size else "")
            yield f'        own.param("{key}", {place}, {place});'
