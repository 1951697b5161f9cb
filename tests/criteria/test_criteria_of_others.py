"""A criterion of another package is asked for by its name, stored, and missed by nobody."""

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import Capture, run

from sysid.criteria import table
from sysid.errors import UsageError
from sysid.structures.model import Model

OLDER = Path(__file__).parents[1] / "data" / "0.1"

HANNAN_QUINN = """
import math
from sysid.criteria.table import Criterion

CRITERION = Criterion(
    "Hannan and Quinn: between AIC and BIC.",
    value=lambda loss: loss.deviance
    + 2.0 * loss.parameters * math.log(math.log(loss.samples)),
)
LIKELIHOOD = Criterion(
    "Log-likelihood; never falls with size.",
    lambda value, best, samples, outputs: math.exp((best - value) / samples / outputs),
    lambda loss: -0.5 * loss.deviance,
    smaller_is_better=False,
)
NO_CRITERION = 3.0
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package that brings criteria, good ones and broken ones, installed for one test."""
    about = tmp_path / "site" / "foreign_criteria-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign-criteria\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[sysid.criteria]\nhq = foreign_criteria:CRITERION\n"
        "likelihood = foreign_criteria:LIKELIHOOD\n"
        "aic = foreign_criteria:CRITERION\n"
    )
    (tmp_path / "site" / "foreign_criteria.py").write_text(HANNAN_QUINN)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    _forget()
    yield
    sys.modules.pop("foreign_criteria", None)
    monkeypatch.undo()
    _forget()


def _forget() -> None:
    table._others.cache_clear()
    table._loaded.cache_clear()


@pytest.fixture
def older(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace of a time when nobody knew that criterion; its logs lie beside it."""
    shutil.copytree(OLDER, tmp_path / "0.1")
    monkeypatch.chdir(tmp_path / "0.1")
    return tmp_path / "0.1"


ASKED = ("arx-eba84e", "bj-476fc8", "armax-6d3972")


@pytest.mark.usefixtures("installed")
def test_models_of_before_are_ranked_by_it(older: Path, capsys: Capture) -> None:
    there = ("--workspace", "workspace", "--json")
    ranking = run(capsys, "compare", *ASKED, "--criterion", "HQ", *there).document
    by_aic = run(capsys, "compare", *ASKED, "--criterion", "aic", *there).document
    assert ranking["criterion"] == "hq"
    assert [m["model"] for m in ranking["ranking"]] == [m["model"] for m in by_aic["ranking"]]
    for line in ranking["ranking"]:  # 280 samples: between AIC (2) and BIC (ln 280) a parameter
        assert line["aic"] < line["hq"] < line["bic"]
    high = run(capsys, "compare", *ASKED, "--criterion", "likelihood", *there).document
    values = [m["likelihood"] for m in high["ranking"]]
    assert values == sorted(values, reverse=True)
    text = run(capsys, "compare", *ASKED, "--criterion", "hq", *there[:2])
    assert "Hannan and Quinn: between AIC and BIC." in text.out


@pytest.mark.usefixtures("installed")
def test_without_the_data_a_model_of_before_is_left_out_by_name(
    older: Path, capsys: Capture
) -> None:
    (older / "log.csv").unlink()
    there = ("--workspace", "workspace", "--json")
    gone = run(capsys, "compare", *ASKED, "--criterion", "hq", *there)
    assert gone.code == 1
    assert "arx-eba84e" in gone.err.partition(" left out: stored without hq")[0]
    assert "left out: stored without hq" in gone.err
    assert run(capsys, "compare", *ASKED, "--criterion", "aic", *there).code == 0


def test_a_fit_stores_it_and_is_read_without_it(
    older: Path, capsys: Capture, request: pytest.FixtureRequest
) -> None:
    request.getfixturevalue("installed")
    fit = ("fit", "log.csv", "--structure", "arx,oe", "--orders", "na=1:2 nb=1 nk=1; oe: nb=1 nf=1")
    for name, leads in (("hq", "lowest"), ("likelihood", "highest")):
        found = run(capsys, *fit[:4], "--criterion", name, "--json").document
        assert name in found["criteria"]
        assert (
            f"{name.upper()}, from one-step errors on the estimation data, is the {leads}"
            in (found["reason"])
        )
    stored = json.loads(Path(found["path"]).read_text())["model"]
    value = stored["criteria"]["hq"]
    table._others.cache_clear()  # as if it were uninstalled: its entry points are gone
    point = older.parent / "site" / "foreign_criteria-1.0.dist-info"
    shutil.rmtree(point)
    assert "hq" not in table.names()
    assert Model.from_json(stored).criteria["hq"] == value
    assert run(capsys, "models").code == 0
    refused = run(capsys, "compare", "--criterion", "hq")
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert "no criterion 'hq'; choose one of aic" in refused.err


@pytest.mark.usefixtures("installed")
def test_what_comes_with_the_workbench_cannot_be_replaced() -> None:
    assert table.criterion("aic") is table.BUILT_IN["aic"]
    assert table.names() == (*table.BUILT_IN, "hq", "likelihood")


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("place", "says"),
    [
        ("foreign_criteria:NO_CRITERION", "is not a Criterion"),
        ("foreign_criteria:NOTHING", "cannot be imported"),
        ("no_such_module:X", "cannot be imported"),
    ],
)
def test_a_package_that_cannot_be_used_is_named(tmp_path: Path, place: str, says: str) -> None:
    about = tmp_path / "site" / "foreign_criteria-1.0.dist-info"
    (about / "entry_points.txt").write_text(f"[sysid.criteria]\nbroken = {place}\n")
    _forget()
    with pytest.raises(UsageError, match=f"'broken' of the package foreign-criteria {says}"):
        table.criterion("broken")


def test_the_name_of_a_criterion_is_read_in_any_case(older: Path, capsys: Capture) -> None:
    found = run(
        capsys, "fit", "log.csv", "--structure", "arx", "--criterion", "BIC", "--json"
    ).document
    assert found["order_search"]["criterion"] == "bic"


@pytest.mark.usefixtures("installed")
def test_a_criterion_that_fails_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every fit evaluates it: the sentence must say whose fault it is."""
    broken = table.Criterion("Broken.", value=lambda loss: loss.samples / 0.0)
    monkeypatch.setattr(table, "_loaded", lambda name: broken)
    wanted = r"criterion 'hq' of the package foreign-criteria fails \(float division by zero\)"
    with pytest.raises(UsageError, match=wanted):
        table.weighed(table.Loss(-1.0, 100, 2, 1))
