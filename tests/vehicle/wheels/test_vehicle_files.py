"""Vehicles from YAML and URDF and back, and files that describe none."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sysid
from sysid.errors import DataError, SysidError
from sysid.robot.mission.spec import VehicleSpec
from sysid.vehicle.wheels.body import Body, Inertia, box_inertia, cylinder_inertia
from sysid.vehicle.wheels.description import ONLY_MISSIONS, VehicleFile
from sysid.vehicle.wheels.urdf_writing import urdf_text
from sysid.vehicle.wheels.vehicle import Vehicle
from sysid.vehicle.wheels.wheel import Wheel

EXAMPLES = Path(__file__).resolve().parents[3] / "datasets" / "vehicles"


def written(folder: Path, text: str, name: str = "v.yaml") -> Path:
    file = folder / name
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("wheels: []", "v.yaml:1: wheels is empty"),
        ("name: x\nwheels: 3", "v.yaml:2: wheels is 3"),
        ("wheels:\n  - {at: [0, 1], r: 0}", "v.yaml:2: wheels[1].r is 0: give a number above 0"),
        ("wheels:\n  - {r: 1}", "v.yaml:2: the key 'wheels[1].at' is missing: add at: [x, y]"),
        ("wheels:\n  - {at: [0], r: 1}", "v.yaml:2: at is [0.0]: write at: [x, y]"),
        ("wheels:\n  - {at: [0, 1], r: 1, kind: round}", "v.yaml:2: kind is the text 'round'"),
        ("wheels:\n  - {at: [0, 1], r: 1, rolle: 1}", "did you mean 'roller'?"),
        ("wheels:\n  - {at: [0, 1], r: 1, offset: 1}", "only a caster has it"),
        ("wheels:\n  - {at: [0, 1], r: 1, kind: caster}", "a caster needs an offset"),
        ("wheels:\n  - {at: [0, 1], r: 1, heading: 90}", "1.571 for 90 degrees"),
        ("wheels:\n  - {at: [0, 1], r: 1, kind: swedish, roller: 1.57}", "drives nothing"),
        ("wheels:\n  - {at: [0, 1], r: .nan}", "wheels[1].r is nan"),
        ("wheels:\n  - {at: [0, 1], r: 1}\nB: 1", "v.yaml:3: B describes tracks"),
        ("wheels: [{at: [0, 1], r: 1, name: a}, {at: [0, 2], r: 1, name: a}]", "called 'a'"),
        ("mass: -1.5", "v.yaml:1: mass is -1.5: give a number above 0"),
        ("mass: 1\nbody: {mass: 2}", "nothing is left for the others"),
        ("body: {inertia: {ixx: 1, iyy: 1, izz: -1}}", "principal moment of -1"),
        ("body: {inertia: {ixx: 1, iyy: 1, izz: 3}}", "exceeds the sum of the others"),
        ("body: {size: [1, 2]}", "size needs three lengths"),
        ("Bb: 1", "unknown key 'Bb': did you mean 'B'?"),
        ("goal: [1, 0]\nvehicle: 3", "v.yaml:2: vehicle is 3"),
        ("goal: [1, 0]\nvehicle:\n  r: -1", "v.yaml:3: r is -1"),
    ],
)
def test_bad_descriptions_are_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(DataError) as refused:
        sysid.load_vehicle(written(tmp_path, text))
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_section_of_a_mission_is_a_vehicle(tmp_path: Path) -> None:
    """Every key that a mission may give is a vehicle's, or passed over by name."""
    assert VehicleSpec.model_fields.keys() <= {*VehicleFile.model_fields, *ONLY_MISSIONS}
    section = "  r: 0.03\n  B: 0.3\n  command_scale: 255\n"
    whole = sysid.load_vehicle(written(tmp_path, f"goal: [1, 0]\nvehicle:\n{section}"))
    alone = sysid.load_vehicle(written(tmp_path, section.replace("  ", "")))
    assert whole == alone
    assert [w.at[1] for w in whole.wheels] == [0.15, -0.15]
    default = sysid.load_vehicle(written(tmp_path, "goal: [1, 0]\n"))
    assert default.wheels[0].r == VehicleSpec().r


def test_the_masses_of_the_thesis_are_shared_out() -> None:
    whole = sysid.load_vehicle(EXAMPLES / "devastator.yaml")
    parts = whole.with_masses()
    assert parts.body.mass == 0.82573504
    assert parts.wheels[0].mass == pytest.approx((1.592 - 0.82573504) / 2)
    properties = whole.mass_properties()
    assert properties is not None
    assert properties.mass == pytest.approx(1.592)
    # Steiner: two cylinders of 0.383 kg at ±93 mm beside a base link of 2.006e-3 kg m²
    wheel, (r, b) = parts.wheels[0].mass or 0.0, (0.0215, 0.04)
    expected = 2.0064271e-3 + 2 * wheel * (0.093**2 + (3 * r**2 + b**2) / 12)
    assert properties.tensor[2, 2] == pytest.approx(expected)


def test_solid_bodies_have_their_textbook_inertia() -> None:
    box = np.diag(box_inertia(12.0, (1.0, 2.0, 3.0)))
    np.testing.assert_allclose(box, [4 + 9, 1 + 9, 1 + 4])
    cylinder = cylinder_inertia(12.0, 2.0, 3.0, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(np.diag(cylinder), [12 + 9, 24, 12 + 9])


# URDF ---------------------------------------------------------------------------------------------

PLATES = st.floats(-1, 1).map(lambda v: round(v, 3))


@st.composite
def some_vehicle(draw: st.DrawFn) -> Vehicle:
    """A vehicle of which a URDF can hold everything."""
    wheels = []
    for k in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(["fixed", "steerable", "caster", "swedish"]))
        more: dict[str, object] = {}
        if kind == "steerable":
            more = {"angle": draw(PLATES), "angle_limits": (-1.0, draw(st.floats(0.5, 1)))}
        if kind == "caster":
            more = {"offset": 0.03, "side": draw(st.sampled_from([-0.02, 0.02]))}
        if kind == "swedish":
            more = {"roller": draw(PLATES)}
        wheels.append(
            Wheel(
                name=f"w{k}",
                kind=kind,
                at=(draw(PLATES), draw(PLATES), 0.02),
                r=0.05,
                width=0.02,
                heading=draw(st.floats(-3.14, 3.14).map(lambda v: round(v, 9))),
                mass=draw(st.sampled_from([None, 0.4])),
                max_speed=draw(st.sampled_from([None, 20.5])),
                **more,
            )
        )
    size = (0.3, 0.2, 0.1)
    inertia = Inertia.of(box_inertia(2.0, size) + 1e-3 * np.eye(3)[[1, 0, 2]])
    at = (draw(PLATES), 0.0, 0.0)
    body = Body(size=size, at=at, mass=2.0, mass_centre=(0.0, draw(PLATES), 0.0), inertia=inertia)
    friction = draw(st.sampled_from([None, 0.1]))
    return Vehicle(tuple(wheels), name="robot & co", body=body, friction=friction)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(vehicle=some_vehicle())
def test_what_a_urdf_holds_is_read_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory, vehicle: Vehicle
) -> None:
    file = tmp_path_factory.getbasetemp() / "robot.urdf"
    text = urdf_text(vehicle)
    file.write_text(text)
    read = sysid.load_vehicle(file)
    assert read.notes == ()
    for given_wheel, result in zip(vehicle.wheels, read.wheels, strict=True):
        assert result == given_wheel
    assert (read.body, read.friction, read.name) == (vehicle.body, vehicle.friction, vehicle.name)
    assert urdf_text(read) == text


@pytest.mark.parametrize("name", [p.stem for p in EXAMPLES.glob("*.yaml")])
def test_examples_keep_their_kinematics_and_mass_in_a_urdf(name: str, tmp_path: Path) -> None:
    vehicle = sysid.load_vehicle(EXAMPLES / f"{name}.yaml")
    read = sysid.load_vehicle(written(tmp_path, urdf_text(vehicle), "v.urdf"))
    assert (read.degrees, read.icr().kind) == (vehicle.degrees, vehicle.icr().kind)
    np.testing.assert_allclose(read.constraints().J1, vehicle.constraints().J1, atol=1e-11)
    before, after = vehicle.mass_properties(), read.mass_properties()
    assert before is not None
    assert after is not None
    assert after.mass == pytest.approx(before.mass)
    np.testing.assert_allclose(after.tensor, before.tensor, atol=1e-12)


FOREIGN = """<?xml version="1.0"?>
<robot name="foreign" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <link name="base_footprint"/>
  <link name="base_link">
    <inertial><origin xyz="0 0 0.1"/><mass value="3"/>
      <inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="0.4 0.2 0.1"/></geometry></visual>
  </link>
  <joint name="base" type="fixed">
    <parent link="base_footprint"/><child link="base_link"/><origin xyz="0 0 0.05"/></joint>
  <link name="left"><inertial><mass value="0.5"/></inertial>
    <collision><origin rpy="0 0 0"/><geometry><cylinder radius="0.05" length="0.02"/></geometry>
    </collision></link>
  <joint name="left_wheel_joint" type="continuous">
    <parent link="base_link"/><child link="left"/>
    <origin xyz="0 0.12 0" rpy="-1.5707963267949 0 0"/><axis xyz="0 0 1"/>
    <limit effort="5" velocity="12"/></joint>
  <link name="right">
    <visual><geometry><cylinder radius="0.05" length="0.02"/></geometry></visual></link>
  <joint name="right_wheel_joint" type="continuous">
    <parent link="base_link"/><child link="right"/>
    <origin xyz="0 -0.12 0" rpy="1.5707963267949 0 0"/><axis xyz="0 0 1"/></joint>
  <link name="fork"/>
  <joint name="swivel" type="continuous">
    <parent link="base_link"/><child link="fork"/>
    <origin xyz="-0.15 0 0"/><axis xyz="0 0 1"/></joint>
  <link name="roll"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="roll_joint" type="continuous">
    <parent link="fork"/><child link="roll"/>
    <origin xyz="-0.03 0 -0.03"/><axis xyz="0 1 0"/></joint>
  <link name="mast"><inertial><origin xyz="0 0 0"/><mass value="1"/></inertial></link>
  <joint name="lift" type="prismatic">
    <parent link="base_link"/><child link="mast"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <link name="scanner"><visual><geometry><mesh filename="a.stl"/></geometry></visual></link>
  <joint name="scan" type="continuous">
    <parent link="base_link"/><child link="scanner"/><axis xyz="0 1 0"/></joint>
</robot>
"""


def test_a_urdf_of_others_is_understood(tmp_path: Path) -> None:
    """Chained origins, axes turned by rpy, a mirrored wheel, a caster, masses that are fixed."""
    vehicle = sysid.load_vehicle(written(tmp_path, FOREIGN, "foreign.urdf"))
    left, right, roll = vehicle.wheels
    assert (left.name, left.kind, left.r, left.width) == ("left_wheel_joint", "fixed", 0.05, 0.02)
    assert left.at == pytest.approx((0.0, 0.12, 0.05))
    assert (left.heading, left.max_speed, left.mass) == (0.0, 12.0, 0.5)
    assert right.heading == pytest.approx(math.pi)  # its axis points to the right: it is mirrored
    assert (roll.kind, roll.offset, roll.at[:2]) == ("caster", 0.03, (-0.15, 0.0))
    assert vehicle.body.mass == 4.0
    assert vehicle.body.mass_centre == pytest.approx((0.1, 0.0, (3 * 0.15 + 0.05) / 4))
    assert vehicle.body.size == (0.4, 0.2, 0.1)
    assert vehicle.degrees.mobility == 2
    driven = vehicle.inverse((0.5, 0.0, 0.0)).wheels
    assert driven["left_wheel_joint"].speed == pytest.approx(10.0)
    assert driven["right_wheel_joint"].speed == pytest.approx(-10.0)  # as its joint counts
    assert "lift (prismatic)" in " ".join(vehicle.notes)
    assert "scan turns like a wheel" in " ".join(vehicle.notes)


def joined(kind: str, parent: str, child: str, place: str, axis: str = "0 1 0") -> str:
    """A joint of a URDF that is called as its child; place holds the attributes of its origin."""
    return (
        f'<joint name="{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin {place}/><axis xyz="{axis}"/><limit lower="-1" upper="0.5" velocity="9"/></joint>'
    )


def round_link(name: str, radius: float) -> str:
    shape = f'<cylinder radius="{radius}" length="0.04"/>'
    return (
        f'<link name="{name}"><collision><origin rpy="1.57 0 0"/><geometry>{shape}</geometry>'
        "</collision></link>"
    )


def test_gears_are_no_wheels_and_wheels_behind_them_are(tmp_path: Path) -> None:
    """A car with a differential: a ring that carries sides, these the wheels; a pinion inside."""
    links = [round_link("ring", 0.025), round_link("pinion", 0.015), '<link name="chassis"/>']
    links += [round_link(f"side_{s}", 0.015) for s in "lr"]
    links += [round_link(f"wheel_{s}", 0.05) for s in "lr"]
    joints = [joined("continuous", "chassis", "ring", 'xyz="0 0 0.05"')]
    joints += [joined("continuous", "ring", "pinion", 'xyz="0 0 0" rpy="0 0 1.57"')]
    for s, y in (("l", 0.1), ("r", -0.1)):
        joints += [joined("continuous", "ring", f"side_{s}", 'xyz="0 0 0"')]
        joints += [joined("fixed", f"side_{s}", f"wheel_{s}", f'xyz="0 {y} 0"')]
        # a hinge whose frame lies on its side, as some programs write it
        hinge = f'xyz="0.3 {y} 0.05" rpy="0 1.57 0"'
        links += [f'<link name="hinge_{s}"/>', round_link(f"front_{s}", 0.05)]
        joints += [joined("revolute", "chassis", f"hinge_{s}", hinge, "1 0 0")]
        joints += [joined("continuous", f"hinge_{s}", f"front_{s}", 'xyz="0 0 0"')]
    text = f'<robot name="car">{"".join(links + joints)}</robot>'
    car = sysid.load_vehicle(written(tmp_path, text, "car.urdf"))
    kinds = {w.name: (w.kind, w.r) for w in car.wheels}
    assert kinds == {
        "side_l": ("fixed", 0.05),
        "side_r": ("fixed", 0.05),
        "front_l": ("steerable", 0.05),
        "front_r": ("steerable", 0.05),
    }
    assert car.degrees == sysid.load_vehicle(EXAMPLES / "ackermann.yaml").degrees
    assert car.wheels[0].at == pytest.approx((0.0, 0.1, 0.05), abs=1e-3)  # 1.57 is no quarter turn
    front = next(w for w in car.wheels if w.name == "front_l")
    assert front.angle_limits == (-0.5, 1.0)  # the hinge points down
    assert any("pinion turns 0.035 m above the ground" in note for note in car.notes)


def test_wheels_without_a_height_stand_on_one_ground() -> None:
    large, small = Wheel(at=(0, 0.1), r=0.1), Wheel(at=(0, -0.1), r=0.04)
    assert [w.at[2] for w in Vehicle((large, small)).wheels] == pytest.approx([0.0, -0.06])
    lifted = large.model_copy(update={"at": (0.0, 0.1, 0.15)})
    assert [w.at[2] for w in Vehicle((lifted, small)).wheels] == pytest.approx([0.15, 0.09])


def test_another_program_finds_the_same_in_the_urdf() -> None:
    """MuJoCo reads what was written: places, axes and limits of joints, masses and inertias."""
    import mujoco

    vehicle = sysid.load_vehicle(EXAMPLES / "tricycle.yaml")
    masses = {w.name: w.model_copy(update={"mass": 0.7, "heading": 0.2}) for w in vehicle.wheels}
    vehicle = Vehicle(tuple(masses.values()), body=vehicle.body)
    model = mujoco.MjModel.from_xml_string(urdf_text(vehicle))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for wheel in vehicle.wheels:
        joint, body = model.joint(wheel.name), model.body(f"{wheel.name}_link")
        np.testing.assert_allclose(data.xanchor[joint.id], wheel.at, atol=1e-12)
        axle = [-math.sin(wheel.heading), math.cos(wheel.heading), 0.0]
        np.testing.assert_allclose(data.xaxis[joint.id], axle, atol=1e-12)
        mass = 0.7 if wheel.kind == "fixed" else 0.99 * 0.7  # the fork has the rest
        assert body.mass[0] == pytest.approx(mass)
        thin = mass * wheel.r**2 / 2  # about its axle, by far the largest of a wheel this thin
        assert max(body.inertia) == pytest.approx(thin)
    hinge = model.joint("front_steering")
    np.testing.assert_allclose(data.xaxis[hinge.id], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(hinge.range, [-1.0, 1.0])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (("<robot", '<!DOCTYPE a [<!ENTITY b "c">]><robot'), "foreign.urdf:2: a document type"),
        (("</robot>", ""), "this is not XML"),
        (('radius="0.05"', 'radius="0"'), "a cylinder has a length of 0 m"),
        (('radius="0.05"', 'radius="wide"'), "radius of <cylinder> is 'wide'"),
        (('<mass value="3"/>', '<mass value="-3"/>'), "link base_link has a mass of -3 kg"),
        (('izz="0.25"', 'izz="2.5"'), "foreign.urdf:6: of link base_link the inertia"),
        (('child link="left"', 'child link="lefty"'), "names the child link 'lefty'"),
        (('child link="right"', 'child link="left"'), "link left hangs on two joints"),
        (('parent link="fork"', 'parent link="roll"'), "link roll hangs on a ring of joints"),
        (('type="prismatic"', 'type="sliding"'), "has the type 'sliding'"),
        (('xyz="-0.15 0 0"', 'xyz="-0.15 0"'), 'xyz="-0.15 0" is not three numbers'),
        (('<link name="fork"/>', '<link name="mast"/>'), "a second link is called mast"),
        (("continuous", "fixed"), "no wheel is found"),
        (('<link name="fork"/>', '<xacro:include filename="a"/>'), "xacro FILE > robot.urdf"),
    ],
)
def test_a_bad_urdf_is_one_sentence(tmp_path: Path, change: tuple[str, str], sentence: str) -> None:
    file = written(tmp_path, FOREIGN.replace(*change), "foreign.urdf")
    with pytest.raises(SysidError) as refused:
        sysid.load_vehicle(file)
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)
