"""Bags where a command reads no log of a fit: the benches, and the noise of a filter."""

import math
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from mission_cases import Robot as Plant
from recorded_robots import EPOCH

from sysid.data.bags.writing import Messages, Outgoing, write_bag, write_drive
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission

pytest.importorskip("rosbags", reason="the extra ros reads bags")

KIND = "std_msgs/msg/Float64"


def recorded(path: Path, step: float, **topics: np.ndarray) -> Path:
    """A bag with a topic of plain numbers for each column."""

    def messages(make: Messages) -> list[Outgoing]:
        return [
            Outgoing(
                f"/{name}", KIND, EPOCH + round(1e9 * step * k), make.make(KIND, data=float(v))
            )
            for name, column in topics.items()
            for k, v in enumerate(column)
        ]

    return write_bag(path, messages)


def test_a_swing_that_was_recorded_as_a_bag(tmp_path: Path, capsys: Capture) -> None:
    t = np.arange(0.0, 20.0, 0.02)
    angle = 0.15 * np.exp(-t / 60.0) * np.cos(2.0 * math.pi / 1.735 * t)
    bag = recorded(tmp_path / "swing.mcap", 0.02, tilt=angle)
    line = ("bench", "pendulum", bag, "--map", "angle=/tilt")
    facts = run(capsys, *line, "--json").document
    assert facts["period_s"] == pytest.approx(1.735, rel=0.005)


def test_a_battery_that_was_recorded_as_a_bag(tmp_path: Path, capsys: Capture) -> None:
    current = np.repeat([0.05, 3.0, 0.05, 2.0, 0.05, 3.5], 100)
    voltage = 7.9 - 0.1 * current + 0.002 * np.random.default_rng(0).standard_normal(600)
    bag = recorded(tmp_path / "rest.bag", 0.1, volts=voltage, amps=current)
    columns = ("battery_voltage=/volts", "battery_current=/amps")
    maps = [w for column in columns for w in ("--map", column)]
    (battery,) = run(capsys, "bench", "power", bag, *maps, "--json").document["battery"]
    assert battery["internal_resistance_ohm"] == pytest.approx(0.1, abs=0.005)


def test_the_noise_of_a_filter_from_a_bag(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "m.yaml").write_text(
        "goal: [1, 0.4]\nnavigation: {kind: kf}\nsensors: {encoders: {}}\n"
    )
    mission = Mission.model_validate(
        {"goal": [1.0, 0.4], "navigation": {"kind": "kf"}, "sensors": {"encoders": {}}}
    )
    write_drive(simulate(mission, Plant(), seed=2).log, tmp_path / "m.mcap")
    maps = [
        w
        for side in ("left", "right")
        for w in ("--map", f"omega_{side[0]}=/joint_states.velocity[{side}_track]")
    ]
    line = ("tune", tmp_path / "m.yaml", "--noise-from", tmp_path / "m.mcap", *maps)
    assert set(run(capsys, *line, "--json").document["r"]) == {"omega_l", "omega_r"}
