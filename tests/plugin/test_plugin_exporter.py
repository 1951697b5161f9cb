"""A format of another package writes a plant, and is refused where it has nothing to write."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from example_package import Installed

from sysid.plant.package import load_model

OLDER = Path(__file__).resolve().parents[1] / "data" / "0.1"
ARX = "arx-eba84e"


@pytest.mark.slow
def test_the_example_exporter_writes_from_its_wheel(
    installed: Installed, tmp_path: Path, capsys: Capture
) -> None:
    shutil.copytree(OLDER / "workspace", tmp_path / "w")
    ask = ("export", "--workspace", "w", "--model", ARX, "--format", "c,impulse", "-o", "p")
    made = installed.document(*ask, folder=tmp_path)
    assert "impulse/responses.csv" in made["files"]
    assert "c/plant.c" in made["files"]
    assert "impulse/responses.csv" in (tmp_path / "p" / "README.md").read_text()
    with (tmp_path / "p" / "impulse" / "responses.csv").open() as file:
        rows = list(csv.DictReader(file))
    # the package is read where the format is not installed; its model runs by filtering
    model = load_model(tmp_path / "p")
    u = np.tile(model.detrend.u_offset, (len(rows), 1))
    u[0, 0] += 1.0
    expected = (model.simulate(u) - model.detrend.y_offset)[:, 0]
    name = f"{model.outputs[0].name}<-{model.inputs[0].name}"
    found = np.array([float(row[name]) for row in rows])
    assert np.any(found)
    # both round about the operating point: some 1e-16 of it a sample
    scale = float(np.max(np.abs(expected)) + np.abs(model.detrend.y_offset[0]))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * scale)

    missing = run(
        capsys, "export", "--workspace", tmp_path / "w", "--model", ARX, "--format", "impulse"
    )
    assert missing.code == 2
    assert "there is no format 'impulse'" in missing.err


def test_it_refuses_what_is_not_linear(installed: Installed, tmp_path: Path) -> None:
    shutil.copytree(OLDER / "workspace", tmp_path / "w")
    models = sorted(p.stem for p in (tmp_path / "w" / "models").glob("narx-wavelet-*.json"))
    ask = ("export", "--workspace", "w", "--model", models[0], "--format", "impulse", "-o", "p")
    done = installed.sysid(*ask, folder=tmp_path)
    assert done.returncode == 1
    assert "is not linear and has no impulse response" in done.stderr
    assert not (tmp_path / "p").exists()
