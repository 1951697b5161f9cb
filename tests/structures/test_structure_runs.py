"""Polynomial structures as runs: several experiments, steps, states, an independent library."""

import control
import numpy as np
import pytest
from polynomial_cases import SYSTEMS, System
from structure_cases import every_system, fitted

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel, Record
from sysid.errors import ModelError
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Initial
from sysid.structures.registry import structure_class

# ------------------ several experiments


def test_several_records_are_one_stacked_least_squares_problem() -> None:
    system = SYSTEMS["arx"]
    records = [system.record(n, 0.3, seed=n, skip=10) for n in (60, 41, 90)]
    rows, targets = [], []
    for r in records:
        y, u = r.y[:, 0], r.u[:, 0]
        rows += [[-y[k - 1], -y[k - 2], u[k - 1], u[k - 2]] for k in range(2, len(y))]
        targets += y[2:].tolist()
    by_hand = np.linalg.lstsq(np.array(rows), np.array(targets), rcond=None)[0]
    assert fit(system.model_structure, records).theta == pytest.approx(by_hand, abs=1e-10)


@pytest.mark.parametrize("name", ["oe", "oe MIMO", "armax", "bj MISO, mixed orders"])
def test_each_experiment_has_its_own_initial_state(name: str) -> None:
    """Two pieces cut from a run, the second with its own past: the truth comes back exactly."""
    system = SYSTEMS[name]
    records = [system.record(200, seed=1, skip=50), system.record(150, seed=2, skip=3)]
    options = FitOptions(initial=Initial.ESTIMATED)
    model = fit(system.model_structure, records, options)
    known = system.model_structure.deterministic_index()
    assert model.theta[known] == pytest.approx(system.truth[known], abs=1e-6)
    for record, x0 in zip(records, model.initial_states, strict=True):
        assert model.simulate(record.u, x0) == pytest.approx(record.y, abs=1e-5)


def test_the_order_of_the_experiments_does_not_matter() -> None:
    system = SYSTEMS["armax"]
    records = [system.record(n, 0.3, seed=n, skip=10) for n in (120, 80)]
    options = FitOptions(initial=Initial.ESTIMATED)
    one = fit(system.model_structure, records, options)
    other = fit(system.model_structure, records[::-1], options)
    errors = np.sqrt(np.diag(one.covariance))
    assert np.max(np.abs(one.theta - other.theta) / errors) < 1e-3


# ------------------ running a model


@every_system
def test_long_horizons_predict_what_the_free_run_simulates(name: str) -> None:
    system = SYSTEMS[name]
    record = system.record(600, 0.3, seed=4)
    model = fitted(system, system.record(500, 0.3, seed=9))
    long = model.predict(record, 300, 40)
    free = model.simulate(record.u)
    settled = slice(400, None)
    # the slowest mode has radius 0.9: 0.9^300 is below 1e-13
    assert long[settled] == pytest.approx(free[settled], abs=1e-9)
    short = model.predict(record, 1, 40)
    misses = [np.std((record.y - p)[settled]) for p in (short, long)]
    assert misses[0] <= misses[1] * 1.001


@every_system
def test_the_step_is_the_simulation(name: str) -> None:
    system = SYSTEMS[name]
    structure, rng = system.model_structure, np.random.default_rng(0)
    u = rng.standard_normal((80, system.nu))
    x = rng.standard_normal(structure.n_states(system.truth))
    whole = structure.simulate(system.truth, u, x)
    step = structure.step(system.truth)
    for k in range(len(u)):
        x, y = step(x, u[k])
        assert y == pytest.approx(whole[k], abs=1e-11)


@every_system
def test_the_plant_is_the_model_in_physical_units(name: str) -> None:
    system = SYSTEMS[name]
    record = system.record(200, 0.1)
    shifted = Record(record.u + 3.0, record.y - 7.0, record.dt)
    model = fit(system.model_structure, [shifted], detrend=Detrend.means([shifted]))
    plant, x = model.plant(), model.plant().initial_state()
    run = []
    for u in shifted.u:
        x, y = plant.step(x, u)
        run.append(y)
    assert np.array(run) == pytest.approx(model.simulate(shifted.u), abs=1e-10)


@every_system
def test_the_fitted_state_starts_the_run_where_the_record_does(name: str) -> None:
    system = SYSTEMS[name]
    record, structure = system.record(60, skip=25), system.model_structure
    x0 = structure.fitted_state(system.truth, record.u, record.y, 60)
    # states of inputs that reach the past of the record are free, so the match is exact
    assert structure.simulate(system.truth, record.u, x0) == pytest.approx(record.y, abs=1e-8)


@every_system
def test_records_too_short_to_predict_give_no_errors_and_no_exception(name: str) -> None:
    system = SYSTEMS[name]
    structure, record = system.model_structure, system.record(30, 0.1)
    for n in range(structure.first_sample() + 1):
        e = structure.errors(system.truth, record.u[:n], record.y[:n], 10)
        assert e.shape == (n, system.ny)
        assert not np.any(np.all(np.isfinite(e), axis=1))
    assert structure.simulate(system.truth, record.u[:0]).shape == (0, system.ny)


def test_a_horizon_below_one_is_refused() -> None:
    system = SYSTEMS["arx"]
    record = system.record(100, 0.1)
    with pytest.raises(ModelError, match="horizon"):
        fitted(system, record).predict(record, 0, 10)


@pytest.mark.parametrize(
    "other",
    [
        Record(np.zeros((50, 2)), np.zeros(50), 0.1),
        Record(np.zeros(50), np.zeros(50), 0.2),
        Record(np.zeros(50), np.zeros(50), 0.1, outputs=(Channel("speed"),)),
    ],
)
def test_a_record_of_other_channels_or_sample_time_is_refused(other: Record) -> None:
    model = fitted(SYSTEMS["arx"], SYSTEMS["arx"].record(100, 0.1))
    with pytest.raises(ModelError):
        model.errors(other, 5)


def as_control(system: System) -> control.TransferFunction:
    """The same transfer matrix, from the polynomials and python-control's own algebra."""
    p = system.model_structure.polynomials(system.truth)

    def tf(num: Array, den: Array) -> control.TransferFunction:
        width = max(len(num), len(den))
        pad = [np.concatenate([v, np.zeros(width - len(v))]) for v in (num, den)]
        return control.tf(pad[0], pad[1], 0.1)

    one = np.ones(1)
    rows = []
    for i in range(system.ny):
        row = []
        for j in range(system.nu):
            if system.model_structure.orders.coupled:
                a = [[tf(p.A[r][c], one) for c in range(2)] for r in range(2)]
                det = a[0][0] * a[1][1] - a[0][1] * a[1][0]
                adj = [[a[1][1], -a[0][1]], [-a[1][0], a[0][0]]]
                entry = (adj[i][0] * tf(p.B[0][j], one) + adj[i][1] * tf(p.B[1][j], one)) / det
            else:
                entry = tf(p.B[i][j], np.convolve(p.A[i][i], p.F[i][j]))
            row.append(entry)
        rows.append(row)
    return rows


# ------------------ an independent library


@every_system
def test_responses_are_those_of_python_control(name: str) -> None:
    system = SYSTEMS[name]
    g = system.model_structure.transfer(system.truth)
    w = np.linspace(0.1, 30.0, 25)
    z = np.exp(1j * w * 0.1)
    A, B, C, D = g.matrices
    mine = np.array([C @ np.linalg.solve(q * np.eye(len(A)) - A, B) + D for q in z])
    t = 0.1 * np.arange(60)
    gain = g.static_gain()
    for i, row in enumerate(as_control(system)):
        for j, entry in enumerate(row):
            assert mine[:, i, j] == pytest.approx(entry(z), rel=1e-8, abs=1e-10)
            u = np.zeros((60, system.nu))
            u[:, j] = 1.0
            step = control.step_response(entry, T=t).outputs
            assert g.simulate(u)[:, i] == pytest.approx(step, rel=1e-8, abs=1e-8)
            assert gain[i, j] == pytest.approx(float(np.real(control.dcgain(entry))), abs=1e-8)


@every_system
def test_poles_are_the_eigenvalues_of_the_state_matrix(name: str) -> None:
    system = SYSTEMS[name]
    g = system.model_structure.transfer(system.truth)
    states = np.linalg.eigvals(g.matrices[0])
    for pole in g.poles():
        # a coupled pair repeats its poles in both rows; a double eigenvalue moves by √1e-16
        assert np.min(np.abs(states - pole)) < 1e-6
    assert system.model_structure.stable(system.truth)
    assert np.all(np.abs(states) < 1.0)


@pytest.mark.parametrize("name", ["arx", "oe", "armax", "bj"])
def test_poles_zeros_and_gain_of_a_single_loop(name: str) -> None:
    properties = SYSTEMS[name].model_structure.properties(SYSTEMS[name].truth, 0.1)
    entry = as_control(SYSTEMS[name])[0][0]
    poles = sorted(complex(p["re"], p["im"]).imag for p in properties["poles"])
    expected = [z for z in entry.poles() if abs(z) > 1e-9]
    assert poles == pytest.approx(sorted(z.imag for z in expected), abs=1e-9)
    assert [z["re"] for z in properties["zeros"]] == pytest.approx([-0.5])
    assert properties["static_gain"] == [[pytest.approx(1.5 / 0.2)]]
    assert properties["stable"] is True
    # a pair 0.75 ± 0.371i at 10 Hz: s = ln z / dt
    s = np.log(complex(0.75, np.sqrt(0.7 - 0.75**2))) / 0.1
    assert properties["poles"][0]["frequency_rad_s"] == pytest.approx(abs(s))
    assert properties["poles"][0]["damping"] == pytest.approx(-s.real / abs(s))


@pytest.mark.parametrize(("pole", "stable"), [(0.999, True), (1.0, False), (1.01, False)])
def test_stability_is_said_of_the_free_run(pole: float, stable: bool) -> None:
    structure = structure_class("oe").from_orders({"nb": 1, "nf": 1}, 1, 1)
    assert structure.stable(np.array([1.0, -pole])) is stable
    arx = structure_class("arx").from_orders({"na": 1, "nb": 1}, 1, 1)
    assert arx.stable(np.array([-pole, 1.0])) is stable
