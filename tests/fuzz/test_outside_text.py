"""What a file says can neither steer a terminal nor leave its place in a file that is written."""

import csv
import io
import re
import unicodedata
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import Capture, run
from hand_made import hand_made
from hypothesis import given, settings
from hypothesis import strategies as st
from laws.cases import case_of

from sysid.data.record import Channel
from sysid.errors import DataError
from sysid.export.package import package_files
from sysid.export.registry import BUILT_IN
from sysid.outside_text import csv_text, visible

HOSTILE = (
    "u\x1b]0;owned\x07\x1b[31m", "=cmd|'/c calc'!A1", "y\u202eb<script>alert(1)</script>",
    "*/ int x; /*", "a\\\n#include <b>", '"; rm -rf ~; "', "${x}`id`", "x\r\ny",
    "]]><a b='", "{{ 7*7 }}", "|a|\x85",
)  # fmt: skip
"""Names of columns that a stranger may choose."""

TURNING = {"LRE", "RLE", "PDF", "LRO", "RLO", "LRI", "RLI", "FSI", "PDI"}
"""Bidirectional classes of the characters that turn the order of others."""


def has_hidden(text: str, keep: str = "\n\t\r") -> bool:
    """Whether a text holds characters that act instead of being seen."""
    return visible(text, keep) != text


@given(st.text())
def test_what_is_visible_stays_and_what_acts_is_escaped(text: str) -> None:
    shown = visible(text, keep="")
    assert not has_hidden(shown, keep="")
    assert visible(shown) == shown
    assert has_hidden(text, keep="") or shown == text
    assert csv_text(text)[:1] not in ("=", "+", "-", "@", "\t", "\r")


def test_every_control_and_turning_character_counts() -> None:
    acting = [
        c
        for c in map(chr, range(0x110000))
        if unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp")
        or unicodedata.bidirectional(c) in TURNING
    ]
    assert [c for c in acting if not has_hidden(c, keep="")] == []


def test_an_error_shows_what_it_repeats_and_no_more_than_a_page() -> None:
    said = str(DataError("unknown keys " + "\x1b[2J, " * 9000 + "; remove them"))
    assert len(said) < 2100
    assert "\x1b" not in said
    assert said.endswith("; remove them")


@pytest.mark.slow
@settings(max_examples=12, deadline=None, derandomize=True)
@given(names=st.lists(st.sampled_from(HOSTILE), min_size=2, max_size=2, unique=True))
def test_no_file_of_a_package_holds_more_than_the_name(names: list[str]) -> None:
    case = case_of("arx")
    model = hand_made(case.structure, case.theta)
    u, y = (Channel(n, n) for n in names)
    model = replace(model, inputs=(u,), outputs=(y,))
    formats = sorted(BUILT_IN.keys() - {"ros"})  # whose channels are a robot's
    files = dict(package_files(model, name=names[0], formats=formats))
    for name, content in list(files.items()):
        if name.endswith(".fmu"):
            archive = zipfile.ZipFile(io.BytesIO(content))
            files |= {f"{name}/{n}": archive.read(n) for n in archive.namelist()}
            del files[name]
    for name, content in files.items():
        if name.endswith((".so", ".dll")):
            continue
        text = content.decode("utf-8")
        assert not has_hidden(text), name
        if name.endswith(".xml"):
            ET.fromstring(text)
        if name.endswith((".c", ".h", ".ino")):
            code = re.sub(r"/\*.*?\*/|//[^\n]*|\"(\\.|[^\"\\\n])*\"", "", text, flags=re.S)
            assert "int x;" not in code, name
            assert "<b>" not in code, name
    head = next(csv.reader(io.StringIO(files["selftest.csv"].decode())))
    assert [cell[:1] for cell in head if cell[:1] in "=+-@"] == []


@pytest.mark.parametrize("hostile", [n for n in HOSTILE if "\n" not in n])
def test_no_name_of_a_column_reaches_the_terminal_as_it_is(
    hostile: str, tmp_path: Path, capsys: Capture
) -> None:
    rows = "".join(f"{0.1 * k:.1f};{(k // 3) % 4};{(k * 7) % 11}\n" for k in range(40))
    quoted = hostile.replace('"', '""')
    (tmp_path / "log.csv").write_text(f't;u;"{quoted}"\n{rows}', encoding="utf-8")
    for words in (["inspect"], ["inspect", "--json"], ["fit", "--input", hostile]):
        result = run(capsys, words[0], tmp_path / "log.csv", *words[1:])
        assert not has_hidden(result.out + result.err)
