"""The page of a diagnosis on a phone: all in 360 px, letters apart and within their panel."""

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import BROWSER, laid_out
from quick_diagnosis import dead_zone_log, diagnose
from test_model_page import Tags

from sysid.data.io import read_log
from sysid.data.record import Channel, Record
from sysid.diagnosis.diagnosis import Diagnosis, Trace
from sysid.diagnosis.validation.localise import Region
from sysid.effects.catalogue import catalogue
from sysid.report import diagnosis_panels as panels
from sysid.report.diagnosis_page import diagnosis_page
from sysid.report.diagnosis_words import ChannelLine
from sysid.report.panels import Panel, Panels
from sysid.report.svg_panels import LETTER, svg
from sysid.report.trace_panels import regimes, stretch

TEXT = re.compile(
    r'<text x="([-\d.]+)" y="([-\d.]+)" text-anchor="(\w+)" class="([\w ]+)">(.*?)</text>'
)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """A diagnosis with every picture it can have."""
    log = read_log(dead_zone_log(tmp_path_factory.mktemp("logs") / "log.csv"))
    line = [[0.1 * k, 0.01 * k * k, 0.0] for k in range(40)]
    trace = {"record": "log.csv", "measured": line, "before": line[:20], "after": line[:30]}
    return replace(diagnose([log], None), path={"mission": "m.yaml", "traces": [trace]})


@pytest.fixture(scope="module")
def page(found: Diagnosis) -> str:
    return diagnosis_page(found, "before", "after").html()


def test_a_page_is_whole_and_stands_alone(page: str) -> None:
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    assert all(re.fullmatch(r"./next_\w+\.csv", a.replace("-", "_")) for a in tags.outside)
    assert "<script" not in page
    assert page.count('<svg class="panel"') >= 15
    for words in ("Excess error by regime", "RMS error by regime", "Residual over", "Path of",
                  "RMSE on held-out data", "Schedule for", "Effects tried"):  # fmt: skip
        assert words in page, words


def test_nothing_moves_sideways(page: str) -> None:
    look = "".join(re.findall(r"<style>(.*?)</style>", page[: page.index("<body>")], re.S))
    assert not re.search(r"[{;\s]min-width: *\d", look)
    heads = len(re.findall(r"<th\b[^>]*>[^<]", page))
    assert heads > 10
    assert set(re.findall(r'data-is="([^"]+)"', page)) >= {"parameter", "RMSE before", "unit"}


def texts(panel: Panel) -> list[tuple[float, float, float, float]]:
    """(left, top, right, bottom) of every text [px], by the mean width of a letter."""
    boxes = []
    for x, y, anchor, kind, words in TEXT.findall(svg(panel)):
        wide = LETTER * len(re.sub(r"&\w+;", "&", words)) * (0.9 if "tick" in kind else 1.0)
        left = float(x) - {"start": 0.0, "middle": 0.5 * wide, "end": wide}[anchor]
        if words:
            boxes.append((left, float(y) - 9.0, left + wide, float(y) + 1.0))
    return boxes


LONG = "w_measured_by_the_encoder_of_the_left_drive_wheel_WWWWWWWWWWWWWWWW"
T = np.arange(200.0)
WAY = np.column_stack([T, T, T]).tolist()
RECORD = Record(
    T[:, None], T[:, None], 1.0, [Channel(LONG, "µs")], [Channel(LONG, "rad/s")],
    name="log of a long day.csv",
)  # fmt: skip
TRACE = Trace(RECORD, T[:, None], T[:, None], "held-out", np.ones(200))
REGION = Region(f"{LONG}: the command is above 75 % of full drive", 0.5, 0.1, (0.4, 0.6))
REGIMES = tuple(
    ("its command is zero while it runs ".strip() * k, 0.1, 2.0, 1.0) for k in (1, 2, 3)
)
ODD: dict[str, Panels] = {
    "regions": panels.regions([REGION] * 2),
    "regimes": regimes(REGIMES, "rad/s", 0.1, changed=True),
    "worst": stretch(TRACE, 0, slice(0, 200), changed=True),
    "gap": panels.gap([ChannelLine(LONG, "rad/s", 1.2345e6, 0.02, 0.01, 10.0, 90.0, 99.9)]),
    "path": panels.paths({"traces": [{"record": LONG, "measured": WAY, "after": WAY}]}),
}


@pytest.mark.parametrize("case", ODD)
def test_long_names_keep_their_room(case: str) -> None:
    for panel in ODD[case]:
        boxes = texts(panel)
        assert boxes
        for left, _, right, _ in boxes:
            assert left >= -1.0, panel.name
            assert right <= 361.0, panel.name
        for a, b in combinations(boxes, 2):
            apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
            assert apart, (panel.name, a, b)


def test_every_accepted_effect_is_among_the_candidates(found: Diagnosis) -> None:
    """One that was tried late, or only beside others, too; scores have a unit."""
    ids = sorted(catalogue(), key=len)[-20:]
    (effect,) = found.effects
    effects = tuple(replace(effect, id=i) for i in (*ids[-2:], "late-effect"))
    candidates = tuple((id, 1e3 - k) for k, id in enumerate(ids))
    (panel,) = panels.candidates(replace(found, effects=effects, candidates=candidates))
    assert len(panel.names) == panels.MOST
    for e in effects:
        assert any(n.startswith(e.id) for n in panel.names), e.id
    assert "late-effect (not alone)" in panel.names
    assert panel.x.endswith("[1]")


@pytest.mark.skipif(BROWSER is None, reason="Chromium is not installed")
def test_a_browser_needs_no_more_than_the_phone(page: str, tmp_path: Path) -> None:
    """Chromium lays the page out in a frame of 360 px and names what sticks out of it."""
    wanted: dict[str, Any] = {"inner": 360, "full": 360, "wide": []}
    assert laid_out(page, tmp_path) == {**wanted, "pictures": page.count('<svg class="panel"')}
