"""What a model does to a step: gains, times and their errors, against plants known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import cont2discrete, lfilter

from sysid.data.documents import by_field, parsed, text
from sysid.data.record import Channel, Record
from sysid.data.schema import checked
from sysid.estimation.assessment.step_response import StepResponse, step_responses
from sysid.estimation.pem import fit
from sysid.estimation.soundness import undetermined
from sysid.fitting.options import FitOptions
from sysid.report.step_words import step_sentences, with_error
from sysid.structures.registry import structure_class

DT = 0.02
GAIN, SLOW, FAST, DELAY = 150.0, 0.12, 0.03, 3


def two_lags(samples: int = 1500, seed: int = 0, noise: float = 2.0) -> Record:
    """K/((T₁s + 1)(T₂s + 1)) behind a zero-order hold and a dead time of 2 samples."""
    top, bottom, _ = cont2discrete(([GAIN], np.polymul([SLOW, 1.0], [FAST, 1.0])), DT, method="zoh")
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-3.0, 3.0, samples // 15 + 1), 15)[:samples]
    late = np.concatenate([np.zeros(DELAY - 1), u[: 1 - DELAY]])
    y = lfilter(top[0], bottom, late) + noise * rng.standard_normal(samples)
    return Record(u, y, DT, (Channel("volt", "V"),), (Channel("speed", "rpm"),))


def model_of(record: Record, name: str = "oe", orders: str = "nb=2 nf=2 nk=3"):
    raw = {k: int(v) for k, v in (item.split("=") for item in orders.split())}
    structure = structure_class(name).from_orders(raw, record.nu, record.ny)
    return fit(structure, [record], FitOptions())


def test_a_step_tells_the_constants_of_the_plant_with_honest_errors() -> None:
    """Over 40 seeds the mean squared deviation is that of the standard errors: χ²₄₀/40 < 1.7."""
    truth = np.array([GAIN, SLOW, FAST])
    scores = []
    for seed in range(40):
        (step,) = step_responses(model_of(two_lags(seed=seed)))
        found = [step.gain, *step.time_constants]
        assert len(found) == 3
        scores.append([(e.value - t) / e.std_error for e, t in zip(found, truth, strict=True)])
        assert step.dead_time == pytest.approx((DELAY - 1) * DT)
    spread = np.mean(np.square(scores), axis=0)
    assert np.all(spread < 1.7)  # the 99.9 % point
    assert np.all(spread > 0.45)  # and the 0.1 % point: errors are not inflated either


def test_settling_and_rise_follow_from_the_response_itself() -> None:
    (step,) = step_responses(model_of(two_lags(noise=1e-6)))
    t = np.linspace(0.0, 2.0, 200_001)
    y = 1.0 - (SLOW * np.exp(-t / SLOW) - FAST * np.exp(-t / FAST)) / (SLOW - FAST)
    settling = t[np.flatnonzero(np.abs(y - 1.0) > 0.02)[-1]]
    rise = t[np.argmax(y > 1.0 - np.exp(-1.0))]
    # between samples the crossing is interpolated: a tenth of a sample is what that costs
    assert step.settling.value - step.dead_time == pytest.approx(settling, abs=0.1 * DT)
    assert step.rise.value == pytest.approx(rise, abs=0.1 * DT)


def test_an_oscillating_plant_has_a_frequency_and_a_damping() -> None:
    omega, damping = 8.0, 0.2
    top, bottom, _ = cont2discrete(
        ([omega**2], [1.0, 2 * damping * omega, omega**2]), DT, method="zoh"
    )
    rng = np.random.default_rng(3)
    u = np.repeat(rng.choice([-1.0, 1.0], 150), 10)
    y = lfilter(top[0], bottom, u) + 0.01 * rng.standard_normal(len(u))
    (step,) = step_responses(model_of(Record(u, y, DT), orders="nb=2 nf=2 nk=1"))
    assert step.oscillation is not None
    for estimate, truth in zip(step.oscillation, (omega, damping), strict=True):
        assert abs(estimate.value - truth) < 4.0 * estimate.std_error
    assert "oscillates at" in step_sentences([step])[0]


def test_an_integrator_is_told_by_the_rate_it_reaches() -> None:
    rng = np.random.default_rng(4)
    u = np.repeat(rng.choice([-1.0, 1.0], 100), 10)
    rate = lfilter([0.0, 0.3 * (1 - np.exp(-DT / 0.1))], [1.0, -np.exp(-DT / 0.1)], u)
    y = np.cumsum(rate) * DT
    record = Record(u, y, DT, (Channel("u", "V"),), (Channel("x", "m"),))
    (step,) = step_responses(model_of(record, "arx", "na=2 nb=2 nk=1"))
    assert step.integrates
    assert step.unit == "(m/s)/V"
    assert step.gain.value == pytest.approx(0.3, rel=1e-3)  # noise-free: rounding and the fit


def test_inputs_that_move_together_leave_their_gains_undetermined() -> None:
    record = two_lags()
    both = Record(np.hstack([record.u, record.u]), record.y, DT)
    steps = step_responses(model_of(both, "arx", "na=2 nb=2 nk=3"))
    assert len(steps) == 2
    assert all(np.isinf(s.gain.std_error) for s in steps)


def test_a_washout_passes_on_no_lasting_change_and_says_so() -> None:
    rng = np.random.default_rng(5)
    u = np.repeat(rng.standard_normal(200), 5)
    y = lfilter([0.0, 1.0, -1.0], [1.0, -0.8], u) + 0.01 * rng.standard_normal(len(u))
    (step,) = step_responses(model_of(Record(u, y, DT), orders="nb=2 nf=1 nk=1"))
    assert abs(step.gain.value) < 3.0 * step.gain.std_error
    assert "not significant" in step_sentences([step])[0]


def test_a_nonlinear_model_is_asked_for_small_half_and_full_steps() -> None:
    """A dead zone of a fifth of the range: the gain grows from 0.2/0.25… with the step."""
    rng = np.random.default_rng(6)
    u = np.repeat(rng.uniform(-1.0, 1.0, 300), 5)
    v = np.sign(u) * np.maximum(np.abs(u) - 0.2, 0.0)
    y = lfilter([0.0, 0.5], [1.0, -0.5], v) + 0.002 * rng.standard_normal(len(u))
    steps = step_responses(model_of(Record(u, y, DT), "hammerstein-wiener", "nb=1 nf=1 nk=1"))
    assert [s.share for s in steps] == [0.25, 0.5, 1.0]
    for s in steps:
        true_gain = max(s.level - 0.2, 0.0) / s.level
        assert s.gain.value == pytest.approx(true_gain, abs=0.03)  # noise of 0.002 in a few levels


def test_gains_are_also_given_in_the_units_of_the_file() -> None:
    record = two_lags()
    turned = Record(
        record.u,
        record.y * (2 * np.pi / 60),
        DT,
        record.inputs,
        (Channel("speed", "rad/s", 2 * np.pi / 60, "rpm"),),
    )
    (step,) = step_responses(model_of(turned))
    assert step.file_unit == "rpm/V"
    assert step.gain.value * step.file_factor == pytest.approx(GAIN, rel=0.02)
    assert "gain 150" in step_sentences([step])[0]
    assert " rpm/V (15." in step_sentences([step])[0]


@pytest.mark.parametrize("unit", [1e-5, 1.0, 1e5])
def test_paths_are_compared_by_what_they_move_whatever_their_units(unit: float) -> None:
    """A brake in Pa moves the speed as far as a pedal in %, with a gain 10⁵ times smaller."""
    rng = np.random.default_rng(4)
    pedal, brake, idle = (np.repeat(rng.uniform(0.0, 100.0, 100), 15) for _ in range(3))
    y = lfilter([0.0, 0.1], [1.0, -0.9], pedal - brake + 0.001 * idle)
    y += 0.01 * rng.standard_normal(len(y))
    names = tuple(Channel(n) for n in ("pedal", "brake", "idle"))
    record = Record(np.column_stack([pedal, unit * brake, unit * idle]), y, DT, names)
    lines = step_sentences(step_responses(model_of(record, "arx", "na=1 nb=1 nk=1")))
    assert [line.partition(" ")[0] for line in lines] == ["pedal", "brake", "idle"]
    assert ": gain " in lines[1]
    assert "below 2 %" in lines[2]


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (150.0, 0.31, "150.00 ± 0.31"),
        (0.12345, 0.002, "0.1235 ± 0.0020"),
        (8.882e-4, 9e-7, "(8.8820 ± 0.0090)e-4"),
        (12.0, 34.0, "12 ± 34"),
        (1.5, 0.0, "1.5"),
        (3.0, np.inf, "3 (not determined by these data)"),
        (np.nan, 1.0, "not determined"),
    ],
)
def test_a_number_has_as_many_digits_as_its_error_allows(
    value: float, error: float, text: str
) -> None:
    assert with_error(value, error) == text


def test_fit_and_show_begin_with_what_the_model_means(tmp_path, capsys: Capture) -> None:
    record = two_lags()
    log = write_log(tmp_path / "motor.csv", ["u_V", "y_rpm"], [record.u[:, 0], record.y[:, 0]], DT)
    place = ("--workspace", tmp_path / "ws")
    orders = ("--structure", "oe", "--orders", "nb=2 nf=2 nk=3", "--detrend", "none")
    out = run(capsys, "fit", log, *orders, *place).out
    assert out.index("gain [rpm/V]") < out.index("u_V → y_rpm ")
    name = run(capsys, "models", "--json", *place).document["models"][0]["model"]
    shown = run(capsys, "show", name, *place).out
    for part in ("u_V → y_rpm: gain", "Poles at", "free run"):
        assert part in shown
    document = run(capsys, "show", name, "--json", *place).document
    kept = checked(tuple[StepResponse, ...], document["report"]["step_response"])
    assert step_sentences(kept)[0] in shown


def test_what_is_not_determined_is_said_of_a_stored_model_too() -> None:
    """A document has null for an infinite error: read back it is infinite again, not clear."""
    said = step_responses(undetermined(model_of(two_lags())))
    stored = checked(tuple[StepResponse, ...], parsed(text([by_field(r) for r in said])))
    assert stored[0].gain.std_error == np.inf
    assert step_sentences(stored) == ("volt → speed: not determined by these data.",)


def test_three_time_constants_are_a_list() -> None:
    (step,) = step_responses(model_of(two_lags()))
    three = replace(step, time_constants=(*step.time_constants, step.time_constants[0]))
    words = step_sentences([three])[0]
    assert words.count(" and ") == 1
    assert words.split("time constants ")[1].count(" s,") == 1


def test_a_double_root_keeps_its_numbers() -> None:
    """Two equal time constants: a pair that is real here is complex a hair's breadth away."""
    top, bottom, _ = cont2discrete(([GAIN], np.polymul([0.1, 1.0], [0.1, 1.0])), DT, method="zoh")
    for seed in range(12):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(-3.0, 3.0, 40), 15)
        y = lfilter(top[0], bottom, u) + 2.0 * rng.standard_normal(600)
        (step,) = step_responses(model_of(Record(u, y, DT), orders="nb=2 nf=2 nk=1"))
        assert step.gain.value == pytest.approx(GAIN, abs=4.0 * step.gain.std_error)


def test_poles_that_no_sample_resolves_are_no_swing() -> None:
    """An ARX of high order on one lag and a delay has noise poles all around the circle."""
    rng = np.random.default_rng(7)
    u = np.repeat(rng.choice([-1.0, 1.0], 60), 10)
    y = lfilter([0.0, 0.1], [1.0, -0.9], u) + 0.05 * rng.standard_normal(600)
    (step,) = step_responses(model_of(Record(u, y, DT), "arx", "na=6 nb=6 nk=1"))
    assert step.oscillation is None
