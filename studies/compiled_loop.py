"""The C of ``sysid export --controller MISSION`` in Python's loop: the plant and its laws.

The files are compiled as they are into a shared library; the few lines of :data:`SIZES` tell how
long their structs are, which Python keeps as bytes. The controller answers as the far half of a
mission (:mod:`sysid.cosim.connection`), the plant stands in a robot plant where the fitted one did.
"""

import ctypes
import subprocess
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.cosim.connection import Asked, Ended, Level, Message, Seen
from sysid.cosim.robot import Pace, play_robot
from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.export.package import Form, write_package
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.model import Model

LAWS = ("guidance", "control", "command", "controller")
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")

SIZES = """
#include <stddef.h>
#include "controller.h"
#include "plant.h"
size_t size_of(int k);
size_t size_of(int k)
{
    const size_t sizes[4] = {sizeof(plant_parameters), sizeof(plant_state),
                             sizeof(controller_parameters), sizeof(controller_state)};
    return sizes[k];
}
"""

OUTPUTS = 8
"""Of ``controller_outputs``: both PWM, arrived, gives up, and what was thought on the way."""


@dataclass(frozen=True, eq=False)
class Struct:
    """A part of the C code with the parameters it was exported with.

    Attributes:
        library: the compiled code.
        name: ``plant`` or ``controller``.
        parameters: its struct.
        size: bytes of its state.
    """

    library: ctypes.CDLL
    name: str
    parameters: Any
    size: int

    def rest(self) -> Any:
        """A state before the first step."""
        state = ctypes.create_string_buffer(self.size)
        getattr(self.library, f"{self.name}_init")(state, self.parameters)
        return state

    def step(self, state: Any, given: Array, outputs: int) -> Array:
        """One step; the state is changed."""
        found = (ctypes.c_double * outputs)()
        inputs = (ctypes.c_double * len(given))(*given)
        getattr(self.library, f"{self.name}_step")(state, self.parameters, inputs, found)
        return np.array(found)


def compiled(model: Model, mission: Mission, folder: Path, compiler: str) -> tuple[Struct, Struct]:
    """Export a plant and the laws of a mission, and compile them.

    Args:
        model: the plant.
        mission: its laws; what moves the vehicle in C is not called.
        folder: an empty one.
        compiler: of C.

    Returns:
        Plant and controller.
    """
    write_package(model, folder / "plant", formats=["json", "c"], form=Form(mission))
    code = folder / "plant" / "c"
    (code / "sizes.c").write_text(SIZES, encoding="utf-8")
    files = [f"{name}.c" for name in ("plant", *LAWS, "sizes")]
    subprocess.run([compiler, *FLAGS, "-o", "loop.so", *files, "-lm"], cwd=code, check=True)
    library = ctypes.CDLL(str(code / "loop.so"))
    library.size_of.restype = ctypes.c_size_t
    parts = []
    for k, name in enumerate(("plant", "controller")):
        parameters = ctypes.create_string_buffer(library.size_of(2 * k))
        getattr(library, f"{name}_defaults")(parameters)
        parts.append(Struct(library, name, parameters, library.size_of(2 * k + 1)))
    plant, controller = parts
    return plant, controller


@dataclass(frozen=True, eq=False)
class CompiledPlant:
    """A plant in C, as the loop steps it; its state is the struct's bytes.

    Attributes:
        code: the plant.
        dt, inputs, outputs, input_range, u_offset, ground: as the fitted one has them.
    """

    code: Struct
    dt: float
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    input_range: tuple[tuple[float, float], ...]
    u_offset: Array
    ground: Ground

    def initial_state(self) -> Any:
        """At rest."""
        return np.frombuffer(self.code.rest(), dtype=np.uint8)

    def step(self, state: Any, u: Array) -> tuple[Any, Array]:
        """One sample."""
        after = ctypes.create_string_buffer(state.tobytes(), self.code.size)
        y = self.code.step(after, u, len(self.outputs))
        return np.frombuffer(after, dtype=np.uint8), y


@dataclass(eq=False)
class CompiledController:
    """Guidance, control and command module in C, as the far half of a mission at level PWM.

    Attributes:
        code: the controller.
        state: its struct.
        seen: what it was told last.
        calls: how often it was stepped.
    """

    code: Struct
    state: Any = field(init=False)
    seen: Seen | None = None
    calls: int = 0

    def __post_init__(self) -> None:
        """At the beginning of a mission."""
        self.state = self.code.rest()

    def send(self, message: Message) -> None:
        """Where the robot believes to be."""
        if isinstance(message, Seen):
            self.seen = message

    def receive(self, patience: float) -> Message:
        """PWM of both tracks, or that the goal is reached."""
        assert self.seen is not None
        t, (pose, speed, yaw_rate, *_) = self.seen
        given = np.array([t, *pose, speed, yaw_rate])
        left, right, arrived, gives_up, *_ = self.code.step(self.state, given, OUTPUTS).tolist()
        self.calls += 1
        if arrived or gives_up:
            return Ended(Outcome.ARRIVED if arrived else Outcome.STUCK)
        return Asked(0.5 * (left + right), 0.5 * (right - left))

    def poll(self) -> Message | None:
        """It speaks when it is asked."""
        return None


def drive(model: Model, mission: Mission, c: tuple[Struct, Struct], seed: int = 0) -> MissionResult:
    """A mission by compiled plant and laws; motion, sensors and navigation are the mission's own.

    Args:
        model: what was exported.
        mission: how the vehicle moves, and what its navigation believes.
        c: of :func:`compiled`.
        seed: of the sensors' noise.
    """
    robot, _ = as_robot(model.plant(), mission)
    plant, controller = c
    names = ("dt", "inputs", "outputs", "input_range", "u_offset", "ground")
    inner = CompiledPlant(plant, **{name: getattr(robot.plant, name) for name in names})
    rest = inner.initial_state()
    robot = replace(robot, plant=inner, rest=np.array([rest, rest]) if robot.twins else rest)
    port = CompiledController(controller)
    return play_robot(mission, robot, port, Pace(lock_step=True), Level.PWM, seed=seed)
