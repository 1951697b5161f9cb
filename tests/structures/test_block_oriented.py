"""Hammerstein-Wiener and Wiener-Hammerstein: statics, chains, fits from simulated truths."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel, Record
from sysid.errors import DataError, UsageError
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.blocks.errors import ChainErrors
from sysid.structures.blocks.gains import normalised
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.static.functions import parse_static
from sysid.structures.blocks.static.kinds import KINDS
from sysid.structures.blocks.static.starts import shaped
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein
from sysid.structures.model import Model
from sysid.structures.registry import structure_class, structure_from_json, structure_to_json

INS, OUTS = (Channel("a", "V"), Channel("b", "V")), (Channel("y"), Channel("z"))

STATICS = {
    "abs": [0.2],
    "dead-zone": [-0.3, 0.4],
    "dead-zone-lower": [-0.2],
    "dead-zone-upper": [0.3],
    "saturation": [-0.5, 0.6],
    "saturation-lower": [-0.5],
    "saturation-upper": [0.5],
    "polynomial:3": [0.9, -0.3, 0.2],
    "piecewise:4": [-1.0, -0.3, 0.4, 1.2, -0.8, -0.1, 0.2, 1.1],
    "spline:5": [-0.7, -0.2, 0.1, 0.5, 0.6],
    "abs,polynomial:2": [0.1, 0.8, 0.3],
    "dead-zone,saturation": [-0.2, 0.2, -0.6, 0.7],
}
"""Every kind, and compositions, with parameters of size one."""


def random_input(n: int, seed: int, level: float = 1.0) -> Array:
    """Steps of random height, held for ten samples: what a bench log looks like."""
    rng = np.random.default_rng(seed)
    return level * np.repeat(rng.uniform(-1.0, 1.0, n // 10 + 1), 10)[:n]


# ------------------------------------------------------------------------------- statics


def test_table_of_cases_covers_every_kind() -> None:
    shown = {stage.kind for text in STATICS for stage in parse_static(text).stages}
    assert shown == set(KINDS) - {"identity"}


@pytest.mark.parametrize("text", STATICS)
def test_static_derivatives_match_differences(text: str) -> None:
    static, p = parse_static(text), np.array(STATICS[text])
    x = np.random.default_rng(1).uniform(-2.0, 2.0, 60)
    value, slope, partials = static.evaluated(x, p)
    np.testing.assert_allclose(value, static.value(x, p), rtol=0, atol=1e-14)
    h = 1e-6  # kinks lie between samples; central differences are then good to h²
    np.testing.assert_allclose(
        slope, (static.value(x + h, p) - static.value(x - h, p)) / (2 * h), atol=1e-8
    )
    for k in range(len(p)):
        step = np.eye(len(p))[k] * h
        wanted = (static.value(x, p + step) - static.value(x, p - step)) / (2 * h)
        np.testing.assert_allclose(partials[k], wanted, atol=1e-8)


@pytest.mark.parametrize("text", STATICS)
def test_static_text_and_json_round_trip(text: str) -> None:
    static = parse_static(text)
    assert static.text == text
    assert type(static).from_json(static.to_json()) == static
    assert len(STATICS[text]) == static.n


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.sampled_from(["piecewise:4", "spline:5"]), st.floats(-50.0, 50.0), st.floats(0.01, 100.0))
def test_extrapolation_is_a_straight_line(text: str, at: float, apart: float) -> None:
    static, p = parse_static(text), np.array(STATICS[text])
    side = 3.0 + abs(at) if at >= 0 else -3.0 - abs(at)
    x = side + np.sign(side) * np.array([0.0, apart, 2.0 * apart])
    a, b, c = static.value(x, p)
    assert c - b == pytest.approx(b - a, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("deadzone", "no static 'deadzone'"),
        ("piecewise", "needs a size from 2 to 40"),
        ("piecewise:1", "needs a size"),
        ("spline:400", "needs a size"),
        ("polynomial:x", "needs a size"),
        ("abs:3", "abs has no size"),
        ("piecewise:4,piecewise:5", "two stages with the same parameters"),
        ("abs,,polynomial:2", "no static ''"),
    ],
)
def test_bad_statics_are_one_clear_sentence(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said) as raised:
        HammersteinWiener.from_orders({"nb": 1, "nf": 1}, 1, 1, {"input": text})
    assert "\n" not in str(raised.value)


# -------------------------------------------------------------------------------- chains


def hammerstein_wiener() -> tuple[BlockStructure, Array]:
    """Two inputs and outputs with every sort of layer, and admissible random parameters."""
    options = {
        "input": "dead-zone",
        "input[b]": "piecewise:4",
        "output": "abs,polynomial:2",
        "output[z]": "spline:5",
    }
    s = HammersteinWiener.from_orders({"nb": 2, "nf": 2, "nk": 1}, 2, 2, options)
    return admissible(s.resolved(INS, OUTS))


def wiener_hammerstein() -> tuple[BlockStructure, Array]:
    s = WienerHammerstein.from_orders(
        {"nb1": 2, "nf1": [2, 1], "nb": 3, "nf": 2, "nk": 0},
        2,
        2,
        {"static": "spline:5", "static[b]": "saturation"},
    )
    return admissible(s.resolved(INS, OUTS))


def admissible(s: BlockStructure) -> tuple[BlockStructure, Array]:
    theta = 0.3 * np.random.default_rng(3).normal(size=s.chain.n)
    rising = {"d_low": -0.3, "d_high": 0.2, "s_low": -0.3, "s_high": 0.2, "f1": -0.7, "f2": 0.1}
    for k, p in enumerate(s.parameters(INS, OUTS)):
        name = p.name.partition("[")[0].rpartition(".")[2]
        if name in rising:
            theta[k] = rising[name]
        if name.startswith("x"):
            theta[k] = -1.0 + 0.7 * int(name[1:])
    return s, theta


CHAINS = {"hammerstein-wiener": hammerstein_wiener, "wiener-hammerstein": wiener_hammerstein}


@pytest.mark.parametrize("name", CHAINS)
def test_gradient_of_a_chain_matches_differences(name: str) -> None:
    s, theta = CHAINS[name]()
    rng = np.random.default_rng(4)
    data = [(rng.normal(size=(n, 2)), rng.normal(size=(n, 2))) for n in (50, 30)]
    kept = [rng.uniform(size=n) < 0.7 for n in (50, 30)]
    problem = ChainErrors(s.chain, data, True, kept)
    p = np.concatenate([theta, rng.normal(size=problem.n_initial)])
    J = problem.jacobian(p)
    numeric = np.array(
        [
            (problem.residual(p + 1e-6 * e) - problem.residual(p - 1e-6 * e)) / 2e-6
            for e in np.eye(len(p))
        ]
    ).T
    np.testing.assert_allclose(J, numeric, atol=1e-6 * np.abs(J).max())
    gram, gradient = problem.normal_equations(p, problem.residual(p))
    np.testing.assert_allclose(gram, J.T @ J, atol=1e-10 * np.abs(gram).max())
    np.testing.assert_allclose(gradient, J.T @ problem.residual(p), atol=1e-9)


@pytest.mark.parametrize("name", CHAINS)
def test_steps_are_the_simulation(name: str) -> None:
    s, theta = CHAINS[name]()
    rng = np.random.default_rng(5)
    u, x = rng.normal(size=(80, 2)), rng.normal(size=s.n_states(theta))
    run, step, now, found = s.simulate(theta, u, x), s.step(theta), x, []
    for row in u:
        now, y = step(now, row)
        found.append(y)
    np.testing.assert_allclose(np.array(found), run, atol=1e-12)


@pytest.mark.parametrize("name", CHAINS)
def test_rest_is_rest_and_long_runs_stay_bounded(name: str) -> None:
    s, theta = CHAINS[name]()
    still = s.simulate(theta, np.zeros((50, 2)))
    np.testing.assert_allclose(still, np.broadcast_to(still[0], still.shape), atol=1e-12)
    assert s.stable(theta)
    wild = s.simulate(theta, 10.0 * np.random.default_rng(6).normal(size=(50_000, 2)))
    assert np.max(np.abs(wild)) < 1e4


@pytest.mark.parametrize("name", CHAINS)
def test_state_is_found_from_its_own_run(name: str) -> None:
    s, theta = CHAINS[name]()
    rng = np.random.default_rng(7)
    u = rng.normal(size=(200, 2))
    # near the steady state, where the statics are not flat and every state is seen
    x = s.chain.steady_state(theta, u[0]) + 0.05 * rng.normal(size=s.chain.n_states)
    run = s.simulate(theta, u, x)
    again = s.simulate(theta, u, s.fitted_state(theta, u, run, 60))
    assert np.max(np.abs(again - run)) < 0.02 * np.ptp(run)


@pytest.mark.parametrize("name", CHAINS)
def test_gains_move_without_changing_the_run(name: str) -> None:
    s, theta = CHAINS[name]()
    u = np.random.default_rng(8).normal(size=(300, 2))
    y = s.simulate(theta, u)
    chain, moved, pins = normalised(s.chain, theta, [(u, y)])
    np.testing.assert_allclose(chain.run(moved, u), y, atol=1e-9)
    assert pins
    # with the pins held nothing is left to move: J has full rank wherever data are
    J = ChainErrors(chain, [(u, y)], False).jacobian(moved)
    free = [k for k in range(chain.n) if k not in pins and np.any(J[:, k])]
    assert np.linalg.matrix_rank(J[:, free] / np.linalg.norm(J[:, free], axis=0), 1e-9) >= (
        len(free) - 2  # the outer points of the piecewise-linear static slide along their lines
    )


@pytest.mark.parametrize("name", CHAINS)
def test_structure_json_round_trip(name: str) -> None:
    s, _ = CHAINS[name]()
    assert structure_from_json(structure_to_json(s)) == s


def test_shape_of_a_dead_zone_is_found_on_a_curve() -> None:
    x = np.linspace(-2.0, 2.0, 500)
    target = 3.0 * parse_static("dead-zone").value(x, np.array([-0.4, 0.8]))
    shape = shaped(parse_static("dead-zone"), x, target)
    # limits come from a grid of 5 % of the range
    np.testing.assert_allclose(shape.p, [-0.4, 0.8], atol=0.21)
    assert shape.gain == pytest.approx(3.0, rel=0.2)


# ---------------------------------------------------------------------------------- fits


def simulated(kind: str, n: int = 1500, seed: int = 11, noise: float = 0.01) -> Record:
    """Known single-channel truths."""
    u = random_input(n, seed)
    rng = np.random.default_rng(seed + 1)
    if kind == "dead-zone":
        v = np.maximum(u - 0.3, 0.0) + np.minimum(u + 0.2, 0.0)
        y = lfilter([0.0, 0.5], [1.0, -0.8], v)
    elif kind == "saturation":
        y = np.clip(lfilter([0.0, 0.4], [1.0, -0.7], u), -0.4, 0.8)
    elif kind == "abs":
        y = np.abs(lfilter([0.0, 0.2, 0.05], [1.0, -1.2, 0.5], u) + 0.05)
    elif kind == "lag, dead-zone, motor":
        v = lfilter([0.5], [1.0, -0.5], u)
        y = lfilter([0.0, 0.4], [1.0, -0.8], np.maximum(v - 0.2, 0.0) + np.minimum(v + 0.3, 0.0))
    else:
        raise KeyError(kind)
    y = y + noise * np.std(y) * rng.normal(size=n)
    return Record(u, y, 0.01, (Channel("u", "V"),), (Channel("y", "V"),), name=kind)


def run_error(model: Model, record: Record) -> float:
    """Free-run error relative to the output's spread, the state fitted to the head."""
    run = model.simulate(record.u, model.fitted_state(record, 30))
    return float(np.std((record.y - run)[30:]) / np.std(record.y))


TRUTHS = [
    (
        "hammerstein-wiener",
        "dead-zone",
        {"nb": 1, "nf": 1, "nk": 1},
        {"input": "dead-zone", "output": "identity"},
    ),
    (
        "hammerstein-wiener",
        "saturation",
        {"nb": 1, "nf": 1, "nk": 1},
        {"form": "wiener", "output": "saturation"},
    ),
    (
        "hammerstein-wiener",
        "abs",
        {"nb": 2, "nf": 2, "nk": 1},
        {"input": "identity", "output": "abs"},
    ),
    (
        "wiener-hammerstein",
        "lag, dead-zone, motor",
        {"nb1": 1, "nf1": 1, "nb": 1, "nf": 1, "nk": 1},
        {"static": "dead-zone"},
    ),
]


@pytest.mark.parametrize(("name", "kind", "orders", "options"), TRUTHS)
def test_truth_is_recovered_kept_and_repeatable(
    name: str, kind: str, orders: dict[str, int], options: dict[str, str], tmp_path: Path
) -> None:
    record, fresh = simulated(kind), simulated(kind, seed=21)
    s = structure_class(name).from_orders(orders, 1, 1, options)
    model = fit(s, [record], FitOptions())
    # one per cent of noise; parameters are worth far more than that, so little is added to it
    assert run_error(model, fresh) < 0.012
    assert model.termination.good
    assert not model.null_directions
    model.save(tmp_path / "model.json")
    again = Model.load(tmp_path / "model.json")
    assert again.structure == model.structure
    assert again.to_json() == model.to_json()
    np.testing.assert_array_equal(again.simulate(fresh.u), model.simulate(fresh.u))
    np.testing.assert_array_equal(fit(s, [record], FitOptions()).theta, model.theta)


def test_parameters_of_a_dead_zone_lie_within_their_errors() -> None:
    s = HammersteinWiener.from_orders(
        {"nb": 1, "nf": 1, "nk": 1}, 1, 1, {"input": "dead-zone", "form": "hammerstein"}
    )
    model = fit(s, [simulated("dead-zone", 3000)], FitOptions())
    truth = {"input.d_low": -0.2, "input.d_high": 0.3, "b1": 0.5, "f1": -0.8}
    found = {p.name: p for p in model.parameter_table()}
    for name, value in truth.items():
        # five standard errors: a false alarm in 10⁵ fits
        assert abs(found[name].value - value) < 5.0 * found[name].std_error
        assert found[name].std_error < 0.01


def test_several_records_share_one_model() -> None:
    whole = simulated("dead-zone", 2400)
    parts = [whole.rows(0, 800), whole.rows(900, 1500), whole.rows(1700, 2400)]
    s = HammersteinWiener.from_orders(
        {"nb": 1, "nf": 1, "nk": 1}, 1, 1, {"input": "dead-zone", "output": "identity"}
    )
    model = fit(s, parts, FitOptions())
    assert len(model.initial_states) == 3
    assert run_error(model, simulated("dead-zone", seed=31)) < 0.012


def test_what_is_left_open_is_chosen() -> None:
    record, fresh = simulated("dead-zone", 1200), simulated("dead-zone", 1200, seed=41)
    model = fit(HammersteinWiener.from_orders({"nk": 1}, 1, 1), [record], FitOptions())
    s = model.structure
    assert isinstance(s, HammersteinWiener)
    assert not s.statics[0][0].is_identity
    assert len(model.starts) > 10
    assert run_error(model, fresh) < 0.02


@pytest.mark.slow
def test_wiener_hammerstein_chooses_orders_and_static() -> None:
    record = simulated("lag, dead-zone, motor", 1500)
    fresh = simulated("lag, dead-zone, motor", seed=41)
    model = fit(WienerHammerstein.from_orders({"nk": 1}, 1, 1), [record], FitOptions())
    assert run_error(model, fresh) < 0.03


def test_signs_of_a_sensor_without_sign_are_recovered() -> None:
    record = simulated("abs", 1000)
    s = HammersteinWiener.from_orders(
        {"nb": 2, "nf": 2, "nk": 1}, 1, 1, {"input": "identity", "output": "abs"}
    )
    model = fit(s, [record], FitOptions(), detrend=Detrend.means([record]))
    assert run_error(model, simulated("abs", seed=51)) < 0.012


def test_each_channel_has_its_own_static() -> None:
    rng = np.random.default_rng(61)
    u = np.column_stack([random_input(2000, 62), random_input(2000, 63)])
    a = np.maximum(u[:, 0] - 0.3, 0.0) + np.minimum(u[:, 0] + 0.3, 0.0)
    b = np.clip(u[:, 1], -0.5, 0.4)
    y = lfilter([0.0, 0.5], [1.0, -0.7], a) + lfilter([0.0, 0.2], [1.0, -0.9], b)
    z = lfilter([0.0, 0.3], [1.0, -0.8], b) - 0.1 * lfilter([0.0, 0.5], [1.0, -0.7], a)
    clean = np.column_stack([y, z])
    record = Record(u, clean + 0.01 * clean.std(axis=0) * rng.normal(size=u.shape), 0.01, INS, OUTS)
    options = {"input[a]": "dead-zone", "input[b]": "saturation", "output": "identity"}
    s = HammersteinWiener.from_orders({"nb": 1, "nf": 1, "nk": 1}, 2, 2, options)
    model = fit(s, [record], FitOptions())
    found = {p.name: p.value for p in model.parameter_table()}
    assert found["input.d_high[a]"] == pytest.approx(0.3, abs=0.02)
    assert found["input.s_low[b]"] == pytest.approx(-0.5, abs=0.02)
    np.testing.assert_allclose(model.simulate(u), clean, atol=0.03 * clean.std())


def test_fixed_parameters_stay_and_bounds_are_reported() -> None:
    record = simulated("dead-zone")
    s = HammersteinWiener.from_orders(
        {"nb": 1, "nf": 1, "nk": 1}, 1, 1, {"input": "dead-zone", "output": "identity"}
    )
    options = FitOptions(fixed={"input.d_high": 0.25}, bounds={"f1": (-0.75, 0.0)})
    model = fit(s, [record], options)
    table = {p.name: p for p in model.parameter_table()}
    assert table["input.d_high"].value == 0.25
    assert table["input.d_high"].fixed
    assert "f1" in model.at_bound


def test_a_limit_that_is_never_reached_is_named() -> None:
    record = simulated("dead-zone")
    s = HammersteinWiener.from_orders(
        {"nb": 1, "nf": 1, "nk": 1}, 1, 1, {"input": "dead-zone,saturation", "output": "identity"}
    )
    model = fit(s, [record], FitOptions())
    # nothing in this record saturates: the limits of the saturation are beyond the data
    named = {name for direction in model.null_directions for name in direction}
    assert named <= {"input.s_low", "input.s_high"}
    errors = {p.name: p.std_error for p in model.parameter_table()}
    assert all(np.isinf(errors[name]) for name in named)


@pytest.mark.parametrize(
    ("name", "orders", "options", "said"),
    [
        ("hammerstein-wiener", {"nb": 1}, {}, "needs nf"),
        ("hammerstein-wiener", {"na": 1, "nb": 1, "nf": 1}, {}, "no order 'na'"),
        ("hammerstein-wiener", {"nb": 1, "nf": 1}, {"units": "3"}, "no option 'units'"),
        ("hammerstein-wiener", {"nb": 1, "nf": 1}, {"form": "linear"}, "choose one of both"),
        ("wiener-hammerstein", {"nb1": 1, "nf1": 1, "nb": 1}, {}, "needs nf"),
        ("wiener-hammerstein", {"nb1": 0, "nf1": 1, "nb": 1, "nf": 1}, {}, "nb1 of at least 1"),
        (
            "wiener-hammerstein",
            {"nb1": -1, "nf1": 1, "nb": 1, "nf": 1},
            {},
            "nb1: orders are whole",
        ),
        ("wiener-hammerstein", {"nx": 1}, {}, "no order 'nx'"),
    ],
)
def test_bad_orders_and_options_are_one_clear_sentence(
    name: str, orders: dict[str, int], options: dict[str, str], said: str
) -> None:
    with pytest.raises(UsageError, match=said) as raised:
        structure_class(name).from_orders(orders, 1, 1, options)
    assert "\n" not in str(raised.value)


def test_unknown_channel_of_an_option_is_said() -> None:
    s = HammersteinWiener.from_orders(
        {"nb": 1, "nf": 1}, 1, 1, {"input[motor]": "dead-zone", "output": "identity"}
    )
    with pytest.raises(UsageError, match="no input 'motor'; there are u"):
        fit(s, [simulated("dead-zone", 200)], FitOptions())


def test_too_few_samples_are_said() -> None:
    s = HammersteinWiener.from_orders(
        {"nb": 1, "nf": 1}, 1, 1, {"input": "piecewise:8", "output": "piecewise:8"}
    )
    with pytest.raises(DataError, match="record"):
        fit(s, [simulated("dead-zone", 20)], FitOptions())
