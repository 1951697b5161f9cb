"""Regressors and terms in the log's own names, and orders for several structures at once."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log

from sysid.data.record import Channel
from sysid.errors import UsageError
from sysid.estimation.selection.grid import parse_grids
from sysid.structures.difference_equations.expressions import parse
from sysid.structures.difference_equations.monomials import parsed, printed, typed_name
from sysid.structures.difference_equations.regressors import named
from sysid.structures.own_names import in_generic_names

NAMES = [
    ("u", "y"),
    ("pwm_l", "omega_l"),
    ("Spannung Motor [V]", "Größe (mm)"),
    ("left motor", "left"),
    ("a-b", "a"),
    ("pwm.l", "pwm"),
    ("sin", "abs"),
    ("u2", "y2"),
    ("y", "u"),
    ("Leistung·10", "ω"),
    ("t", "e"),
]
EXPRESSIONS = [
    "|u1(t-1)|",
    "y1(t-2)*sign(u1(t-1))",
    "max(u1(t), 0.5)-y1(t-1)^2",
    "sin(u1(t-3))",
    "u1*y1",
]


@pytest.mark.parametrize(("u", "y"), NAMES)
@pytest.mark.parametrize("text", EXPRESSIONS)
def test_what_is_printed_is_read_back(u: str, y: str, text: str) -> None:
    if u == "sin" and "t" not in text:
        pytest.skip("a channel called like a function is one only at a time")
    wanted = parse(text, 1, 1)
    shown = named(wanted, [Channel(u)], [Channel(y)])
    assert u in shown
    assert parse(in_generic_names(shown, [Channel(u)], [Channel(y)]), 1, 1) == wanted


@pytest.mark.parametrize(("u", "y"), NAMES)
def test_terms_are_read_back_as_printed_and_as_named(u: str, y: str) -> None:
    inputs, outputs = [Channel("other"), Channel(u)], [Channel(y), Channel("z")]
    wanted = parsed("y1(t-1)^2*u2(t-12)*y2(t-3)*e(t-1)", 2, 2, 0)
    for show in (printed, typed_name):
        text = in_generic_names(show(wanted, inputs, outputs), inputs, outputs)
        assert parsed(text, 2, 2, 0) == wanted


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("pwm(t-1), pwm_l(t-1); y", "u1(t-1), u2(t-1); y"),
        ("pwm_left(t-1)", "pwm_left(t-1)"),
        ("u2(t-1)*y(t-1)", "u2(t-1)*y(t-1)"),
        ("abs(pwm)", "abs(u1)"),
        ("xpwm", "xpwm"),
    ],
)
def test_other_words_stay_as_they_are(text: str, wanted: str) -> None:
    assert in_generic_names(text, [Channel("pwm"), Channel("pwm_l")], [Channel("speed")]) == wanted


def two_inputs(path: Path) -> Path:
    """y(t) = 0.7 y(t−1) + 0.5 |u(t−1)| + 0.3 v(t−1)."""
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-1.0, 1.0, (2, 300))
    y = np.zeros(300)
    for k in range(1, 300):
        y[k] = 0.7 * y[k - 1] + 0.5 * abs(u[k - 1]) + 0.3 * v[k - 1]
    y += 0.01 * rng.standard_normal(300)
    return write_log(path, ["u_heiz strom", "u_kühl", "y_wärme"], [u, v, y])


def test_a_regressor_is_given_as_the_file_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    log = two_inputs(Path("log.csv"))
    line = ["fit", log, "--structure", "narmax", "--orders", "na=1 nb=1"]
    terms = "terms=y_wärme(t-1), u_heiz strom(t−1)², u_kühl(t-1)"
    found = run(capsys, *line, "--option", terms, "--json").document
    names = {p["name"] for p in found["parameters"]}
    assert names >= {"y_wärme(t-1)", "u_heiz strom(t-1)^2", "u_kühl(t-1)"}
    refused = run(capsys, *line, "--option", "terms=u_warm(t-1)")
    assert refused.code == 2
    assert refused.err.count("\n") == 1


def test_orders_for_several_structures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    line = ["fit", two_inputs(Path("log.csv")), "--json", "--structure", "arx,oe"]
    for orders in ("arx: na=1 nb=2; oe: nb=2 nf=1", "na=1 nb=2 nf=1 nk=1"):
        found = run(capsys, *line, "--orders", orders).document
        assert {m["structure"]: m["orders"] for m in found["models"]} == {
            "arx": {"na": 1, "nb": [[2, 2]], "nk": [[1, 1]]},
            "oe": {"nb": [[2, 2]], "nf": [[1, 1]], "nk": [[1, 1]]},
        }


def test_one_set_of_orders_serves_every_structure_that_has_them() -> None:
    grids = parse_grids("na=1:2 nb=2 nf=1:3 nk=1", ["arx", "oe"])
    assert [g["na"] for g in grids["arx"]] == [1, 2]
    assert [g["nf"] for g in grids["oe"]] == [1, 2, 3]
    assert all("nf" not in g for g in grids["arx"])


def test_orders_by_structure_keep_matrices_and_leave_others_to_the_search() -> None:
    grids = parse_grids("ARX: na=1,0;0,1 nb=1; bj: nb=1 nc=1:2 nd=1 nf=1", ["arx", "oe", "bj"])
    assert set(grids) == {"arx", "bj"}
    assert grids["arx"] == [{"na": [[1, 0], [0, 1]], "nb": 1}]
    assert len(grids["bj"]) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("na=1 nb=1 nz=2", "has an order nz"),
        ("na=1 nb=1 nc=2", "none of arx, oe has an order nc"),
        ("bj: nb=1", "bj is not one of the structures to fit: arx, oe"),
        ("arx: na=1 nb=1; arx: na=2 nb=1", "arx is given twice"),
        ("na=1 arx: na=2", "`orders`"),
        ("na=1; arx: na=2 nb=1", "comes before the first structure"),
        ("arx:", "`orders`"),
    ],
)
def test_orders_that_cannot_be_are_refused(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=re.escape(words)):
        parse_grids(text, ["arx", "oe"])
