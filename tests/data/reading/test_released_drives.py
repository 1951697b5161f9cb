"""Rows in which a drive is released or braked answer no command and are left out."""

from pathlib import Path

import numpy as np
import pytest

from sysid.data.io import read_file
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.roles import roles
from sysid.errors import DataError, UsageError


def written(folder: Path, name: str, engaged: np.ndarray) -> Path:
    """A motor's speed, which coasts where ``engaged`` is 0."""
    w, rows = 0.0, [f"t,u_V,speed_rad_s,{name}"]
    for k, on in enumerate(engaged):
        u = 2.0 * np.sin(0.05 * k) * on
        w += 0.1 * (u - w) if on else -0.002 * w
        rows.append(f"{0.01 * k:.2f},{u:.4f},{w:.5f},{int(on)}")
    path = folder / "bench.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


ON = np.repeat([1, 0, 1], [120, 80, 100])


@pytest.mark.parametrize(("name", "state"), [("torque_on", ON), ("brake", 1 - ON), ("Enabled", ON)])
def test_released_rows_cut_a_log_into_driven_pieces(
    tmp_path: Path, name: str, state: np.ndarray
) -> None:
    found = read_file(written(tmp_path, name, ON if name != "brake" else state))
    if name == "brake":  # written with the drive's own state
        text = (tmp_path / "bench.csv").read_text().splitlines()
        assert text[1].endswith(",0")
        assert text[150].endswith(",1")
    assert [len(r) for r in found.records] == [120, 100]
    (said,) = [f for f in found.findings if f.code == "released"]
    assert "80 of 300 rows" in said.sentence
    (shown,) = [d for d in found.records[0].read_as if d.what == "driven"]
    assert name in shown.value


def test_every_row_is_kept_where_it_is_asked_for(tmp_path: Path) -> None:
    path = written(tmp_path, "torque_on", ON)
    (whole,) = read_file(path, ReadOptions(enable="none")).records
    assert len(whole) == 300


def test_a_brake_that_is_an_input_leaves_no_row_out(tmp_path: Path) -> None:
    path = written(tmp_path, "BrakeLight", 1 - ON)
    head, *rows = path.read_text().splitlines()
    bars = [f"{r},{12.5 * float(r[-1]):g}" for r in rows]
    path.write_text("\n".join([f"{head},BrakePressure", *bars]) + "\n")
    outputs = ("speed_rad_s",)
    both = ReadOptions(inputs=("u_V", "BrakePressure"), outputs=outputs)
    assert [len(r) for r in read_file(path, both).records] == [300]
    assert len(read_file(path, ReadOptions(inputs=("u_V",), outputs=outputs)).records) == 2


def test_a_column_of_any_name_can_be_given(tmp_path: Path) -> None:
    path = written(tmp_path, "state", ON)
    options = ReadOptions(inputs=("u_V",), outputs=("speed_rad_s",))
    assert len(read_file(path, options).records) == 1
    given = ReadOptions(inputs=("u_V",), outputs=("speed_rad_s",), enable="state")
    assert len(read_file(path, given).records) == 2
    with pytest.raises(UsageError, match="clutch"):
        read_file(path, ReadOptions(enable="clutch"))
    with pytest.raises(DataError, match="two values"):
        read_file(path, ReadOptions(outputs=("speed_rad_s",), inputs=("state",), enable="u_V"))


def test_a_switch_that_never_moves_says_nothing(tmp_path: Path) -> None:
    found = read_file(written(tmp_path, "torque_on", np.ones(300)))
    assert not [f for f in found.findings if f.code == "released"]


def test_a_switch_is_an_input_only_where_nothing_else_is_commanded() -> None:
    of = {"brake": np.arange(9) % 2.0, "u_V": np.arange(9) % 3.0, "speed": np.arange(9) % 4.0}
    assert roles(dict.fromkeys(of, ""), (), (), (), of.get).inputs == (("u_V",),)
    assert roles({"brake": "", "speed": ""}, (), (), (), of.get).inputs == (("brake",),)
