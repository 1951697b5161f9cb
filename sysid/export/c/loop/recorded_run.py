"""One run of a mission with the inputs and outputs of every law, for the self-test in C."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.export.c.loop.laws_of_mission import command_outputs, flat, guidance_outputs
from sysid.robot.mission.contracts import TurnsTracks
from sysid.robot.mission.loop import COLUMNS, Loop
from sysid.robot.mission.simulator import run
from sysid.runners import floats

CLOSED = ("pwm_l", "pwm_r", "omega_l", "omega_r", "x", "y", "psi")
"""Columns of the mission's log that the closed loop in C is compared in."""

Row = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """What happened.

    Attributes:
        rows: law → inputs and outputs of every step by name, (steps, signals).
        closed: the log in the columns :data:`CLOSED`, (samples, columns).
    """

    rows: Mapping[str, Mapping[str, Array]]
    closed: Array


@dataclass(eq=False)
class _Watched:
    """A law whose inputs and outputs are written down."""

    law: Any
    inputs: Callable[[Any, float], Row]
    outputs: Callable[[Any], Row]
    rows: list[Row] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.law, name)

    def step(self, state: Any, inputs: Any, dt: float, xp: Any) -> tuple[Any, Any]:
        after, output = self.law.step(state, inputs, dt, xp)
        self.rows.append({**self.inputs(inputs, dt), **self.outputs(output)})
        return after, output


def record_run(loop: Loop, seed: int = 0) -> RecordedRun:
    """Drive a closed loop once.

    Args:
        loop: on plain numbers.
    """
    watched: dict[str, Any] = {
        "guidance": _Watched(
            loop.guidance,
            lambda i, dt: {"t": i.t, **flat(i.estimate)},
            guidance_outputs,
        ),
        "control": _Watched(
            loop.control,
            lambda i, dt: {
                "t": i.t,
                "reference_speed": i.references.speed,
                "reference_psi": i.references.psi,
                **flat(i.estimate),
                "applied_v_cmd": i.applied.v_cmd,
                "applied_psi_cmd": i.applied.psi_cmd,
            },
            lambda command: command._asdict(),
        ),
        "navigation": _Watched(
            loop.navigation,
            lambda i, dt: {
                "t": i.t,
                "dt": dt,
                **i.measurements,
                "drive_l": i.drive[0],
                "drive_r": i.drive[1],
            },
            flat,
        ),
        "motion": _Watched(loop.motion, lambda i, dt: {}, flat),
    }
    commands: list[Row] = []

    def shaper(command: Any, estimate: Any, t: float, xp: Any) -> Any:
        shaped = loop.shaper(command, estimate, t, xp)
        read = {"t": t, "v_cmd": command.v_cmd, "psi_cmd": command.psi_cmd, **flat(estimate)}
        commands.append({**read, **command_outputs(*shaped)})
        return shaped

    _, table = run(replace(loop, shaper=shaper, xp=floats, **watched), seed)
    rows = {n: w.rows for n, w in watched.items() if n != "motion"} | {"command": commands}
    columns = [COLUMNS.index(n) for n in CLOSED]
    return RecordedRun(
        {law: _columns(shaped) for law, shaped in rows.items()},
        table[:, columns],
    )


def not_again(loop: Loop, blocks: Collection[str]) -> str:
    """Why what was driven here cannot be driven again in C, a sentence; empty where it can.

    Args:
        blocks: names of the laws that are written as C.
    """
    if loop.scene.sensors:
        why = "has sensors with noise"
    elif loop.feed is not None:
        why = "has a supply between command and plant, which is not written as C"
    elif isinstance(loop.motion, TurnsTracks):
        why = "moves the vehicle by the torque of its motors, not by the plant"
    elif "motion" not in blocks:
        why = "moves the vehicle in a way that cannot be written as C"
    else:
        return ""
    return (
        f"The mission {why}, so the self-test of the loop steps each function through what went in "
        "and out of it during one drive and does not drive the mission itself."
    )


def _columns(rows: list[Row]) -> dict[str, Array]:
    return {n: np.array([float(r[n]) for r in rows]) for n in rows[0]} if rows else {}
