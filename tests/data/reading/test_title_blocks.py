"""Logs whose header stands below a title block, as laboratory loggers write them."""

from pathlib import Path

import numpy as np
import pytest
from written_logs import motor

from sysid.data.io import read_file
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError

LABVIEW = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
    "Date\t2026/05/04\nTime\t14:02:11.29\n***End_of_Header***\t\n{e}\nChannels\t2{e}\n"
    "Samples\t240\t240{e}\nDate\t2026/05/04\t2026/05/04{e}\nTime\t14:02:11.3\t14:02:11.3{e}\n"
    "Y_Unit_Label\tV\t%{e}\nX_Dimension\tTime\tTime{e}\nX0\t0.0\t0.0{e}\n"
    "Delta_X\t0.02\t0.02{e}\n***End_of_Header***\nX_Value\tPump voltage\tLevel\tComment\n"
)
SCOPE = (
    "Model,MSO24\nFirmware Version,1.38\n\nPoint Format,Y,\nHorizontal Units,s,\n"
    "Sample Interval,2e-02,\nRecord Length,240,\nVertical Units,V,A\nLabel,coil,shunt\n{gap}"
    "TIME,CH1,CH2\n"
)


def table(sep: str = "\t", end: str = "") -> str:
    k, u, y = motor()
    return "".join(
        f"{i * 0.02:.6f}{sep}{a:g}{sep}{b:.2f}{end}\n" for i, a, b in zip(k, u, y, strict=True)
    )


def read(tmp_path: Path, text: str, **options: object) -> tuple[np.ndarray, np.ndarray, float]:
    path = tmp_path / "log.csv"
    path.write_text(text)
    (record,) = read_file(path, ReadOptions(**options)).records  # type: ignore[arg-type]
    return record.u[:, 0], record.y[:, 0], record.dt


SIGNALS = {"inputs": ("CH1",), "outputs": ("CH2",)}
BLOCKS: dict[str, tuple[str, dict[str, object]]] = {
    "labview": (LABVIEW.format(e="") + table(), {}),
    "labview, trailing tabs": (LABVIEW.format(e="\t") + table(end="\t"), {}),
    "labview, tabs behind every title": (
        LABVIEW.format(e="\t").replace("_Header***\nX", "_Header***\t\t\t\nX") + table(end="\t"),
        {},
    ),
    "labview, a comment in the first row": (
        LABVIEW.format(e="\t") + table().replace("\n", "\tpump on\n", 1),
        {},
    ),
    "scope": (SCOPE.format(gap="\n") + table(","), SIGNALS),
    "scope without the empty line": (SCOPE.format(gap="") + table(","), SIGNALS),
    "a date above the header": ("2026-05-04 14:02:11\nt;u;y\n" + table(";"), {}),
    "counts above the header": ("Channels;2\nRows;240;240\nt;u;y\n" + table(";"), {}),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_the_header_is_the_last_line_of_words_above_the_numbers(name: str, tmp_path: Path) -> None:
    text, options = BLOCKS[name]
    _, u, y = motor()
    got_u, got_y, dt = read(tmp_path, text, **options)
    np.testing.assert_allclose(got_u, u)
    np.testing.assert_allclose(got_y, y)
    assert dt == pytest.approx(0.02)


NO_X = LABVIEW.format(e="").replace("Separator\tTab\n", "Separator\tTab\nX_Columns\tNo\n")


def without_time(lead: str) -> str:
    """The rows alone, behind the empty cell of a time that is named and not written, or not."""
    return "".join(lead + row.split("\t", 1)[1] + "\n" for row in table().splitlines())


@pytest.mark.parametrize(
    ("text", "units"),
    [
        (NO_X + without_time("\t"), ("V", "%")),
        (NO_X.replace("X_Value\t", "").replace("\tComment", "") + without_time(""), ("V", "%")),
        (LABVIEW.format(e="") + table(), ("V", "%")),
        (SCOPE.format(gap="\n").replace("TIME,CH1,CH2", "TIME,u_1,y_2") + table(","), ("V", "A")),
        ("Source,u_1,y_2\nVertical Units,V,A\n" + table(","), ("V", "A")),
    ],
)
def test_units_and_interval_of_a_title_block_are_read(
    text: str, units: tuple[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    found = read_file(path)
    (record,) = found.records
    assert (record.inputs[0].unit, record.outputs[0].unit) == units
    assert record.dt == pytest.approx(0.02)
    _, u, y = motor()
    np.testing.assert_allclose(record.u[:, 0], u)
    np.testing.assert_allclose(record.y[:, 0], y)
    assert not any("Vertical Units" in f.text for f in found.findings)


FAULTS = {
    "words among the rows": "t,u,y\n0,1,2\n1,1,2\nERR,ERR,ERR\n2,1,2\n3,1,2\n",
    "another table below": "t,u,y\n0,1,2\n1,1,2\nt,u,y,z\n2,1,2,3\n3,1,2,3\n",
    "rows that begin with words": "what,u,y\na,1,2\nb,1,2\nt,u,y\n2,1,2\n3,1,2\n",
    "two lines of words": "t,u,y\nalpha,beta,gamma\n0,1,2\n1,1,2\n",
}


@pytest.mark.parametrize("name", FAULTS)
def test_rows_of_a_table_are_never_left_out_as_a_title_block(name: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"line|column"):
        read(tmp_path, FAULTS[name])


TAGS, WORDS, UNITS = "Time,P1.OP,P1.PV,P2.PV", ",Valve,Flow in,Flow out", ",%,GPM,GPM"
STACKS: dict[str, tuple[str, tuple[str, ...]]] = {
    "tags, descriptions, units": (f"Server,A,,\n{TAGS}\n{WORDS}\n{UNITS}\n", ("%", "GPM")),
    "tags, full descriptions, units": (f"{TAGS}\nClock{WORDS}\n{UNITS}\n", ("%", "GPM")),
    "tags and descriptions": (f"{TAGS}\n{WORDS}\n", ("", "")),
    "tags and units that nobody knows": (f"{TAGS}\n,blurb,furlong,furlong\n", ("blurb", "furlong")),
    "channels, tags, units": (f"Channel,,CH1,CH2\n{TAGS}\n{UNITS}\n", ("%", "GPM")),
    "a title with as many cells": (f"Plant 4,17,A,B\n{TAGS}\n{UNITS}\n", ("%", "GPM")),
    "labels of an instrument": (f"Label,a,b,c\n{TAGS}\n{UNITS}\n", ("%", "GPM")),
    "a processing row": (f"{TAGS}\n{UNITS}\n,Smp,Avg,Avg\n", ("%", "GPM")),
}  # fmt: skip


@pytest.mark.parametrize("name", STACKS)
def test_of_several_rows_of_words_the_first_full_one_has_the_names(
    name: str, tmp_path: Path
) -> None:
    head, units = STACKS[name]
    k, u, y = motor()
    rows = [f"{i * 0.02:.2f},{a:g},{b:.2f},{i % 5}\n" for i, a, b in zip(k, u, y, strict=True)]
    path = tmp_path / "log.csv"
    path.write_text(head + "".join(rows))
    (record,) = read_file(path, ReadOptions(inputs="P1.OP", outputs="P1.PV")).records
    np.testing.assert_allclose(record.u[:, 0], u)
    channels = (*record.inputs, *record.outputs)
    assert tuple(c.file_unit or c.unit for c in channels) == units


@pytest.mark.parametrize(
    ("header", "names"),
    [
        ("t,u,u", "u, u (2)"),
        ("t,a [V],a [V]", "a, a (2)"),
        ("t,a [V],a [A]", "a [V], a [A]"),
        ("t,a,a,a (2)", "a, a (3), a (2)"),
    ],
)
def test_columns_of_one_name_are_told_apart(header: str, names: str, tmp_path: Path) -> None:
    from sysid.data.reading.table import read_table

    rows = "".join(
        f"{k},{k % 3},{k % 5},{k % 7}"[: 2 * header.count(",") + len(f"{k}")] + "\n"
        for k in range(30)
    )
    table = read_table(f"{header}\n{rows}".encode(), "l.csv")
    assert ", ".join(table.names[1:]) == names
    assert ("share a name" in " ".join(table.notes)) == ("(" in names)


@pytest.mark.parametrize(
    ("header", "names", "units"),
    [
        ("time [s],flap %,Aussen [°C],Innen °C", "time flap Aussen Innen", "s % °C °C"),
        ("T / °C;T2/°C;pwm%;Druck, bar", "T T2 pwm Druck", "°C °C % bar"),
        ("Drehzahl U/min,v km/h,pos mm,P kW", "Drehzahl v pos P", "U/min km/h mm kW"),
        ("Innen °C,Innen %,rpm [V],rpm [A]", "Innen °C|Innen %|rpm [V]|rpm [A]", "°C % V A"),
        ("time s,motor A,phase V,temp min", "time s|motor A|phase V|temp min", ""),
        ("time s,EC mS/cm,spring N/mm", "time s|EC mS/cm|spring N/mm", ""),
        ("left drive,on/off,x in y,% open", "left drive|on/off|x in y|% open", ""),
    ],
)
def test_a_unit_is_read_behind_a_name_however_it_is_set_off(
    header: str, names: str, units: str
) -> None:
    from sysid.data.reading.header import names_and_units

    raw = tuple(header.split(";" if ";" in header else ","))
    split = names_and_units(raw)
    assert split[0] == tuple(names.split("|" if "|" in names else " "))
    assert split[1] == (tuple(units.split()) or ("",) * len(raw))
