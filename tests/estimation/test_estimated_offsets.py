"""Levels: estimated with the model, read off a rest, or left at zero, and always said."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import lfilter

from sysid.data.facts import LogFacts
from sysid.data.operating_point import OperatingPoint, Origin, value_with_error
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel, Record
from sysid.data.rest import rest_head
from sysid.errors import ModelError
from sysid.estimation.offsets.choice import choose_offsets
from sysid.estimation.pem import fit
from sysid.estimation.selection.select_structure import select_structure
from sysid.fitting.options import FitOptions
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

DT, GAIN, LEVEL, STANDBY = 0.01, 150.0, 40.0, 2.0
A = np.poly([np.exp(-DT / 0.12), np.exp(-DT / 0.03)])
B = np.convolve([0.0, 0.6, 0.4], [1.0]) * A.sum() * GAIN

ORDERS = {
    "arx": {"na": 2, "nb": 2, "nk": 1},
    "armax": {"na": 2, "nb": 2, "nc": 2, "nk": 1},
    "oe": {"nb": 2, "nf": 2, "nk": 1},
    "bj": {"nb": 2, "nc": 1, "nd": 1, "nf": 2, "nk": 1},
}


def log(
    seed: int,
    *,
    level: float = 0.0,
    standby: float = 0.0,
    rest: int = 50,
    both: bool = False,
    noise: float = 2.0,
    samples: int = 800,
    noise_inside: bool = False,
) -> Record:
    """A motor of 150 rpm/V: random steps every 0.4 s, from rest or out of operation."""
    rng = np.random.default_rng(seed)
    before = 0 if rest else 300
    u = rng.uniform(-10.0 if both else 0.0, 10.0, (samples + before) // 40 + 1).repeat(40)
    u = u[: samples + before]
    u[:rest] = 0.0
    e = noise * rng.normal(size=len(u))
    y = lfilter(B, A, u) + (lfilter([1.0], A, 0.02 * e) if noise_inside else e)
    volts, speed = (Channel("volts", "V"),), (Channel("speed", "rpm"),)
    return Record(u[before:, None] + standby, y[before:, None] + level, DT, volts, speed)


def gain(m: Model) -> tuple[float, float]:
    """Static gain and its standard error by the delta method."""
    s = m.structure

    def of(theta: Array) -> float:
        return float(s.transfer(theta).static_gain()[0, 0])  # type: ignore[attr-defined]

    slopes = np.zeros(len(m.theta))
    for k, value in enumerate(m.theta):
        step = 1e-7 * max(abs(value), 1e-3)
        nudged = m.theta.copy()
        nudged[k] += step
        slopes[k] = (of(nudged) - of(m.theta)) / step
    return of(m.theta), float(np.sqrt(slopes @ m.covariance @ slopes))


def fitted(name: str, record: Record, detrend: str = "auto") -> Model:
    return fit(structure_class(name).from_orders(ORDERS[name], 1, 1), [record], detrend=detrend)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "bj")) for n in ORDERS]
)
@pytest.mark.parametrize("rest", [0, 50])
def test_a_level_is_a_parameter_with_an_honest_error(name: str, rest: int) -> None:
    # 12 seeds: a mean squared z above 2.2 has a probability below 1 % at the nominal error
    z, g = [], []
    for seed in range(12):
        inside = name in ("arx", "armax")
        r = log(seed, level=LEVEL, standby=STANDBY, rest=rest, noise_inside=inside)
        m = fitted(name, r)
        at = float(m.detrend.u_offset[0])
        truth = LEVEL + GAIN * (at - STANDBY)
        assert m.operating_point.origin is Origin.ESTIMATED
        z.append((float(m.detrend.y_offset[0]) - truth) / m.operating_point.y_error[0])
        value, error = gain(m)
        g.append((value - GAIN) / error)
        if rest:
            assert at == STANDBY
    assert np.mean(np.square(z)) < 2.2
    assert np.mean(np.square(g)) < 2.2
    assert np.mean(np.square(z)) > 0.2  # nor an error that is far too large


@pytest.mark.parametrize("name", list(ORDERS))
def test_levels_move_with_the_data(name: str) -> None:
    plain = log(3, rest=0, level=LEVEL)
    moved = Record(plain.u + 7.0, plain.y - 900.0, DT, plain.inputs, plain.outputs)
    one, other = fitted(name, plain), fitted(name, moved)
    assert other.theta == pytest.approx(one.theta, rel=1e-5)
    x = one.fitted_state(plain, 50), other.fitted_state(moved, 50)
    run = other.simulate(moved.u, x[1])
    # the runs agree to what two searches agree to, against 800 rpm of range
    assert run == pytest.approx(one.simulate(plain.u, x[0]) - 900.0, abs=0.05)
    assert one.operating_point.y_error == pytest.approx(other.operating_point.y_error, rel=1e-3)
    assert one.operating_point.estimated == 1


@pytest.mark.parametrize(
    ("case", "origin"),
    [
        ({}, Origin.ZERO),
        ({"both": True}, Origin.ZERO),
        ({"both": True, "rest": 0}, Origin.ZERO),
        ({"both": True, "rest": 0, "level": LEVEL}, Origin.ESTIMATED),
        ({"level": LEVEL}, Origin.ESTIMATED),
        ({"rest": 0}, Origin.ESTIMATED),
        ({"rest": 0, "standby": 20.0}, Origin.ESTIMATED),
    ],
)
def test_what_decides(case: dict[str, object], origin: Origin) -> None:
    # at the levels where an unseen offset counts, 5 % of logs with none get one: 4 seeds, 1 may
    found = [choose_offsets([log(seed, **case)]).origin for seed in range(4)]  # type: ignore[arg-type]
    assert sum(o is origin for o in found) >= 3


def test_models_that_explain_nothing_do_not_speak_against_an_offset() -> None:
    """30 samples of dead time, of which an ARX from nk = 1 knows nothing: errors of 99 %."""
    rng = np.random.default_rng(2)
    u = np.repeat(rng.uniform(-1, 1, 60), 15)
    at = np.exp(-0.25)
    y = lfilter([*np.zeros(30), 1.0 - at], [1.0, -at], u) + 0.3 + 0.02 * rng.standard_normal(900)
    assert choose_offsets([Record(u[:, None], y[:, None], 0.1)]).origin is Origin.ESTIMATED


@pytest.mark.parametrize(("name", "origin"), [("arx", Origin.ZERO), ("process", Origin.ESTIMATED)])
def test_an_offset_that_is_not_seen_is_estimated_in_continuous_time(
    name: str, origin: Origin
) -> None:
    r = log(1, both=True, rest=0)
    structure = structure_class(name).from_orders(
        {"na": 1, "nb": 1} if name == "arx" else {"np": 1}, 1, 1
    )
    assert choose_offsets([r]).for_structure(structure, [r]).origin is origin


def test_policies() -> None:
    r = log(0, level=LEVEL)
    assert choose_offsets([r], "none").detrend.is_none
    assert choose_offsets([r], "mean").detrend == Detrend.means(LogFacts((r,)).outliers.records)
    assert choose_offsets([r], "linear").detrend == Detrend.linear(LogFacts((r,)).outliers.records)
    assert choose_offsets([log(0)], "level").estimated == (True,)
    robot = Record(r.u, r.y, DT, (Channel("pwm_l"),), (Channel("omega_l"),))
    assert choose_offsets([robot]).detrend.is_none
    assert not choose_offsets([robot]).estimated


def test_a_step_from_rest_does_not_integrate() -> None:
    # an oven at 20 °C, one step of 1 kW, gain 80 °C/kW, an hour at 10 s, a time constant of 600 s
    for seed in range(3):
        rng = np.random.default_rng(seed)
        u = np.where(np.arange(360) < 12, 0.0, 1.0)
        pole = np.exp(-10.0 / 600.0)
        y = 20.0 + lfilter([0.0, 80.0 * (1 - pole)], [1.0, -pole], u) + 0.3 * rng.normal(size=360)
        names = (Channel("power", "kW"),), (Channel("temperature", "°C"),)
        r = Record(u[:, None], y[:, None], 10.0, *names)
        m = select_structure(("arx", "oe"), [r], FitOptions()).entries[0].model
        value, error = gain(m)
        assert m.structure.stable(m.theta)
        assert abs(value - 80.0) < max(0.03 * 80.0, 3.0 * error)
        at = 20.0 + 80.0 * float(m.detrend.u_offset[0])
        # the rest alone tells 0.3 °C / √12 = 0.09 °C
        assert float(m.detrend.y_offset[0]) == pytest.approx(
            at, abs=4 * m.operating_point.y_error[0]
        )
        assert m.operating_point.y_error[0] < 0.5


def test_an_integrating_output_has_a_balance_instead() -> None:
    rng = np.random.default_rng(1)
    u = 3.0 + rng.uniform(-1.0, 1.0, 40).repeat(20)
    e = 0.001 * rng.normal(size=len(u))
    y = lfilter([0.0, 0.05], [1.0, -1.0], u - 2.5) + lfilter([1.0], [1.0, -1.0], e)
    r = Record(u[:, None], y[:, None], 1.0)
    m = fit(structure_class("arx").from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1), [r])
    assert m.detrend.u_offset[0] == pytest.approx(
        2.5, abs=4 * max(m.operating_point.u_error[0], 1e-3)
    )


def test_rest_at_the_head() -> None:
    found = rest_head(log(0, level=LEVEL, standby=STANDBY))
    assert found is not None
    assert found.samples == 50
    assert found.u[0] == STANDBY
    assert abs(found.y[0] - LEVEL) < 4 * found.y_error[0]
    assert not found.at_zero
    assert rest_head(log(0, rest=0)) is None
    still = log(0, noise=0.0)
    exact = rest_head(still)
    assert exact is not None
    assert exact.at_zero
    # inputs that rest while the output still settles are no rest of the plant
    falling = Record(still.u, still.y + 100.0 * np.exp(-np.arange(800.0) / 30.0)[:, None], DT)
    assert rest_head(falling) is None


def test_a_nonlinear_structure_keeps_the_zero_of_its_input() -> None:
    rng = np.random.default_rng(2)
    u = rng.uniform(-0.3, 1.0, 60).repeat(20)
    v = np.maximum(u - 0.2, 0.0) + np.minimum(u + 0.2, 0.0)
    y = 20.0 + lfilter([0.0, 1.0], [1.0, -0.8], v) + 0.02 * rng.normal(size=len(u))
    s = structure_class("hammerstein-wiener").from_orders(
        {"nb": 1, "nf": 1, "nk": 1}, 1, 1, {"input": "dead-zone", "output": "identity"}
    )
    m = fit(s, [Record(u[:, None], y[:, None], 0.1)])
    table = {p.name: p for p in m.parameter_table()}
    assert m.detrend.is_none
    assert table["input.d_low"].value == pytest.approx(-0.2, abs=0.02)
    assert table["input.d_high"].value == pytest.approx(0.2, abs=0.02)
    assert table["y0"].value == pytest.approx(20.0, abs=3 * table["y0"].std_error)


def test_given_terms_are_products_of_readings() -> None:
    rng = np.random.default_rng(0)
    u = rng.uniform(0.0, 1.0, 600)
    y = np.zeros(600)
    for t in range(1, 600):
        y[t] = 0.7 * y[t - 1] + 0.5 * u[t - 1] - 0.2 * y[t - 1] * u[t - 1]
    y += 0.002 * rng.normal(size=600)
    terms = {"terms": "y(t-1), u(t-1), y(t-1)*u(t-1)"}
    s = structure_class("narmax").from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1, terms)
    m = fit(s, [Record(u[50:, None], y[50:, None], 0.1)])
    values = {p.name: p.value for p in m.parameter_table()}
    assert sorted(values.values()) == pytest.approx([-0.2, 0.5, 0.7], abs=0.02)
    assert m.detrend.is_none
    assert "the term constant" in m.operating_point_sentence()


@pytest.mark.slow
def test_levels_of_a_searched_polynomial() -> None:
    rng = np.random.default_rng(0)
    u = rng.uniform(0.0, 1.0, 50).repeat(8)
    y = 20.0 + lfilter([0.0, 0.5], [1.0, -0.7], u) + 0.002 * rng.normal(size=400)
    found = select_structure(("narmax", "arx"), [Record(u[:, None], y[:, None], 0.1)], FitOptions())
    for m in (e.model for e in found.entries):
        # a step of 1 raises the output by 5/3, whatever it is counted from
        low, high = (m.simulate(np.full((400, 1), v))[-1, 0] for v in (0.2, 0.8))
        assert high - low == pytest.approx(0.6 * 0.5 / 0.3, rel=0.02)
        assert low == pytest.approx(20.0 + 0.2 * 0.5 / 0.3, abs=0.02)
    origins = {e.model.operating_point.origin for e in found.entries}
    assert origins == {Origin.MEANS, Origin.ESTIMATED}


def test_the_level_is_said(tmp_path: Path, capsys: Capture) -> None:
    r = log(4, level=LEVEL)
    path = write_log(tmp_path / "log.csv", ["volts", "speed"], [r.u[:, 0], r.y[:, 0]], DT)
    call = ("fit", path, "--structure", "oe", "--orders", "nb=2 nf=2", "--input", "volts",
            "--output", "speed", "--unit", "volts=V")  # fmt: skip
    found = run(capsys, *call, "--json").document["offsets"]
    assert abs(found["y_offset"][0] - LEVEL) < 4 * found["y_std_error"][0]
    assert found["origin"] == "estimated"
    said = run(capsys, *call).out
    assert "Operating point: speed = " in said
    models = run(capsys, "models", "--json").document
    shown = run(capsys, "show", models["models"][-1]["model"]).out
    assert "Operating point: speed = " in shown
    assert "(speed - " in shown
    means = run(capsys, *call, "--detrend", "mean").out
    assert "Operating point: the means" in means


def test_a_level_is_stored_and_damaged_ones_refused(tmp_path: Path) -> None:
    m = fitted("oe", log(5, level=LEVEL))
    m.save(tmp_path / "m.json")
    assert Model.load(tmp_path / "m.json").operating_point == m.operating_point
    raw = m.to_json()
    raw.pop("level")  # as version 0.1.0 wrote it
    assert Model.from_json(raw).operating_point.origin is Origin.MEANS
    with pytest.raises(ModelError, match=r"level\.origin: it should be"):
        Model.from_json(m.to_json() | {"level": {"origin": "somewhere"}})
    assert OperatingPoint.of_detrend(Detrend.none(1, 1)).origin is Origin.ZERO


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (71.32, 0.2, "71.32 ± 0.20"),
        (71.3, 0.0, "71.3"),
        (1234.4, 31.0, "1234 ± 31"),
        (1e-12, 1e-14, "1e-12 ± 1e-14"),
        (2.0, np.inf, "2 (unknown)"),
    ],
)
def test_numbers_with_errors(value: float, error: float, text: str) -> None:
    assert value_with_error(value, error) == text
