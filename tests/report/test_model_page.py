"""The page of a model: alone in its file, readable anywhere, and true to the numbers."""

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from browser import BROWSER, laid_out
from command_line import Capture, robot_log, run
from sysid_cli.app import main

from sysid.report.panels import Curve, Panel
from sysid.report.svg_panels import svg
from sysid.workspace.store import Workspace

TITLES = (
    "Checks of the log",
    "Measured and simulated",
    "Fit against steps ahead",
    "Step response",
    "Frequency response over the measured one",
    "Poles and zeros",
    "Residual tests",
    "Residuals against input and output",
    "Parameters",
    "Warnings",
    "Where it comes from",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace as ``fit`` and ``compare`` leave it."""
    place = tmp_path_factory.mktemp("pages")
    log, val = robot_log(place / "log.csv"), robot_log(place / "val.csv", seed=2)
    ws = ("--workspace", str(place / "ws"))
    orders = ("--structure", "arx,oe", "--orders", "arx: na=1 nb=1; oe: nb=1 nf=1")
    assert main(["fit", str(log), "--val", str(val), *orders, *ws]) == 0
    assert main(["compare", *ws]) == 0
    return place / "ws"


class Tags(HTMLParser):
    """Open tags that nobody closes, ids, and addresses of other files."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        self.ids += [named["id"] or ""] if "id" in named else []
        self.outside += [v or "" for k, v in attrs if k in ("src", "href") and (v or "")[:1] != "#"]
        if tag not in ("meta", "input", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Closed in itself."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", ["fit.html", "compare.html"])
def test_a_page_stands_alone(name: str, folder: Path) -> None:
    text = (folder / name).read_text(encoding="utf-8")
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.outside == []
    assert len(set(tags.ids)) == len(tags.ids)
    assert "<script" not in text
    assert len(text) < 1_000_000
    assert not re.search(r"\bnan\b|\binf\b", re.sub(r"<style>.*?</style>", "", text, flags=re.S))


def test_every_section_is_there_with_its_verdict(folder: Path) -> None:
    text = (folder / "fit.html").read_text(encoding="utf-8")
    heads = [text.index(f">{t}</h2>") for t in TITLES]
    assert heads == sorted(heads)
    assert "On data that it was not fitted to (val.csv)" in text
    title = re.search(r"<h1>([-\w]+):", text)
    assert title
    best = Workspace(folder).load(title[1])
    assert f"val.csv --structure {best.model.structure.name} --orders" in text
    assert f"log.csv: SHA-256 {best.model.provenance.data[0].sha256}" in text
    fit = best.report["validation"]["fit_percent"]["omega_l"]
    assert f"omega_l: {fit:.1f}\u00a0% fit" in text


def test_fit_and_compare_agree_or_say_that_they_do_not(folder: Path, capsys: Capture) -> None:
    """With orders given a fit ranks by its own data, a comparison by the log that judges: said."""
    (won,) = re.findall(r"<h1>([-\w]+):", (folder / "fit.html").read_text(encoding="utf-8"))
    page = (folder / "compare.html").read_text(encoding="utf-8")
    ranking = run(capsys, "compare", "--workspace", folder, "--json").document
    best = ranking["best"]
    assert f"Best: {best}." in page
    assert best == won or f"take {best} from now on; before this comparison they took {won}" in page
    for line in ranking["ranking"]:
        stored = Workspace(folder).load(line["model"])
        assert line["aic"] == pytest.approx(stored.report["criteria"]["aic"], rel=1e-12)


def test_the_whole_page_of_a_model_and_of_several(folder: Path, capsys: Capture) -> None:
    ws = ("--workspace", folder)
    told = run(capsys, "report", *ws)
    assert told.out == f"Page: {folder / 'report.html'}\n"
    assert "Checks of the log" in (folder / "report.html").read_text(encoding="utf-8")
    both = run(capsys, "report", "oe", "arx", *ws, "-o", folder / "two.html", "--json").document
    text = Path(both["page"]).read_text(encoding="utf-8")
    assert "2 models on val.csv" in text
    assert re.search(r"RMSE beyond the best.*[-+]\d+\.\d\s%", text, re.S)
    assert run(capsys, "report", *ws, "-o", "page.txt").code == 2


@pytest.mark.skipif(BROWSER is None, reason="Chromium is not installed")
@pytest.mark.parametrize("width", [360, 1280])
@pytest.mark.parametrize("name", ["fit.html", "compare.html"])
def test_nothing_sticks_out(name: str, width: int, folder: Path, tmp_path: Path) -> None:
    text = (folder / name).read_text(encoding="utf-8")
    seen = laid_out(text, tmp_path, width)
    pictures = text.count('<svg class="panel"')
    assert pictures > 8
    assert seen == {"inner": width, "full": width, "wide": [], "pictures": pictures}


@pytest.mark.parametrize(
    "panel",
    [
        Panel("a", "constant", "t", "y", (Curve("", np.arange(9.0), np.ones(9)),)),
        Panel("b", "nothing", "t", "y", (Curve("", np.arange(3.0), np.full(3, np.nan)),)),
        Panel("c", "no point", "t", "y", (Curve("", np.zeros(0), np.zeros(0)),)),
        Panel("d", "zero, log", "w", "G", (Curve("", np.arange(5.0), np.arange(5.0)),), True, True),
        Panel("e", "<b>&", "t", "y", (Curve("x" * 90, np.arange(2.0), np.array([np.inf, 1.0])),)),
    ],
    ids=lambda p: p.title,
)  # fmt: skip
def test_odd_numbers_and_names_leave_a_picture(panel: Panel) -> None:
    text = svg(panel)
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert "nan" not in text
    assert "inf" not in text.replace("info", "")


def test_a_line_is_drawn_where_its_numbers_are() -> None:
    """(0, 0) and (1, 2) lie at the corners of the panel, but for the margin of 6 %."""
    text = svg(Panel("p", "", "x", "y", (Curve("", np.array([0.0, 1.0]), np.array([0.0, 2.0])),)))
    drawn = re.search(r'class="line c0" d="M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)"', text)
    assert drawn
    x0, y0, x1, y1 = map(float, drawn.groups())
    assert (x0, x1) == (52.0, 350.0)
    height = 216.0 - 34.0 - 34.0
    assert y0 - y1 == pytest.approx(height / 1.12, abs=0.2)


def test_names_that_have_no_room_stand_whole_below_the_panel() -> None:
    x = np.array([0.0, 1.0])
    names = [f"augmented-{k:06d}" for k in range(5)]
    drawn = svg(Panel("p", "p", "x", "y", tuple(Curve(n, x, x, colour=0) for n in names)))
    places = {
        n: (float(at[1]), float(at[2]))
        for n in names
        if (at := re.search(rf'<text x="([\d.]+)" y="([\d.]+)"[^>]*>{n}<', drawn))
    }
    assert len(set(places.values())) == len(names)
    height = re.search(r'viewBox="0 0 360 ([\d.]+)"', drawn)
    assert height
    assert all(216.0 < y < float(height[1]) and x < 300.0 for x, y in places.values())
