"""The C code on a Cortex-M4F under qemu-system-arm: same numbers, instructions, no hanging."""

import shutil
from pathlib import Path

import pytest
from plant_models import robot_model

import sysid
from sysid.export.package import PLANT_ALONE, Form, package_files
from sysid.export.verification import runtimes
from sysid.export.verification.runtimes import CORTEX_M4, CortexM, Result
from sysid.robot.mission.spec import load_mission

MISSIONS = Path(sysid.__file__).parents[1] / "datasets" / "missions"

needs_emulator = pytest.mark.skipif(
    CORTEX_M4.lacks() != "", reason="no arm-none-eabi-gcc, newlib or qemu-system-arm here"
)


def replayed(folder: Path, form: Form = PLANT_ALONE, **instead: str) -> Result:
    """The package of a robot on the emulated machine, with other sources in place of some."""
    files = package_files(robot_model(), formats=["c"], form=form)
    files |= {f"c/{name}.c": text.encode() for name, text in instead.items()}
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return CORTEX_M4.replay(folder, files)


@needs_emulator
def test_the_loop_runs_there_and_every_step_is_counted(tmp_path: Path) -> None:
    replay_result = replayed(tmp_path, Form(load_mission(MISSIONS / "goal_1m.yaml"), double=False))
    assert replay_result.failed == ""
    assert replay_result.passed
    assert replay_result.max_error is not None
    assert 1e-9 < replay_result.max_error < 1e-4
    means = {name: c["mean"] for name, c in replay_result.instructions.items()}
    laws = ("guidance_step", "control_step", "command_step")
    assert set(means) == {*laws, "plant_step", "controller_step", "motion_step", "navigation_step"}
    # the controller is its laws and what copies numbers between them
    assert sum(means[n] for n in laws) < means["controller_step"]
    assert means["controller_step"] < 1.5 * sum(means[n] for n in laws)
    # four transfer functions of second order: some 40 operations, as many loads, a few stores
    assert 40 < means["plant_step"] < 200
    assert all(c["mean"] <= c["most"] for c in replay_result.instructions.values())


@needs_emulator
def test_a_program_that_faults_or_never_ends_is_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fault = "int main(void) { return *(volatile int *)0x60000000; }\n"
    assert "selftest fails" in replayed(tmp_path, selftest=fault).failed
    monkeypatch.setattr(runtimes, "SECONDS", 0.5)
    endless = "int main(void) { for (;;); }\n"
    assert "longer than 0.5 s; it was stopped" in replayed(tmp_path, selftest=endless).failed


def test_what_is_not_installed_is_said(tmp_path: Path) -> None:
    nowhere = CortexM("cortex-m4", "no-such-gcc", "qemu-system-arm")
    assert nowhere.replay(tmp_path, {}).skipped == "no-such-gcc is not installed"


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
def test_a_compiler_without_newlib_is_skipped() -> None:
    assert CortexM("cortex-m4", "gcc", "gcc").lacks() == "newlib for arm-none-eabi is not installed"
