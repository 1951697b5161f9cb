"""Console lines ``name=value``, the interval in a title, and which column drives which."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from written_logs import motor

from sysid.data.io import LogFile, read_file
from sysid.data.reading.columns import choose_columns
from sysid.data.reading.line_keys import interval_of
from sysid.errors import DataError

BOOT = "rst:0x1 (POWERON_RESET),boot:0x13\nI (312) cpu_start: Pro cpu up.\n"


def log(tmp_path: Path, text: str) -> LogFile:
    path = tmp_path / "console.log"
    path.write_text(text)
    return read_file(path)


def lines(form: str) -> str:
    k, u, y = motor()
    return "".join(
        form.format(ms=1500 + 20 * i, s=1.5 + 0.02 * i, u=int(a), y=b)
        for i, a, b in zip(k, u, y, strict=True)
    )


FORMS = {
    "espressif": BOOT + lines("I ({ms}) fan: duty={u} y={y:.2f}\n"),
    "espressif in colours": BOOT + lines("\x1b[0;32mI ({ms}) fan: duty={u}, y={y:.2f}\x1b[0m\n"),
    "its own time": "ready\n" + lines("t={s:.2f}, u={u}, y={y:.2f}\n"),
    "units behind the numbers": lines("t={s:.2f}s u={u}% y={y:.2f}degC\n"),
    "other messages between": lines("I ({ms}) fan: duty={u} y={y:.2f}\n").replace(
        "\n", "\nW (1501) wifi: retry=1 rssi=-70\n", 40
    ),
    "a date in front": "".join(
        f"2026-02-03T06:00:{0.02 * i:06.3f}Z u={a:g} y={b:.2f}\n"
        for i, a, b in zip(*motor(), strict=True)
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_values_with_their_names_in_every_line_are_a_table(form: str, tmp_path: Path) -> None:
    found = log(tmp_path, FORMS[form])
    (record,) = found.records
    _, u, y = motor()
    np.testing.assert_allclose(record.u[:, 0], u)
    np.testing.assert_allclose(np.ptp(record.y[:, 0]), np.ptp(y))
    assert record.dt == pytest.approx(0.02)
    assert any("the names before the signs = are the columns" in n for n in found.notes)


def test_a_few_settings_above_a_table_are_no_table(tmp_path: Path) -> None:
    found = log(tmp_path, "kp=1 ki=2\nkp=3 ki=4\nt,u,y\n0,1,2\n1,1,3\n2,2,3\n3,1,4\n")
    assert found.records[0].u[:, 0].tolist() == [1.0, 1.0, 2.0, 1.0]


def test_the_interval_of_a_title_block_is_the_sample_time(tmp_path: Path) -> None:
    _, u, y = motor()
    rows = "".join(f"{i + 1},{a:g},{b:.2f}\n" for i, (a, b) in enumerate(zip(u, y, strict=True)))
    head = 'Rig\n"Interval","20 ms"\n\n"No.","Torque","Angle"\n"","[mNm]","[deg]"\n'
    found = log(tmp_path, head + rows)
    (record,) = found.records
    assert record.dt == pytest.approx(0.02)
    assert (record.input_names, record.output_names) == (("Torque",), ("Angle",))
    assert any("one row every 0.02 s" in note for note in found.notes)


@pytest.mark.parametrize(
    ("title", "seconds"),
    [
        ('"Interval","20 ms"', 0.02),
        ("Sample rate: 50 Hz", 0.02),
        ("Abtastzeit;0.5 s", 0.5),
        ("Sampling interval (100 us)", 1e-4),
        ("Interval,20", None),
        ("Start time 12 s later", None),
        ("Interval,0 ms", None),
        ("Sample rate,20 ms", None),
    ],
)
def test_only_an_interval_with_its_unit_is_one(title: str, seconds: float | None) -> None:
    assert interval_of(title) == (None if seconds is None else pytest.approx(seconds))


@pytest.mark.parametrize(
    ("names", "inputs", "outputs"),
    [
        (("t", "Torque", "Angle"), ("Torque",), ("Angle",)),
        (("t", "Angle", "Torque"), ("Torque",), ("Angle",)),
        (("t", "position", "force"), ("force",), ("position",)),
        (("t", "coil_current", "level"), ("coil_current",), ("level",)),
        (("t", "freq_hz", "flow_m3h"), ("freq_hz",), ("flow_m3h",)),
        (("t", "voltage", "current", "speed"), ("voltage",), ("speed",)),
        (("t", "pwm", "torque"), ("pwm",), ("torque",)),
    ],
)
def test_what_moves_a_plant_is_the_input(
    names: tuple[str, ...], inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> None:
    found = choose_columns(names)
    assert (found.inputs, found.outputs) == (inputs, outputs)


@pytest.mark.parametrize(
    ("names", "example"),
    [
        (("t", "flow", "freq", "pressure"), "inputs='freq', outputs='flow'"),
        (("t", "angle", "force", "torque"), "inputs='force', outputs='angle'"),
        (("TIME", "CH1", "CH2"), "inputs='CH1', outputs='CH2'"),
    ],
)
def test_what_stays_open_is_refused_with_an_example_in_order(
    names: tuple[str, ...], example: str
) -> None:
    with pytest.raises(DataError) as caught:
        choose_columns(names)
    assert example in str(caught.value)


def test_a_fan_is_not_judged_as_a_robot(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "fan.log"
    path.write_text(lines("I ({ms}) fan: duty={u} rpm={y:.2f}\n"))
    shown = run(capsys, "inspect", path)
    assert not any(word in shown.out for word in ("robot", "PWM", "track", "ω"))
