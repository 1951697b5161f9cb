"""A folder in which every command has what it needs."""

from pathlib import Path

import numpy as np
import pytest
from plant_models import robot_model, robot_record

from sysid.workspace.store import Workspace


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a log, a mission, a workspace with a model, and its exported plant."""
    monkeypatch.chdir(tmp_path)
    record = robot_record(300)
    header = "t,pwm_l,pwm_r,omega_l,omega_r"
    rows = np.column_stack([record.t, record.u, record.y])
    lines = [header, *(",".join(f"{v:.9g}" for v in row) for row in rows)]
    Path("log.csv").write_text("\n".join(lines) + "\n")
    dead = np.column_stack([record.t, record.u, record.y * [0, 1]])
    lines = [header, *(",".join(f"{v:.9g}" for v in row) for row in dead)]
    Path("constant.csv").write_text("\n".join(lines) + "\n")
    Path("mission.yaml").write_text("goal: [1, 0]\n")
    Path("bad.yaml").write_text("goal: [1, 0]\nfuel: 3\n")
    Path("empty").mkdir()
    Path("bin.csv").write_bytes(bytes(range(256)))
    (tmp_path / "damaged" / "models").mkdir(parents=True)
    (tmp_path / "damaged" / "models" / "arx-000000.json").write_text("{")
    place = Workspace(Path(".sysid"))
    report = {"estimation": {"fit_percent": {"omega_l": 98.5, "omega_r": 98.25}}}
    place.remember("latest", [place.save(robot_model("oe"), report).id])
    from sysid.export.package import write_package

    write_package(robot_model("oe"), place.plant_dir)
    return tmp_path
