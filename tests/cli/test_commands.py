"""The commands as a person uses them: what they print, write, find and remember."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Capture, robot_log, robot_signals, run, write_log

SHARED = Path(os.environ.get("SYSID_DATA", Path(__file__).parents[3] / "shared" / "data"))

ARX = ("--structure", "arx", "--orders", "na=1 nb=1")
OE = ("--structure", "oe", "--orders", "nb=1 nf=1")

FIGURES = {"data", "horizon", "initial_state", "fit_percent", "rmse"}
CRITERIA = {"aic", "aicc", "naic", "bic", "mdl", "fpe", "loss"}
TRUTH = {
    "f1[omega_l,pwm_l]": -0.6,
    "b1[omega_l,pwm_l]": 4e-4,
    "f1[omega_r,pwm_r]": -0.7,
    "b1[omega_r,pwm_r]": 3e-4,
}
"""Of the log that ``robot_log`` writes, as an output-error model has it."""


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def assert_figures(figures: dict[str, Any], channels: list[str], horizon: object) -> None:
    assert figures.keys() >= FIGURES
    assert figures["horizon"] == horizon
    assert isinstance(figures["data"], str)
    assert isinstance(figures["initial_state"], str)
    for key in ("fit_percent", "rmse"):
        assert list(figures[key]) == channels
        assert all(isinstance(v, float) for v in figures[key].values())
    assert all(v >= 0 for v in figures["rmse"].values())


def assert_fit_document(found: dict[str, Any], channels: list[str], *, judged: bool) -> None:
    assert Path(found["path"]).is_file()
    assert Path(found["path"]).stem == found["model"]
    assert isinstance(found["structure"], str)
    assert all(name.startswith("n") for name in found["orders"])
    for parameter in found["parameters"]:
        assert parameter.keys() >= {"name", "value", "std_error", "unit"}
        assert isinstance(parameter["value"], float)
    for part in ("estimation", "validation"):
        if part == "validation" and not judged:
            assert found["validation"] is None
            continue
        assert_figures(found[part], channels, "free-run")
        assert_figures(found[part]["one_step"], channels, 1)
        assert found["one_step"][part] == found[part]["one_step"]
    assert found["criteria"].keys() == CRITERIA
    for test in ("whiteness", "independence"):
        assert isinstance(found["residuals"][test]["passed"], bool)
        assert 0.0 <= found["residuals"][test]["p_value"] <= 1.0
    assert found["termination"].keys() == {"code", "message"}
    assert found["seconds"] > 0
    assert all(isinstance(w, str) for w in found["warnings"])


def parameters(found: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Name → value and standard error (infinite where null)."""
    return {
        p["name"]: (p["value"], np.inf if p["std_error"] is None else p["std_error"])
        for p in found["parameters"]
    }


def timeless(value: Any) -> Any:
    """A document without what may differ between two runs."""
    if isinstance(value, dict):
        return {k: timeless(v) for k, v in value.items() if k not in ("seconds", "path")}
    return [timeless(v) for v in value] if isinstance(value, list) else value


@pytest.mark.slow
def test_four_commands_in_a_row_in_an_empty_folder(tmp_path: Path, capsys: Capture) -> None:
    robot_log(tmp_path / "data.csv", 400)
    (tmp_path / "mission.yaml").write_text("goal: [1, 0]\n")
    best = run(capsys, "fit", "data.csv", "--json").document
    assert_fit_document(best, ["omega_l", "omega_r"], judged=False)
    ranking = run(capsys, "compare", "--criterion", "aic", "--json").document
    exported = run(capsys, "export", "--json").document
    driven = run(capsys, "simulate", "mission.yaml", "--json").document

    assert best["models"][0]["structure"] == best["structure"]
    assert {m["structure"] for m in best["models"]} >= {"arx", "armax", "oe", "bj"}
    for model in best["models"]:
        assert_fit_document(model, ["omega_l", "omega_r"], judged=False)
    assert " leads: " in best["reason"]

    lines = ranking["ranking"]
    assert ranking["criterion"] == "aic"
    assert ranking["best"] == lines[0]["model"]
    assert {line["model"] for line in lines} == {m["model"] for m in best["models"]}
    for line in lines:
        assert line.keys() >= {"model", "structure", "orders", "fit_percent", "residuals"}
        assert line.keys() >= CRITERIA
    assert [line["aic"] for line in lines] == sorted(line["aic"] for line in lines)

    assert Path(exported["plant"], "plant.json").is_file()
    assert exported["model"] == ranking["best"]
    assert exported["selftest"]["max_error"] < 1e-9

    assert driven["outcome"] == "arrived"
    assert driven["final"].keys() == {"x", "y", "psi"}
    assert driven["time_s"] > 1.0
    assert driven["path_length_m"] > 0.8
    assert driven["min_clearance_m"] is None, "there is no obstacle: not a finite number"
    assert Path(driven["log"]).is_file()
    again = run(capsys, "fit", driven["log"], *ARX, "--json").document
    assert min(again["estimation"]["fit_percent"].values()) > 95, "a mission's log can be fitted"


@pytest.mark.slow
def test_the_default_fit_finds_the_truth(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv", 600, seed=3)
    found = run(capsys, "fit", log, "--structure", "oe", "--json").document
    assert found["orders"] == {
        "nb": [[1, 1], [1, 1]],
        "nf": [[1, 1], [1, 1]],
        "nk": [[1, 1], [1, 1]],
    }
    values = parameters(found)
    for name, true in TRUTH.items():
        value, error = values[name]
        # four standard errors: a chance of 6e-5 each
        assert abs(value - true) < 4 * error, name
        assert error < 0.02 * abs(true)
    assert found["residuals"]["independence"]["passed"]
    assert not [w for w in found["warnings"] if "residuals" in w]


@pytest.mark.parametrize("delay", [0, 1, 5])
def test_the_delay_is_found(delay: int, tmp_path: Path, capsys: Capture) -> None:
    rng = np.random.default_rng(delay)
    u = np.repeat(rng.choice([-1.0, 1.0], 200), 3)
    y = np.zeros(600)
    for k in range(max(delay, 1), 600):
        y[k] = 0.7 * y[k - 1] + 0.5 * u[k - delay]
    log = write_log(tmp_path / "log.csv", ["u", "y"], [u, y + 0.05 * rng.standard_normal(600)])
    found = run(capsys, "fit", log, "--structure", "oe", "--json").document
    assert found["orders"]["nk"] == delay


@pytest.mark.slow
def test_the_winner_follows_the_plant_with_few_parameters(tmp_path: Path, capsys: Capture) -> None:
    """Under output noise ARX needs many lags for what OE and ARMAX say with one pole a track."""
    log = robot_log(tmp_path / "log.csv", 600, seed=4, noise=0.5)
    found = run(capsys, "fit", log, "--json").document
    assert found["structure"] in ("oe", "armax", "arx")  # tied: fewest parameters lead
    assert len(found["parameters"]) <= 8
    assert found == {
        **found["models"][0],
        **{k: found[k] for k in ("reason", "failed", "models", "read_as")},
    }


def test_orders_are_read_back_as_they_are_printed(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv")
    text = "na=1,0;0,2 nb=1,1;2,1 nk=1,2;1,0"
    found = run(capsys, "fit", log, "--structure", "arx", "--orders", text, "--json").document
    assert found["orders"] == {
        "na": [[1, 0], [0, 2]],
        "nb": [[1, 1], [2, 1]],
        "nk": [[1, 2], [1, 0]],
    }
    shown = run(capsys, "fit", log, "--structure", "arx", "--orders", "na=2 nb=1 nk=0")
    assert "arx na=2 nb=1 nk=0" in shown.out


def test_ranges_of_orders_are_searched(tmp_path: Path, capsys: Capture) -> None:
    signals = robot_signals(400)
    log = write_log(tmp_path / "log.csv", ["u", "y"], [signals["pwm_l"], signals["omega_l"]])
    words = ("--structure", "arx", "--orders", "na=1:4 nb=1:4 nk=0:3")
    found = run(capsys, "fit", log, *words, "--json").document
    assert 10 <= found["order_search"]["tried"] <= 64  # the whole grid, or its promising part
    assert len(found["order_search"]["candidates"]) == 10
    assert found["orders"]["nk"] == 1
    assert 1 <= found["orders"]["na"] <= 4


@pytest.mark.slow
def test_two_runs_say_the_same(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv", 200)
    words = ("fit", log, "--split", "0.7", "--json", "--workspace")
    first = run(capsys, *words, tmp_path / "a").document
    second = run(capsys, *words, tmp_path / "b").document
    assert timeless(first) == timeless(second)
    assert_fit_document(first, ["omega_l", "omega_r"], judged=True)


def test_split_and_val_judge_and_never_choose(tmp_path: Path, capsys: Capture) -> None:
    log, val = robot_log(tmp_path / "log.csv", 400), robot_log(tmp_path / "val.csv", seed=7)
    alone = run(capsys, "fit", log, *OE, "--json").document
    judged = run(capsys, "fit", log, "--val", val, *OE, "--json").document
    halves = run(capsys, "fit", log, "--split", "0.5", *OE, "--json").document
    assert alone["validation"] is None
    assert judged["parameters"] == alone["parameters"]
    assert judged["validation"]["data"] == "val.csv"
    assert judged["validation"]["samples"] == 300
    assert halves["estimation"]["data"] == "log.csv, first 50 %"
    assert halves["validation"]["samples"] == 200
    assert halves["parameters"] != alone["parameters"]


def test_horizons_stand_between_one_step_and_free_run(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv")
    found = run(capsys, "fit", log, *ARX, "--horizon", 5, "--horizon", 2, "--json").document
    ahead = found["estimation"]["k_step"]
    assert [f["horizon"] for f in ahead] == [2, 5]
    for figures in ahead:
        assert_figures(figures, ["omega_l", "omega_r"], figures["horizon"])


def test_several_logs_are_several_experiments(tmp_path: Path, capsys: Capture) -> None:
    logs = [robot_log(tmp_path / f"{n}.csv", n, seed=n) for n in (90, 150, 260)]
    found = run(capsys, "fit", *logs, *OE, "--json").document
    assert found["estimation"]["data"] == "90.csv, 150.csv, 260.csv"
    assert found["estimation"]["samples"] == 500
    values = parameters(found)
    for name, true in TRUTH.items():
        assert abs(values[name][0] - true) < 4 * values[name][1], name


def test_units_are_converted_stored_and_used_again(tmp_path: Path, capsys: Capture) -> None:
    signals = robot_signals(400)
    raw = {k: v * (255 / 20000 if "pwm" in k else 30 / np.pi) for k, v in signals.items()}
    plain = write_log(tmp_path / "plain.csv", list(signals), list(signals.values()))
    rpm = write_log(tmp_path / "rpm.csv", list(raw), list(raw.values()))
    units = ("--unit", "omega_l=rpm,omega_r=rpm", "--pwm-max", "255")
    wanted = run(capsys, "fit", plain, *ARX, "--json", "--workspace", "plain").document
    more = {k: v[:-1] for k, v in raw.items()}  # a log cannot judge itself: one row less is another
    val = write_log(tmp_path / "val.csv", list(more), list(more.values()))
    found = run(capsys, "fit", rpm, *ARX, *units, "--val", val, "--json").document
    for name, (value, _) in parameters(wanted).items():
        # nine printed digits of the log leave six of a parameter
        assert parameters(found)[name][0] == pytest.approx(value, rel=1e-6, abs=1e-12), name
    inside = found["estimation"]["fit_percent"]
    assert found["validation"]["fit_percent"] == pytest.approx(inside, abs=0.1)
    ranked = run(capsys, "compare", "--val", val, "--json").document
    judged = found["validation"]["fit_percent"]
    assert ranked["ranking"][0]["fit_percent"] == pytest.approx(judged)
    plant = run(capsys, "export", "--json").document["plant"]
    channels = json.loads(Path(plant, "plant.json").read_text())["inputs"]
    assert [c["scale"] for c in channels] == pytest.approx([20000 / 255] * 2)
    replayed = run(capsys, "simulate", rpm, "--json").document
    for name, fit in found["estimation"]["fit_percent"].items():
        # from rest instead of an estimated state: a few samples of difference
        assert replayed["fit_percent"][name] == pytest.approx(fit, abs=0.5)


def test_fixed_and_bounded_parameters(tmp_path: Path, capsys: Capture) -> None:
    signals = robot_signals(400)
    log = write_log(tmp_path / "log.csv", ["u", "y"], [signals["pwm_l"], signals["omega_l"]])
    words = ("--fix", "f1=-0.5", "--bound", "b1=0:0.0003", "--json")
    found = run(capsys, "fit", log, *OE, *words).document
    f1, b1 = {p["name"]: p for p in found["parameters"]}.values().__reversed__()
    assert (f1["value"], f1["std_error"], f1["fixed"]) == (-0.5, 0.0, True)
    assert b1["value"] == pytest.approx(3e-4, rel=1e-5)
    assert b1["at_bound"]
    assert any("b1" in w and "bound" in w for w in found["warnings"])


def test_stable_admits_no_unstable_model(tmp_path: Path, capsys: Capture) -> None:
    rng = np.random.default_rng(5)
    u = rng.standard_normal(120)
    y = np.cumsum(np.cumsum(u)) * 1.0 + 1.05 ** np.arange(120)
    log = write_log(tmp_path / "log.csv", ["u", "y"], [u, y])
    words = ("--structure", "arx", "--orders", "na=2 nb=1", "--detrend", "none", "--json")
    free = run(capsys, "fit", log, *words).document
    kept = run(capsys, "fit", log, *words, "--stable").document
    assert not free["properties"]["stable"]
    assert any("unstable" in w for w in free["warnings"])
    assert kept["properties"]["stable"]


@pytest.mark.slow
def test_an_unstable_model_does_not_lead(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv", 300, seed=9, noise=2.0)
    found = run(capsys, "fit", log, "--json").document
    assert found["properties"]["stable"]


def test_tracks_commanded_alike_are_named(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv", together=True)
    result = run(capsys, "fit", log, *ARX, "--json")
    found = result.document
    said = " ".join(found["warnings"])
    assert "pwm_l and pwm_r always move together" in said
    assert "no information about a combination of b1[omega_l,pwm_l], b1[omega_l,pwm_r]" in said
    errors = {p["name"]: p["std_error"] for p in found["parameters"]}
    assert errors["b1[omega_l,pwm_l]"] is None, "infinite, and JSON has no infinity"
    assert errors["a1[omega_l,omega_l]"] > 0
    # the smallest values that explain the sum of both effects
    assert parameters(found)["b1[omega_l,pwm_l]"][0] == pytest.approx(2e-4, rel=0.1)
    assert run(capsys, "fit", log, *ARX).code == 0


def test_compare_refuses_criteria_across_data(tmp_path: Path, capsys: Capture) -> None:
    one, two = robot_log(tmp_path / "one.csv"), robot_log(tmp_path / "two.csv", seed=2)
    old = run(capsys, "fit", one, *ARX, "--json").document["model"]
    for words in (ARX, OE):
        run(capsys, "fit", two, *words)
    found = run(capsys, "compare", "--criterion", "bic", "--json").document
    assert [line["structure"] for line in found["ranking"]] == ["oe", "arx"]
    assert [e["model"] for e in found["excluded"]] == [old]
    assert "other data" in found["excluded"][0]["reason"]
    judged = run(capsys, "compare", "--val", one, "--json").document
    assert len(judged["ranking"]) == 3
    assert judged["excluded"] == []
    assert judged["data"] == "one.csv"


def test_criteria_are_the_same_in_fit_and_compare(tmp_path: Path, capsys: Capture) -> None:
    """Over the samples that all of them predict: an ARX with more lags predicts fewer."""
    log = robot_log(tmp_path / "log.csv")
    orders = ("--structure", "arx,oe", "--orders", "arx: na=5 nb=1; oe: nb=1 nf=1")
    fitted = run(capsys, "fit", log, *orders, "--json").document["models"]
    ranked = run(capsys, "compare", "--criterion", "aic", "--json").document["ranking"]
    by_model = {line["model"]: line["aic"] for line in ranked}
    for m in fitted:
        assert m["criteria"]["aic"] == pytest.approx(by_model[m["model"]], rel=1e-9)


def test_compare_needs_the_same_held_out_data(tmp_path: Path, capsys: Capture) -> None:
    log, val = robot_log(tmp_path / "log.csv"), robot_log(tmp_path / "val.csv", seed=2)
    run(capsys, "fit", log, *ARX)
    run(capsys, "fit", log, *OE, "--val", val)
    found = run(capsys, "compare", "--json").document
    assert {line["figures"]["data"] for line in found["ranking"]} == {"val.csv"}
    assert all("from now on" in note for note in found["notes"])  # which model leads
    val.unlink()
    found = run(capsys, "compare", "--json").document
    assert {line["figures"]["data"] for line in found["ranking"]} == {"log.csv"}
    assert any("--val" in note for note in found["notes"])


def test_compare_goes_on_without_the_log(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv")
    for words in (ARX, OE):
        run(capsys, "fit", log, *words)
    fresh = run(capsys, "compare", "--criterion", "aic", "--json").document
    assert not any("gone or have changed" in note for note in fresh["notes"])
    robot_log(log, seed=8)
    changed = run(capsys, "compare", "--criterion", "aic", "--json").document
    log.unlink()
    gone = run(capsys, "compare", "--criterion", "aic", "--json").document
    for found in (changed, gone):
        assert [r["model"] for r in found["ranking"]] == [r["model"] for r in fresh["ranking"]]
        assert any("gone or have changed" in note for note in found["notes"])


@pytest.mark.slow
def test_pictures_are_drawn(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv")
    (tmp_path / "mission.yaml").write_text("goal: [1, 0]\nobstacles: [[0.5, 0.4]]\n")
    assert run(capsys, "fit", log, *ARX, "--split", 0.7).code == 0
    assert run(capsys, "plot", "fit", "-o", "fit.svg").code == 0
    assert run(capsys, "fit", log, *OE).code == 0
    assert run(capsys, "plot", "ranking", "-o", "ranking.png").code == 0
    assert run(capsys, "export").code == 0
    assert run(capsys, "simulate", "mission.yaml", "--plot", "path.svg").code == 0
    assert run(capsys, "simulate", "mission.yaml", "--runs", 4, "--plot", "runs.svg").code == 0
    written = run(capsys, "report", "mission.yaml", "-o", "m.html", "--json").document
    assert written == {"page": "m.html", "mission": "mission.yaml"}
    assert "200 runs" in (tmp_path / "m.html").read_text(encoding="utf-8")
    for page in ("mission.html", "mission_runs.html"):
        assert "Clearance of the centre" in (tmp_path / ".sysid" / "missions" / page).read_text()
    refused = run(capsys, "report", "mission.yaml", "arx")
    assert refused.code == 2
    assert "name one mission or one diagnosis alone" in refused.err
    svg = dict.fromkeys(("fit.svg", "path.svg", "runs.svg"), b"<?xml")
    heads = {**svg, "ranking.png": b"\x89PNG"}
    for name, head in heads.items():
        assert (tmp_path / name).read_bytes().startswith(head)


def test_what_a_person_sees(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv")
    shown = run(capsys, "fit", log, *ARX, "--split", 0.7)
    for word in ("* arx", "fit %, free run", "last 30 %", "gain [(rad/s)/µs]", "Next:"):
        assert word in shown.out, word
    full = run(capsys, "fit", log, *ARX, "--split", 0.7, "--full")
    for word in ("a1[omega_l,omega_l]", "free run", "1 step", "first 70 %", "last 30 %", "Next:"):
        assert word in full.out, word
    assert "estimated from the first" in full.out, "no fit without its initial-state policy"
    assert full.out.endswith(run(capsys, "show").out)


needs_data = pytest.mark.skipif(
    not SHARED.is_dir(), reason=f"the measured records are not at {SHARED} (or in $SYSID_DATA)"
)


def measured(name: str) -> tuple[list[str], np.ndarray]:
    """Header and rows of one measured record."""
    path = SHARED / name
    with path.open() as stream:
        header = stream.readline().strip().split(",")
    return header, np.loadtxt(path, delimiter=",", skiprows=1)


def write_rows(path: Path, header: list[str], rows: np.ndarray) -> Path:
    np.savetxt(path, rows, delimiter=",", header=",".join(header), comments="", fmt="%.10g")
    return path


@needs_data
@pytest.mark.parametrize(("level", "published"), [("low", 0.2915), ("high", 0.3305)])
def test_free_run_figures_of_the_coupled_drives(
    level: str, published: float, tmp_path: Path, capsys: Capture
) -> None:
    """ARX with ten lags each on the first half of the training samples, its means removed."""
    header, rows = measured(f"ced/unif_{level}.csv")
    train = write_rows(tmp_path / "train.csv", header, rows[:200])
    test = write_rows(tmp_path / "test.csv", header, rows[400:])
    words = ("--structure", "arx", "--orders", "na=10 nb=10 nk=0", "--skip", 10)
    words = (*words, "--detrend", "mean")  # as it was published
    found = run(capsys, "fit", train, "--val", test, *words, "--json").document
    # four digits were published
    assert found["validation"]["rmse"]["y_speed_V"] == pytest.approx(published, abs=5e-5)
    assert found["validation"]["samples"] == 90
    assert "first 10 samples" in found["validation"]["initial_state"]


@needs_data
def test_published_parameters_of_the_dryer(tmp_path: Path, capsys: Capture) -> None:
    header, rows = measured("dryer/dryer.csv")
    log = write_rows(tmp_path / "log.csv", header, rows[:300])
    words = ("--structure", "arx", "--orders", "na=2 nb=2 nk=3", "--detrend", "mean")
    found = run(capsys, "fit", log, *words, "--json").document
    values = [value for value, _ in parameters(found).values()]
    # four digits were published
    assert values == pytest.approx([-1.2737, 0.3935, 0.0666, 0.0445], abs=6e-5)
    assert found["estimation"]["one_step"]["fit_percent"]["y_temp_V"] == pytest.approx(
        95.12, abs=0.006
    )
