"""One contest: what is asked for is fitted the same way alone and in company, and who may lead."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.preparation import Preparation
from sysid.data.preprocess import Detrend
from sysid.data.record import Channel, Record
from sysid.estimation.assessment.step_response import step_responses
from sysid.estimation.pem import fit
from sysid.estimation.selection import final_fits
from sysid.estimation.selection import select_structure as selection
from sysid.estimation.selection.defaults import default_structures, usual_orders
from sysid.estimation.selection.orders import Candidate, OrderSearch, search_orders
from sysid.estimation.selection.select_structure import select_structure
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.registry import structure_class, structure_classes


def _motor(samples: int = 260, noise: float = 0.05) -> Record:
    """A first-order motor behind a saturation: one input, one output, from rest."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 5), 5)
    y = lfilter([0.0, 0.3], [1.0, -0.7], np.tanh(1.5 * u)) + noise * rng.standard_normal(samples)
    return Record(u[:, None], y[:, None], 0.1, (Channel("u", "V"),), (Channel("y", "rad/s"),))


def _asked(names: Sequence[str], record: Record, patch: pytest.MonkeyPatch) -> dict[str, Structure]:
    """The structures that a contest fits to all data, by name, without fitting any of them."""
    seen: dict[str, Structure] = {}

    def searched(name: str, grid: Sequence[Mapping[str, Any]], *_: Any, **__: Any) -> OrderSearch:
        # what a search within a structure brings back: orders that nobody asked for
        found = [dict(o) | dict.fromkeys(structure_class(name).traits.order_names, 1) for o in grid]
        return OrderSearch(
            name, "fit", tuple(Candidate(o, 2, 0.1, 0.1) for o in found), 0.02, (100, 1)
        )

    def fitted(structure: Structure, *_: Any, **__: Any) -> Model:
        seen[structure.name] = structure
        plain = structure_class("arx").from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
        return fit(plain, [record])

    patch.setattr(selection, "search_orders", searched)
    patch.setattr(final_fits, "fit", fitted)
    select_structure(names, [record], FitOptions(), Detrend.none(1, 1))
    return seen


NONLINEAR = [
    name
    for name in structure_classes()
    if not structure_class(name).traits.linear and name != "tanks"  # two levels that drain
]


def test_there_are_nonlinear_structures_to_compare() -> None:
    assert {"hammerstein-wiener", "narmax", "narx-wavelet", "dc-motor"} <= set(NONLINEAR)


@pytest.mark.parametrize("name", NONLINEAR)
def test_the_same_request_is_the_same_structure(name: str) -> None:
    """Alone, beside a linear one, beside all others: the same structure goes to the same fit."""
    record = _motor()
    found = []
    for company in ([name], [name, "arx"], [*NONLINEAR, "oe"]):
        with pytest.MonkeyPatch.context() as patch:
            found.append(_asked(company, record, patch)[name])
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("name", ["hammerstein-wiener"])
def test_the_same_request_is_the_same_model(name: str) -> None:
    """The fits themselves, to the last bit."""
    record = _motor(200)
    options = FitOptions(max_evaluations=15)
    alone = select_structure([name], [record], options, Detrend.none(1, 1)).entries
    beside = select_structure([name, "arx"], [record], options, Detrend.none(1, 1)).entries
    (other,) = (e.model for e in beside if e.model.structure.name == name)
    assert alone[0].model.structure == other.structure
    assert np.array_equal(alone[0].model.theta, other.theta)


def test_orders_searched_apart_are_ranked_over_the_same_samples() -> None:
    """Chains of one delay each give the scores that a single search over all delays gives."""
    data = hold_out([_motor()])
    grid = [{"nb": 1, "nf": 1, "nk": nk} for nk in (1, 2, 9)]
    options = FitOptions()
    whole = search_orders("oe", grid, data, options, "bic")
    scores = {c.orders["nk"]: c.score for c in whole.candidates}
    for o in grid:
        apart = search_orders("oe", [o], data, options, "bic", None, grid)
        # another start may end elsewhere within the tolerance of a search, 1e-4 of the cost
        assert apart.best.score == pytest.approx(scores[o["nk"]], abs=0.05)
    alone = search_orders("oe", grid[:1], data, options, "bic")
    assert abs(alone.best.score - scores[1]) > 1.0


def test_what_competes_unasked_is_said_by_the_classes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert default_structures(True) == ("arx", "armax", "oe", "bj")
    assert default_structures(False) == ("ar", "arma", "ma")
    tanks = structure_class("tanks")
    monkeypatch.setattr(tanks, "traits", replace(tanks.traits, by_default=True))
    assert default_structures(True) == ("arx", "armax", "oe", "bj", "tanks")


@pytest.mark.parametrize("name", sorted(default_structures(True)))
def test_a_record_of_any_length_leaves_candidates(name: str) -> None:
    """One that bears no order gets the lowest: the fit itself refuses it."""
    few = structure_class(name).candidate_orders(1, 1, 5, 1)
    assert few == (dict.fromkeys(structure_class(name).traits.order_names, 1),)
    assert len(structure_class(name).candidate_orders(2, 2, 2000, 1)) > 3


def _two_outputs(samples: int) -> Record:
    """Three states that two outputs share."""
    rng = np.random.default_rng(5)
    A = np.array([[0.8, 0.3, 0.0], [-0.3, 0.8, 0.2], [0.0, 0.0, 0.5]])
    B, C = rng.standard_normal((3, 1)), np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.0]])
    u, x, y = rng.standard_normal((samples, 1)), np.zeros(3), np.zeros((samples, 2))
    for k in range(samples):
        y[k] = C @ x + 0.1 * rng.standard_normal(2)
        x = A @ x + B @ u[k]
    return Record(u, y, 0.1)


@pytest.mark.slow
def test_what_else_is_tried_follows_from_the_data() -> None:
    """Process models where samples are few, state space of several outputs."""
    few, many, two = _motor(80), _motor(260), _two_outputs(400)
    assert usual_orders([few], FitOptions()) == {"process": ({"np": 1}, {"np": 2})}
    assert usual_orders([many], FitOptions()) == {}
    assert usual_orders([two], FitOptions()) == {"ss": ({"n": 3},)}
    assert usual_orders([two], FitOptions(fixed={"a1": -0.9})) == {}
    names = {e.model.structure.name for e in select_structure((), [few], FitOptions()).entries}
    assert names == {*default_structures(True), "process"}
    found = select_structure((), [two], FitOptions())
    assert {e.model.structure.name for e in found.entries} == {*default_structures(True), "ss"}
    assert all(e.error is not None for e in found.entries)


def test_orders_whose_free_run_diverges_give_way(monkeypatch: pytest.MonkeyPatch) -> None:
    record = _motor()

    def runaway(structure: Structure, *more: Any, **named: Any) -> Model:
        model = fit(structure, *more, **named)
        if structure.order_values()["na"] == 1:
            return model
        return replace(model, theta=np.where(np.arange(len(model.theta)) == 0, -1.5, model.theta))

    monkeypatch.setattr(final_fits, "fit", runaway)
    grid = [{"na": na, "nb": 1, "nk": 1} for na in (1, 2)]
    usual = select_structure(("arx",), [record], FitOptions(), grid=grid)
    model, notes = usual.entries[0].model, usual.entries[0].notes
    assert model.structure.order_values()["na"] == 1
    told = [n for n in notes if "free run diverges: na=1 nb=1 nk=1 is taken" in n]
    search = search_orders("arx", grid, hold_out([record]), FitOptions())
    assert bool(told) == (search.best.orders["na"] == 2)
    alone = select_structure(("arx",), [record], FitOptions(), grid=grid[1:])
    assert "Its free run does not settle (largest pole at radius" in alone.reason


def oven(seed: int, samples: int = 600, dt: float = 10.0) -> Record:
    """1.8 °C/% and 300 s (30 samples) in a room whose temperature walks at random."""
    rng = np.random.default_rng(seed)
    u = np.repeat(40.0 + 15.0 * rng.choice([-1.0, 0.0, 1.0], samples // 30), 30)
    room = np.cumsum(rng.normal(0.0, 0.12, samples))
    a = np.exp(-dt / 300.0)
    y = lfilter([0.0, 1.0 - a], [1.0, -a], 1.8 * u + room) + rng.normal(0.0, 0.1, samples)
    return Record(u[:, None], y[:, None], dt, (Channel("duty", "%"),), (Channel("oven", "degC"),))


@pytest.mark.parametrize("shape", ["straight", "swing"])
def test_a_level_that_drifts_leads_to_no_slow_mode(shape: str) -> None:
    """In free run models that do not settle led; one step ahead the noise model has the drift."""
    rng, n = np.random.default_rng(0), 1000
    u = np.repeat(20.0 + 10.0 * rng.integers(0, 4, n // 50), 50)
    swing = 4.0 * np.sin(np.arange(n) / 100.0)
    a = np.exp(-2.0 / 60.0)
    y = lfilter([0.0, 2.0 * (1.0 - a)], [1.0, -a], u) + 0.15 * rng.standard_normal(n)
    y += np.linspace(0.0, 8.0, n) if shape == "straight" else swing
    record = Record(u[60:, None], y[60:, None], 2.0)
    found = select_structure(("oe", "bj"), [record], FitOptions())
    model = found.entries[0].model
    assert "one step ahead, because a level drifts" in found.reason
    (response,) = step_responses(model)
    assert response.gain.value == pytest.approx(2.0, abs=1.5 * response.gain.reach)
    assert response.settles
    assert response.gain.reach < 0.3


@pytest.mark.parametrize("seed", range(3))
def test_what_is_left_of_a_drift_takes_no_modes(seed: int) -> None:
    """In free run modes as slow as the drift would err least."""
    record = Preparation(remove_drift=True).apply(oven(seed))
    found = select_structure((), [record], FitOptions())
    model = found.entries[0].model
    assert "one step ahead, because a level drifts" in found.reason
    step = model.step_response(samples=3000)[1][:, 0] - model.detrend.y_offset[0]
    assert step[-1] == pytest.approx(1.8, rel=0.1)
    assert np.argmax(step > (1.0 - np.exp(-1.0)) * step[-1]) == pytest.approx(30, rel=0.2)
