"""NARX networks: units, free runs, expressions, fits from simulated truths, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.errors import DataError, Termination, UsageError
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.methods.narx import all_data
from sysid.structures.difference_equations.chunks import ChunkedRuns
from sysid.structures.difference_equations.expressions import parse, written
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.model import Model
from sysid.structures.narx.compiled import compiled_runs
from sysid.structures.narx.run import NarxRun
from sysid.structures.narx.search import largest
from sysid.structures.narx.simulation_error import RowRuns
from sysid.structures.narx.structure import NarxWavelet
from sysid.structures.narx.wavelet_network import KINDS, RowDesign
from sysid.structures.registry import structure_class, structure_from_json, structure_to_json

ORDERS = {"na": 1, "nb": 1, "nk": 1}
SMALL = {"degree": "1", "units": "4", "network": "each"}
"""A small network: what is compiled for it takes a second."""


def steps(n: int, seed: int, nu: int = 1) -> Array:
    """Random levels held for five samples."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, (n // 5 + 1, nu)), 5, axis=0)[:n]


def design(d: int, views: bool, units: int = 3) -> RowDesign:
    """A row with products and units, all of its numbers of size one."""
    rng = np.random.default_rng(d)
    return RowDesign(
        (0.1,) * d,
        (0.8,) * d,
        (-4.0,) * d,
        (4.0,) * d,
        ((0, 1), (0, 0, 1)),
        tuple(tuple(row) for row in rng.uniform(-0.5, 0.5, (d, d)).tolist()),
        (0, 1, 1)[:units],
        tuple((k % d,) for k in range(units)) if views else (),
    )


def truth(ny: int = 1, estimator: str = "wavelet", views: bool = True) -> tuple[NarxWavelet, Array]:
    """A stable network of ny coupled outputs and as many inputs, with ranges, and its θ."""
    orders = {"na": np.ones((ny, ny), dtype=int).tolist(), "nb": 1, "nk": 1}
    plain = NarxWavelet.from_orders(orders, ny, ny, {"estimator": estimator})
    d = 2 * ny
    designs = (design(d, views),) * ny
    rng = np.random.default_rng(7)
    theta = []
    for _ in range(ny):
        T, K, q = designs[0].sizes[1:]
        linear = [0.6, *[0.1] * (ny - 1), *[0.5] * ny]
        shape, place = rng.uniform(1.0, 2.0, K), rng.uniform(-0.3, 0.3, K * q)
        theta += [0.05, *linear, *[-0.03] * T, *[0.3, -0.2, 0.15][:K], *shape, *place]
    found = replace(plain, designs=designs, output_range=((-3.0, 3.0),) * ny)
    return replace(found, input_range=((-1.0, 1.0),) * ny), np.array(theta)


def curves() -> tuple[NarxWavelet, Array]:
    """A truth that is a sum of curves: two of the past output, one of the input."""
    s, _ = truth()
    scale = tuple(tuple(row) for row in (0.4 * np.eye(2)).tolist())
    d = replace(s.designs[0], terms=(), projection=scale, views=((1,), (0,), (1,)))
    theta = np.array([0.05, 0.6, 0.5, 0.5, -0.3, 0.2, 3.0, 1.5, 2.0, 0.1, 0.3, -0.2])
    return replace(s, designs=(d,)), theta


def simulated(n: int = 900, seed: int = 0, noise: float = 0.0) -> Record:
    """A log of the first-order truth."""
    s, theta = curves()
    u = steps(n, seed)
    y = s.simulate(theta, u)
    return Record(u, y + noise * np.random.default_rng(seed + 100).standard_normal(y.shape), 0.1)


def made(options: dict[str, str], orders: object = None, nu: int = 1, ny: int = 1) -> NarxWavelet:
    """A structure from text."""
    return NarxWavelet.from_orders(orders or ORDERS, nu, ny, options)  # type: ignore[arg-type]


def missed(model: Model, r: Record) -> float:
    """Free-run error from rest relative to the spread of the output."""
    run = model.structure.simulate(model.theta, r.u)
    return float(np.sqrt(np.mean((run - r.y) ** 2)) / np.std(r.y))


# ------------------------------------------------------------------------------- the map


@pytest.mark.parametrize("views", [False, True])
@pytest.mark.parametrize("name", KINDS)
def test_derivatives_of_the_map_match_differences(name: str, views: bool) -> None:
    d = design(3, views)
    rng = np.random.default_rng(2)
    theta, x = rng.uniform(0.2, 1.0, d.n), rng.uniform(-2.0, 2.0, (40, 3))
    signals = tuple(Signal("u", j, 1) for j in range(3))
    run = NarxRun((signals,), (d,), name, 3, ((-np.inf, np.inf),))

    def at(t: Array) -> Array:
        of_inputs, of_outputs = run.parts(np, t, run.along)
        return np.asarray(of_outputs([], of_inputs(x.T))[0])

    to_theta = np.asarray(compiled_runs(run.maps).partial(theta, run.frames, x))[:, 0]
    h = 1e-6  # central differences are good to h²; boxes are flat between their edges
    for k in range(d.n):
        step = h * np.eye(d.n)[k]
        wanted = (at(theta + step) - at(theta - step)) / (2 * h)
        np.testing.assert_allclose(to_theta[:, k], wanted, atol=1e-7)


@pytest.mark.parametrize("ny", [1, 2])
def test_all_ways_of_running_agree(ny: int) -> None:
    s, theta = truth(ny)
    u = steps(60, 3, ny)
    x0 = 0.1 * np.arange(1.0, s.n_states(theta) + 1)
    run = s.simulate(theta, u, x0)
    step, x = s.step(theta), x0
    for k, now in enumerate(u):
        x, y = step(x, now)
        np.testing.assert_allclose(y, run[k], atol=1e-12)
    free = s.free_run()
    past_y, past_u = free.past(x0)
    many = free.driven(theta, np.concatenate([past_u, u])[:, :, None], past_y[:, :, None])
    np.testing.assert_allclose(many[:, :, 0], run, atol=1e-12)
    compiled = s.free_run(compiled_from=1).simulate(theta, u, x0)
    np.testing.assert_allclose(compiled, run, atol=1e-12)


def test_compiled_free_runs_and_their_jacobian() -> None:
    s, theta = truth(2)
    r = Record(steps(41, 4, 2), np.random.default_rng(1).uniform(-1, 1, (41, 2)), 0.1)
    problem = ChunkedRuns(s.free_run(), [(r.u, r.y)], 20)
    runs = [
        s.simulate(theta, r.u[a:b], s.free_run().state(r.y[:a], r.u[:a]))
        for a, b in ((1, 21), (21, 41))
    ]
    wanted = np.concatenate([((r.y[1:21] - runs[0]) / r.y.std(axis=0)).T.ravel(),
                             ((r.y[21:] - runs[1]) / r.y.std(axis=0)).T.ravel()])  # fmt: skip
    np.testing.assert_allclose(problem.residual(theta), wanted, atol=1e-10)
    J, h = problem.jacobian(theta), 1e-6
    for k in range(0, len(theta), 3):
        step = h * np.eye(len(theta))[k]
        slope = (problem.residual(theta + step) - problem.residual(theta - step)) / (2 * h)
        np.testing.assert_allclose(J[:, k], slope, atol=1e-6)


def test_long_horizon_prediction_tends_to_simulation() -> None:
    s, theta = truth()
    r = simulated(120, noise=0.05)
    np.testing.assert_allclose(
        s.predict(theta, r.u, r.y, 1, 0)[1:], (r.y - s.errors(theta, r.u, r.y, 0))[1:]
    )
    far = s.predict(theta, r.u, r.y, 60, 0)
    run = s.simulate(theta, r.u)
    # 0.6^60 of the initial difference is left
    np.testing.assert_allclose(far[61:], run[61:], atol=1e-6)


def test_a_long_free_run_stays_inside_its_limits() -> None:
    s, theta = truth()
    wild = theta.copy()
    wild[1] = 1.4  # unstable without the limits
    u = np.tile(steps(500, 5), (6, 1))
    low, high = s.limits[0]
    run = s.simulate(wild, u)
    assert np.all((run >= low) & (run <= high))
    assert s.at_limits(run)[0] > 0.1
    assert not s.stable(wild)
    assert s.stable(theta)
    far = s.simulate(theta, 1e6 * u)
    assert np.all((far >= low) & (far <= high))


# ------------------------------------------------------------------------------- regressors


@pytest.mark.parametrize(
    "text",
    ["|u(t-1)|", "y(t-1)*sign(u(t-2))", "-(u(t)-0.5)^2/3.0", "max(y(t-1), pos(u(t-1)))",
     "tanh(2.0*y(t-3)) + exp(u(t-1))"],
)  # fmt: skip
def test_expressions_round_trip(text: str) -> None:
    e = parse(text, 1, 1)
    assert parse(written(e), 1, 1) == e


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("u(t-1", "')' is missing"),
        ("__import__('os')", "no meaning"),
        ("y(t)", "lag it"),
        ("u(t-1)/y(t-1)", "only a number"),
        ("u(t-1)^9", "exponent"),
        ("eval(u)", "no signal"),
        ("u3(t-1)", "the log has 1 inputs"),
        ("3.5", "holds no signal"),
        ("(" * 60 + "u" + ")" * 60, "nested deeper"),
        ("u + " * 100 + "u", "longer than"),
        ("|u|; |u|", "divide the outputs"),
    ],
)
def test_bad_expressions_are_refused_in_words(text: str, says: str) -> None:
    with pytest.raises(UsageError, match="regressors") as caught:
        made({"regressors": text})
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("orders", "options", "says"),
    [
        ({"na": 0, "nb": 0}, {}, "has no input"),
        ({"na": 150, "nb": 1}, {}, "at most"),
        ({"na": -1, "nb": 1}, {}, "na"),
        (ORDERS, {"units": "many"}, "whole number"),
        (ORDERS, {"estimator": "magic"}, "choose one of"),
        (ORDERS, {"estimator": "polynomial"}, "choose one of"),
        (ORDERS, {"degree": "7"}, "whole number"),
        (ORDERS, {"margin": "-1"}, "share"),
        (ORDERS, {"network": "some"}, "choose one of"),
        (ORDERS, {"colour": "red"}, "colour"),
    ],
)
def test_bad_orders_and_options_are_refused(
    orders: dict[str, int], options: dict[str, str], says: str
) -> None:
    with pytest.raises(UsageError) as caught:
        made(options, orders)
    assert says in str(caught.value)


def test_regressors_of_several_outputs() -> None:
    orders = {"na": [[1, 0], [2, 1]], "nb": [[1, 0], [0, 2]], "nk": 1}
    s = made({"regressors": "|u1(t-1)|; y2*u2"}, orders, 2, 2)
    first, second = ([written(e) for e in row] for row in s.rows)
    assert first == ["y1(t-1)", "u1(t-1)", "|u1(t-1)|"]
    # its own past first
    assert second == ["y2(t-1)", "y1(t-1)", "y1(t-2)", "u2(t-1)", "u2(t-2)", "y2(t-1)*u2(t-1)"]


# ------------------------------------------------------------------------------- fits


@pytest.fixture(scope="module")
def refined() -> Model:
    """Fitted to the truth with a little noise, over free runs."""
    options = {**SMALL, "refine": "50", "starts": "1"}
    focus = FitOptions(focus=Focus.SIMULATION)
    return fit(made(options), [simulated(noise=0.01)], focus)


def test_recovers_its_own_truth(refined: Model) -> None:
    # 1 % of noise on the data; a second log without noise
    assert missed(refined, simulated(seed=9)) < 0.03
    assert any("refined" in s.start for s in refined.starts)
    assert refined.termination is not Termination.CLOSED_FORM


def test_save_and_load_bit_for_bit(refined: Model, tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    refined.save(path)
    loaded = Model.load(path)
    u = steps(200, 6)
    np.testing.assert_array_equal(
        loaded.structure.simulate(loaded.theta, u), refined.structure.simulate(refined.theta, u)
    )
    assert structure_from_json(structure_to_json(refined.structure)) == refined.structure
    assert structure_class("narx-wavelet") is NarxWavelet


@pytest.mark.parametrize("estimator", KINDS)
def test_every_estimator_beats_the_line(estimator: str) -> None:
    r, free = simulated(400), {"estimator": estimator, "refine": "none"}
    line = fit(made({"degree": "1", "units": "0", "refine": "none"}), [r])
    found = fit(made({**free, **SMALL, "units": "8"}), [r])
    assert missed(found, r) < 0.8 * missed(line, r)
    assert found.termination is Termination.CLOSED_FORM


def test_products_alone_beat_the_line_and_are_read_as_an_earlier_estimator() -> None:
    r = simulated(400)
    line, products = (
        fit(made({"degree": degree, "units": "0", "refine": "none"}), [r]) for degree in "13"
    )
    assert missed(products, r) < 0.8 * missed(line, r)
    raw = structure_to_json(products.structure)
    raw["settings"]["options"]["estimator"] = "polynomial"  # as 0.1.0 called it
    assert structure_from_json(raw) == products.structure


def test_channel_scaling_changes_nothing() -> None:
    r, options = simulated(400, noise=0.01), {**SMALL, "refine": "none"}
    scaled = Record(1e3 * r.u, 1e-2 * r.y, r.dt)
    a, b = fit(made(options), [r]), fit(made(options), [scaled])
    run = a.structure.simulate(a.theta, r.u)
    np.testing.assert_allclose(
        b.structure.simulate(b.theta, scaled.u), 1e-2 * run, atol=1e-7 * float(np.std(run))
    )


def test_everything_is_fitted_at_last() -> None:
    r = simulated(700)
    s = made(SMALL).with_ranges([r])
    row = RowRuns(s, 0, all_data([r]), largest(s))
    weight = row._chunks(50).weight
    assert np.count_nonzero(weight) == len(r) - 1
    # of unit norm for errors of the size of the output's spread
    assert np.sum(weight**2) * float(np.var(r.y)) == pytest.approx(1.0)


def test_offsets_are_kept_with_the_model() -> None:
    r = simulated(400)
    away = Record(r.u + 3.0, r.y - 2.0, r.dt)
    shift = Detrend.means([away])
    model = fit(made({**SMALL, "refine": "none"}), [away], detrend=shift)
    plain = shift.remove(away)
    run = model.structure.simulate(model.theta, plain.u[50:])
    assert np.sqrt(np.mean((run[50:] - plain.y[100:]) ** 2)) < 0.1 * np.std(r.y)


def test_twin_inputs_leave_a_direction_without_information() -> None:
    r = simulated(400, noise=0.01)
    twins = Record(np.hstack([r.u, r.u]), r.y, r.dt)
    options = {"degree": "1", "units": "0", "refine": "none"}
    model = fit(made(options, ORDERS, 2, 1), [twins])
    names = [p.name for p in model.structure.parameters(twins.inputs, twins.outputs)]
    spread = np.diag(model.covariance)
    blind = {n for n, v in zip(names, spread, strict=True) if not np.isfinite(v)}
    assert len(blind) == 2
    assert all("u" in n for n in blind)


@pytest.mark.parametrize(
    ("options", "says"), [(FitOptions(fixed={"y0": 0.0}), "can be fixed or bounded")]
)
def test_what_it_cannot_do_it_says(options: FitOptions, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        fit(made(SMALL), [simulated(200)], options)


def test_simulation_focus_needs_refinement() -> None:
    with pytest.raises(UsageError, match="'refine': 'none'"):
        fit(made({"refine": "none"}), [simulated(200)], FitOptions(focus=Focus.SIMULATION))


def test_too_few_samples_are_one_sentence() -> None:
    with pytest.raises(DataError) as caught:
        fit(made({}), [simulated(20)])
    assert "\n" not in str(caught.value)
    assert "record more" in str(caught.value)


def test_names_and_equation(refined: Model) -> None:
    r = simulated(50)
    inputs, outputs = r.inputs, r.outputs
    names = [p.name for p in refined.structure.parameters(inputs, outputs)]
    assert len(set(names)) == len(names) == len(refined.theta)
    text = refined.structure.equations(refined.theta, inputs, outputs)[0]
    assert "wavelets each of 1 of (" in text
    found = refined.structure.properties(refined.theta, 0.1)
    assert found["stable"]
    assert found["outputs"][0]["units"] == 4
