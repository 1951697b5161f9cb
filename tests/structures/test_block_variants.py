"""Block-oriented models beyond the plain case: one-sided and composed statics, forms, several
channels and records, refusals, and what the normal equations leave out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.record import Array, Channel, Record
from sysid.errors import ModelError
from sysid.estimation.assessment.advice import beyond_range
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.static.functions import parse_static
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.blocks.trials import ChainData, Effort, Trial
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein
from sysid.structures.blocks.wiener_hammerstein_starts import ways_to_deal
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

FIRST = {"nb": 1, "nf": 1, "nk": 1}


def steps(n: int, seed: int) -> Array:
    """Steps of random height, held for ten samples."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, n // 10 + 1), 10)[:n]


def record(u: Array, y: Array, noise: float = 0.01, seed: int = 0) -> Record:
    """A log with white noise of that share of the output's spread."""
    u, y = u.reshape(len(u), -1), y.reshape(len(y), -1)
    e = noise * y.std(axis=0) * np.random.default_rng(seed).normal(size=y.shape)
    names = "ab"[: u.shape[1]], "yz"[: y.shape[1]]
    ins, outs = (tuple(Channel(c) for c in letters) for letters in names)
    return Record(u, y + e, 0.01, ins, outs, name="bench")


def truth(kind: str, n: int, seed: int) -> tuple[Array, Array]:
    """(u, y) of a known plant without noise."""
    u = steps(n, seed)
    w = lfilter([0.0, 0.4], [1.0, -0.8], u)
    if kind == "one-sided dead zone":
        return u, lfilter([0.0, 0.4], [1.0, -0.8], np.maximum(u - 0.2, 0.0))
    if kind == "one-sided saturation":
        return u, np.minimum(w, 0.5)
    if kind == "abs then square":
        v = np.abs(w + 0.1)
        return u, v + 0.5 * v**2
    if kind == "dead zone then saturation":
        v = np.maximum(u - 0.1, 0.0) + np.minimum(u + 0.1, 0.0)
        return u, lfilter([0.0, 0.4], [1.0, -0.8], np.clip(v, -0.5, 0.5))
    raise KeyError(kind)


CASES = [
    (
        "one-sided dead zone",
        {"input": "dead-zone-upper", "output": "identity"},
        {"input.d_high": 0.2, "f1": -0.8, "b1": 0.4},
    ),
    (
        "one-sided saturation",
        {"input": "identity", "output": "saturation-upper"},
        {"output.s_high": 0.5, "f1": -0.8},
    ),
    ("abs then square", {"input": "identity", "output": "abs,polynomial:2"}, {"f1": -0.8}),
    (
        "dead zone then saturation",
        {"input": "dead-zone,saturation", "form": "hammerstein"},
        {"input.d_high": 0.1, "input.s_high": 0.5, "f1": -0.8},
    ),
]


@pytest.mark.parametrize(("kind", "options", "known"), CASES)
def test_one_sided_and_composed_statics_are_recovered(
    kind: str, options: dict[str, str], known: dict[str, float]
) -> None:
    u, y = truth(kind, 2000, 1)
    model = fit(HammersteinWiener.from_orders(FIRST, 1, 1, options), [record(u, y)], FitOptions())
    fresh_u, fresh_y = truth(kind, 1000, 2)
    run = model.simulate(fresh_u[:, None])[:, 0]
    # one per cent of noise on 2000 samples leaves a few tenths of a per cent in the response
    assert np.std(run - fresh_y) < 0.006 * np.std(fresh_y)
    values = {p.name: p.value for p in model.parameter_table()}
    for name, value in known.items():
        assert values[name] == pytest.approx(value, abs=0.02), name


@pytest.mark.parametrize(("form", "empty"), [("hammerstein", 1), ("wiener", 0)])
def test_form_leaves_one_side_empty(form: str, empty: int) -> None:
    u, y = truth("one-sided dead zone", 800, 3)
    s = HammersteinWiener.from_orders(FIRST, 1, 1, {"form": form})
    model = fit(s, [record(u, y)], FitOptions())
    assert isinstance(model.structure, HammersteinWiener)
    assert model.structure.statics[empty][0].is_identity


def two_tracks(n: int, seed: int) -> tuple[Array, Array]:
    """Per track a driver's lag, a dead zone, a motor; a tenth of it reaches the other track."""
    u = np.column_stack([steps(n, seed), steps(n, seed + 1)])
    v = lfilter([0.4], [1.0, -0.6], u, axis=0)
    s = np.maximum(v - 0.2, 0.0) + np.minimum(v + 0.2, 0.0)
    w = lfilter([0.0, 0.3], [1.0, -0.85], s, axis=0)
    return u, w + 0.1 * w[:, ::-1]


def two_track_fit(records: list[Record]) -> Model:
    s = WienerHammerstein.from_orders(
        {"nb1": 1, "nf1": 1, "nb": 1, "nf": 1, "nk": 1}, 2, 2, {"static": "dead-zone"}
    )
    return fit(s, records, FitOptions())


@pytest.mark.slow
def test_wiener_hammerstein_of_two_tracks_from_two_records() -> None:
    u, y = two_tracks(1600, 5)
    whole = record(u, y)
    model = two_track_fit([whole.rows(0, 800), whole.rows(850, 1600)])
    fresh_u, fresh_y = two_tracks(800, 15)
    run = model.simulate(fresh_u)
    assert np.all(np.std(run - fresh_y, axis=0) < 0.01 * np.std(fresh_y, axis=0))
    found = {p.name: p.value for p in model.parameter_table()}
    # the gain of the first blocks is a convention: the dead zone is as wide in units of their B/F
    for c in "ab":
        gain = found[f"first.b0[{c}]"] / (1.0 + found[f"first.f1[{c}]"])
        assert found[f"static.d_high[{c}]"] / gain == pytest.approx(0.2, abs=0.02)
    wild = model.simulate(100.0 * np.random.default_rng(6).normal(size=(100_000, 2)))
    assert np.max(np.abs(wild)) < 1e4


CHAINS = [
    ("hammerstein-wiener", {"nb": 2, "nf": 2, "nk": 1}, {"input": "dead-zone", "output": "abs"}),
    (
        "wiener-hammerstein",
        {"nb1": 2, "nf1": 2, "nb": 2, "nf": 1, "nk": 1},
        {"static": "saturation"},
    ),
]


@pytest.mark.parametrize(("name", "orders", "options"), CHAINS)
def test_derivatives_of_states_end_where_nothing_is_left_of_them(
    name: str, orders: dict[str, int], options: dict[str, str]
) -> None:
    s = structure_class(name).from_orders(orders, 1, 1, options)
    assert isinstance(s, BlockStructure)
    values = {"d_low": -0.2, "d_high": 0.3, "s_low": -1.0, "s_high": 1.0}
    theta = np.full(s.chain.n, 0.2)
    for k, p in enumerate(s.parameters([Channel("u")], [Channel("y")])):
        last = p.name.rpartition(".")[2]
        theta[k] = values.get(last, -0.5 if last == "f1" else theta[k])
    u = np.random.default_rng(7).normal(size=(5000, 1))
    x0 = np.full(s.chain.n_states, 0.1)
    run, D = s.chain.tangents(theta, u, x0, states=True)
    whole_run, whole = s.chain._derived(theta, u, x0, True, s.chain.n_states)
    np.testing.assert_array_equal(run, whole_run)
    np.testing.assert_allclose(D, whole, rtol=0, atol=1e-15)
    tails = D[:, s.chain.n :, 1000:]
    assert not np.any(tails)  # zeros, not denormal numbers


def test_bounds_that_allow_no_stable_model_are_refused_by_name() -> None:
    u, y = truth("one-sided dead zone", 400, 8)
    s = HammersteinWiener.from_orders(FIRST, 1, 1, {"input": "dead-zone", "output": "identity"})
    with pytest.raises(ModelError, match="f1") as raised:
        fit(s, [record(u, y)], FitOptions(bounds={"f1": (-3.0, -1.5)}))
    assert "\n" not in str(raised.value)


def test_inputs_beyond_the_estimation_data_are_said() -> None:
    u, y = truth("one-sided saturation", 600, 9)
    log = record(u, y)
    s = HammersteinWiener.from_orders(
        FIRST, 1, 1, {"input": "identity", "output": "saturation-upper"}
    )
    model = fit(s, [log], FitOptions())
    assert beyond_range(model, [log]) == ()
    (said,) = beyond_range(model, [replace(log, u=2.0 * log.u, sha256="")])
    assert said.startswith("a runs from -1.977 to 1.951 in the validation data")
    assert "estimation data" in said
    linear = fit(structure_class("oe").from_orders(FIRST, 1, 1), [log], FitOptions())
    assert beyond_range(linear, [replace(log, u=2.0 * log.u, sha256="")]) == ()


def unfelt_start(kind: str, seed: int) -> tuple[BlockStructure, Record, Array, Array]:
    """A plant whose initial state is hidden by its static for the first seconds.

    Returns:
        The structure, a record, the true θ, and a start not far from it.
    """
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1.2, 1.2, 150).repeat(4)
    e = 0.02 * rng.standard_normal(600)
    if kind == "wiener-hammerstein":
        u[:40] = 0.1 * rng.standard_normal(40)
        orders = {"nb1": 1, "nf1": 1, "nb": 1, "nf": 1, "nk": 1}
        options = {"static": "dead-zone"}
        theta = np.array([0.5, -0.5, -0.25, 0.35, 0.6, -0.8, 0.0])
        lag = lfilter([0.5], [1.0, -0.5], u)
        dead = np.maximum(lag - 0.35, 0.0) + np.minimum(lag + 0.25, 0.0)
        y = lfilter([0.0, 0.6], [1.0, -0.8], dead)
    else:
        u[:40] = 1.5
        orders, options = FIRST, {"input": "identity", "output": "saturation"}
        theta = np.array([0.4, -0.6, -0.7, 0.8, 0.0])
        y = np.clip(lfilter([0.0, 0.4], [1.0, -0.6], u, zi=[1.5])[0], -0.7, 0.8)
    s = structure_class(kind).from_orders(orders, 1, 1, options)
    assert isinstance(s, BlockStructure)
    start = theta * rng.uniform(0.9, 1.1, len(theta))
    return s, Record(u, y + e, 0.1), theta, start


@pytest.mark.parametrize("kind", ["wiener-hammerstein", "hammerstein-wiener"])
def test_a_state_that_nothing_shows_does_not_stop_a_descent(kind: str) -> None:
    """Its column of the Jacobian is next to nothing: scaled to one it takes every step away."""
    for seed in range(8):
        s, r, theta, start = unfelt_start(kind, seed)
        data = ChainData.of([r])
        best = Trial(s, theta).descended(data, Effort(100, 1e-9))
        hidden = data.problem(s.chain).with_states(start)
        hidden[s.chain.n] = 0.01 if kind == "wiener-hammerstein" else 1.4
        found = Trial(s, hidden).descended(data, Effort(100, 1e-9))
        assert found.cost < 1.02 * best.cost


def test_the_pair_that_is_split_is_the_best_damped_one() -> None:
    """Two real poles of two filters that are seen as one pair of damping .97 beside .39 and .46."""
    slow, damped, quick = 0.895 + 0.164j, 0.864 + 0.029j, 0.691 + 0.401j
    poles = np.array([z for p in (slow, damped, quick) for z in (p, p.conjugate())])
    dealt = ways_to_deal(poles, 3)
    assert len(dealt) == 4  # of two pairs and two equal poles
    for first, second in dealt:
        for block in (first, second):
            assert np.sum(np.isclose(block, abs(damped))) == 1


def test_a_spline_ends_where_fitted_samples_end() -> None:
    """What is held out reaches further, but nothing says how the curve goes there."""
    u = np.linspace(-1.0, 1.0, 400)
    u[350:] *= 3.0
    held_out = np.arange(400) >= 350
    data = ChainData.of([record(u, 2.0 * u, noise=0.0)], [held_out])
    orders = {"nb1": 1, "nf1": 0, "nb": 1, "nf": 0, "nk": 0}
    line = Trial(WienerHammerstein.from_orders(orders, 1, 1), np.array([1.0, 2.0, 0.0]))
    (spline,) = line.reshaped([[parse_static("spline:5")]], data).structure.statics[0]
    assert spline.stages[0].knots[-1] == pytest.approx(u[349])
