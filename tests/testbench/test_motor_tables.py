"""The thesis's motor from the tables it prints: its numbers to their digits."""

from pathlib import Path

import pytest
import sysid_datasets
from command_line import Capture, run

from sysid.workspace.store import Workspace

TABLES = sorted(sysid_datasets.folder("bench").glob("motor_*.csv"))

PRINTED = {
    # constant: what the printed tables imply, tolerance of its printed digits
    "R": (3.1, 1e-12),
    "Kem": (0.00231, 5e-6),
    "Kc": (8.648e-4, 5e-8),
    "f": (4.3e-8, 5e-10),
    "C0": (1.0e-4, 5e-7),
    "J": (1e-7, 1e-19),
}


def test_the_printed_tables_give_what_they_imply(tmp_path: Path, capsys: Capture) -> None:
    document = run(
        capsys, "bench", "motor", *TABLES, "--workspace", tmp_path / "w", "--json"
    ).document
    result = {p["name"]: p for p in document["parameters"]}
    for name, (value, tolerance) in PRINTED.items():
        assert result[name]["value"] == pytest.approx(value, abs=tolerance), name
        assert result[name]["std_error"] > 0.0
        assert result[name]["reason"]
    assert result["L"]["value"] is None
    ways = {r["how"]: r["value"] for r in document["one_at_a_time"] if r["name"] == "Kc"}
    assert ways["stall: mean of torque over stall current"] == pytest.approx(7.34e-4, abs=5e-7)
    stored = Workspace(tmp_path / "w").load(document["model"])
    assert stored.model.structure.name == "dc-motor"
