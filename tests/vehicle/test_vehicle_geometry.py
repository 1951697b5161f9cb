"""The vehicle's lengths in a diagnosis: given, estimated from the pose, and never an effect."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import quick_diagnosis
from command_line import Capture, Run, run, write_log
from pose_cases import DT, driven, ground, wandering
from scipy.signal import lfilter

from sysid.data.record import Record
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis, diagnose_pose
from sysid.effects.ground import Ground
from sysid.robot.calibration.geometry import contradicted
from sysid.robot.calibration.windows import path_of, track_channels, tracks_of
from sysid.vehicle.kinematics import Geometry

ROBOT = Geometry()
WARTHOG = Geometry(0.30, 1.08)
SKIDDING = Geometry(0.30, 1.7 * 1.08)


def told_of(
    geometry: Geometry,
    on: Ground | None = None,
    given: Geometry | None = None,
    change: Callable[[Record], Record] = lambda r: r,
    first: int = 5,
) -> PoseDiagnosis:
    """Two logs of a vehicle that reaches some 0.5 m/s at most, diagnosed."""
    speed = min(1.0, 0.1 / geometry.r)
    parts = [
        change(driven(speed * wandering(seed=s), on, seed=s, geometry=geometry))
        for s in (first, first + 1)
    ]
    diagnosis = diagnose_pose(parts[:1], parts[1:], given)
    assert diagnosis is not None
    return diagnosis


@pytest.mark.parametrize(
    "geometry",
    [WARTHOG, Geometry(0.05, 0.30), Geometry(0.033, 0.16), Geometry(0.0215, 0.35),
     Geometry(0.0215, 0.12), Geometry(0.165, 0.55), Geometry(0.0215, 0.186 * 1.25),
     Geometry(0.0215, 0.186 * 1.45)],
)  # fmt: skip
def test_lengths_that_nobody_gave_are_estimated_and_are_no_effects(geometry: Geometry) -> None:
    diagnosis = told_of(geometry)
    assert diagnosis.effects == ()
    assert not diagnosis.ground
    assert diagnosis.warnings == ()
    assert diagnosis.geometry is not None
    r_error, b_error = diagnosis.geometry.std_errors
    assert r_error is not None
    assert b_error is not None
    # 4 standard errors; they are small: a log of a minute tells a length to 1 %
    assert diagnosis.geometry.geometry.r == pytest.approx(geometry.r, abs=4.0 * r_error)
    assert pytest.approx(geometry.B, abs=4.0 * b_error) == diagnosis.geometry.geometry.B
    assert r_error < 0.01 * geometry.r
    assert b_error < 0.01 * geometry.B
    assert "contradicts" in diagnosis.geometry.sentence


@pytest.mark.slow
def test_a_robot_as_assumed_or_as_given_needs_no_estimate() -> None:
    assert told_of(ROBOT).geometry is None
    assert told_of(WARTHOG, given=WARTHOG).geometry is None
    # off by less than a fifth: the lengths stay, what differs is said as before
    assert told_of(Geometry(0.0215, 0.186 * 1.15)).geometry is None


@pytest.mark.slow
def test_standard_errors_of_the_lengths_hold_the_truth() -> None:
    z = []
    for seed in range(0, 14, 2):
        diagnosis = told_of(WARTHOG, first=seed)
        assert diagnosis.geometry is not None
        r_error, b_error = diagnosis.geometry.std_errors
        assert r_error
        assert b_error
        z += [
            (diagnosis.geometry.geometry.r - WARTHOG.r) / r_error,
            (diagnosis.geometry.geometry.B - WARTHOG.B) / b_error,
        ]
    # of 14 normal z the root mean square is below 1.7 in 99.9 % of the cases
    assert np.sqrt(np.mean(np.square(z))) < 1.7


@pytest.mark.slow
@pytest.mark.parametrize("slip", [0.25, 0.35])
def test_lengths_as_assumed_are_no_estimate_where_slip_explains_the_turns(slip: float) -> None:
    diagnosis = told_of(ROBOT, ground("track-slip", slip))
    assert diagnosis.geometry is None  # turns as of a B that is up to half larger
    assert [e.id for e in diagnosis.effects] == ["track-slip"]
    both = told_of(Geometry(ROBOT.r, 1.4 * ROBOT.B), ground("track-slip", slip))
    assert both.geometry is not None
    assert pytest.approx(1.4 * ROBOT.B, rel=0.02) == both.geometry.geometry.B
    assert [e.id for e in both.effects] == ["track-slip"]


def slipping(seed: int, share: float = 0.08, change: float = 0.06, memory: float = 3.0) -> Record:
    """A log of 300 s on gravel: each side slips by another share every few seconds."""
    rng = np.random.default_rng(seed)
    n, pole = 3000, np.exp(-DT / memory)
    shocks = np.sqrt(1.0 - pole**2) * rng.standard_normal((n, 2))
    slips = share + change * lfilter([1.0], [1.0, -pole], shocks, axis=0)
    speeds = 0.35 * wandering(n, seed)
    pose = path_of(speeds * (1.0 - slips), DT, Ground(), SKIDDING)
    pose += np.array([0.01, 0.01, 0.005]) * rng.standard_normal(pose.shape)
    return replace(driven(speeds, seed=seed), pose=pose, name="gravel.csv", sha256=str(seed))


def test_standard_errors_hold_the_truth_where_slip_comes_and_goes() -> None:
    z = []
    for seed in range(40, 60):
        record = slipping(seed)
        channels = track_channels(record)
        assert channels is not None
        estimate = contradicted(tracks_of([record], channels), ROBOT)
        assert estimate is not None
        r_error, b_error = estimate.std_errors
        assert r_error
        assert b_error
        z.append((estimate.geometry.r - SKIDDING.r * (1.0 - 0.08)) / r_error)
        z.append((estimate.geometry.B - SKIDDING.B) / b_error)
    # of 40 z with spread 1.3, as measured on 60 other logs, 99 % have a root mean square below 1.7;
    # taken for independent errors of one size they have 2.8
    assert np.sqrt(np.mean(np.square(z))) < 1.7


@pytest.mark.parametrize(
    ("on", "id", "value"),
    [
        (ground("track-slip", 0.25), "track-slip", 0.25),
        (ground("radius-mismatch", 0.93, 1.0), "radius-mismatch", 0.93),
    ],
)
def test_effects_are_named_beside_lengths_that_are_estimated(
    on: Ground, id: str, value: float
) -> None:
    diagnosis = told_of(WARTHOG, on)
    assert [e.id for e in diagnosis.effects] == [id]
    assert diagnosis.effects[0].parameters[0].value == pytest.approx(value, abs=0.02)
    assert diagnosis.geometry is not None
    # the mean of both radii, and of B what the slip leaves: 4 % for what they have in common
    lengths = (diagnosis.geometry.geometry.r, diagnosis.geometry.geometry.B)
    assert lengths == pytest.approx((WARTHOG.r, WARTHOG.B), rel=0.04)


def headed(factor: float, angle: float = 0.0, mirrored: float = 1.0) -> Callable[[Record], Record]:
    """The heading counted from elsewhere, the other way round, in degrees, in mirrored axes."""

    def change(record: Record) -> Record:
        assert record.pose is not None
        pose = record.pose * np.array([1.0, mirrored, mirrored])
        turned = np.sign(factor) * pose[:, 2] + angle
        pose[:, 2] = abs(factor) * np.angle(np.exp(1j * turned))
        return replace(record, pose=pose)

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (headed(1.0, np.pi / 2.0), "90° off the driving"),
        (headed(-1.0, np.pi / 2.0), "counts clockwise"),
        (headed(180.0 / np.pi), "in degrees"),
        (headed(-180.0 / np.pi, np.pi / 2.0), "in degrees and counts clockwise"),
        (headed(1.0, 0.0, -1.0), "left and right are swapped"),
    ],
)
@pytest.mark.parametrize("geometry", [ROBOT, Geometry(0.05, 0.30)])
def test_a_heading_of_another_convention_is_understood_and_said(
    geometry: Geometry, change: Callable[[Record], Record], words: str
) -> None:
    diagnosis = told_of(geometry, change=change)
    assert diagnosis.effects == ()
    assert any(words in w for w in diagnosis.warnings)
    assert (diagnosis.geometry is None) == (geometry == ROBOT)


def test_a_pose_in_millimetres_is_called_a_matter_of_units() -> None:
    def in_millimetres(record: Record) -> Record:
        assert record.pose is not None
        return replace(record, pose=record.pose * np.array([1000.0, 1000.0, 1.0]))

    diagnosis = told_of(ROBOT, change=in_millimetres)
    assert diagnosis.geometry is not None
    assert "not in metres" in diagnosis.geometry.sentence


# The command --------------------------------------------------------------------------------------


def posed_log(path: Path, geometry: Geometry, seed: int = 5) -> Path:
    r = driven(wandering(400, seed), seed=seed, geometry=geometry)
    assert r.pose is not None
    names = ["pwm_l", "pwm_r", "omega_l", "omega_r", "x", "y", "psi"]
    return write_log(path, names, [*r.u.T, *r.y.T, *r.pose.T])


@pytest.fixture
def warthog(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a log of a large vehicle; pictures take seconds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sysid.report.diagnosis_page.diagnosis_page", quick_diagnosis.no_page)
    posed_log(tmp_path / "log.csv", WARTHOG)
    return tmp_path


def test_the_first_line_says_that_the_geometry_was_estimated(
    warthog: Path, capsys: Capture
) -> None:
    result = run(capsys, "diagnose", "log.csv")
    assert result.code == 0, result.err
    answer = result.out[result.out.index("The pose contradicts") :]  # below what was read
    assert answer.startswith("The pose contradicts the geometry that is assumed")
    assert "Missing:" not in result.out.removesuffix(answer)
    document = (warthog / ".sysid" / "diagnosis" / "diagnosis.json").read_text()
    assert '"geometry": {' in document
    for id in ("radius-mismatch", "track-width", "track-slip"):
        assert f"{id} (vehicle)" not in result.out


def test_a_given_geometry_is_taken(warthog: Path, capsys: Capture) -> None:
    given = run(capsys, "diagnose", "log.csv", "--geometry", "r=0.30, B=1.08", "--json")
    assert given.document["geometry"] is None
    assert not any("radius" in w for w in given.document["warnings"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0.3,1.08", "--geometry cannot read '0.3'"),
        ("r=0.3", "gives no B"),
        ("r=0.3,B=wide", "cannot read 'B=wide'"),
        ("r=0.3,r=0.3", "--geometry names r twice"),
        ("r=0,B=1", "length in metres above 0"),
    ],
)
def test_a_geometry_that_cannot_be_is_refused(
    text: str, words: str, warthog: Path, capsys: Capture
) -> None:
    result: Run = run(capsys, "diagnose", "log.csv", "--geometry", text)
    assert result.code == 2
    assert words in result.err.replace("\n", " ")


def test_two_geometries_that_differ_are_refused(warthog: Path, capsys: Capture) -> None:
    (warthog / "m.yaml").write_text("goal: [1, 1]\nvehicle: {r: 0.2, B: 1.0}\n")
    result = run(
        capsys, "diagnose", "log.csv", "--geometry", "r=0.30,B=1.08", "--mission", "m.yaml"
    )
    assert result.code == 2
    assert "r = 0.2 m and B = 1 m" in result.err.replace("\n", " ")
