"""Pictures: the same bytes every time, small, well-formed, and drawn from whatever data come."""

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.data.record import Channel, Record
from sysid.errors import UsageError
from sysid.report import plots
from sysid.report.data_panels import run_panels
from sysid.report.envelope import envelope, isolated
from sysid.report.movement import mover
from sysid.report.panels import PLACES, Curve, Panel, PanelPicture, panel
from sysid.report.svg_panels import svg


def channels(letter: str, n: int, unit: str) -> tuple[Channel, ...]:
    return tuple(Channel(f"{letter}{k + 1}", unit) for k in range(n))


def fit_picture(
    n: int = 120, ny: int = 1, names: str = "ω", bad: float | None = None
) -> PanelPicture:
    """Measured and simulated outputs of one record."""
    rng = np.random.default_rng(7)
    y = rng.normal(size=(n, ny)).cumsum(axis=0)
    run = y + rng.normal(size=(n, ny)) if bad is None else np.full((n, ny), bad)
    outputs = channels(names, ny, "rad/s")
    record = Record(np.zeros((n, 1)), y, 0.1, outputs=outputs, name="log.csv")
    return PanelPicture(
        "oe-1: OE, nb = 2, nf = 2, nk = 1", "free run", run_panels(record, {"oe": run})
    )


def small_picture(name: str = "ranking") -> PanelPicture:
    """Dots over named rows, and dots over a logarithm."""
    rows = Curve("ω", np.arange(3.0), np.array([90.0, 95.0, 97.0]), kind="dots")
    dots = Curve("ω", np.array([1.0, 10.0, 99.0]), np.array([1.0, 2.0, np.nan]), kind="marks")
    panels = (
        Panel(name, name, "fit [%]", "", (rows,), names=(name, "b", "c")),
        Panel("p", name, name, name, (dots,), log_x=True),
    )
    return PanelPicture(name, name, panels)


def way_picture() -> PanelPicture:
    """A plane with what moves in it above two signals."""
    x = np.linspace(0.0, 6.0, 60)
    head = np.array([[0.1, 0.0], [-0.1, 0.1], [-0.1, -0.1]])
    moved = mover(x, x, x**2, np.arctan(2.0 * x), head)
    path = Curve("path ψ", x, x**2)
    way = Panel("way", "Way", "x [m]", "y [m]", (path,), equal=True, large=True, movers=(moved,))
    signals = [Panel(n, n, "time [s]", "[µs]", (Curve("", x, x),)) for n in ("a", "b", "c")]
    return PanelPicture("goal", "arrived", (way, *signals))


def svg_of(picture: object, folder: Path) -> str:
    path = folder / "picture.svg"
    plots.write_picture(path, picture)
    text = path.read_text(encoding="utf-8")
    ET.fromstring(text)  # well-formed, or this raises
    assert "nan" not in re.sub(r"<!--.*?-->", "", text)  # no coordinate is NaN
    return text


PICTURES = {"fit": fit_picture(), "ranking": small_picture(), "mission": way_picture()}


@pytest.mark.parametrize(
    ("name", "suffix"), [*((name, "svg") for name in PICTURES), ("ranking", "png")]
)
def test_the_same_content_gives_the_same_bytes(name: str, suffix: str, tmp_path: Path) -> None:
    for file in (f"a.{suffix}", f"b.{suffix.upper()}"):
        plots.write_picture(tmp_path / file, PICTURES[name])
    first = (tmp_path / f"a.{suffix}").read_bytes()
    assert first == (tmp_path / f"b.{suffix.upper()}").read_bytes()
    assert first.startswith(b"<?xml" if suffix == "svg" else b"\x89PNG")
    assert b"atplotlib v" not in first  # neither date nor version
    assert not re.search(rb"20\d\d-\d\d-\d\d", first)
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"a.{suffix}", f"b.{suffix.upper()}"]


@pytest.mark.slow
def test_another_process_draws_the_same_bytes_and_obeys_no_matplotlibrc(tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text("font.size: 20\naxes.facecolor: red\n")
    script = (
        "import sys; sys.path[:0] = sys.argv[1:2]\n"
        "import sysid.report.plots as p, test_plots as t\n"
        "from pathlib import Path\n"
        "assert 'matplotlib' not in sys.modules\n"
        "p.write_picture(Path('theirs.svg'), t.small_picture())\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "import matplotlib; assert matplotlib.rcParams['font.size'] == 20\n"
    )
    here = str(Path(__file__).parent)
    subprocess.run([sys.executable, "-c", script, here], cwd=tmp_path, check=True)
    plots.write_picture(tmp_path / "ours.svg", PICTURES["ranking"])
    assert (tmp_path / "ours.svg").read_bytes() == (tmp_path / "theirs.svg").read_bytes()


def test_drawing_leaves_the_global_settings_alone(tmp_path: Path) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    svg_of(PICTURES["ranking"], tmp_path)
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("name", ["x.eps", "x", "x.svg.gz", ".svg", "x.jpeg"])
def test_other_suffixes_are_refused_by_name(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"\.svg, \.png or \.pdf"):
        plots.write_picture(tmp_path / name, fit_picture())
    assert not list(tmp_path.iterdir())


def test_a_hundred_thousand_samples_stay_small(tmp_path: Path) -> None:
    assert len(svg_of(fit_picture(100_000, 2), tmp_path)) < 600_000


@pytest.mark.parametrize("n", [1, 2, 60, 500])
@pytest.mark.parametrize("ny", [1, 2])
def test_every_kind_of_fit_is_drawn(n: int, ny: int, tmp_path: Path) -> None:
    text = svg_of(fit_picture(n, ny), tmp_path)
    assert "<!-- ω1 [rad/s] -->" in text
    assert text.count("at its worst") == (3 * ny if n > 120 else 0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e300])
def test_useless_simulations_are_drawn(bad: float, tmp_path: Path) -> None:
    svg_of(fit_picture(50, bad=bad), tmp_path)


def test_a_gap_breaks_the_line_and_a_lone_sample_is_a_dot(tmp_path: Path) -> None:
    def strokes(measured: np.ndarray) -> tuple[int, int]:
        """Moves of the pen within measured lines, and dots."""
        curve = Curve("measured", np.arange(80.0), measured, colour=-1)
        text = svg_of(PanelPicture("", "", (Panel("p", "", "t", "y", (curve,)),)), tmp_path)
        lines = re.findall(r'd="([^"]*)"[^>]*stroke: #a3b1bf; stroke-width: 2.4', text)
        return max(line.count("M") for line in lines), text.count("fill: #a3b1bf")

    whole = np.sin(0.3 * np.arange(80.0))
    gap = whole.copy()
    gap[30:50] = np.nan
    lone = gap.copy()
    lone[40] = 0.5
    assert strokes(whole) == (1, 0)
    assert strokes(gap)[0] == 2
    assert strokes(lone)[1] > strokes(gap)[1]


AWKWARD = ("$x^2 a_b & <c> -- 速度 \t\n\x00 \udcff", "λ" * 300)


@pytest.mark.parametrize("name", AWKWARD)
def test_any_name_can_be_drawn(name: str, tmp_path: Path) -> None:
    svg_of(fit_picture(30, names=name), tmp_path)
    svg_of(small_picture(name), tmp_path)


def test_a_large_panel_stands_alone_and_shows_what_moves_at_some_places() -> None:
    figure = plots.figure_of(way_picture())
    figure.draw_without_rendering()
    boxes = [axes.get_position() for axes in figure.axes]
    assert len(figure.axes[0].patches) == PLACES
    np.testing.assert_allclose(figure.axes[0].patches[0].get_xy()[0], (0.1, 0.0), atol=1e-12)
    assert boxes[0].width > 1.9 * boxes[1].width
    assert boxes[0].height > 1.5 * boxes[1].height
    assert boxes[1].y0 == boxes[2].y0 > boxes[3].y0  # two beside each other, the third below


def test_words_stand_at_their_point_and_curves_take_colours_in_turn() -> None:
    x, at = np.arange(3.0), np.array([1.0])
    curves = (Curve("a", x, x), Curve("b", x, x), Curve("asked for", x, x, colour=-1))
    drawn = panel("a panel", "x", "y", curves, around=(Curve("beside", at, at, kind="words"),))
    assert [c.colour for c in drawn.curves] == [0, -1, 0, 1]
    text = svg(drawn)
    assert text.count(">beside<") == 1
    (axes,) = plots.figure_of(PanelPicture("", "", (drawn,))).axes
    assert [a.get_text() for a in axes.texts] == ["beside"]
    named = [a.get_text() for a in axes.get_legend().get_texts()]
    assert named == ["asked for", "a", "b"]


def test_a_limit_of_named_rows_stands_upright() -> None:
    rows = Curve("", np.arange(2.0), np.array([10.0, 80.0]), kind="dots")
    panel = Panel("p", "", "angle", "", (rows,), rules=(90.0,), names=("a", "b"))
    (axes,) = plots.figure_of(PanelPicture("", "", (panel,))).axes
    assert [90.0, 90.0] in [list(line.get_xdata()) for line in axes.lines]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=150),
    st.integers(1, 50),
)
def test_the_envelope_keeps_every_extreme(values: list[float], bins: int) -> None:
    y, t = np.array(values), np.arange(float(len(values)))
    thin_t, thin_y = envelope(t, y, bins)
    assert len(thin_t) == len(thin_y) <= max(2 * bins, 1)
    assert np.all(np.diff(thin_t) >= 0)
    kept = np.isfinite(thin_y)
    np.testing.assert_array_equal(thin_y[kept], y[thin_t[kept].astype(int)])
    if np.isfinite(y).any():
        assert np.nanmax(thin_y) == np.nanmax(y)
        assert np.nanmin(thin_y) == np.nanmin(y)


def test_an_infinite_sample_counts_as_missing() -> None:
    y = np.array([1.0, np.inf, 2.0, np.nan, -np.inf, 3.0])
    _, seen = envelope(np.arange(6.0), y, 10)
    np.testing.assert_array_equal(np.isnan(seen), [False, True, False, True, True, False])
    np.testing.assert_array_equal(isolated(seen), [True, False, True, False, False, True])
