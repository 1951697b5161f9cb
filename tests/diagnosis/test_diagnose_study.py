"""The harness of the blind study: who may see what, and that right and wrong are told apart."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sysid_datasets.hidden_effects import RANGES
from sysid_datasets.hidden_logs import hide
from sysid_datasets.outside_effects import OUTSIDE

from studies import diagnose, diagnose_cases, diagnose_scores

STUB = """
from pathlib import Path

def nothing(est, val, *, clean, base, mission):
    return {"verdict": "no-missing-effect", "effects": [], "gap": None}

def tie(est, val, *, clean, base, mission):
    there = sorted(p.name for p in est.parent.iterdir())
    assert not any("truth" in name for name in there), there
    wanted = ["est.csv", "val.csv"] + (["clean.csv"] if base else [])
    wanted += ["mission_est.yaml", "mission_val.yaml"] if mission else []
    assert there == sorted(wanted), (there, wanted)
    effect = {"id": "stiction", "indistinguishable": ["coulomb-friction"]}
    channels = {c: {"rmse_before": 1.1, "rmse_after": 0.1} for c in ("omega_l", "omega_r")}
    gap = {"closed_percent": 97.0, "channels": channels}
    return {"verdict": "effects-found", "effects": [effect], "gap": gap}

def broken(est, val, *, clean, base, mission):
    raise RuntimeError("exit 1: no\\nsuch thing")
"""


@pytest.fixture
def stubs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stubs that may be named as adapters."""
    folder = tmp_path / "stubs"
    folder.mkdir()
    (folder / "stub_diagnosis.py").write_text(STUB, encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    # Short logs: the stubs do not read them.
    monkeypatch.setattr(diagnose, "hide", lambda r: hide(replace(r, duration=15.0)))


def test_the_cases_are_as_many_as_the_study_promises() -> None:
    cases = diagnose_cases.all_cases()
    assert len({case.key for case in cases}) == len(cases)
    groups: dict[str, list[Any]] = {}
    for case in cases:
        groups.setdefault(case.group, []).append(case)
    for effect in RANGES:
        for noise in ("low", "high"):
            runs = [c for c in groups["single"] if c.request.effects == (effect,)]
            assert sum(c.request.noise == noise for c in runs) >= 5
            assert len({c.request.style for c in runs}) == 2
    assert len(groups["pair"]) >= 20
    for kind in ("white", "ar", "walk", "closed"):
        assert len(groups[f"nothing {kind}"]) >= 20
    assert len({c.request.effects for c in groups["outside"]}) == len(OUTSIDE) >= 5
    assert {c.base for c in cases} == {"", "oe", "hw", "narx"}
    assert all(
        c.request.clean or c.request.effects == ("changed-parameter",) for c in cases if c.base
    )
    quick = diagnose_cases.all_cases(quick=True)
    assert {c.group for c in quick} == set(groups)
    assert len(quick) < len(cases) / 5


@pytest.mark.parametrize(
    ("truth", "entries", "right", "every", "false"),
    [
        (("a",), [("a",)], True, True, 0),
        (("a",), [("b", "a")], True, True, 0),
        (("a",), [("b",), ("a",)], False, True, 1),
        (("a",), [("a",), ("b",)], True, True, 1),
        (("a",), [], False, False, 0),
        (("a", "b"), [("b",), ("a",)], True, True, 0),
        # One entry that ties both names is one effect, not two.
        (("a", "b"), [("a", "b")], True, False, 0),
        (("a", "b"), [("a", "b"), ("a",)], True, True, 0),
        (("a", "b"), [("b",), ("c",)], True, False, 1),
        ((), [("c",)], False, True, 1),
        # What is found by looking at the samples has no order.
        (("dropouts",), [("c",), ("dropouts",)], True, True, 1),
    ],
)
def test_marks(
    truth: tuple[str, ...], entries: list[tuple[str, ...]], right: bool, every: bool, false: int
) -> None:
    o = diagnose_scores.Outcome("k", "single", "low", truth, entries=tuple(entries))
    assert (o.right, o.all_right, o.false_names) == (right, every, false)


@pytest.mark.slow
@pytest.mark.usefixtures("stubs")
def test_a_study_with_a_stub_writes_its_report(tmp_path: Path) -> None:
    out, kept = tmp_path / "report.md", tmp_path / "runs.jsonl"
    arguments = ["--quick", "--jobs", "1", "-o", str(out), "--results", str(kept)]
    arguments += ["--adapter", "stub_diagnosis:tie"]
    only = [
        "--only",
        "single|coulomb",
        "changed-parameter",
        "mission|",
        "|other-1|",
        "nothing walk",
    ]
    assert diagnose.main([*arguments, *only]) == 0
    text = out.read_text(encoding="utf-8")
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines()]
    cells = {row[0]: row[1:] for row in rows if len(row) > 2}
    # Of the singles coulomb-friction is in the tie; changed-parameter and three of pose are not.
    assert cells["single: right name first"] == ["2", "50.0 %", "≥ 95 %", "no"]
    assert cells["mission: right name first"][1] == "0.0 %"
    assert cells["outside: no name"][1] == "0.0 %"
    assert cells["nothing walk: a false name"] == ["2", "100.0 %", "≤ 5 %", "no"]
    assert cells["gap closed, by its own account: worst"][1] == "97.0 %"
    # All of 1.1² − 0.1² of the true gap 1.1² − floor², the floor being 0.1.
    measured = float(cells["gap closed, by the true floor: worst"][1].removesuffix(" %"))
    assert measured == pytest.approx(100.0, abs=0.5)
    assert cells["`coulomb-friction`"][0] == "1/1"
    assert cells["`coulomb-friction`"][3] == "2.0"
    assert "Confusion matrix" in text
    assert "stiction=coulomb-friction" in text
    # Finished runs are kept: the broken adapter is not even asked.
    arguments[arguments.index("stub_diagnosis:tie")] = "stub_diagnosis:broken"
    assert diagnose.main([*arguments, *only]) == 0
    again = out.read_text(encoding="utf-8").replace("stub_diagnosis:broken", "stub_diagnosis:tie")
    assert again == text  # its foot shows the command


@pytest.mark.usefixtures("stubs")
def test_a_run_without_an_answer_is_wrong_everywhere() -> None:
    case = diagnose_cases.all_cases(quick=True)[0]
    o = diagnose.run(case, "stub_diagnosis:broken")
    assert o.error == "RuntimeError: exit 1: no"
    assert not o.right
    nothing = diagnose.run(case, "stub_diagnosis:nothing")
    assert (nothing.error, nothing.verdict, nothing.right) == ("", "no-missing-effect", False)
    text = diagnose_scores.summary([o, nothing])
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines()]
    assert ["single: right name first", "2", "0.0 %", "≥ 95 %", "no"] in rows
    assert ["runs without an answer", "2", "1", "0", "no"] in rows


@pytest.mark.parametrize(
    "answer",
    [
        {},
        {"verdict": "perhaps", "effects": []},
        {"verdict": "effects-found", "effects": []},
        {"verdict": "no-missing-effect", "effects": [{"id": "a", "indistinguishable": []}]},
    ],
)
def test_an_answer_against_the_contract_is_refused(answer: dict[str, Any]) -> None:
    case = diagnose_cases.all_cases(quick=True)[0]
    with pytest.raises((KeyError, ValueError)):
        diagnose_scores.outcome(case, answer, {"floor": {"val": {}}})


def test_no_gap_in_the_wheels_is_none_to_close() -> None:
    closed = diagnose_scores._closed
    on_the_ground = {"omega_l": {"rmse_before": 0.102, "rmse_after": 0.102}}
    in_the_motor = {"omega_l": {"rmse_before": 0.2, "rmse_after": 0.1}}
    assert closed(on_the_ground, {"omega_l": 0.1}) is None
    assert closed(in_the_motor, {"omega_l": 0.1}) == pytest.approx(100.0)


def test_the_name_of_a_part_is_not_wrong_outside_the_catalogue() -> None:
    scores = diagnose_scores
    cogged = scores.Outcome("", "outside", "low", ("other-4",), "effects-found")
    right = replace(cogged, entries=(("speed-ripple",), ("gravity-load",)))
    assert scores._no_wrong_name(right)
    assert scores._no_wrong_name(cogged)
    assert not scores._no_wrong_name(replace(right, entries=(("dead-zone",),)))
    assert "outside: no name, or that of a part" in scores.summary([right])
