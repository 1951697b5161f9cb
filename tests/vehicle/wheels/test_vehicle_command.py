"""``sysid vehicle``: documents, tables, pictures and files."""

from pathlib import Path

import pytest
from command_line import Capture, run

import sysid

EXAMPLES = Path(__file__).resolve().parents[3] / "datasets" / "vehicles"


def test_the_document_says_everything(capsys: Capture) -> None:
    result = run(capsys, "vehicle", EXAMPLES / "devastator.yaml", "--json").document
    degrees = (result["mobility"], result["steerability"], result["manoeuvrability"])
    assert degrees == (2, 0, 2)
    assert result["icr"] | {"sentence": ""} == {
        "kind": "line",
        "x": 0.0,
        "y": 0.0,
        "direction": [0.0, 1.0],
        "sentence": "",
    }
    left = result["wheels"][0]
    assert (left["name"], left["kind"], left["y"]) == ("left", "fixed", 0.093)
    assert left["speeds"] == {
        "vx": pytest.approx(1 / 0.0215),
        "vy": None,
        "wz": pytest.approx(-0.093 / 0.0215),
    }
    assert result["limits"]["vx_m_s"] == pytest.approx(0.43)
    assert result["mass_kg"] == pytest.approx(1.592)
    assert "7.39 times" in result["notes"][0]


def test_motions_are_turned_into_speeds_and_back(capsys: Capture) -> None:
    file = EXAMPLES / "devastator.yaml"
    wanted = run(capsys, "vehicle", file, "--twist", "-0.1,0,0.5", "--json").document["inverse"]
    assert wanted["residual_m_s"] == 0.0
    speeds = ",".join(f"{n}={w['speed']!r}" for n, w in wanted["wheels"].items())
    result = run(capsys, "vehicle", file, "--speeds", speeds, "--json").document["forward"]
    assert result["twist"] == pytest.approx({"vx": -0.1, "vy": 0.0, "wz": 0.5}, abs=1e-12)
    assert result["icr"]["y"] == pytest.approx(-0.2)
    in_order = run(capsys, "vehicle", file, "--speeds", "10,10", "--json").document["forward"]
    assert in_order["twist"]["vx"] == pytest.approx(0.215)


def test_the_tables_show_matrices_answers_and_what_is_missing(capsys: Capture) -> None:
    shown = run(
        capsys, "vehicle", EXAMPLES / "ackermann.yaml", "--angles", "0.3,0.3",
        "--twist", "0,0.5,1", "--speeds", "rear_left=1,rear_right=2",
    )  # fmt: skip
    assert shown.code == 0, shown.err
    for words in ("front_left rolls", "rank of C1 at these angles: 3", "Not all of it is possible"):
        assert words in shown.out
    assert "The wheels do not agree" in shown.out
    assert "do not meet in one point" in shown.err


def test_pictures_and_urdf_are_written(capsys: Capture, tmp_path: Path) -> None:
    picture, urdf = tmp_path / "v.svg", tmp_path / "v.urdf"
    file = EXAMPLES / "mecanum.yaml"
    done = run(
        capsys, "vehicle", file, "--twist", "0.1,0,0.5", "--plot", picture, "--urdf", urdf, "--json"
    )
    assert done.document["urdf"] == str(urdf)
    assert "<svg" in picture.read_text()
    before = picture.read_bytes()
    run(capsys, "vehicle", file, "--twist", "0.1,0,0.5", "--plot", picture)
    assert picture.read_bytes() == before
    assert len(sysid.load_vehicle(urdf).wheels) == 4
    again = run(capsys, "vehicle", urdf, "--json").document
    assert (again["mobility"], again["mass_kg"]) == (3, 12.0)  # no wheel of it has a mass


@pytest.mark.parametrize(
    ("options", "sentence", "code"),
    [
        (("--twist", "1,2"), "a twist is three finite numbers", 2),
        (("--twist", "a,b,c"), "--twist cannot read 'a,b,c'; write numbers", 2),
        (("--speeds", "1"), "has 1 numbers for 2 wheels (left, right)", 2),
        (("--speeds", "left=1"), "leave the motion open", 2),
        (("--speeds", "front=1"), "no wheel 'front'", 2),
        (("--speeds", "left=1,left=2"), "once for each wheel", 2),
        (("--angles", "left=0.1"), "left is not steered", 2),
        (("--plot", "v.gif"), ".svg, .png or .pdf", 2),
        (("--urdf", "nowhere/v.urdf"), "nowhere does not exist", 2),
    ],
)
def test_wrong_options_are_one_sentence(
    capsys: Capture, options: tuple[str, ...], sentence: str, code: int
) -> None:
    done = run(capsys, "vehicle", EXAMPLES / "devastator.yaml", *options)
    assert (done.code, done.out) == (code, "")
    assert sentence in " ".join(done.err.split())
