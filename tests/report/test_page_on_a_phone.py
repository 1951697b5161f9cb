"""The page of a diagnosis on a phone: everything in 360 px, letters large enough, none hidden."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from browser import BROWSER, laid_out
from quick_diagnosis import dead_zone_log, diagnose

from sysid.data.io import read_log
from sysid.diagnosis.validation.localise import Region
from sysid.effects.catalogue import catalogue
from sysid.report import diagnosis_bars, diagnosis_drawing
from sysid.report.diagnosis_picture import RegimeLine, Window
from sysid.report.diagnosis_words import ChannelLine
from sysid.report.html import diagnosis_page
from sysid.report.plots import inline_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PHONE, MARGIN = 360.0, 16.0
ROOM = PHONE - 2.0 * MARGIN
LEGIBLE = 10.0
"""Height of the smallest letters [px]."""
LETTER = re.compile(
    r'transform="translate\(([-\d.]+) ([-\d.]+)\)( rotate\(-90\))? scale\(([\d.]+) -[\d.]+\)">'
    r"(.*?)</g>",
    re.S,
)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A page with every picture it can have."""
    log = read_log(dead_zone_log(tmp_path_factory.mktemp("logs") / "log.csv"))
    line = [[0.1 * k, 0.01 * k * k, 0.0] for k in range(40)]
    trace = {"record": "log.csv", "measured": line, "before": line[:20], "after": line[:30]}
    diagnosis = replace(diagnose([log], None), path={"mission": "m.yaml", "traces": [trace]})
    return diagnosis_page(diagnosis, "before", "after")


def pictures_of(page: str) -> list[str]:
    return re.findall(r'<svg role="img".*?</svg>', page, re.S)


def viewbox(svg: str) -> tuple[float, float]:
    """Width and height in the picture's own unit [pt]."""
    result = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
    assert result
    return float(result[1]), float(result[2])


def text_boxes(svg: str) -> list[tuple[float, float, float, float, float]]:
    """(left, top, right, bottom, size) of every text [pt].

    The last letter is taken as half its size wide, which few letters fall short of.
    """
    boxes = []
    for x, y, turned, scale, inside in LETTER.findall(svg):
        if "<use" not in inside:
            continue
        starts = [float(v) for v in re.findall(r"<use[^>]*translate\(([-\d.]+)", inside)]
        size = 100.0 * float(scale)
        long = max([0.0, *starts]) * float(scale) + 0.5 * size
        left, low = float(x), float(y)
        if turned:
            boxes.append((left - 0.7 * size, low - long, left, low, size))
        else:
            boxes.append((left, low - 0.7 * size, left + long, low, size))
    return boxes


def check_picture(svg: str) -> None:
    """All text inside the picture, none below the legible size, no text over another."""
    width, height = viewbox(svg)
    assert width * 96.0 / 72.0 <= ROOM  # at the size it asks for: a pixel is 1/96 in
    pixels = ROOM / width  # it fills its column
    boxes = text_boxes(svg)
    assert boxes
    for left, top, right, bottom, size in boxes:
        assert size * pixels >= LEGIBLE
        assert min(left, top) >= -0.5, (left, top)
        assert right <= width + 0.5, (right, width)
        assert bottom <= height + 0.5, (bottom, height)
    for a, b in combinations(boxes, 2):
        apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
        assert apart, (a, b)


def test_every_picture_is_legible_on_a_phone(page: str) -> None:
    pictures = pictures_of(page)
    assert len(pictures) == 11
    for svg in pictures:
        check_picture(svg)


def test_nothing_moves_sideways(page: str) -> None:
    look = "".join(re.findall(r"<style>(.*?)</style>", page[: page.index("<body>")], re.S))
    assert "overflow-x" not in look
    assert not re.search(r"min-width: *\d", look)
    for width in re.findall(r"[^-]width: *(\d+)px", look):
        assert float(width) <= ROOM
    heads = len(re.findall(r"<th\b[^>]*>[^<]", page))
    assert heads > 10
    assert set(re.findall(r'data-is="([^"]+)"', page)) >= {"parameter", "RMSE before", "unit"}


def test_letters_stand_once_in_a_page(page: str) -> None:
    outlines = re.findall(r'<path id="l\d+"([^>]*)/>', page)
    assert len(outlines) == len(set(outlines)) > 20
    assert "DejaVuSans" not in page
    used = set(re.findall(r'<use xlink:href="#(l\d+)"', page))
    assert used == {f"l{k}" for k in range(len(outlines))}


LONG = "w_measured_by_the_encoder_of_the_left_drive_wheel_WWWWWWWWWWWWWWWW"
T = np.arange(200.0)
WINDOW = Window(LONG, "rad/s", "log of a long day.csv", T, T, T, T, T, f"{LONG} [µs]")
LINES = (ChannelLine(LONG, "rad/s", 1.2345e6, 0.02, 0.01, 10.0, 90.0, 99.9),)
REGION = Region(f"{LONG}: the command is above 75 % of full drive", 0.5, 0.1, (0.4, 0.6))
REGIMES = tuple(
    RegimeLine("its command is zero while it runs ".strip() * k, 0.1, 2.0, 1.0) for k in (1, 2, 3)
)
PATHS = tuple((name, np.column_stack([T, T])) for name in ("measured", "before", "after", LONG))
COLUMNS = ("t", *(f"pwm_of_motor_{k}" for k in range(9)))
STEPS = np.ones((3, 10)) * [[0.0], [1.0], [2.0]]
ODD: dict[str, Callable[["Figure"], None]] = {
    "regions": lambda figure: diagnosis_drawing.draw_regions(figure, [REGION] * 2),
    "regimes": lambda figure: diagnosis_drawing.draw_regimes(
        figure, REGIMES, "rad/s", 0.1, changed=True
    ),
    "worst": lambda figure: diagnosis_drawing.draw_worst(figure, [WINDOW], changed=True),
    "gap": lambda figure: diagnosis_bars.draw_gap(figure, LINES),
    "path": lambda figure: diagnosis_drawing.draw_path(figure, PATHS),
    "schedule": lambda figure: diagnosis_drawing.draw_schedule(figure, COLUMNS, STEPS),
}


@pytest.mark.parametrize("case", ODD)
def test_long_names_and_many_of_them_keep_their_room(case: str) -> None:
    check_picture(inline_svg(case, "odd names", ODD[case]))


def test_no_effect_of_the_catalogue_is_cut() -> None:
    """The widest case: every effect accepted, thus in bold."""
    ids = sorted(catalogue(), key=len)[-diagnosis_bars.MOST :]
    candidates = tuple((id, 12345.6) for id in ids)
    shown: list[str] = []

    def draw(figure: "Figure") -> None:
        diagnosis_bars.draw_candidates(figure, candidates, ids, ())
        shown.extend(text.get_text() for text in figure.axes[0].texts)

    check_picture(inline_svg("candidates", "candidates", draw))
    assert set(ids) <= set(shown)


@pytest.mark.skipif(BROWSER is None, reason="Chromium is not installed")
def test_a_browser_needs_no_more_than_the_phone(page: str, tmp_path: Path) -> None:
    """Chromium lays the page out in a frame of 360 px and names what sticks out of it."""
    pictures = len(pictures_of(page))
    assert laid_out(page, tmp_path) == {"inner": 360, "full": 360, "wide": [], "pictures": pictures}
