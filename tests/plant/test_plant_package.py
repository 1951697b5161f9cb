"""Plant packages: what is written is read back as the same plant, and damage is told in words."""

import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from plant_models import ORDERS, bench_model, robot_model

from sysid.errors import DataError, ModelError, UsageError
from sysid.export.package import package_files, write_package
from sysid.plant import storage
from sysid.plant.package import CARD, UNLISTED, load_plant, read_description
from sysid.plant.selftest import TOLERANCE, make_selftest, run, selftest
from sysid.plant.storage import MARK, zip_bytes
from sysid.structures.model import Model

REPORT = {
    "validation": {
        "data": "val.csv",
        "horizon": "free run",
        "initial_state": "estimated",
        "fit_percent": {"omega_l": 97.25, "omega_r": float("nan")},
        "rmse": {"omega_l": 0.125, "omega_r": 0.5},
    },
    "estimation": {"data": "est.csv"},
    "warnings": ["Mind the step."],
}

MODELS = [
    *((s, 1, 1, 1) for s in ORDERS),
    *((s, 2, 2, 1) for s in ORDERS),
    ("arx", 1, 1, 0),
    ("oe", 2, 1, 0),
    ("arx", 1, 3, 1),
]


@pytest.mark.parametrize(("structure", "nu", "ny", "nk"), MODELS)
@pytest.mark.parametrize("name", ["plant", "plant.zip"])
def test_every_structure_survives_the_package(
    tmp_path: Path, structure: str, nu: int, ny: int, nk: int, name: str
) -> None:
    model = bench_model(structure, nu, ny, nk)
    path = write_package(model, tmp_path / name)
    plant = load_plant(path)
    assert plant.dt == model.dt
    assert plant.inputs == model.inputs
    assert plant.outputs == model.outputs
    u = model.detrend.u_offset + np.random.default_rng(1).normal(size=(300, nu))
    expected = model.simulate(u)
    # JSON keeps every bit of θ; only the order of additions differs: some 1e-16 a sample
    np.testing.assert_allclose(run(plant, u), expected, atol=1e-11 * np.ptp(expected))
    assert 0 <= selftest(path) < 1e-10 * np.ptp(expected)


def test_selftest_covers_the_domain_from_rest() -> None:
    model = robot_model()
    test = make_selftest(model)
    low, high = model.ranges[:2].T
    assert len(test.t) == 200
    np.testing.assert_array_equal(test.u[:5], 0.0)  # the operating point of a robot
    np.testing.assert_array_equal(test.y[0], 0.0)
    assert np.all(test.u >= low)
    assert np.all(test.u <= high)
    assert np.all(np.ptp(test.u, axis=0) > 0.8 * (high - low))
    assert abs(np.corrcoef(test.u[5:].T)[0, 1]) < 0.5  # the inputs move apart


def test_selftest_numbers_keep_every_bit(tmp_path: Path) -> None:
    model = robot_model()
    text = package_files(model)["selftest.csv"].decode()
    rows = np.array([[float(c) for c in line.split(",")] for line in text.splitlines()[1:]])
    test = make_selftest(model)
    np.testing.assert_array_equal(rows[:, 1:3], test.u)
    np.testing.assert_array_equal(rows[:, 3:], test.y)


def test_the_bytes_depend_on_the_model_only(tmp_path: Path) -> None:
    first = write_package(robot_model(), tmp_path / "a.zip", REPORT, "m").read_bytes()
    os.utime(tmp_path / "a.zip", (0, 0))
    again = write_package(robot_model(), tmp_path / "b.zip", REPORT, "m").read_bytes()
    assert first == again
    folder = write_package(robot_model(), tmp_path / "c", REPORT, "m")
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        built = {
            f"c/{n}" for n in ("Makefile", "CMakeLists.txt", "report.md", "simulink/plant_sfun.c")
        }
        assert set(archive.namelist()) == {CARD, MARK, *UNLISTED, *built}
        for name in archive.namelist():
            assert archive.read(name) == (folder / name).read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.zip", "b.zip", "c"]  # nothing left


def test_plant_json_tells_what_a_user_must_know(tmp_path: Path) -> None:
    model = robot_model()
    raw = read_description(write_package(model, tmp_path / "p", REPORT, "oe-123456"))
    assert [b["kind"] for b in raw["blocks"]] == [
        "input_operating_point",
        "core",
        "output_operating_point",
    ]
    assert raw["fit"]["on"] == "validation"
    assert raw["fit"]["fit_percent"] == {"omega_l": 97.25, "omega_r": None}
    assert raw["domain"]["inputs"]["pwm_l"] == [-12000.0, 12000.0]
    assert raw["data"][0]["sha256"] == model.provenance.data[0].sha256
    assert raw["warnings"] == [*model.warnings, "Mind the step."]
    assert raw["properties"]["stable"] is True
    table = raw["blocks"][1]["parameters"]
    assert [p["value"] for p in table] == model.theta.tolist()
    assert all(p["std_error"] > 0 for p in table)
    assert {p["unit"] for p in table} == {"", "(rad/s)/µs"}


def test_without_validation_the_card_says_so() -> None:
    report = {"estimation": REPORT["validation"] | {"data": "est.csv"}}
    files = package_files(robot_model(), report)
    assert json.loads(files["plant.json"])["fit"]["on"] == "estimation"
    assert "On estimation data (the data it was fitted to, est.csv)" in files[CARD].decode()
    assert "No fit figures are stored" in package_files(robot_model())[CARD].decode()


def test_the_card_shows_equations_parameters_fit_domain_and_warnings() -> None:
    model = robot_model()
    card = package_files(model, REPORT, "oe-123456")[CARD].decode()
    for line in model.structure.equations(model.theta, model.inputs, model.outputs):
        assert line in card
    for p in model.parameter_table():
        assert f"| {p.name} | {p.value:.8g} | {p.std_error:.3g} |" in card
    for words in (
        "97.25",
        "horizon: free run",
        "initial state: estimated",
        "Mind the step.",
        "| pwm_l | input | µs | -12000 | 12000 |",
        "robot.csv",
        "time constant",
    ):
        assert words in card
    assert "$" not in card


def test_an_unstable_model_is_still_packed(tmp_path: Path) -> None:
    from dataclasses import replace

    model = bench_model("oe")
    theta = model.theta.copy()
    names = [p.name for p in model.parameters]
    theta[names.index("f1")], theta[names.index("f2")] = -2.2, 1.2  # poles 1 and 1.2
    unstable = replace(model, theta=theta)
    path = write_package(unstable, tmp_path / "p")
    assert selftest(path) < np.inf
    assert "Unstable" in (path / CARD).read_text()
    assert len(make_selftest(unstable).t) < 200  # it ends before numbers lose their sense


# Replacing and refusing ---------------------------------------------------------------------------


def test_an_existing_package_is_replaced(tmp_path: Path) -> None:
    for name in ("plant", "plant.zip"):
        write_package(robot_model("arx"), tmp_path / name)
        write_package(robot_model("oe"), tmp_path / name)
        assert read_description(tmp_path / name)["blocks"][1]["structure"] == "oe"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["plant", "plant.zip"]


def test_what_belongs_to_others_is_left_alone(tmp_path: Path) -> None:
    package = write_package(robot_model("arx"), tmp_path / "plant")
    (package / "notes.txt").write_text("mine")
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("mine")
    (tmp_path / "photos.zip").write_bytes(zip_bytes({"cat.jpg": b"mine"}))
    (tmp_path / "text.zip").write_text("mine")
    (tmp_path / "file").write_text("mine")
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    for name in ("plant", "thesis", "photos.zip", "text.zip", "file", "file/plant"):
        with pytest.raises((UsageError, DataError)) as caught:
            write_package(robot_model("oe"), tmp_path / name)
        assert "\n" not in str(caught.value)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_the_current_folder_is_not_swapped_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="current folder"):
        write_package(robot_model("arx"), Path())


def test_an_interrupted_write_leaves_the_old_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_package(robot_model("arx"), tmp_path / "plant")
    before = {p.name: p.read_bytes() for p in path.rglob("*") if p.is_file()}
    real = os.rename

    def full(source: object, target: object) -> None:
        if "/new/" in str(source):
            raise OSError(28, "No space left on device")
        real(str(source), str(target))

    monkeypatch.setattr(os, "rename", full)
    with pytest.raises(DataError, match="No space left"):
        write_package(robot_model("oe"), path)
    assert {p.name: p.read_bytes() for p in path.rglob("*") if p.is_file()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["plant"]


# Damage -------------------------------------------------------------------------------------------


def _with(model: Model, change: object) -> bytes:
    raw = json.loads(package_files(model)["plant.json"])
    change(raw)  # type: ignore[operator]
    return json.dumps(raw).encode()


def _core(raw: dict[str, list[dict[str, object]]]) -> dict[str, object]:
    return raw["blocks"][1]


DAMAGE = {
    "other schema": (lambda r: r.update(schema="sysid-plant/9"), "sysid-plant/9"),
    "no schema": (lambda r: r.pop("schema"), "names no schema"),
    "no blocks": (lambda r: r.pop("blocks"), "'blocks' is missing"),
    "blocks in another order": (lambda r: r["blocks"].reverse(), "blocks must be"),
    "an unknown block": (lambda r: r["blocks"][0].update(kind="dead_zone"), "blocks must be"),
    "one block too few": (lambda r: r["blocks"].pop(), "damaged"),
    "unknown structure": (lambda r: _core(r).update(structure="magic"), "no structure 'magic'"),
    "orders that do not fit": (lambda r: _core(r).update(orders={"na": -1}), "cannot be read"),
    "a parameter too few": (lambda r: _core(r)["parameters"].pop(), "do not fit its orders"),
    "a parameter renamed": (
        lambda r: _core(r)["parameters"][0].update(name="q9"),
        "do not fit its orders",
    ),
    "a parameter without value": (
        lambda r: _core(r)["parameters"][0].update(value=None),
        "a number is missing",
    ),
    "a parameter that is NaN": (
        lambda r: _core(r)["parameters"][0].update(value=float("nan")),
        "not finite",
    ),
    "a parameter that is text": (
        lambda r: _core(r)["parameters"][0].update(value="0.5"),
        "a number is missing",
    ),
    "an offset too many": (lambda r: r["blocks"][0]["offset"].append(1.0), "input offsets"),
    "sample time zero": (lambda r: r.update(sample_time=0), "not positive"),
    "no sample time": (lambda r: r.pop("sample_time"), "'sample_time' is missing"),
    "an input too few": (lambda r: r["inputs"].pop(), "channels do not fit"),
    "a channel with a strange key": (lambda r: r["inputs"][0].update(colour=1), "damaged"),
    "domain of one number": (lambda r: r["domain"]["inputs"].update(pwm_l=[1]), "domain"),
    "huge numbers": (lambda r: _core(r)["parameters"][0].update(value=10**400), "damaged"),
}  # fmt: skip


@pytest.mark.parametrize("kind", DAMAGE)
def test_damaged_descriptions_are_refused_in_one_sentence(tmp_path: Path, kind: str) -> None:
    change, words = DAMAGE[kind]
    path = write_package(robot_model("arx"), tmp_path / "p")
    (path / "plant.json").write_bytes(_with(robot_model("arx"), change))
    for use in (load_plant, selftest):
        with pytest.raises(ModelError) as caught:
            use(path)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


HEADER = b"t,pwm_l,pwm_r,omega_l,omega_r\n"
BROKEN = {
    "nothing there": (None, None, "there is no plant package"),
    "no plant.json": ("plant.json", None, "has no plant.json"),
    "no selftest.csv": ("selftest.csv", None, "has no selftest.csv"),
    "not JSON": ("plant.json", b"{", "not JSON"),
    "not UTF-8": ("plant.json", b"\xff\xfe{}", "not JSON"),
    "a list": ("plant.json", b"[]", "names no schema"),
    "too deep": ("plant.json", b"[" * 100_000, "nested too deep"),
    "empty self-test": ("selftest.csv", b"", "selftest.csv is damaged"),
    "self-test of text": ("selftest.csv", HEADER + b"0,a,b,c,d\n", "damaged"),
    "self-test of NaN": ("selftest.csv", HEADER + b"0,0,0,nan,0\n", "damaged"),
    "self-test with other columns": ("selftest.csv", b"t,u,y\n0,0,0\n", "damaged"),
    "self-test with a short row": ("selftest.csv", HEADER + b"0,0,0,0,0\n0,0\n", "damaged"),
    "self-test that fails": ("selftest.csv", HEADER + b"0,0,0,1,0\n", "fails its self-test"),
}


@pytest.mark.parametrize("kind", BROKEN)
@pytest.mark.parametrize("form", ["folder", "zip"])
def test_broken_packages_are_refused_in_one_sentence(tmp_path: Path, kind: str, form: str) -> None:
    member, content, words = BROKEN[kind]
    files = dict(package_files(robot_model("arx")))
    path = tmp_path / ("p" if form == "folder" else "p.zip")
    if member is not None:
        files.pop(member)
        if content is not None:
            files[member] = content
        if form == "zip":
            path.write_bytes(zip_bytes(files))
        else:
            for name, data in files.items():
                (path / name).parent.mkdir(parents=True, exist_ok=True)
                (path / name).write_bytes(data)
    with pytest.raises(ModelError) as caught:
        selftest(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_zip_and_a_truncated_zip(tmp_path: Path) -> None:
    whole = zip_bytes(package_files(robot_model("arx")))
    for content in (b"", b"hello", whole[: len(whole) // 2]):
        (tmp_path / "p.zip").write_bytes(content)
        with pytest.raises(ModelError, match="neither a folder nor an intact zip"):
            load_plant(tmp_path / "p.zip")
    flipped = bytearray(whole)
    at = whole.index(b'"schema"')
    flipped[at] ^= 0xFF  # the checksum of the member catches it
    (tmp_path / "p.zip").write_bytes(bytes(flipped))
    with pytest.raises(ModelError):
        load_plant(tmp_path / "p.zip")


def test_a_hostile_zip_writes_nothing(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    files = dict(package_files(robot_model("arx"))) | {"../escaped.txt": b"x", "/tmp/abs.txt": b"x"}
    (inside / "p.zip").write_bytes(zip_bytes(files))
    load_plant(inside / "p.zip")
    selftest(inside / "p.zip")
    assert [p.name for p in tmp_path.iterdir()] == ["inside"]
    assert [p.name for p in inside.iterdir()] == ["p.zip"]


def test_a_zip_bomb_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "p.zip", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as z:
        z.writestr("plant.json", b" " * (65 * 1024**2))
    with pytest.raises(ModelError, match="too large"):
        load_plant(tmp_path / "p.zip")


def test_a_bomb_of_many_members_is_given_up_at_the_first_too_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [f"c/{k}.c" for k in range(100)]
    described = json.loads(package_files(robot_model("arx"))["plant.json"]) | {"files": names}
    with zipfile.ZipFile(tmp_path / "p.zip", "w", zipfile.ZIP_DEFLATED) as z:
        z.writestr("plant.json", json.dumps(described))
        for name in names:
            z.writestr(name, bytes(100_000))
    opened: list[str] = []
    whole = zipfile.ZipFile.open
    monkeypatch.setattr(storage, "MOST_BYTES", 350_000)
    monkeypatch.setattr(
        zipfile.ZipFile, "open", lambda z, n, *more: opened.append(n) or whole(z, n, *more)
    )
    with pytest.raises(ModelError, match="too large"):
        load_plant(tmp_path / "p.zip")
    assert len(opened) == 5  # plant.json and four of the hundred


def test_the_selftest_notices_a_changed_parameter(tmp_path: Path) -> None:
    path = write_package(robot_model("arx"), tmp_path / "p")

    def change(raw: dict[str, list[dict[str, object]]]) -> None:
        raw["blocks"][1]["parameters"][0]["value"] *= 1 + 1e-6  # type: ignore[index, operator]

    (path / "plant.json").write_bytes(_with(robot_model("arx"), change))
    with pytest.raises(ModelError, match="fails its self-test"):
        selftest(path)
    assert TOLERANCE < 1e-6
