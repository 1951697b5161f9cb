"""report.md: operations a step, sizes and parameters, of a plant alone and of a loop."""

import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from c_programs import COMPILER, needs_compiler
from plant_models import robot_model

import sysid
from sysid.export.c.report import counted
from sysid.export.package import Form, package_files
from sysid.robot.mission.spec import load_mission

MISSIONS = Path(sysid.__file__).parents[1] / "datasets" / "missions"


@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("const double t0 = a - b * c / d;", Counter(added=1, multiplied=1, divided=1)),
        ("out[0] += t0;", Counter(added=1)),
        ("const double t1 = a0[3 * i0 + i1] * -x;", Counter(multiplied=1)),
        ("const double t2 = sqrt(t1) + pow(t0, 2.5);", Counter(added=1, roots=1, calls=1)),
        ("const int t3 = fabs(t1) >= 0.5;", Counter(compared=2)),
        ("const double t4 = t3 ? t1 : t2;", Counter(compared=1)),
        ("const double t5 = (double)((t4 > 0.0) - (t4 < 0.0));", Counter(added=1, compared=2)),
        ("state->x[0] = t5;", Counter()),
    ],
)
def test_operations_of_a_line(line: str, count: Counter[str]) -> None:
    assert counted([line]) == count


def rows(text: str) -> dict[str, list[str]]:
    """Cells of the table of functions by the function, the first of each."""
    collected: dict[str, list[str]] = {}
    for line in text.splitlines():
        if re.match(r"\| `\w+_step` \|", line):
            cells = [c.strip() for c in line.strip("|").split("|")]
            collected.setdefault(cells[0].strip("`"), cells[1:])
    return collected


def test_a_plant_alone_has_its_report() -> None:
    files = package_files(robot_model("arx"), formats=["c"])
    text = files["c/report.md"].decode()
    does, state, parameters, *made = rows(text)["plant_step"]
    # two rows y(t) = a1 y(t-1) + a2 y(t-2) + b1 u(t-1) + b2 u(t-2) for two inputs, in observer form
    assert (state, parameters) == ("32 B", "96 B")
    added, multiplied, divided, roots, compared, calls = map(int, made)
    assert multiplied == 12
    assert added >= 10
    assert (divided, roots, compared, calls) == (0, 0, 0, 0)
    assert "identified plant" in does
    assert "| `b1_omega_l_pwm_l` | (rad/s)/µs | b1[omega_l,pwm_l] |" in text
    assert "./loop_selftest" not in text


@needs_compiler
def test_sizes_are_those_of_the_compiler(tmp_path: Path) -> None:
    form = Form(load_mission(MISSIONS / "goal_1m.yaml"), double=False)
    files = package_files(robot_model(), formats=["c"], form=form)
    for name, content in files.items():
        if name.startswith("c/") and name.count("/") == 1:
            (tmp_path / name[2:]).write_bytes(content)
    table = rows((tmp_path / "report.md").read_text(encoding="utf-8"))
    names = [n.removesuffix("_step") for n in table]
    assert {"plant", "guidance", "control", "command", "navigation", "controller"} <= set(names)
    prints = "".join(
        f'printf("%zu %zu\\n", sizeof({n}_state), sizeof({n}_parameters));\n' for n in names
    )
    includes = "".join(f'#include "{n}.h"\n' for n in names)
    text = f"#include <stdio.h>\n{includes}int main(void) {{ {prints} return 0; }}\n"
    (tmp_path / "sizes.c").write_text(text, encoding="utf-8")
    subprocess.run([str(COMPILER), "-o", "sizes", "sizes.c"], cwd=tmp_path, check=True)
    out = subprocess.run([tmp_path / "sizes"], capture_output=True, text=True, check=True).stdout
    for name, line in zip(names, out.splitlines(), strict=True):
        # a struct without members holds one byte in C, and a struct of structs what fills it up
        for shown, size in zip(table[f"{name}_step"][1:3], map(int, line.split()), strict=True):
            assert abs(int(shown.removesuffix(" B")) - size) <= (4 if name == "controller" else 1)
