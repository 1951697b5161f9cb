"""Pictures: the same bytes every time, small, well-formed, and drawn from whatever data come."""

import dataclasses
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.data.record import Channel
from sysid.errors import DataError, UsageError
from sysid.report import plots
from sysid.report.correlation_panels import LagTest
from sysid.report.envelope import envelope, isolated
from sysid.report.fit_picture import FitPicture, FitSegment
from sysid.report.mission_drawing import MissionPicture
from sysid.report.missions.scene import Obstacle, Scene
from sysid.report.ranking_drawing import RankingPicture, RankingRow


def channels(letter: str, n: int, unit: str) -> tuple[Channel, ...]:
    return tuple(Channel(f"{letter}{k + 1}", unit) for k in range(n))


def fit_picture(n: int = 120, ny: int = 1, nu: int = 2, t1: float | None = None) -> FitPicture:
    """A record split at 2/3, or two records when ``t1``, the start of the second, is given."""
    rng = np.random.default_rng(7)
    t, cut = 0.1 * np.arange(n), max(1, 2 * n // 3)
    y = rng.normal(size=(n, ny)).cumsum(axis=0)
    s = y + rng.normal(size=(n, ny))
    u = rng.choice([-9000.0, 9000.0], size=(n, nu))
    later = t[cut:] if t1 is None else t[cut:] - t[cut] + t1
    past, future = np.arange(26.0), np.arange(-25.0, 0.0)
    names = tuple(f"pwm{k + 1}" for k in range(nu))
    whiteness = LagTest(past[1:], ("ω1",), rng.normal(size=(1, 25)), 25.0, 44.3, "white")
    independence = LagTest(past, names, rng.normal(size=(nu, 26)), 143.0, 107.0, "depend on u")
    feedback = LagTest(future, names, rng.normal(size=(nu, 25)), 50.0, 107.0, "")
    return FitPicture(
        title="oe-1: OE, nb = 2, nf = 2, nk = 1",
        outputs=channels("ω", ny, "rad/s"),
        inputs=channels("pwm", nu, "µs"),
        segments=(
            FitSegment(t[:cut], y[:cut], s[:cut], u[:cut], "estimation", "log.csv"),
            FitSegment(later, y[cut:], s[cut:], u[cut:], "validation", "log_val.csv"),
        ),
        initial_state="estimated",
        estimation_fit=(91.47, 91.9, 88.0, 87.0)[:ny],
        validation_fit=(90.04, float("nan"), 85.0, 84.0)[:ny],
        whiteness=(whiteness,) * ny,
        independence=(independence,) * ny if nu else (),
        feedback=(feedback,) * ny if nu else (),
    )


def ranking_picture(n: int = 5) -> RankingPicture:
    rows = [
        RankingRow(
            f"oe-{k}", f"OE  nb={k} nf=2 nk=1", -4000.0 + 3.0**k, f"{-4000 + 3**k}", (97.0, 96)
        )
        for k in range(n)
    ]
    return RankingPicture("Ranked by AIC", "AIC", tuple(rows), ("ω1", "ω2"), from_best=True)


def mission_picture(n: int = 60, width: float = 3.0) -> MissionPicture:
    s = np.linspace(0.0, 1.0, n)
    pose = np.stack([6 * s, width * s**2, np.arctan2(2 * width * s, 6.0)], axis=1)
    return MissionPicture(
        name="obstacles_6_3",
        outcome="arrived",
        t=34 * s,
        pose=pose,
        speed=np.full(n, 0.2),
        pwm=np.stack([9000 + 100 * s, 9000 - 100 * s], axis=1),
        scene=Scene((6.0, width), 0.1, (Obstacle(3.0, 1.0, 0.15),), influence=0.7),
        speed_reference=np.full(n, 0.22),
        heading_reference=pose[:, 2] + 2 * np.pi,
        min_clearance=0.18,
    )


def svg_of(picture: object, folder: Path) -> str:
    path = folder / "picture.svg"
    plots.write_picture(path, picture)
    text = path.read_text(encoding="utf-8")
    ET.fromstring(text)  # well-formed, or this raises
    assert "nan" not in re.sub(r"<!--.*?-->", "", text)  # no coordinate is NaN
    return text


PICTURES = {"fit": fit_picture(), "ranking": ranking_picture(), "mission": mission_picture()}


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


def test_another_process_draws_the_same_bytes_and_obeys_no_matplotlibrc(tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text("font.size: 20\naxes.facecolor: red\n")
    script = (
        "import sys; sys.path[:0] = sys.argv[1:2]\n"
        "import sysid.report.plots as p, test_plots as t\n"
        "from pathlib import Path\n"
        "assert 'matplotlib' not in sys.modules\n"
        "p.write_picture(Path('theirs.svg'), t.ranking_picture())\n"
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
    assert len(svg_of(fit_picture(100_000, 2, 2), tmp_path)) < 300_000


FIT_CASES: dict[str, FitPicture] = {
    "one sample a part": fit_picture(2, 1, 1),
    "two outputs": fit_picture(60, 2, 2),
    "two records": fit_picture(60, 1, 2, t1=0.0),
    "no input": fit_picture(30, 1, 0),
    "without correlations": dataclasses.replace(fit_picture(), whiteness=(), independence=()),
    "whiteness only": dataclasses.replace(fit_picture(), independence=()),
    "independence only": dataclasses.replace(fit_picture(), whiteness=()),
    "no fits": dataclasses.replace(fit_picture(), estimation_fit=(), validation_fit=()),
    "three units": dataclasses.replace(
        fit_picture(40, 1, 3), inputs=(Channel("a", "V"), Channel("b", "A"), Channel("c", "K"))
    ),
    "two units": dataclasses.replace(
        fit_picture(40, 1, 2), inputs=(Channel("a", "V"), Channel("b", "A"))
    ),
    "forty records": dataclasses.replace(
        fit_picture(30, 1, 1), segments=fit_picture(30, 1, 1, t1=0.0).segments * 20
    ),
}


@pytest.mark.parametrize("case", FIT_CASES)
def test_every_kind_of_fit_is_drawn(case: str, tmp_path: Path) -> None:
    text = svg_of(FIT_CASES[case], tmp_path)
    assert "<!-- ω1 [rad/s] -->" in text
    assert "<!-- free-run simulation, initial state estimated -->" in text
    # A lone sample tells no sample time, so nothing can be seen to continue it.
    apart = {"two records", "forty records", "one sample a part"}
    assert ("one after another" in text) == (case in apart)


def test_the_picture_shows_what_decides(tmp_path: Path) -> None:
    text = svg_of(fit_picture(60, 1, 2), tmp_path)
    assert "past inputs: depend on u" in text
    assert "Σ² 143 &gt; 107" in text
    assert "past residuals: white" in text
    assert "Σ² 25 &lt; 44.3" in text


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e300])
def test_useless_simulations_are_drawn(bad: float, tmp_path: Path) -> None:
    picture = fit_picture(50, 1, 1)
    first, last = picture.segments
    broken = dataclasses.replace(last, simulated=np.full_like(last.simulated, bad))
    svg_of(dataclasses.replace(picture, segments=(first, broken)), tmp_path)
    empty = dataclasses.replace(
        broken, measured=broken.simulated * np.nan, u=broken.u * 0.0, part="estimation"
    )
    svg_of(dataclasses.replace(picture, segments=(empty,)), tmp_path)


def test_fit_and_parts_are_named(tmp_path: Path) -> None:
    text = svg_of(fit_picture(60, 2, 1), tmp_path)
    assert "simulated, fit 91.5 % estimation, 90.0 % validation" in text
    assert "simulated, fit 91.9 % estimation, – validation" in text  # undefined, not "nan"
    assert "estimation · log.csv" in text
    assert "validation · log_val.csv" in text


def test_a_gap_breaks_the_line_and_a_lone_sample_is_a_dot(tmp_path: Path) -> None:
    def strokes(measured: np.ndarray) -> tuple[int, int]:
        """Moves of the pen within measured lines, and dots."""
        picture = fit_picture(120, 1, 0)
        first = dataclasses.replace(picture.segments[0], measured=measured)
        bare = dataclasses.replace(picture, segments=(first,), whiteness=(), independence=())
        text = svg_of(bare, tmp_path)
        lines = re.findall(r'd="([^"]*)"[^>]*stroke: #a3b1bf; stroke-width: 2.6', text)
        return max(line.count("M") for line in lines), text.count("fill: #a3b1bf")

    whole = np.sin(0.3 * np.arange(80.0))[:, None]
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
    fit = fit_picture(30, 1, 1)
    awkward = dataclasses.replace(
        fit, title=name, outputs=(Channel(name, name),), inputs=(Channel(name, "µs"),)
    )
    svg_of(awkward, tmp_path)
    row = RankingRow(name, name, 1.0, name, (1.0,))
    svg_of(RankingPicture(name, name, (row, row), (name,)), tmp_path)
    svg_of(dataclasses.replace(mission_picture(), name=name, outcome=name), tmp_path)


def test_greek_letters_are_drawn_as_such(tmp_path: Path) -> None:
    text = svg_of(mission_picture(), tmp_path)
    assert "<!-- reference ψd -->" in text
    assert "<!-- PWM [µs] -->" in text


@pytest.mark.parametrize(
    ("values", "from_best", "higher"),
    [
        ((1.0,), True, False),
        ((np.nan,), True, False),
        ((np.nan, np.nan), False, False),
        ((0.0, 0.0), False, False),
        ((1e-9, 1.0, 1e9), False, False),
        ((1e-9, 1.0, 1e9), False, True),
        ((97.0, -300.0), False, True),
        ((-5.0, -4.0), True, False),
        ((-5.0, -4.0), False, False),
    ],
)
def test_every_kind_of_ranking_is_drawn(
    values: tuple[float, ...], from_best: bool, higher: bool, tmp_path: Path
) -> None:
    rows = tuple(RankingRow(f"m{k}", "", v, f"{v:g}") for k, v in enumerate(values))
    svg_of(RankingPicture("R", "FPE", rows, (), higher, from_best), tmp_path)


def test_a_long_ranking_says_what_it_leaves_out(tmp_path: Path) -> None:
    assert "5 more not shown" in svg_of(ranking_picture(35), tmp_path)


def test_many_outputs_are_summarised(tmp_path: Path) -> None:
    rows = (RankingRow("m", "", 1.0, "1.0", (90.0, 80.0, 70.0, 60.0, 50.0), True),)
    text = svg_of(RankingPicture("R", "FPE", rows, tuple("abcde")), tmp_path)
    assert "<!-- 70.0 % -->" in text
    assert "<!-- 50.0 % -->" in text


@pytest.mark.parametrize("outcome", ["timeout", "collision", "stuck"])
def test_the_outcome_is_in_the_title(outcome: str, tmp_path: Path) -> None:
    words = {"timeout": "timed out", "collision": "collided"}.get(outcome, outcome)
    text = svg_of(dataclasses.replace(mission_picture(), outcome=outcome), tmp_path)
    assert f"obstacles_6_3: {words} after 34.0 s" in text


def test_every_kind_of_mission_is_drawn(tmp_path: Path) -> None:
    alone = mission_picture(1)
    bare = dataclasses.replace(
        alone,
        scene=Scene(alone.scene.goal, alone.scene.tolerance),
        speed_reference=None,
        heading_reference=None,
    )
    svg_of(bare, tmp_path)
    svg_of(mission_picture(60, 0.03), tmp_path)
    gaps = mission_picture().pose.copy()
    gaps[20:30] = np.nan
    svg_of(dataclasses.replace(mission_picture(), pose=gaps), tmp_path)
    lost = dataclasses.replace(mission_picture(), pose=gaps * np.nan)
    svg_of(lost, tmp_path)


def test_shapes_that_do_not_fit_are_named() -> None:
    t, y = np.arange(3.0), np.zeros((3, 1))
    with pytest.raises(DataError, match="have incompatible shapes"):
        FitSegment(t, y, y[:2], y)
    with pytest.raises(DataError, match="1 and 2 are named"):
        dataclasses.replace(fit_picture(), segments=(FitSegment(t, y, y, y),))
    with pytest.raises(DataError, match="one entry per output"):
        dataclasses.replace(fit_picture(), estimation_fit=(1.0, 2.0))
    with pytest.raises(DataError, match="equally long"):
        dataclasses.replace(mission_picture(), speed=np.zeros(3))
    with pytest.raises(DataError, match="1 fits for 2 outputs"):
        dataclasses.replace(ranking_picture(), rows=(RankingRow("m", "", 1.0, "1", (1.0,)),))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=400),
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
