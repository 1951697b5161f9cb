"""sysid compare on equal terms: every option counts, and who is best can be built on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, robot_log, run, write_log
from sysid_cli.app import main

from sysid.criteria.table import BUILT_IN
from sysid.data.record import Record
from sysid.errors import Termination
from sysid.estimation.pem import fit
from sysid.estimation.selection.comparison import Contender, compare
from sysid.estimation.soundness import Doubts, doubts_about, leader, relative_gap
from sysid.fitting.options import FitOptions
from sysid.structures.registry import structure_class

Judged = tuple[Path, list[str]]


def _workspace(folder: Path, *options: object) -> None:
    log, val = robot_log(folder / "log.csv"), robot_log(folder / "val.csv", seed=2)
    extra = ["--val", val] if "--val" in options else []
    rest = [o for o in options if o != "--val"]
    for name, orders in (("arx", "na=2 nb=2"), ("oe", "nb=1 nf=1")):
        asked = ["--structure", name, "--orders", orders, *extra, *rest]
        assert main(["fit", *map(str, (log, *asked, "--workspace", folder / "ws"))]) == 0


HELD = {"val": ["--val"], "split": ["--split", "0.7"], "none": []}


@pytest.fixture(
    scope="module",
    params=["val", *(pytest.param(h, marks=pytest.mark.slow) for h in ("split", "none"))],
)
def judged(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Judged:
    """A folder of two fits, and what was held out for them."""
    folder = tmp_path_factory.mktemp(request.param)
    _workspace(folder, *HELD[request.param])
    return folder, HELD[request.param]


def test_every_option_counts_without_naming_a_log(judged: Judged, capsys: Capture) -> None:
    """--skip, --horizon and --initial change the figures on whatever judged the models."""
    folder, held = judged
    place = ["--workspace", folder / "ws", "--json"]
    plain = run(capsys, "compare", *place).document["ranking"][0]["figures"]
    options = ["--skip", 30, "--horizon", 5, "--horizon", 8, "--initial", "zero"]
    asked = run(capsys, "compare", *options, *place).document["ranking"][0]["figures"]
    assert asked["samples"] == plain["samples"] - 30
    assert [f["horizon"] for f in asked["k_step"]] == [5, 8]
    assert asked["initial_state"] == "zero"
    assert asked["data"] == plain["data"]
    assert asked["held_out"] == plain["held_out"] == bool(held)


def test_the_figures_are_those_of_a_fit_that_was_asked_the_same(
    judged: Judged, tmp_path: Path, capsys: Capture
) -> None:
    """Whether the fit or the comparison is told how to judge, the numbers are the same."""
    options = ["--skip", 20, "--horizon", 4]
    folder, held = judged
    _workspace(tmp_path, *held, *options)
    found = [
        run(capsys, "compare", *options, "--workspace", x / "ws", "--json").document
        for x in (tmp_path, folder)
    ]
    told, asked = ([r["figures"] for r in document["ranking"]] for document in found)
    assert told == asked


def test_without_the_log_other_figures_are_refused_in_a_sentence(
    tmp_path: Path, capsys: Capture
) -> None:
    _workspace(tmp_path, "--val")
    (tmp_path / "val.csv").unlink()
    assert run(capsys, "compare", "--workspace", tmp_path / "ws").code == 0
    refused = run(capsys, "compare", "--skip", 10, "--workspace", tmp_path / "ws")
    assert refused.code == 1
    assert "is missing or has changed" in refused.err
    assert "--val" in refused.err


def test_models_of_logs_of_unequal_length_are_ranked_by_error_alone(
    tmp_path: Path, capsys: Capture
) -> None:
    """On one validation log; information criteria leave the others out and say so."""
    val = robot_log(tmp_path / "val.csv", 200, 9)
    place = ["--workspace", tmp_path / "ws"]
    for k, samples in enumerate((150, 400)):
        log = robot_log(tmp_path / f"log{k}.csv", samples, k)
        shared = ["--structure", "arx", "--orders", "na=1 nb=1", "--val", val, *place]
        assert run(capsys, "fit", log, *shared).code == 0
    judged = run(capsys, "compare", "--val", val, *place, "--json").document
    assert [r["figures"]["samples"] for r in judged["ranking"]] == [200, 200]
    by_aic = run(capsys, "compare", "--criterion", "aic", *place, "--json").document
    assert len(by_aic["ranking"]) == 1
    assert "other data" in by_aic["excluded"][0]["reason"]


def _two_sides(folder: Path) -> Path:
    """Two motors, as the fits of them name their channels in one order and another."""
    rng = np.random.default_rng(3)
    u, y = np.repeat(rng.uniform(-1.0, 1.0, (60, 2)), 10, axis=0), np.zeros((600, 2))
    for k in range(1, 600):
        y[k] = 0.8 * y[k - 1] + [0.2, 0.3] * u[k - 1]
    y += 0.01 * rng.standard_normal(y.shape)
    return write_log(folder / "two.csv", ["u1", "u2", "y1", "y2"], [*u.T, *y.T])


def test_models_of_the_same_channels_in_another_order_are_ranked_together(
    tmp_path: Path, capsys: Capture
) -> None:
    log, place = _two_sides(tmp_path), ["--workspace", tmp_path / "ws"]
    for k, u in enumerate(("u1,u2", "u2,u1")):
        of = ["--structure", "arx", "--orders", f"na=1 nb={1 + k} nk=1", "--split", "0.7"]
        assert run(capsys, "fit", log, "-u", u, *of, *place).code == 0
    for criterion in ("fit", "aic"):
        ranked = run(capsys, "compare", "--criterion", criterion, *place, "--json").document
        assert len(ranked["ranking"]) == 2
        assert not ranked["excluded"]
    assert run(capsys, "compare", *place).code == 0


def test_models_of_other_channels_are_left_out_in_one_sentence(
    tmp_path: Path, capsys: Capture
) -> None:
    log, place = _two_sides(tmp_path), ["--workspace", tmp_path / "ws"]
    for na, y in ((1, "y2"), (2, "y2"), (1, "y1")):
        of = ["--structure", "arx", "--orders", f"na={na} nb=1 nk=1"]
        assert run(capsys, "fit", log, "-u", "u1", "-y", y, *of, *place).code == 0
    done = run(capsys, "compare", "--val", log, *place)
    shown = " ".join((done.out + done.err).split())
    assert shown.count("left out") == 1
    assert "left out: a model of u1 → y2 cannot be judged on" in shown
    assert "(u1 → y1), nor be ranked there." in shown


# ------------------------------------------------------------------------ who may lead


def _record(seed: int = 1, samples: int = 400) -> Record:
    """A stable first-order plant, pole .8, with white noise on its output."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], samples // 4), 4)
    y = np.zeros(samples)
    for k in range(1, samples):
        y[k] = 0.8 * y[k - 1] + 0.2 * u[k - 1]
    return Record(u[:, None], (y + 0.05 * rng.standard_normal(samples))[:, None], 0.1)


def _contender(id: str, record: Record, pole: float | None) -> Contender:
    """An OE model; with a pole its second mode has that pole and hardly any weight."""
    n = 1 if pole is None else 2
    oe = structure_class("oe").from_orders({"nb": n, "nf": n, "nk": 1}, 1, 1)
    fixed = {}
    if pole is not None:
        f, b = np.poly([0.8, pole]), 0.2 * np.array([1.0, -pole])
        fixed = {"f1": f[1], "f2": f[2], "b1": b[0], "b2": b[1] + 1e-7}
        names = [p.name for p in oe.parameters(record.inputs, record.outputs)]
        fixed = {n: fixed[n.split("[")[0]] for n in names}
    model = fit(oe, [record], FitOptions(fixed=fixed))
    figures = {"data": "here", "fit_percent": {"y": 0.0}, "rmse": {"y": 1.0}}
    return Contender(id, model, (record,), {"estimation": figures})


def test_progress_counts_every_model_once() -> None:
    """One that cannot be compared, too: the bar ends at its end."""
    record = _record()
    contenders = [_contender("a", record, None), _contender("b", record, None)]
    elsewhere = replace(record, name="other", inputs=(replace(record.inputs[0], name="x"),))
    contenders.append(_contender("c", elsewhere, None))
    steps: list[int] = []
    ranking = compare(contenders, "fit", ([record], "here"), advance=steps.append)
    assert set(ranking.excluded) == {"c"}
    assert steps == [1, 1, 1]


@pytest.mark.parametrize("criterion", BUILT_IN)
def test_a_model_that_drifts_leads_by_no_criterion(criterion: str) -> None:
    """Fixed values count as no parameters, so the drifting model is first by every criterion."""
    record = _record()
    drifting = _contender("drifting", record, 1.0004)
    settled = _contender("settled", record, None)
    ranking = compare([drifting, settled], criterion, ([record], "here"))
    assert ranking.best.contender.id == "settled"
    assert ranking.lines[0].contender.id == "drifting"
    assert any("drifting is first by" in n and "1.0004" in n for n in ranking.notes)


def test_a_mode_longer_than_the_log_does_not_lead_and_is_said() -> None:
    record = _record()
    slow, settled = _contender("slow", record, 0.9999), _contender("settled", record, None)
    assert "999.9 s, longer than the log of 40 s" in doubts_about(slow.model).words
    assert compare([slow, settled], "aic", ([record], "here")).best.contender.id == "settled"
    alone = compare([slow], "aic", ([record], "here"))
    assert alone.best.contender.id == "slow"
    assert any("slow leads although" in n for n in alone.notes)


def test_a_search_that_was_given_up_is_held_against_a_model() -> None:
    record = _record()
    settled = _contender("settled", record, None)
    stopped = replace(settled.model, termination=Termination.MAX_ITERATIONS)
    given_up = Contender("given-up", stopped, (record,), settled.report)
    assert "ended before convergence" in doubts_about(given_up.model).words
    assert doubts_about(settled.model).settled
    assert compare([given_up, settled], "fit", ([record], "here")).best.contender.id == "settled"


def test_only_a_tie_lets_a_settled_model_pass() -> None:
    """A clearly better model leads, whatever speaks against it; an unbounded one never does."""
    calm, slow = Doubts(False, ()), Doubts(False, ("it is slow",))
    wild = Doubts(True, ("it runs away",))
    names = {"calm": calm, "slow": slow, "wild": wild}

    def lead(order: list[str], tied: set[str]) -> str:
        return leader(
            order,
            lambda e: not names[e].unbounded,
            lambda e, best: e in tied,
            lambda e: names[e].settled,
        )

    assert lead(["slow", "calm"], {"slow"}) == "slow"
    assert lead(["slow", "calm"], {"slow", "calm"}) == "calm"
    assert lead(["wild", "slow", "calm"], {"slow", "calm"}) == "calm"
    assert lead(["wild", "slow", "calm"], {"slow"}) == "slow"
    assert lead(["wild"], {"wild"}) == "wild"


@pytest.mark.parametrize("criterion", BUILT_IN)
def test_criteria_measure_the_same_distance(criterion: str) -> None:
    """Errors 10 % larger, the same number of parameters: a gap of 10 % by every criterion."""
    from sysid.criteria.information import information_criteria

    e = np.random.default_rng(0).standard_normal((500, 2))
    if criterion in ("fit", "rmse"):
        values = (95.0, 94.5) if criterion == "fit" else (1.0, 1.1)
    else:
        values = tuple(information_criteria([s * e], 5)[criterion] for s in (1.0, 1.1))
    assert relative_gap(criterion, values[1], values[0], 500, 2) == pytest.approx(0.1, rel=1e-6)
