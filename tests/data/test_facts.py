"""A log is known once: no command estimates a fact of it twice."""

import ast
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sysid_datasets
from scipy.signal import lfilter
from source_statements import statements_of
from sysid_cli.app import main

from sysid.data import facts
from sysid.data.facts import LogFacts
from sysid.data.finding import Finding, Severity

LOGS = Path(sysid_datasets.__file__).parent / "devastator"

ESTIMATORS = (
    "bridged",
    "estimate_delays",
    "estimate_speed",
    "feedback_tests",
    "measurement_noise",
    "nonlinearity_tests",
    "refreshes",
    "rest_head",
)
"""What ``LogFacts`` calls to compute its facts."""

ELSEWHERE = {"estimation/online/order_choice.py": "a log being written is another one each time"}
"""Modules that ask an estimator themselves, and why."""


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each estimator ran, by its name and the samples it saw."""
    seen: Counter[str] = Counter()

    def counted(name: str, estimator: Callable[..., Any]) -> Callable[..., Any]:
        def call(data: Any, *args: Any, **kwargs: Any) -> Any:
            records: Sequence[Any] = data if isinstance(data, Sequence) else (data,)
            seen[f"{name} of {[r.sha256[:8] + str(len(r)) for r in records]}"] += 1
            return estimator(data, *args, **kwargs)

        return call

    for name in ESTIMATORS:
        monkeypatch.setattr(facts, name, counted(name, getattr(facts, name)))
    return seen


@pytest.mark.parametrize(
    "options",
    [
        ["--structure", "arx", "--orders", "na=2 nb=2"],
        ["--structure", "arx,oe"],
        ["--structure", "arx", "--split", "0.7"],
    ],
)
def test_a_fit_computes_no_fact_twice(
    options: list[str], tmp_path: Path, calls: Counter[str]
) -> None:
    line = ["fit", str(LOGS / "multilevel.csv"), *options, "--workspace", str(tmp_path)]
    assert main(line) == 0
    assert any(name.startswith("feedback_tests") for name in calls)
    assert {name: n for name, n in calls.items() if n > 1} == {}


@pytest.mark.slow
def test_a_diagnosis_computes_no_fact_twice(tmp_path: Path, calls: Counter[str]) -> None:
    """Two logs of a motor with a dead zone; the records of a pose are new ones."""
    rng = np.random.default_rng(1)
    for name in ("log", "val"):
        u = np.repeat(rng.uniform(-1.0, 1.0, 40), 15)
        acting = np.sign(u) * np.maximum(np.abs(u) - 0.15, 0.0)
        y = lfilter([0.0, 0.2], [1.0, -0.8], acting) + 0.003 * rng.standard_normal(600)
        rows = np.column_stack([0.05 * np.arange(600), u, y])
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.6g", ",", header="t,u,y", comments="")
    logs = [str(tmp_path / "log.csv"), "--val", str(tmp_path / "val.csv")]
    assert main(["diagnose", *logs, "-o", str(tmp_path / "d"), "--workspace", str(tmp_path)]) == 0
    assert any(name.startswith("measurement_noise") for name in calls)
    assert {name: n for name, n in calls.items() if n > 1} == {}


def test_only_log_facts_imports_the_estimators() -> None:
    root = Path(facts.__file__).parents[1]
    users = {
        path.relative_to(root).as_posix(): names
        for path in root.rglob("*.py")
        if (names := _imported(path) & set(ESTIMATORS))
    }
    assert set(users) == {"data/facts.py", *ELSEWHERE}, users


def _imported(path: Path) -> set[str]:
    if not any(name in path.read_text(encoding="utf-8") for name in ESTIMATORS):
        return set()
    imports = [n for n in statements_of(path) if isinstance(n, ast.ImportFrom)]
    return {alias.name for n in imports for alias in n.names}


def test_facts_are_those_of_their_records_and_keep_what_the_reader_said() -> None:
    known = LogFacts((), (Finding("gaps", Severity.NOTE, "One row is missing."),))
    assert LogFacts.of(known) is known
    assert LogFacts.of([]).reading == ()
