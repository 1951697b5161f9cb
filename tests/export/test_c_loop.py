"""The laws of a mission as C: every step function, and the closed loop, against Python."""

import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from c_programs import COMPILER, FLAGS, needs_compiler
from plant_models import robot_model
from pose_cases import two_tracks

import sysid
from sysid.diagnosis.pose.ground_model import with_ground
from sysid.effects.ground import Ground
from sysid.export.c.precision import in_single, single
from sysid.export.c.report import operations
from sysid.export.package import Form, package_files, write_package
from sysid.robot.mission.navigation.fusion import RUN
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.motion import time_constants

MISSIONS = Path(sysid.__file__).parents[1] / "datasets" / "missions"
STRICT = [*FLAGS, "-ffp-contract=off"]
QUICK = [*STRICT, "-O0"]
"""What is compiled once and run once need not be fast."""

FUSED = """
goal: [2, 1]
obstacles: [[1, 1.2], {at: [1.5, 0], velocity: [0.0, 0.01]}]
timeout: 12
navigation: {kind: ekf, q: {slip: 0}}
motion: {kind: slip, slip: 0.2}
sensors: {encoders: {}, gyroscope: {}, position_fixes: {noise: 0.001}}
guidance: {kind: harmonic}
control: {speed: {kind: pid}, yaw: {kind: adaptive}}
"""


def mission_of(text: str, folder: Path) -> Mission:
    (folder / "mission.yaml").write_text(text, encoding="utf-8")
    return load_mission(folder / "mission.yaml")


def exported(folder: Path, mission: Mission, double: bool = True) -> Path:
    """The folder with the C code of a mission and its plant."""
    write_package(robot_model(), folder / "plant", formats=["c"], form=Form(mission, double))
    return folder / "plant" / "c"


def ran(c: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=c, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stderr or done.stdout}"
    return done.stdout


def errors(c: Path, program: str = "./loop_selftest") -> Mapping[str, float]:
    """What a self-test of the loop prints."""
    return {
        n: float(v) for n, v in (line.split() for line in ran(c, *program.split()).splitlines())
    }


def sources(c: Path) -> list[str]:
    return sorted(p.name for p in c.glob("*.c") if p.name != "selftest.c")


@pytest.fixture(scope="module")
def second(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The second mission, in double precision."""
    return exported(
        tmp_path_factory.mktemp("second"), load_mission(MISSIONS / "obstacles_6_3.yaml")
    )


@needs_compiler
def test_the_closed_loop_in_c_drives_the_mission_as_python_does(second: Path) -> None:
    ran(second, str(COMPILER), *STRICT, "-o", "loop_selftest", *sources(second), "-lm")
    deviations = errors(second)
    # the programs stop with an error beyond these; here they are seen to be far below
    assert deviations["closed-loop"] < 1e-12
    assert deviations["later"] == 0
    assert all(
        deviations[name] < 1e-14 for name in ("guidance", "control", "command", "navigation")
    )


@needs_compiler
def test_the_first_mission_is_driven_in_c_as_well(tmp_path: Path) -> None:
    c = exported(tmp_path, load_mission(MISSIONS / "goal_1m.yaml"))
    ran(c, str(COMPILER), *QUICK, "-o", "loop_selftest", *sources(c), "-lm")
    deviations = errors(c)
    assert deviations["closed-loop"] < 1e-12
    assert deviations["later"] == 0


@pytest.mark.slow
@needs_compiler
def test_every_law_of_a_mission_with_filter_and_sensors_is_written(tmp_path: Path) -> None:
    mission = mission_of(FUSED, tmp_path)
    log = simulate(mission, as_robot(robot_model().plant(), mission)[0]).log
    assert log["rejected"].sum() > RUN
    # a gate that does not open again for a run of fixes ends 0.44 m off
    assert np.hypot(log["x"] - log["x_est"], log["y"] - log["y_est"]).max() < 0.1
    c = exported(tmp_path, mission)
    ran(c, str(COMPILER), *QUICK, "-o", "loop_selftest", *sources(c), "-lm")
    deviations = errors(c)
    assert "closed-loop" not in deviations  # its noise is Python's
    assert max(deviations.values()) < 1e-12
    assert "does not drive the mission itself" in (c / "report.md").read_text(encoding="utf-8")


@needs_compiler
def test_single_precision_keeps_what_it_states(tmp_path: Path) -> None:
    c = exported(tmp_path, load_mission(MISSIONS / "goal_1m.yaml"), double=False)
    ran(c, str(COMPILER), *QUICK, "-o", "loop_selftest", *sources(c), "-lm")
    deviations = errors(c)
    assert 1e-9 < deviations["closed-loop"] < single(robot_model()).loop
    assert abs(deviations["later"]) <= 1


CHANGED = r"""
#include <stdio.h>
#include "controller.h"
int main(void)
{
    controller_parameters p;
    controller_state s;
    controller_inputs in = {0.3, 0.2, 0.1, 0.4, 0.1, 0.0};
    controller_outputs out;
    controller_defaults(&p);
    p.guidance.goal_x = 1.5;
    p.guidance.goal_y = 2.0;
    p.guidance.obstacle_2_x = 0.5;
    p.guidance.v_max = 0.25;
    p.control.kp_yaw = 0.7;
    controller_init(&s, &p);
    controller_step(&s, &p, &in, &out);
    printf("%.17g %.17g %.17g %.17g\n", out.reference_speed, out.reference_psi, out.v_cmd,
           out.psi_cmd);
    return 0;
}
"""


@needs_compiler
def test_parameters_changed_at_run_time_act_as_another_mission_does(second: Path) -> None:
    from sysid.robot.mission.contracts import Body, ControlInputs, GuidanceInputs, Pose
    from sysid.runners import floats

    (second / "changed.c").write_text(CHANGED, encoding="utf-8")
    laws = ["changed.c", "controller.c", "guidance.c", "control.c", "command.c"]
    out = ran(second, str(COMPILER), *QUICK, "-o", "changed", *laws, "-lm") + ran(
        second, "./changed"
    )
    (second / "changed.c").unlink()

    other = mission_of(
        "goal: [1.5, 2.0]\nobstacles: [[2, 3.5], [0.5, 1], [4, 2.5], [5, 3]]\n"
        "guidance: {v_max: 0.25}\ncontrol: {kp_yaw: 0.7}\n",
        second.parent,
    )
    scene, seen = other.scene(), Body(Pose(0.2, 0.1, 0.4), 0.1, 0.0)
    asked = GuidanceInputs(0.3, seen, scene)
    guidance, control = other.complete_guidance, other.control
    _, wanted = guidance.step(guidance.start(scene, floats), asked, 0.1, floats)
    _, command = control.step(
        control.start(scene, floats), ControlInputs(0.3, wanted, seen, scene), 0.1, floats
    )
    expected = (wanted.speed, wanted.psi, *command)
    assert [float(v) for v in out.split()] == pytest.approx(expected, rel=1e-14)


@pytest.mark.skipif(shutil.which("make") is None, reason="no make here")
@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake here")
@needs_compiler
@pytest.mark.slow
def test_makefile_and_cmake_build_both_self_tests(second: Path) -> None:
    ran(second, "make", "-s")
    assert errors(second)["later"] == 0
    ran(second, "cmake", "-S", ".", "-B", "build")
    ran(second, "cmake", "--build", "build")
    ran(second, "ctest", "--test-dir", "build")
    shutil.rmtree(second / "build")
    ran(second, "make", "-s", "clean")


@pytest.mark.skipif(shutil.which("clang") is None, reason="no clang here")
def test_clang_has_nothing_to_say(second: Path) -> None:
    ran(second, "clang", *QUICK, "-o", "by_clang", *sources(second), "-lm")
    assert errors(second, "./by_clang")["closed-loop"] < 1e-12


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="no cppcheck here")
def test_cppcheck_has_nothing_to_say(second: Path) -> None:
    checks = "--enable=warning,performance,portability"
    ran(second, "cppcheck", checks, "--error-exitcode=1", "--quiet", "--std=c99", *sources(second))


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
def test_the_sanitizers_see_nothing_undefined(second: Path) -> None:
    sanitize = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    ran(second, "gcc", "-std=c99", "-g", *sanitize, "-o", "sane", *sources(second), "-lm")
    assert errors(second, "./sane")["later"] == 0


@pytest.mark.skipif(shutil.which("qemu-arm") is None, reason="no qemu-arm here")
@pytest.mark.skipif(shutil.which("arm-linux-gnueabihf-gcc") is None, reason="no compiler for ARM")
def test_on_arm_it_gives_the_same(second: Path) -> None:
    compiler = "arm-linux-gnueabihf-gcc"
    ran(second, compiler, *QUICK, "-static", "-o", "by_arm", *sources(second), "-lm")
    assert errors(second, "qemu-arm ./by_arm")["closed-loop"] < 1e-12


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler here")
def test_headers_serve_cpp_and_the_arduino_library_includes_them_all(second: Path) -> None:
    library = second / "arduino" / "SysidRobot"
    headers = {p.name for p in second.glob("*.h")} - {"loop_data.h"}
    assert {p.name for p in (library / "src").glob("*.h")} == {*headers, "SysidRobot.h"}
    sketch = (library / "examples" / "Drive" / "Drive.ino").read_text(encoding="utf-8")
    stub = "#include <cmath>\nstatic unsigned long millis() { return 0; }\n"
    stub += f"{sketch}\nint main() {{ setup(); loop(); return 0; }}\n"
    (second / "sketch.cpp").write_text(stub, encoding="utf-8")
    ran(
        second,
        "g++",
        "-Wall",
        "-Wextra",
        f"-I{library / 'src'}",
        "-c",
        "-o",
        "sketch.o",
        "sketch.cpp",
    )
    for name in ("sketch.cpp", "sketch.o"):
        (second / name).unlink()


def test_the_same_mission_gives_the_same_files() -> None:
    mission = load_mission(MISSIONS / "goal_1m.yaml")
    one, other = (package_files(robot_model(), formats=["c"], form=Form(mission)) for _ in range(2))
    assert one == other
    assert {"c/controller.h", "c/loop_selftest.c", "c/report.md", "c/Makefile"} <= set(one)


def test_the_self_test_holds_what_python_drives() -> None:
    """The rows in C are those of the simulator: nothing of the export's own."""
    mission = load_mission(MISSIONS / "goal_1m.yaml")
    files = package_files(robot_model(), formats=["c"], form=Form(mission))
    text = files["c/loop_data.h"].decode()
    rows = text.partition("loop_rows[")[2].partition("{\n")[2].partition("\n};")[0].splitlines()
    robot, _ = as_robot(robot_model().plant(), mission)
    log = simulate(mission, robot).log
    last = [float(v) for v in rows[-1].strip(" {},").split(",")]
    assert len(rows) == len(log["t"])
    assert last[4:] == [log[n][-1] for n in ("x", "y", "psi")]


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("const double t1 = 0.1 * a[2];", "const float t1 = 0.1f * a[2];"),
        ("x = 1e300 > y ? 1e-300 : -2.0;", "x = HUGE_VALF > y ? 1.1754944e-38f : -2.0f;"),
        ("y = fabs(x) + pow(a, 2.5e-07); /* 0.1 */", "y = fabsf(x) + powf(a, 2.5e-07f); /* 0.1 */"),
        ('printf("double 0.5");', 'printf("double 0.5");'),
        ("x1.5e = t10;", "x1.5e = t10;"),
    ],
)
def test_single_precision_changes_types_literals_and_functions(code: str, expected: str) -> None:
    assert in_single(code) == expected


def test_operations_are_counted_with_their_loops() -> None:
    lines = [
        "const double t0 = a + b * c;",
        "for (int i0 = 0; i0 < 10; i0++) {",
        "    a1[i0] = sin(a0[i0]) - 1.0;",
        "}",
    ]
    assert operations(lines) == (2 + 10, 10)


class _Modes(SimpleNamespace):
    """A structure of which the slowest mode is known."""


@time_constants.register
def _(structure: _Modes, theta: Any) -> Any:
    return np.array([1.0, structure.samples])


def with_mode(samples: float) -> Any:
    """A model whose slowest mode forgets in so many samples."""
    return SimpleNamespace(structure=_Modes(samples=samples), theta=np.zeros(0), dt=0.1)


def test_a_slow_pole_loosens_what_single_precision_promises() -> None:
    quick, slow = single(with_mode(10.0)), single(with_mode(1e5))
    assert quick.reason == ""
    assert slow.loop > 10.0 * quick.loop
    assert "slowest mode (1e+04 s)" in slow.reason


@needs_compiler
def test_a_ground_that_remembers_and_slides_is_driven_in_c(tmp_path: Path) -> None:
    slides = {"ahead": np.full(2, 0.02), "drift": np.full(2, 0.1)}
    numbers = {"scrub-lag": {"lag": np.full(2, 0.3)}, "lateral-slip": slides}
    ground = Ground(tuple(numbers), numbers)
    form = Form(mission_of("goal: [1.5, 1]\ntimeout: 12\n", tmp_path), True)
    write_package(
        with_ground(two_tracks(), ground, {}), tmp_path / "plant", formats=["c"], form=form
    )
    c = tmp_path / "plant" / "c"
    ran(c, str(COMPILER), *QUICK, "-o", "loop_selftest", *sources(c), "-lm")
    assert errors(c)["closed-loop"] < 1e-12


@needs_compiler
def test_what_the_command_module_makes_up_for_may_be_changed(tmp_path: Path) -> None:
    from sysid.export.package import loop_of
    from sysid.robot.mission.contracts import Body, Command, Pose
    from sysid.runners import floats

    base = two_tracks()
    structure = replace(base.structure, effects=("dead-zone",))
    model = replace(
        base,
        structure=structure,
        theta=np.concatenate([base.theta, [0.15, 0.12, 0.0] * 2]),
        parameters=structure.parameters(base.inputs, base.outputs),
        covariance=np.eye(10),
    )
    mission = mission_of(
        "goal: [1, 0.2]\ntimeout: 12\ncontrol: {compensate: identified}\n", tmp_path
    )
    write_package(model, tmp_path / "plant", formats=["c"], form=Form(mission, True))
    c = tmp_path / "plant" / "c"
    main = """
#include <stdio.h>
#include "command.h"
int main(void)
{
    command_parameters p;
    command_state s;
    command_inputs in = {0};
    command_outputs out;
    command_defaults(&p);
    p.dead_zone_plus_r *= 2.0;
    command_init(&s, &p);
    in.v_cmd = 0.4;
    in.psi_cmd = 0.1;
    command_step(&s, &p, &in, &out);
    printf("%.17g %.17g\\n", out.pwm_l, out.pwm_r);
    return 0;
}
"""
    (c / "changed.c").write_text(main, encoding="utf-8")
    ran(c, str(COMPILER), *QUICK, "-o", "changed", "changed.c", "command.c", "-lm")
    loop = loop_of(model, mission)
    known = loop.shaper.identified  # type: ignore[attr-defined]
    numbers = {"dead-zone": {**known.parameters["dead-zone"], "plus": np.array([0.15, 0.3])}}
    other = replace(loop.shaper, identified=replace(known, parameters=numbers))  # type: ignore[type-var]
    body = Body(Pose(0.0, 0.0, 0.0), 0.0, 0.0)
    expected, _ = other(Command(0.4, 0.1), body, 0.0, floats)
    plain, _ = loop.shaper(Command(0.4, 0.1), body, 0.0, floats)
    result = [float(v) for v in ran(c, "./changed").split()]
    assert result == pytest.approx(expected, rel=1e-13)
    assert result[1] > plain[1] + 1.0
