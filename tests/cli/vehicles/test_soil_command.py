"""``sysid soil`` as a person uses it."""

import math
from pathlib import Path

import pytest
from command_line import Capture, run


def test_presets_are_listed_with_their_sources(capsys: Capture) -> None:
    listed = run(capsys, "soil", "--json").document["presets"]
    assert {"dry-sand", "loam", "clay", "snow", "concrete", "carpet"} <= {p["name"] for p in listed}
    assert all(p["source"] and p["std"] for p in listed)
    shown = run(capsys, "soil")
    assert "dry-sand: Wong, Theory of Ground Vehicles" in shown.out


def test_a_soil_under_the_bundled_robot(capsys: Capture) -> None:
    found = run(capsys, "soil", "dry-sand", "--slope", 17, "--slip", "0.1,1", "--json").document
    numbers = {q["name"]: q for q in found["quantities"]}
    assert numbers["slope_pull"]["value"] == pytest.approx(
        1.592 * 9.81 * math.sin(math.radians(17))
    )
    assert 0.0 < numbers["slope_slip"]["value"] < 0.2
    assert numbers["thrust_max"]["std_error"] > 0.0
    assert numbers["turning_moment"]["value"] == pytest.approx(0.53 * 1.592 * 9.81 * 0.14 / 4.0)
    assert [d["slip"] for d in found["drawbar"]] == [0.1, 1.0]
    assert all(d["efficiency"] <= 1.0 - d["slip"] for d in found["drawbar"])
    moments = [t["moment_nm"] for t in found["turning"]]
    assert moments == sorted(moments, reverse=True)


@pytest.mark.slow
def test_files_of_soil_and_vehicle_and_a_picture(capsys: Capture, tmp_path: Path) -> None:
    mission, ground = tmp_path / "mission.yaml", tmp_path / "ground.yaml"
    mission.write_text(
        "goal: [1, 0]\n"
        "vehicle: {mass: 3, L: 0.15, centre: -0.01, soil: concrete, command_scale: 2}\n"
    )
    ground.write_text("soil:\n  preset: clay\n  friction_angle_deg: 10\n")
    own = run(capsys, "soil", "--vehicle", mission, "--set", "friction=0.5", "--json").document
    assert (own["vehicle"]["mass"], own["vehicle"]["contact_length"]) == (3.0, 0.15)
    assert own["pressure"]["distribution"] == "linear"
    assert math.tan(own["soil"]["friction_angle"]) == pytest.approx(0.5)
    assert "friction_angle" not in own["soil"]["std"]
    picture = tmp_path / "soil.svg"
    drawn = run(capsys, "soil", ground, "--vehicle", mission, "--road-wheels", 4, "--plot", picture)
    assert drawn.code == 0, drawn.err
    assert "Cohesion alone holds" in drawn.err
    assert picture.read_text().count("Normal pressure along a track") >= 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("dry-sandy",), "did you mean dry-sand?"),
        (("nothing.yaml",), "nothing.yaml: file not found"),
        (("ice", "--slope", "95"), "the slope is 95°"),
        (("ice", "--slip", "2"), "the slip is 2"),
        (("ice", "--slip", "much"), "--slip cannot read 'much'"),
        (("ice", "--set", "cohesion"), "--set cannot read 'cohesion'"),
        (("ice", "--set", "cohesian=3"), "did you mean cohesion?"),
        (("ice", "--road-wheels", "0"), "0 road wheels"),
        (("ice", "--plot", "picture.eps"), "ends in .svg, .png or .pdf"),
        (("ice", "--vehicle", "{wrong}"), "wrong.yaml:2: unknown key 'mas': did you mean 'mass'?"),
        (("ice", "--vehicle", "{heavy}"), "heavy.yaml:1: mass is the text 'much': give a number"),
        (("ice", "--vehicle", "{light}"), "light.yaml:1: mass is -1: give a number above 0"),
        (("ice", "--vehicle", "{cart}"), "cart.yaml:2: it has wheels"),
        (("{bad}",), "bad.yaml:2: the soil's cohesion is -3"),
    ],
)
def test_wrong_use_is_one_sentence(
    capsys: Capture, tmp_path: Path, arguments: tuple[str, ...], sentence: str
) -> None:
    texts = {
        "wrong": "B: 0.2\nmas: 3\n",
        "heavy": "mass: much\n",
        "light": "mass: -1\n",
        "cart": "name: cart\nwheels: [{at: [0, 0], r: 0.1}]\n",
        "bad": "vehicle:\n  soil: {preset: loam, cohesion: -3}\n",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.yaml").write_text(text)
    files = {name: tmp_path / f"{name}.yaml" for name in texts}
    result = run(capsys, "soil", *(a.format(**files) for a in arguments))
    assert result.code in (1, 2)
    assert sentence in result.err
    assert len(result.err.strip().splitlines()) == 1
