"""Grey boxes from files of equations: what is read, refused, run, fitted and stored."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, lfilter, lsim

from sysid.data.record import Array, Channel, Record
from sysid.errors import DataError, SysidError, UsageError
from sysid.estimation.assessment.advice import _information
from sysid.estimation.assessment.delta_method import estimates
from sysid.estimation.pem import fit
from sysid.structures.grey_box.file.definition import definition_of
from sysid.structures.grey_box.file.expressions import evaluate, parse
from sysid.structures.grey_box.file.physics import FilePhysics
from sysid.structures.grey_box.file.structure import FromFile
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.model import Model
from sysid.structures.registry import structure_class, structure_from_json, structure_to_json

EXAMPLES = Path(__file__).parents[2] / "datasets" / "equations"

SPRING = """
inputs: {force: N}
states: {q: {unit: m}, v: {unit: m/s}}
parameters:
  k: {unit: N/m, start: 8, bounds: [0.1, 100]}
  d: {unit: N*s/m, start: 1, bounds: [0, 50]}
  m: {unit: kg, start: 0.5, fixed: true}
equations: {q: v, v: (force - k*q - d*v)/m}
outputs: {position: {unit: m, equation: q}}
"""

MOTOR = """
inputs: {u: V}
states: {speed: {unit: rad/s}}
parameters:
  k: {unit: N*m/V, start: 0.05, bounds: [0.001, 10]}
  J: {unit: kg*m^2, start: 0.01, bounds: [0.00001, 1]}
  b: {unit: N*m*s/rad, start: 0.02, bounds: [0.0001, 1]}
equations: {speed: (k*u - b*speed)/J}
outputs: {omega: {unit: rad/s, equation: speed}}
"""

DECAY = """
time: discrete
inputs: {u: }
states: {x: {}}
parameters: {a: {start: 0.5}, b: {start: 1, per_experiment: true}}
equations: {x: a*x + b*u}
outputs: {y: {equation: x}}
"""


def boxed(text: str, dt: float = 0.1, substeps: int = 0) -> FromFile:
    """The structure of a text, with a sample time, as a fit leaves it."""
    d = definition_of(text)
    physics = FilePhysics(len(d.inputs), len(d.outputs), text)
    return FromFile(physics, Sampling(dt, substeps or 1))


def commands(n: int, seed: int, held: int = 10) -> Array:
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, (n // held, 1)), held, axis=0)


# ------------------------------------------------------------------------------ expressions


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 - 2 - 3", -4.0),
        ("-2^2", -4.0),
        ("2^-1", 0.5),
        ("2*x^2/4", 4.5),
        ("x**(1/2)", 3.0**0.5),
        ("if(x > 2 and not x >= 4, 10, 20)", 10.0),
        ("clip(x, 0, 2) + min(x, 1) - max(x, 5)", -2.0),
        ("abs(-x) + sign(-x) + sqrt(0)", 2.0),
        ("exp(log(x)) + tanh(0) + sin(0) + cos(0)", 4.0),
    ],
)
def test_an_expression_has_the_value_of_arithmetic(text: str, value: float) -> None:
    assert evaluate(parse(text), {"x": 3.0}, np) == pytest.approx(value, abs=1e-14)


# what is changed in SPRING, what it becomes, and what is said, where
WRONG = [
    ("q: v, v", "q: v +, v", "equations.ode.yaml:8:19: it ends too early"),
    ("k*q", "k*qq", "8:33: 'qq' is not defined; there are d, force, k, m, q, v"),
    ("d*v)", "d*v", "')' is missing at the end"),
    ("k*q", "$q", "the character '$' has no meaning here"),
    ("k*q", "system(q)", "'system' is no function; there are sqrt"),
    ("k*q", "k*q^2", "8:29: the units do not agree: m^2·kg/s^2 is subtracted from m·kg/s^2"),
    ("q: v, v", "q: 2*v*v, v", "the rate of q must be in m/s, this is in m^2/s^2"),
    ("k*q", "k*sin(q)", "sin needs a number without unit"),
    ("equation: q", "equation: q + force", "force cannot stand here: an output reads states"),
    ("start: 8,", "start: 800,", "5: start 800 is outside the bounds 0.1 … 100"),
    ("start: 8,", "strat: 8,", "unknown key 'strat' in parameters.k: did you mean 'start'?"),
    ("unit: N*s/m", "unit: N*sx/m", "'sx' in the unit 'N*sx/m' is no unit that is known"),
    (", v: (force - k*q - d*v)/m", "", "'v' has no equation: add it to equations"),
    ("k: {unit", "v: {unit", "'v' is among states, too: rename one"),
    ("equation: q", "equation: min(q, 1)", "write the equation in quotes"),
    ("equation: q", 'equation: "q > 0"', "a comparison is no number"),
    ("k*q", "if(q, 1, 2)", "write the equation in quotes"),
    ("inputs: {force: N}", "inputs: {}", "inputs is empty: name at least one"),
]


@pytest.mark.parametrize(("old", "new", "sentence"), WRONG)
def test_a_wrong_file_is_refused_with_its_place(
    old: str, new: str, sentence: str, tmp_path: Path
) -> None:
    assert SPRING.count(old) == 1
    path = tmp_path / "equations.ode.yaml"
    path.write_text(SPRING.replace(old, new))
    with pytest.raises(DataError) as caught:
        structure_class(str(path))
    assert sentence in str(caught.value)
    assert str(caught.value).startswith("equations.ode.yaml:")


@pytest.mark.parametrize(
    ("old", "sentence"),
    [("+".join("q" * 400), "more than 300 parts"), ("(" * 60 + "q" + ")" * 60, "nested too deep"),
     ("q^1e300", "the exponent is beyond 20"), ("q^(1/0)", "the exponent divides by 0")],
)  # fmt: skip
def test_what_asks_for_too_much_is_refused(old: str, sentence: str) -> None:
    with pytest.raises(DataError, match=sentence):
        definition_of(SPRING.replace("k*q", old))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    st.integers(0, len(SPRING) - 1),
    st.sampled_from("{}()[],:#^*/-+ '\"0q@\u00e4\n|>&"),
    st.booleans(),
)
def test_a_damaged_file_gives_a_sentence(at: int, sign: str, instead: bool) -> None:
    text = SPRING[:at] + sign + SPRING[at + instead :]
    said = ""
    try:
        definition = definition_of(text)
    except DataError as error:
        said = str(error)
    if said:
        assert said.startswith("equations:")
    else:  # another space, a name with one letter more: what is left can be run
        physics = FilePhysics(1, 1, text)
        x = np.ones((len(definition.states), 1))
        p = physics.unpack(np, physics.pack({}))
        with np.errstate(all="ignore"):
            assert np.shape(physics.rates(np, x, np.ones((1, 1)), p)) == x.shape


def test_units_of_a_file_go_with_those_of_the_log() -> None:
    s = boxed(SPRING)
    named = [Channel("f", "N")], [Channel("q", "m")]
    assert [p.unit for p in s.parameters(*named)] == ["N/m", "N*s/m", "kg"]
    with pytest.raises(UsageError, match="input force of the file is in N, f of the log in V"):
        s.parameters([Channel("f", "V")], named[1])


# ------------------------------------------------------------------------------ runs


def test_linear_equations_are_stepped_exactly() -> None:
    s = boxed(SPRING)
    assert s.physics.definition.linear
    k, d, m = theta = np.array([8.0, 1.0, 0.5])
    u, dt = commands(100, 1), s.sampling.dt
    A, B = [[0.0, 1.0], [-k / m, -d / m]], [[0.0], [1 / m]]
    exact = StateSpace(A, B, [[1.0, 0.0]], [[0.0]]).to_discrete(dt)
    y = lsim(StateSpace(A, B, [[1.0, 0.0]], [[0.0]]), u, dt * np.arange(100), interp=False)[1]
    assert exact.dt == dt
    assert s.simulate(theta, u)[:, 0] == pytest.approx(y, abs=1e-12)


@pytest.mark.parametrize("name", ["pendulum", "two_tanks"])
def test_every_way_to_run_an_example_gives_the_same(name: str) -> None:
    made = structure_class(f"{EXAMPLES / name}.ode.yaml").from_orders({}, 1, 1)
    assert isinstance(made, FromFile)
    s = replace(made, sampling=Sampling(0.05 if name == "pendulum" else 4.0, 4))
    theta, u = s.physics.pack({}), 2.0 + 2.0 * commands(60, 2)
    x0 = s.physics.state_guess(theta, u, np.array([[1.0]]), s.sampling.dt)
    whole = s.simulate(theta, u, x0)
    step, x = s.step(theta), x0
    for row, expected in zip(u, whole, strict=True):
        x, y = step(x, row)
        assert y == pytest.approx(expected, abs=1e-12)  # the same operations in another order
    columns = s.gradients(theta, u, whole)[0]
    for k in np.flatnonzero([c.free for c in s.physics.constants]):
        size = 1e-6 * max(abs(theta[k]), 1.0)
        ends = [s.simulate(theta + side * size * np.eye(len(theta))[k], u, x0) for side in (1, -1)]
        differences = (ends[0] - ends[1])[:, 0] / (2 * size)
        # central differences: 1e-6² of the third derivative, and rounding over the step
        assert columns[:, k] == pytest.approx(differences, rel=1e-3, abs=1e-3)


def test_an_overflow_ends_every_step() -> None:
    s = structure_class(f"{EXAMPLES / 'two_tanks'}.ode.yaml").from_orders({}, 1, 1)
    assert isinstance(s, FromFile)
    s = replace(s, sampling=Sampling(4.0, 8))
    theta = s.physics.pack({"top": 3.0})
    run = s.simulate(theta, np.full((200, 1), 5.0))
    assert run.max() == 3.0


# ------------------------------------------------------------------------------ fits


def fitted() -> tuple[Array, Model]:
    s, theta = boxed(SPRING), np.array([12.0, 0.7, 0.5])
    u = commands(300, 3)
    y = s.simulate(theta, u) + 1e-3 * np.random.default_rng(4).standard_normal((300, 1))
    log = Record(u, y, 0.1, inputs=(Channel("force", "N"),), outputs=(Channel("position", "m"),))
    return theta, fit(boxed(SPRING, 0.0), (log,))


def test_a_fit_recovers_the_truth_and_its_model_holds_the_equations(tmp_path: Path) -> None:
    theta, model = fitted()
    errors = np.sqrt(np.diag(model.covariance))[:2]
    assert np.all(np.abs(model.theta - theta)[:2] < 4.0 * errors)
    assert model.theta[2] == 0.5
    path = tmp_path / "model.json"
    model.save(path)
    again = Model.load(path)
    u = commands(50, 5)
    assert np.array_equal(again.simulate(u), model.simulate(u))
    assert again.structure.physics.text == SPRING  # type: ignore[attr-defined]
    assert "dv/dt = (force - k*q - d*v)/m" in again.equations()


def test_parameters_that_only_show_together_are_said_with_what_would_help() -> None:
    text = SPRING.replace("fixed: true", "bounds: [0.1, 5]")  # all four as multiples of the mass
    text = text.replace("(force - k*q", "(g*force - k*q").replace(
        "  m:", "  g: {start: 1, bounds: [0.1, 10]}\n  m:"
    )
    truth, u = boxed(text), commands(400, 5)
    y = truth.simulate(np.array([8.0, 1.0, 1.0, 0.5, 0.0, 0.0]), u)
    noisy = y + 1e-3 * np.random.default_rng(1).standard_normal(y.shape)
    log = Record(u, noisy, 0.1, (Channel("force", "N"),), (Channel("position", "m"),))
    model = fit(truth, [log])
    (said,) = (s for s in _information(model) if "together" in s)
    assert "No experiment that was tried separates k, d, g, m" in said


def test_what_only_shows_together_is_determined_together(tmp_path: Path) -> None:
    """k, J and b have no error of their own; k/b and J/b have that of K and T of ``process``."""
    rng = np.random.default_rng(3)
    u = 5.0 * commands(600, 8, held=30)
    at = np.exp(-0.01 / 0.4)
    speed = lfilter([0.0, 2.0 * (1.0 - at)], [1.0, -at], u[:, 0])[:, None]
    log = Record(
        u,
        speed + 0.05 * rng.standard_normal(speed.shape),
        0.01,
        (Channel("u", "V"),),
        (Channel("omega", "rad/s"),),
    )
    model = fit(boxed(MOTOR, 0.0), [log])
    assert np.all(np.isinf(np.diag(model.covariance)))
    path = tmp_path / "model.json"
    model.save(path)

    def ratios(theta: Array) -> Array:
        k, J, b = theta
        return np.array([k / b, J / b, J])

    gain, time, inertia = estimates(Model.load(path), ratios)
    assert np.isinf(inertia.std_error)
    assert (gain.value, time.value) == pytest.approx((2.0, 0.4), rel=0.01)
    made = structure_class("process").from_orders({"np": 1}, 1, 1, {"delay": "none"})
    other = {p.name: p for p in fit(made, [log], detrend="none").parameter_table()}
    assert gain.value == pytest.approx(other["K"].value, abs=other["K"].std_error)
    # the grey box estimates its first state, too: a sample of six hundred
    assert gain.std_error == pytest.approx(other["K"].std_error, rel=0.05)
    assert time.std_error == pytest.approx(other["T1"].std_error, rel=0.05)


def test_every_experiment_may_have_a_parameter_of_its_own() -> None:
    s, rng = boxed(DECAY, 1.0), np.random.default_rng(6)
    logs = []
    for own in (0.5, 2.0):
        u = rng.standard_normal((120, 1))
        y = s.simulate(np.array([0.8]), u, np.array([0.0, own - 1.0]))
        logs.append(Record(u, y + 1e-3 * rng.standard_normal(y.shape), 1.0))
    at_rest = s.simulate(np.array([0.8]), logs[0].u)
    assert at_rest[1, 0] == pytest.approx(logs[0].u[0, 0])  # b is 1, its start
    model = fit(s, logs)
    # noise of 1e-3 over 120 samples of unit drive
    assert model.theta[0] == pytest.approx(0.8, abs=1e-3)
    # counted from the start in the file, which is 1
    assert [x[1] for x in model.initial_states] == pytest.approx([-0.5, 1.0], abs=2e-3)


def test_a_known_first_state_is_not_estimated() -> None:
    given = SPRING.replace("q: {unit: m}", "q: {unit: m, initial: 0.2, known: true}")
    s = boxed(given)
    theta, u = np.array([12.0, 0.7, 0.5]), commands(200, 7)
    y = s.simulate(theta, u, np.array([0.2, 0.0]))
    log = Record(u, y, 0.1, inputs=(Channel("f", "N"),), outputs=(Channel("q", "m"),))
    model = fit(s, (log,))
    assert model.initial_states[0][0] == 0.2
    assert model.n_estimated == 3  # k, d and the first speed
    assert s.fitted_state(theta, u, y, 50)[0] == 0.2


# ------------------------------------------------------------------------------ files


def test_a_stored_file_is_read_back_alike() -> None:
    s = boxed(DECAY)
    assert structure_from_json(structure_to_json(s)) == s


@pytest.mark.parametrize("damage", [{"text": "inputs: {"}, {"text": SPRING + "x: 1"}])
def test_a_damaged_file_is_refused(damage: dict[str, str]) -> None:
    raw = structure_to_json(boxed(DECAY))
    with pytest.raises(SysidError):
        structure_from_json({**raw, "settings": {**raw["settings"], **damage}})


def test_an_ode_is_no_name_to_fit() -> None:
    with pytest.raises(UsageError, match="no structure 'ode'"):
        structure_class("ode")


def test_a_pendulum_swings_as_scipy_integrates_it() -> None:
    made = structure_class(f"{EXAMPLES / 'pendulum'}.ode.yaml").from_orders({}, 1, 1)
    assert isinstance(made, FromFile)
    s = replace(made, sampling=Sampling(0.05, 8))
    gravity, damping, dry, gain, slow = theta = np.array([30.0, 1.0, 0.5, 5.0, 0.05])
    u = commands(25, 6)
    x = s.physics.state_guess(theta, u, np.array([[0.4]]), 0.05)
    assert x == pytest.approx([0.4, 0.0])
    run = s.simulate(theta, u, x)[:, 0]
    for k in range(len(u)):
        assert run[k] == pytest.approx(x[0], abs=2e-3)  # the bend of dry friction within a substep

        def moves(t: float, x: Array, k: int = k) -> list[float]:
            friction = damping * x[1] + dry * np.tanh(x[1] / slow)
            return [x[1], gain * u[k, 0] - friction - gravity * np.sin(x[0])]

        x = solve_ivp(moves, (0.0, 0.05), x, method="LSODA", rtol=1e-8, atol=1e-9).y[:, -1]
