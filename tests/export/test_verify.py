"""``sysid verify``: the self-test on every runtime, and packages that must be refused."""

import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from c_programs import needs_compiler
from command_line import Capture, run
from plant_models import robot_model

import sysid
from sysid.errors import ModelError
from sysid.export.package import Form, form_of, write_package
from sysid.export.verification import runtimes
from sysid.export.verification import verify as module
from sysid.export.verification.verify import foreign_code, verify
from sysid.plant.package import KEY, content_hash, files_of, read_package
from sysid.plant.storage import zip_bytes
from sysid.robot.mission.spec import load_mission

MISSIONS = Path(sysid.__file__).parents[1] / "datasets" / "missions"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return write_package(robot_model(), tmp_path / "plant")


def changed(package: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change a package as somebody would who knows how its hash is made."""
    described = json.loads((package / "plant.json").read_text(encoding="utf-8"))
    change(described)
    there = [n for n in described["files"] if (package / n).is_file()]
    described[KEY] = content_hash(described, {n: (package / n).read_bytes() for n in there})
    (package / "plant.json").write_text(json.dumps(described), encoding="utf-8")


@needs_compiler
def test_every_runtime_that_is_here_gives_what_python_gave(package: Path) -> None:
    results = verify(package)
    ran = [r for r in results.results if not r.skipped]
    assert results.passed
    assert {"python"} < {r.name for r in ran} <= {"python", "gcc", "clang", "qemu-arm", "cortex-m4"}
    for r in ran:
        assert r.max_error is not None
        assert r.max_error < 1e-12, r.name
        assert r.version
    assert {r.name for r in results.results} >= {"FMPy", "libcosimpy"}
    for r in ran:
        # double precision is computed in software there: a multiplication alone takes some 30
        steps = r.instructions.get("plant_step", {"mean": 0.0})
        assert (steps["mean"] > 400) == (r.name == "cortex-m4")


@pytest.mark.slow
def test_the_command_prints_a_table_or_one_document(package: Path, capsys: Capture) -> None:
    document = json.loads(run(capsys, "verify", package, "--json").out)
    assert document["passed"] is True
    assert document["runtimes"][0]["name"] == "python"
    for result in document["runtimes"]:
        assert set(result) >= {"name", "version", "max_error", "passed", "skipped"}
    shown = " ".join(run(capsys, "verify", package).out.split())
    assert "skipped: the package has no FMU" in shown
    there = any(r["instructions"] for r in document["runtimes"])
    assert ("instructions on cortex-m4" in shown) == there


@needs_compiler
def test_a_runtime_that_gives_something_else_fails_the_command(
    package: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "COMPILED", (runtimes.Compiled("gcc", "cc"),))
    source = package / "c" / "plant.c"
    text = source.read_text(encoding="utf-8")
    wrong = text.replace("y[0] = out[0]", "y[0] = 1.001 * out[0]")
    assert wrong != text
    source.write_text(wrong, encoding="utf-8")
    changed(package, lambda described: None)
    gone = run(capsys, "verify", package, "--trust", "--json")
    by_name = {r["name"]: r for r in json.loads(gone.out)["runtimes"]}
    assert gone.code == 1
    assert by_name["python"]["passed"] is True
    assert by_name["gcc"]["passed"] is False
    assert "selftest fails" in by_name["gcc"]["failed"]


@needs_compiler
def test_a_program_that_never_ends_is_stopped(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtimes, "SECONDS", 1.0)
    (package / "c" / "selftest.c").write_text("int main(void) { for (;;); }\n", encoding="utf-8")
    changed(package, lambda described: None)
    runtime = runtimes.Compiled("cc", "cc")
    files = {"c/selftest.c": b""}
    assert "longer than 1 s; it was stopped" in runtime.replay(package, files).failed


ATTACK = """#include <stdio.h>
#include <sys/socket.h>
int main(void) {{
  FILE *outside = fopen("{outside}", "w");
  printf("0 %d\\n", (outside != NULL) + 2 * (socket(AF_INET, SOCK_STREAM, 0) >= 0));
  return 0;
}}
"""


@needs_compiler
def test_code_of_somebody_else_runs_only_where_it_is_trusted_and_then_closed_off(
    package: Path, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its hash is right: what is compared is the code that plant.json gives."""
    monkeypatch.setattr(module, "COMPILED", (runtimes.Compiled("cc", "cc"),))
    outside = tmp_path / "outside.txt"
    (package / "c" / "selftest.c").write_text(ATTACK.format(outside=outside), encoding="utf-8")
    changed(package, lambda described: None)
    gone = run(capsys, "verify", package)
    assert gone.code == 1
    assert "c/selftest.c is not what sysid" in gone.err
    assert "--trust" in gone.err
    assert not outside.exists()
    result = next(r for r in verify(package, trust=True).results if r.name == "cc")
    assert result.max_error == 0.0  # neither wrote outside nor opened a socket
    assert not outside.exists()


@pytest.mark.parametrize("double", [True, False])
def test_the_code_of_a_mission_is_made_again_from_plant_json(tmp_path: Path, double: bool) -> None:
    form = Form(load_mission(MISSIONS / "obstacles_6_3.yaml"), double)
    path = write_package(robot_model(), tmp_path / "plant.zip", formats=["c"], form=form)
    package = read_package(path)
    assert form_of(package.description, "") == form
    assert foreign_code(package, files_of(path)) == {}


def test_a_binary_that_another_compiler_made_is_skipped(tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    path = write_package(robot_model(), tmp_path / "plant", formats=["fmu"])
    unit = path / "fmu" / "plant.fmu"
    with zipfile.ZipFile(unit) as archive:
        inside = {n: archive.read(n) for n in archive.namelist()}
    for change, sources in (("binaries/", False), ("sources/", True)):
        unit.write_bytes(zip_bytes({n: b + b" " * n.startswith(change) for n, b in inside.items()}))
        changed(path, lambda described: None)
        assert foreign_code(read_package(path), files_of(path))["fmu"].sources == sources


def orders_beyond_reason(described: dict[str, Any]) -> None:
    core = next(b for b in described["blocks"] if b["kind"] == "core")
    core["orders"]["nf"] = [[10**9, 10**9], [10**9, 10**9]]


def a_name_that_leads_out(described: dict[str, Any]) -> None:
    described["files"].append("../../etc/passwd")


def too_many_files(described: dict[str, Any]) -> None:
    described["files"] += [f"f{k}" for k in range(1000)]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (orders_beyond_reason, "orders are whole numbers"),
        (a_name_that_leads_out, "its list of files"),
        (too_many_files, "lists 100"),
    ],
)
def test_a_hostile_description_is_refused_though_its_hash_is_right(
    package: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    changed(package, change)
    with pytest.raises(ModelError, match=words) as caught:
        verify(package)
    assert "\n" not in str(caught.value)


def test_a_number_that_is_none_is_refused(package: Path) -> None:
    rows = (package / "selftest.csv").read_text(encoding="utf-8").splitlines()
    rows[5] = ",".join([*rows[5].split(",")[:-1], "nan"])
    (package / "selftest.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    changed(package, lambda described: None)
    with pytest.raises(ModelError, match=r"selftest.csv is damaged"):
        verify(package)


def test_a_package_that_was_changed_or_cut_short_is_refused(package: Path) -> None:
    source = package / "c" / "plant.c"
    whole = source.read_bytes()
    source.write_bytes(whole + b"/* mine */")
    with pytest.raises(ModelError, match="its content and its hash differ"):
        verify(package)
    source.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ModelError, match="its content and its hash differ"):
        verify(package)


def test_a_zip_that_holds_more_than_it_lists_is_refused(package: Path, tmp_path: Path) -> None:
    archive = Path(shutil.make_archive(str(tmp_path / "whole"), "zip", package))
    assert verify(archive).passed
    with zipfile.ZipFile(archive, "a") as opened:
        opened.writestr("../outside.txt", "no")
    with pytest.raises(ModelError, match=r"'../outside.txt', which its plant.json does not list"):
        verify(archive)


def test_a_zip_bomb_is_refused_before_it_is_unpacked(package: Path, tmp_path: Path) -> None:
    described = json.loads((package / "plant.json").read_text(encoding="utf-8"))
    bomb = tmp_path / "bomb.zip"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as opened:
        for name in ("plant.json", "README.md", *described["files"]):
            if name != "c/plant.c":
                opened.write(package / name, name)
        with opened.open("c/plant.c", "w", force_zip64=True) as member:
            for _ in range(65):
                member.write(bytes(1024**2))
    assert bomb.stat().st_size < 1024**2
    with pytest.raises(ModelError, match="too large"):
        verify(bomb)


def test_what_people_build_beside_a_package_does_no_harm(package: Path) -> None:
    (package / "c" / "plant.o").write_bytes(b"\x7fELF")
    (package / "c" / "build").mkdir()
    (package / "c" / "build" / "CMakeCCompilerId.c").write_text("int x;\n")
    (package / "notes.txt").write_text("mine\n")
    assert verify(package).passed


@pytest.mark.parametrize("name", ["c/math.h", "c/more.C", "c/simulink/simstruc.h"])
def test_a_source_that_nobody_exported_is_refused(package: Path, name: str) -> None:
    """A compiler would take it, and no hash covers it."""
    (package / name).write_text("#define sqrt(x) (x)\n")
    with pytest.raises(ModelError, match=f"{name}', which its plant.json does not list"):
        verify(package)
