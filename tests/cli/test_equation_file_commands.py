"""Commands on a file of equations: fit, sensitivity, export, and what refuses one."""

from pathlib import Path

import pytest
from command_line import Capture, run

EXAMPLES = Path(__file__).parents[2] / "datasets" / "equations"
LOG = str(EXAMPLES / "pendulum.csv")
FILE = str(EXAMPLES / "pendulum.ode.yaml")

TRUTH = {"gravity": 24.5, "damping": 0.8, "dry": 1.2, "gain": 4.2}
"""Of datasets/equation_logs.py, whose simulation is not ours."""


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_a_file_is_fitted_shown_and_exported(capsys: Capture) -> None:
    found = run(capsys, "fit", LOG, "--structure", FILE, "--json").document
    values = {p["name"]: p for p in found["parameters"]}
    for name, value in TRUTH.items():
        assert abs(values[name]["value"] - value) < 4.0 * values[name]["std_error"]
    shown = run(capsys, "sensitivity", LOG, "--json").document
    expected = {p["name"]: p["std_error"] for p in shown["parameters"]}
    for name in TRUTH:
        # residuals that pass for white: the errors of a fit are those of the information
        assert values[name]["std_error"] == pytest.approx(expected[name], rel=0.1)
    assert run(capsys, "export").code == 0
    line = ("excite", "optimal", "--duration", "2", "--amplitude", "2", "--json")
    design = run(capsys, *line).document
    assert [p["name"] for p in design["parameters"]] == list(TRUTH)
    assert all(p["error_promised"] > 0.0 for p in design["parameters"])
    rows = Path("schedule_optimal.csv").read_text().splitlines()
    assert rows[0] == "t,u_V"
    assert len(rows) == 1 + 100
    assert {abs(float(r.split(",")[1])) for r in rows[1:]} <= {0.0, 1.0, 2.0}
    assert "has no --hold" in run(capsys, "excite", "optimal", "--hold", "1", "2").err


def test_before_a_fit_a_file_is_enough(capsys: Capture) -> None:
    done = run(capsys, "sensitivity", LOG, "--structure", FILE, "--plot", "when.svg")
    assert done.code == 0
    assert "Rank 6 of 6 unknowns" in done.out
    assert Path("when.svg").is_file()


@pytest.mark.slow
def test_what_only_shows_together_is_said_once_and_before_the_fit(capsys: Capture) -> None:
    split = Path(FILE).read_text().replace("gain*u", "gain*share*u")
    split = split.replace("  gain:", "  share: {start: 1, bounds: [0.1, 10]}\n  gain:")
    Path("split.ode.yaml").write_text(split)
    done = run(capsys, "fit", LOG, "-s", "split.ode.yaml")
    err = " ".join(done.err.split())
    assert done.code == 0
    assert err.count("share, gain only show together on this log.") == 1
    found = run(capsys, "fit", LOG, "-s", "split.ode.yaml", "--json").document["before_fit"]["ode"]
    assert (found["rank"], found["unknowns"]) == (6, 7)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (("fit", LOG, "--structure", "none.ode.yaml"), "none.ode.yaml: file not found"),
        (("sensitivity", LOG, "--structure", "oe"), "oe has no parameters before a fit"),
        (("sensitivity", LOG, "-s", FILE, "-m", "x"), "exclude each other"),
    ],
)
def test_what_cannot_be_is_said(capsys: Capture, line: tuple[str, ...], sentence: str) -> None:
    done = run(capsys, *line)
    assert done.code in (1, 2)
    assert done.out == ""
    assert sentence in " ".join(done.err.split())
