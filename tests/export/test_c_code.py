"""The C code of a plant does what the Python plant does, to rounding."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from c_programs import COMPILER, FLAGS, build, driven, needs_compiler, worst_error
from plant_models import ORDERS, bench_model, robot_model

from sysid.errors import ModelError
from sysid.export.c.step import c_sources
from sysid.plant.selftest import make_selftest
from sysid.structures.base import Structure

EXACT = 1e-12
"""Relative to the output's range: the C code adds in another order than scipy's filter, which
costs some 1e-16 a sample, and the poles of these models amplify that by less than 1e3."""

CASES = [
    *((s, 1, 1, 1) for s in ORDERS),
    *((s, 2, 2, 1) for s in ORDERS),
    ("arx", 1, 1, 0),
    ("oe", 3, 1, 0),
    ("arx", 1, 3, 1),
]


@needs_compiler
@pytest.mark.parametrize(("structure", "nu", "ny", "nk"), CASES)
def test_c_equals_python(tmp_path: Path, structure: str, nu: int, ny: int, nk: int) -> None:
    model = bench_model(structure, nu, ny, nk)
    programs = build(tmp_path, model, "selftest", "driver")
    assert worst_error(programs["selftest"]) < EXACT
    u = model.detrend.u_offset + np.random.default_rng(7).normal(size=(500, nu))
    y = driven(programs["driver"], u)
    expected = model.simulate(u)
    np.testing.assert_allclose(y, expected, rtol=0, atol=EXACT * np.ptp(expected))


@needs_compiler
def test_the_c_selftest_can_fail(tmp_path: Path) -> None:
    model = robot_model("oe")
    build(tmp_path, model)
    source = (tmp_path / "plant.c").read_text()
    first = repr(float(-model.theta[[p.name for p in model.parameters].index(
        "f1[omega_l,pwm_l]")]))  # fmt: skip
    assert first in source
    (tmp_path / "plant.c").write_text(source.replace(first, repr(float(first) * (1 + 1e-6))))
    command = [str(COMPILER), *FLAGS, "-o", "selftest", "plant.c", "selftest.c", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    test = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True, check=False)
    assert test.returncode == 1
    assert float(test.stdout) > 1e-9


@needs_compiler
def test_names_cannot_break_out_of_a_comment(tmp_path: Path) -> None:
    from dataclasses import replace

    model = bench_model("arx")
    wicked = replace(model.inputs[0], name="u */ #error\n#error \\\n??/", unit="/*")
    build(tmp_path, replace(model, inputs=(wicked,)), "selftest")


@needs_compiler
@pytest.mark.skipif(shutil.which("qemu-arm") is None, reason="no qemu-arm here")
@pytest.mark.skipif(shutil.which("arm-linux-gnueabihf-gcc") is None, reason="no compiler for ARM")
def test_what_only_adds_multiplies_and_divides_has_the_same_bits_on_arm(tmp_path: Path) -> None:
    model = bench_model("bj", 2, 2)
    here = build(tmp_path, model, "driver")["driver"]
    command = ["arm-linux-gnueabihf-gcc", *FLAGS, "-ffp-contract=off", "-static", "-o", "by_arm"]
    subprocess.run([*command, "plant.c", "driver.c", "-lm"], cwd=tmp_path, check=True)
    u = model.detrend.u_offset + np.random.default_rng(5).normal(size=(200, 2))
    rows = "\n".join(" ".join(f"{v:.17g}" for v in row) for row in u)
    shown = []
    for way in ([f"./{here.name}"], ["qemu-arm", "./by_arm"]):
        done = subprocess.run(
            way, cwd=tmp_path, input=rows, capture_output=True, text=True, check=True
        )
        shown.append(done.stdout)
    assert shown[0].count("\n") == len(u)
    assert shown[0] == shown[1]


@needs_compiler
def test_channels_may_be_called_like_words_of_c_or_in_greek(tmp_path: Path) -> None:
    from dataclasses import replace

    model = bench_model("oe", 2, 2)
    greek = [replace(c, name=n) for c, n in zip(model.outputs, ("ω", "φ"), strict=True)]
    words = [replace(c, name=n) for c, n in zip(model.inputs, ("double", "if"), strict=True)]
    parameters = model.structure.parameters(words, greek)
    named = replace(model, inputs=tuple(words), outputs=tuple(greek), parameters=parameters)
    programs = build(tmp_path, named, "selftest")
    assert worst_error(programs["selftest"]) < EXACT


def test_the_code_keeps_its_promises() -> None:
    sources = c_sources(robot_model("oe"), make_selftest(robot_model("oe")), "oe-123456")
    assert sorted(sources) == ["plant.c", "plant.h", "selftest.c"]
    for text in sources.values():
        assert "$" not in text
        assert "oe-123456" in text
    for forbidden in ("malloc", "static", "extern double", "printf"):
        assert forbidden not in sources["plant.c"]
    assert "u[0]  pwm_l [µs]" in sources["plant.h"]
    assert "PLANT_SAMPLE_TIME 0.1" in sources["plant.h"]


def test_a_structure_without_transfer_matrix_is_refused() -> None:
    from dataclasses import replace

    class Strange:
        name = "strange"
        nu = ny = 1

    strange: Structure = Strange()  # type: ignore[assignment]
    model = replace(bench_model("arx"), structure=strange)
    with pytest.raises(ModelError, match="cannot be written as C"):
        c_sources(model, make_selftest(bench_model("arx")))
