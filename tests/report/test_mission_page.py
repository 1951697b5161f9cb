"""The page of a mission: its verdict is what was driven, its tube holds what it says."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from browser import BROWSER, dumped, laid_out
from mission_cases import Robot, goal
from test_model_page import Tags

from sysid.report.missions.outlines import tube
from sysid.report.missions.page import mission_page, verdict
from sysid.report.missions.panels import ShownRuns, shown_runs
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.monte_carlo.runs import simulate_runs
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission

MISSION = goal(1.0, 0.3, obstacles=[(0.5, -0.3)], walls=[[(0.0, 1.0), (1.0, 1.0)]])
NARROW = ((-5000.0, 5000.0), (-5000.0, 5000.0))


@cache
def drive(mission: Mission = MISSION) -> MissionResult:
    return simulate(mission, Robot())


def test_saturation_and_extrapolation_are_those_of_the_log() -> None:
    result, plant = drive(), Robot(input_range=NARROW)
    u = np.column_stack([result.log["pwm_l"], result.log["pwm_r"]])
    outside = 100.0 * np.mean((np.abs(u) > 5100.0).any(axis=1))  # beyond by 1 % of the range
    assert 0.0 < outside < 100.0
    said = {sentence: mark for mark, sentence in verdict(result, plant)}
    (mark,) = (m for s, m in said.items() if f"In {outside:.1f} % of the time" in s)
    assert mark == "bad"
    wide = verdict(result, Robot(input_range=((-2e4, 2e4),) * 2))
    assert ("good", "All commands are within what the plant was identified on.") in wide
    full = 100.0 * np.mean((np.abs(u) >= 19_990.0).any(axis=1))
    assert any(f"full drive in {full:.1f} %" in s for s in said) is bool(full > 0.0)


def test_the_page_of_many_runs_stands_alone() -> None:
    batch = simulate_runs(MISSION, [Robot()], 60, 3)
    runs = shown_runs(Setup.of(MISSION, [Robot()]), batch)
    assert len(runs.paths) == 60
    text = mission_page("m", MISSION, drive(), Robot(input_range=NARROW), runs).html()
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.outside == []
    assert not re.search(r"\bnan\b|\binf\b", re.sub(r"<style>.*?</style>", "", text, flags=re.S))
    arrived = batch.outcomes["arrived"].count
    for words in ("The way", "Over time", "60 runs", "What matters", "90\u00a0% of the runs",
                  f"{arrived} of 60 runs arrive", "Clearance of the centre"):  # fmt: skip
        assert words in text, words
    assert mission_page("m", MISSION, drive(), None, None).html().count("What matters") == 0


def test_a_tube_holds_its_share_of_shifted_paths() -> None:
    """Straight ways aside by −1 … 1 m: the edges are their 5 % and 95 % quantiles."""
    x = np.linspace(0.0, 4.0, 200)
    aside = np.linspace(-1.0, 1.0, 81)
    outline = tube([np.column_stack([x, np.full(200, a)]) for a in aside])
    assert outline is not None
    left, right = np.split(outline, 2)
    np.testing.assert_allclose(left[:, 1], 0.9, atol=1e-9)
    np.testing.assert_allclose(right[:, 1], -0.9, atol=1e-9)
    assert left[-1, 0] == pytest.approx(4.0)


def test_a_tube_ends_where_half_of_the_paths_have() -> None:
    paths = [np.column_stack([[0.0, 1.0 + k], [0.0, 0.0]]) for k in range(21)]
    outline = tube(paths)
    assert outline is not None
    assert outline[:, 0].max() == pytest.approx(11.0)
    assert tube(paths[:10]) is None
    assert tube([np.zeros((5, 2))] * 30) is None


def test_runs_that_are_too_few_for_shares_say_so() -> None:
    batch = simulate_runs(MISSION, [Robot()], 3)
    runs = ShownRuns(batch, [], [])
    assert "Too few runs to say it." in mission_page("m", MISSION, drive(), None, runs).html()


@pytest.mark.skipif(BROWSER is None, reason="Chromium is not installed")
@pytest.mark.parametrize("width", [360, 1280])
def test_nothing_sticks_out(width: int, tmp_path: Path) -> None:
    text = mission_page("m", MISSION, drive(), Robot(input_range=NARROW)).html()
    pictures = text.count('<svg class="panel"')
    assert pictures == 6
    seen = laid_out(text, tmp_path, width)
    assert seen == {"inner": width, "full": width, "wide": [], "pictures": pictures}


def test_the_robot_moves_over_the_way_without_a_script() -> None:
    """It begins and ends where the path does; less motion leaves the instants, print nothing."""
    text = mission_page("m", MISSION, drive(), Robot()).html()
    assert "<script" not in text
    (way,) = re.findall(r'<path class="line c0" d="M([^"]+)"/><style>', text)
    places = re.findall(r"%\{transform:translate\(([\d.]+)px,([\d.]+)px\)", text)
    ends = [tuple(map(float, p.split(" "))) for p in (way.split("L")[0], way.split("L")[-1])]
    for place, end in zip((places[0], places[-1]), ends, strict=True):
        np.testing.assert_allclose(np.array(place, float), end, atol=0.11)  # a digit each
    times = re.findall(r'class="at"[^>]*aria-label="([\d.]+) s"', text)
    assert float(times[-1]) == pytest.approx(drive().time_s, abs=0.06)
    look = "".join(re.findall(r"<style>(.*?)</style>", text, re.S))
    hidden = re.search(r"@media print \{[^@]*\.drive, \.mover \{ display: none; \}", look)
    assert hidden
    assert hidden.start() > look.index(".drive { display: flex")  # the later rule is the one
    animated = look.count("animation:")
    assert animated == look.count("(prefers-reduced-motion: no-preference){figure") == 1


@pytest.mark.skipif(BROWSER is None, reason="Chromium is not installed")
def test_a_browser_plays_it_from_the_chosen_instant(tmp_path: Path) -> None:
    """One animation, and it starts half way: at the tenth instant of 20."""
    text = mission_page("m", MISSION, drive(), Robot()).html()
    text = text.replace('class="play"', 'class="play" checked').replace(
        " checked><span>", "><span>"
    )
    text = text.replace('value="10" aria', 'value="10" checked aria')
    asked = (
        "<script>addEventListener('load', () => { const all = document.getAnimations();"
        " const t = all[0].effect.getComputedTiming(); document.body.setAttribute('data-told',"
        " [all.length, Math.round(100 * t.delay / t.duration)].join(' ')); });</script></body>"
    )
    assert re.findall(r"<body[^>]*>", dumped(text.replace("</body>", asked), tmp_path)) == [
        '<body data-told="1 -50">'
    ]
