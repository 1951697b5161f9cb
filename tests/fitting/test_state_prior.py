"""Searches end, also where the data hardly tell initial states or parameters apart."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, robot_log, run
from scipy.signal import lfilter
from sysid_datasets import path

from sysid.data.io import read_logs
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Record
from sysid.errors import Termination
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Initial
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

BJ = {"nb": 2, "nc": 1, "nd": 1, "nf": 2, "nk": 1}
BJ_TOO_LARGE = {"nb": 3, "nc": 1, "nd": 1, "nf": 3, "nk": 1}
OE = {"nb": 2, "nf": 2, "nk": 1}
OE_TOO_LARGE = {"nb": 3, "nf": 3, "nk": 1}


def _two_paths_with_the_same_poles(seed: int, head: float = 0.0) -> Record:
    """Poles .8 and .5 from both inputs, a second at rest first (or an output of ``head``)."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], (120, 2)), 5, axis=0)
    u[:10] = 0.0
    f = np.poly([0.8, 0.5])
    y = lfilter([0.0, 0.3, -0.1], f, u[:, 0]) + lfilter([0.0, 0.1, -0.05], f, u[:, 1])
    y += lfilter([1.0], [1.0, -0.7], 0.05 * rng.standard_normal(600))
    return Record(u, (y + head * 0.8 ** np.arange(600))[:, None], 0.1)


@pytest.mark.parametrize(
    ("name", "orders"), [("oe", OE), ("oe", OE_TOO_LARGE), ("bj", BJ), ("bj", BJ_TOO_LARGE)]
)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_states_that_look_alike_do_not_keep_a_search_from_ending(
    name: str, orders: dict[str, int], seed: int
) -> None:
    """Every path has states of its own; with equal poles their free responses are the same."""
    record = _two_paths_with_the_same_poles(seed)
    structure = structure_class(name).from_orders(dict(orders), 2, 1, {})
    model = fit(structure, [record], FitOptions(initial=Initial.ESTIMATED))
    assert model.termination.good, model.termination
    assert _largest_response(model, record) <= np.linalg.norm(record.y)


def _largest_response(model: Model, record: Record) -> float:
    """‖free response‖ of the initial state that the model gives the record."""
    rest = np.zeros_like(record.u)
    return float(np.linalg.norm(model.simulate(rest, model.initial_states[0], record.t0)))


@pytest.mark.parametrize("head", [0.0, 2.0, -5.0])
def test_states_that_the_data_show_are_found_all_the_same(head: float) -> None:
    """A free response of known size is recovered within its noise, from rest or far from it."""
    record = _two_paths_with_the_same_poles(4, head)
    structure = structure_class("bj").from_orders(dict(BJ), 2, 1, {})
    model = fit(structure, [record], FitOptions(initial=Initial.ESTIMATED))
    rest = np.zeros_like(record.u)
    found = model.simulate(rest, model.initial_states[0], record.t0)[:, 0]
    # the disturbance has a standard deviation of .07 and a pole of .7: an initial state is known
    # to about that
    assert np.max(np.abs(found[:20] - head * 0.8 ** np.arange(20))) < 0.25


@pytest.mark.parametrize(
    ("log", "name", "orders"),
    [("prbs", "bj", BJ_TOO_LARGE), ("prbs", "oe", {"nb": 2, "nf": 3, "nk": 1})],
)
def test_the_bundled_example_converges(log: str, name: str, orders: dict[str, int]) -> None:
    """Twelve paths, four of each with nearly the same poles, on a log that begins at rest."""
    records = read_logs([path(log)], ReadOptions())
    structure = structure_class(name).from_orders(dict(orders), 2, 2, {})
    model = fit(structure, records)
    assert model.termination.good


@pytest.mark.parametrize("name", ["oe", pytest.param("armax", marks=pytest.mark.slow)])
def test_the_limit_of_a_search_is_the_users(name: str, tmp_path: Path, capsys: Capture) -> None:
    """--max-iterations ends a search and is said; --tolerance ends one earlier."""
    log = robot_log(tmp_path / "log.csv")
    orders = {"oe": "nb=1 nf=1", "armax": "na=1 nb=1 nc=1"}
    shared = ["fit", log, "--structure", name, "--workspace", tmp_path / "ws", "--json"]
    shared += ["--orders", orders[name]]
    stopped = run(capsys, *shared, "--max-iterations", 1).document
    assert stopped["termination"]["code"] == "max-iterations"
    assert Termination.MAX_ITERATIONS.value in stopped["warnings"]
    coarse = run(capsys, *shared, "--tolerance", 0.1).document
    fine = run(capsys, *shared, "--tolerance", 1e-12, "--max-iterations", 500).document
    assert coarse["termination"]["code"] != "max-iterations"
    spent = [max(s["evaluations"] for s in d["starts"]) for d in (coarse, fine)]
    assert spent[0] <= spent[1]


def test_a_tolerance_that_is_none_is_refused(tmp_path: Path, capsys: Capture) -> None:
    """Zero, negative, above one: one sentence."""
    log = robot_log(tmp_path / "log.csv")
    for value in ("0", "-1", "1.5"):
        refused = run(capsys, "fit", log, "--tolerance", value, "--workspace", tmp_path / "ws")
        assert refused.code == 2
        assert "--tolerance is a relative change between 0 and 1" in refused.err
