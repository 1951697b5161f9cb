"""Structures of another package are fitted, compared, exported to C and read again."""

import math
import re
import subprocess
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from c_programs import COMPILER, FLAGS, needs_compiler
from command_line import Capture, run, write_log
from example_package import EXAMPLE, Installed

from sysid.data.record import Array
from sysid.structures.registry import structure_to_json

SURE = 4.0
"""Standard errors that a right estimate stays within: 1 in 16 000 lies outside."""


PAGE = EXAMPLE.parents[1] / "docs" / "extending.md"


def two_gain_signals(samples: int = 400) -> tuple[Array, Array]:
    """u, y of the equation with white errors of 0.05."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 4), 4)
    e, y = 0.05 * rng.standard_normal(samples), np.zeros(samples)
    for t in range(2, samples):
        drive = 0.8 * u[t - 1] if u[t - 1] > 0.0 else 0.3 * u[t - 1]
        y[t] = 1.2 * y[t - 1] - 0.5 * y[t - 2] + drive + e[t]
    return u, y


def pendulum_signals(samples: int = 300, dt: float = 0.05) -> tuple[Array, Array]:
    """u, y of a pendulum that swings up to 0.7 rad, white noise of 0.01 rad on y.

    By leapfrog in a hundred steps a sample: with omega·h = 0.0025 it is exact to 1e-6 of a swing.
    """
    rng = np.random.default_rng(2)
    u = np.repeat(rng.uniform(-2.0, 2.0, samples // 10), 10)
    y, angle, speed, h = np.zeros(samples), 0.0, 0.0, dt / 100
    for t in range(samples):
        y[t] = angle
        for _ in range(100):
            angle += 0.5 * h * speed
            speed += h * (4.0 * u[t] - 25.0 * math.sin(angle) - 0.5 * speed)
            angle += 0.5 * h * speed
    return u, y + 0.01 * rng.standard_normal(samples)


TRUTHS = {
    "two-gain": (
        two_gain_signals,
        0.1,
        ("--orders", "na=2"),
        {"a1": 1.2, "a2": -0.5, "b_plus": 0.8, "b_minus": 0.3},
    ),
    "pendulum": (pendulum_signals, 0.05, (), {"gain": 4.0, "damping": 0.5, "omega": 5.0}),
}


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("name", TRUTHS)
def test_it_goes_from_a_log_to_c_by_the_command_line(
    name: str, installed: Installed, tmp_path: Path, capsys: Capture
) -> None:
    signals, dt, orders, truth = TRUTHS[name]
    write_log(tmp_path / "log.csv", ["u", "y"], signals(), dt)
    ask = ("log.csv", "--structure", name, *orders, "--split", "0.7")
    fitted = installed.document("fit", *ask, folder=tmp_path)
    found = {p["name"]: p for p in fitted["parameters"]}
    assert found.keys() == truth.keys()
    for parameter, value in truth.items():
        error = found[parameter]["value"] - value
        assert abs(error) < SURE * found[parameter]["std_error"], parameter

    # the saved models are read again by another process, beside one of ours
    linear = ("--structure", "arx", "--orders", "na=2 nb=1 nk=1", "--split", "0.7")
    place = ("--workspace", tmp_path / ".sysid")
    assert run(capsys, "fit", tmp_path / "log.csv", *linear, *place).code == 0
    ranking = installed.document("compare", "--val", "log.csv", folder=tmp_path)
    assert ranking["best"].startswith(name)

    model = ranking["best"]
    made = installed.document("export", "--model", model, "-o", "p", folder=tmp_path)
    assert "c/plant.c" in made["files"]
    code = tmp_path / "p" / "c"
    build = [str(COMPILER), *FLAGS, "-o", "selftest", "plant.c", "selftest.c", "-lm"]
    assert subprocess.run(build, cwd=code, check=False, capture_output=True).returncode == 0
    done = subprocess.run([code / "selftest"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout

    # where the package is missing a model of it is refused in one sentence
    gone = run(capsys, "export", *place, "--model", model, "-o", "q")
    assert gone.code == 1
    assert f"no structure {name!r}" in gone.err


def test_the_code_of_the_page_is_a_package_that_recovers_its_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = PAGE.read_text().partition("\n## A grey box\n")[2]
    grey_box, structure, check = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert grey_box == (EXAMPLE / "sysid_example" / "pendulum.py").read_text()
    folder = tmp_path / "my_structures"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "soft_limit.py").write_text(structure)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "page_check.py").write_text(check)
    found = import_module("page_check")
    s, r, theta = found.model.structure, found.record, found.model.theta
    assert type(s).from_json(structure_to_json(s)) == s
    x, shown = np.zeros(1), []
    for now in r.u:
        x, y = s.step(theta)(x, now)
        shown.append(y)
    np.testing.assert_allclose(shown, s.simulate(theta, r.u), rtol=0, atol=1e-14)
    one_step = s.predict(theta, r.u, r.y, 1, 0)
    np.testing.assert_allclose(one_step, r.y - s.errors(theta, r.u, r.y, 0), rtol=0, atol=1e-14)
