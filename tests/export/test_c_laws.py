"""Laws that are not simple as C: long memories, rounds over several values, motions, supplies."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plant_models import robot_model

from sysid.export.c.loop.block import Law, recorded
from sysid.export.package import Form, package_files
from sysid.robot.mission.spec import load_mission
from sysid.runners.loops import repeated
from sysid.runners.trace.traced import TRACE


def law(start: Any, step: Any, **parameters: float) -> Law:
    named = {(name,): value for name, value in parameters.items()}
    return Law("law", "A law", named, {"u": 0.0}, lambda given: start, step, lambda place: ("", ""))


def test_a_memory_that_only_loops_read_is_kept() -> None:
    def step(given: Mapping[Any, Any], state: Any, read: Mapping[str, Any]) -> tuple[Any, Any]:
        after = 0.5 * state + given["gain",] * read["u"]
        return after, {"y": TRACE.sum(state)}

    block = recorded(law(np.ones(30), step, gain=2.0))
    assert [(f.name, f.size) for f in block.states] == [("value", 30)]
    assert [f.name for f in block.parameters] == ["gain"]


def test_rounds_over_two_values_that_begin_with_numbers_are_one_loop() -> None:
    def step(given: Mapping[Any, Any], state: Any, read: Mapping[str, Any]) -> tuple[Any, Any]:
        def halved(ends: tuple[Any, Any]) -> tuple[Any, Any]:
            low, high = ends
            middle = 0.5 * (low + high)
            below = middle * middle < read["u"]
            return TRACE.where(below, middle, low), TRACE.where(below, high, middle)

        low, _ = repeated(TRACE, 40, halved, (0.0, 10.0))
        return (), {"root": low}

    text = "\n".join(recorded(law((), step)).step)
    assert "for (int round = 0; round < 40; round++) {" in text
    assert text.count("* t") < 5  # written once, not forty times


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("vehicle: {supply: {voltage: 6.0, sag: 0.05}}", "has a supply between command and plant"),
        ("sensors: {gyroscope: {}}", "has sensors with noise"),
    ],
)
def test_what_keeps_the_mission_from_being_driven_in_c_is_said(
    tmp_path: Path, more: str, words: str
) -> None:
    (tmp_path / "mission.yaml").write_text(f"goal: [0.6, 0.1]\n{more}\n", encoding="utf-8")
    form = Form(load_mission(tmp_path / "mission.yaml"))
    files = package_files(robot_model(), formats=["c"], form=form)
    assert words in files["c/report.md"].decode()
    assert b"drive_mission" not in files["c/loop_selftest.c"]
    assert b"test_guidance" in files["c/loop_selftest.c"]
