"""The checks before a fit: each fault is named, and clean logs raise no alarm."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from sysid.data.checks.delay import estimate_delays
from sysid.data.checks.dynamics_checks import excitation_order
from sysid.data.checks.feedback import feedback_tests
from sysid.data.checks.integral import integrals
from sysid.data.facts import LogFacts
from sysid.data.finding import Finding, Severity, worst
from sysid.data.impulse import long_regression
from sysid.data.inspection import inspect_records, require_usable
from sysid.data.io import read_log
from sysid.data.record import PWM_FULL_SCALE, Channel, Record
from sysid.data.speed import estimate_speed
from sysid.errors import DataError

MEASURED = Path(os.environ.get("SYSID_DATA", "../shared/data"))
BUNDLED = Path(__file__).parents[2] / "datasets" / "devastator"
needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason="the measured records are not there (../shared/data, SYSID_DATA)"
)
ROBOT = (
    (Channel("pwm_l", "µs"), Channel("pwm_r", "µs")),
    (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
)
POLE = 0.7


def motor(n: int = 800, delay: int = 1, noise: float = 0.02, seed: int = 0) -> Record:
    """y(t) = 0.7 y(t−1) + 0.3 u(t−delay), measured with white noise; u random ±1 and 0."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 0.0, 1.0], -(-n // 3)), 3)[:n, None]
    b = np.zeros(delay + 1)
    b[delay] = 1 - POLE
    y = signal.lfilter(b, [1, -POLE], u, axis=0) + noise * rng.normal(size=(n, 1))
    return Record(u, y, 0.1, (Channel("u"),), (Channel("y"),), name="motor")


def robot(n: int = 900, seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.integers(-18, 19, (n // 6, 2)), 6, axis=0) * 1000.0
    y = signal.lfilter([0, 1 - POLE], [1, -POLE], u, axis=0) * 20 / PWM_FULL_SCALE
    y += 0.05 * rng.normal(size=y.shape)
    return Record(u, y, 0.1, *ROBOT, name="robot")


def alarms(findings: tuple[Finding, ...]) -> set[str]:
    return {f.code for f in findings if f.severity >= Severity.WARNING}


# ------------------------------------------------------------------------------- each fault named


def dead(y: np.ndarray) -> np.ndarray:
    out = y.copy()
    out[300:400] = out[300]
    return out


def spiked(y: np.ndarray) -> np.ndarray:
    out = y.copy()
    out[[200, 500]] += 8.0
    return out


def lagging(y: np.ndarray, times: int) -> np.ndarray:
    return np.repeat(y[::times], times, axis=0)[: len(y)]


def slow_motor(pole: float, n: int = 20000) -> Record:
    rng = np.random.default_rng(8)
    u = np.repeat(rng.choice([-1.0, 1.0], n // 100), 100)[:, None]
    y = signal.lfilter([0, 1 - pole], [1, -pole], u, axis=0) + 0.01 * rng.normal(size=(n, 1))
    return Record(u, y, 0.001, name="slow")


def controlled(gain: float = 1.0, n: int = 3000, within: int = 1) -> Record:
    """A motor under proportional control, with process noise; u(t) answers to y(t − within)."""
    rng = np.random.default_rng(9)
    reference = np.repeat(rng.normal(size=n // 10), 10)
    u, y = np.zeros(n), np.zeros(n)
    for t in range(1, n):
        y[t] = POLE * y[t - 1] + (1 - POLE) * u[t - 1] + 0.05 * rng.normal()
        u[t] = gain * (reference[t] - y[t - within])
    return Record(u[:, None], y[:, None], 0.1, name="loop")


SIGNALS: dict[str, Callable[[int], np.ndarray]] = {
    "zero": np.zeros,
    "one": np.ones,
    "ramp": lambda n: np.arange(n) / 7,
    "step": lambda n: (np.arange(n) > n // 2).astype(float),
    "spike": lambda n: (np.arange(n) == n // 2).astype(float),
    "sine": lambda n: np.sin(np.arange(n)),
    "noise": lambda n: np.random.default_rng(n).normal(size=n),
    "growing": lambda n: 1.2 ** np.arange(n),
}


@dataclass(frozen=True)
class Fault:
    """A finding's code, a pattern of its sentence, and the log that has it."""

    code: str
    sentence: str
    record: Callable[[], Record]

    @classmethod
    def of(
        cls, code: str, sentence: str, base: Callable[[], Record], **changes: Callable
    ) -> "Fault":
        """Of a good log, some signals of which are changed."""

        def spoilt() -> Record:
            record = base()
            return replace(record, sha256="", **{k: make(record) for k, make in changes.items()})

        return cls(code, sentence, spoilt if changes else base)

    @property
    def severity(self) -> Severity:
        fatal = self.code in ("constant", "missing", "length")
        return Severity.FATAL if fatal else Severity.WARNING


FAULTS = {
    "constant input": Fault.of(
        "constant",
        "The input u never changes .it stays at 0.1",
        motor,
        u=lambda r: np.full_like(r.u, 0.1),
    ),
    "constant output": Fault.of(
        "constant", "The output y never changes", motor, y=lambda r: np.zeros_like(r.y)
    ),
    "not a number": Fault.of(
        "missing",
        "y is not a number in 1 sample at t = 0.7 s",
        motor,
        y=lambda r: np.where(np.arange(len(r))[:, None] == 7, np.nan, r.y),
    ),
    "too short": Fault.of("length", "15 samples", partial(motor, 15)),
    "stuck": Fault.of(
        "stuck", "y repeats .* for 100 samples from t = 30 s", motor, y=lambda r: dead(r.y)
    ),
    "doubled": Fault.of("doubled", "each value 2 times", motor, y=lambda r: lagging(r.y, 2)),
    "clipped": Fault.of(
        "saturation", "y is at its largest value 0.6", motor, y=lambda r: np.minimum(r.y, 0.6)
    ),
    "coarse": Fault.of(
        "resolution", "resolution of about 0.5", motor, y=lambda r: np.round(r.y / 0.5) * 0.5
    ),
    "outliers": Fault.of(
        "outliers", "2 outliers in y, the first at t = 20 s", motor, y=lambda r: spiked(r.y)
    ),
    "weak input": Fault.of(
        "excitation",
        "u excites the plant to order 2 only; 8 was",
        motor,
        u=lambda r: np.sin(0.3 * np.arange(len(r)))[:, None],
        y=lambda r: r.y,
    ),
    "tracks always alike": Fault.of(
        "collinear",
        "pwm_l and pwm_r always move together .correlation 1.000",
        robot,
        u=lambda r: r.u[:, [0, 0]],
    ),
    "feedback": Fault.of("feedback", "recorded in closed loop", controlled),
    "sampled too fast": Fault.of(
        "sampling", "much faster than the plant", partial(slow_motor, 0.999)
    ),
    "sampled too slow": Fault.of(
        "sampling", "too slow to see", motor, y=lambda r: np.roll(r.u, 1, axis=0) + 0.01 * r.y
    ),
    "reversed track": Fault.of(
        "sign", "omega_r runs against pwm_r", robot, y=lambda r: r.y * [1, -1]
    ),
    "sides swapped": Fault.of(
        "side", "left ω follows the right PWM", robot, y=lambda r: r.y[:, ::-1]
    ),
    "sides swapped, one reversed": Fault.of(
        "sign",
        r"omega_l runs against pwm_r .*`units=\{'omega_l': '-rad/s'\}`",
        robot,
        y=lambda r: r.y[:, ::-1] * [-1, 1],
    ),
    "sides of swapped columns": Fault.of(
        "side", r"`inputs=\['pwm_r', 'pwm_l'\]`", robot, y=lambda r: r.y[:, ::-1]
    ),
    "rpm": Fault.of(
        "omega-unit", r"`units=\{'omega_l': 'rpm'\}`", robot, y=lambda r: r.y * 60 / (2 * np.pi)
    ),
    "degrees": Fault.of(
        "omega-unit", r"`units=\{'omega_l': 'deg/s'\}`", robot, y=lambda r: np.degrees(r.y)
    ),
    "ticks": Fault.of("omega-unit", "ticks/360", robot, y=lambda r: r.y * 1920 / (2 * np.pi)),
    "turns": Fault.of(
        "omega-unit", r"`units=\{'omega_l': 'rev/s'\}`", robot, y=lambda r: r.y / (2 * np.pi)
    ),
    "8-bit PWM": Fault.of(
        "pwm-scale", "`pwm_max=255.0`", robot, u=lambda r: np.round(r.u / 20000 * 255)
    ),
    "PWM in ±1": Fault.of("pwm-scale", "`pwm_max=1.0`", robot, u=lambda r: r.u / 20000),
    "PWM too large": Fault.of("pwm-scale", "beyond ±20000", robot, u=lambda r: r.u * 2),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_named(fault: str) -> None:
    known = FAULTS[fault]
    findings = inspect_records([known.record()])
    hit = [f for f in findings if f.code == known.code and f.severity is known.severity]
    assert hit, [f.text for f in findings]
    assert re.search(known.sentence, hit[0].text), hit[0].text
    assert hit[0].advice
    assert worst(findings) is known.severity


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("make", [motor, robot])
def test_clean_logs_raise_no_alarm(make: Callable[..., Record], seed: int) -> None:
    findings = inspect_records([make(seed=seed)])
    assert not alarms(findings), [f.text for f in findings if f.severity >= Severity.WARNING]


def test_every_check_speaks_in_a_fixed_order() -> None:
    order = [f.code for f in inspect_records([robot()])]
    expected = ["length", "missing", "constant", "stuck", "saturation", "resolution", "outliers"]
    expected += [
        "robot",
        "levels",
        "excitation",
        "sampling",
        "sampling",
        "delay",
        "delay",
        "feedback",
    ]
    expected += ["change", "nonlinearity"]
    assert order == expected
    assert all(f.sentence.endswith(".") for f in inspect_records([robot()]))


def test_several_experiments_are_judged_together() -> None:
    still = replace(motor(seed=1), u=np.ones((800, 1)), sha256="", name="still")
    findings = inspect_records([motor(), still])
    assert [f.severity for f in findings if f.code == "constant"] == [Severity.NOTE]
    straight, turn = robot(seed=1), robot(seed=2)
    straight = replace(straight, u=straight.u[:, [0, 0]], sha256="")
    turn = replace(turn, u=turn.u[:, [0, 0]] * [1, -1], sha256="")
    assert "collinear" not in {f.code for f in inspect_records([straight, turn])}


def test_require_usable_raises_the_fatal_sentence() -> None:
    require_usable([motor()])
    for fault in ("constant input", "not a number", "too short"):
        with pytest.raises(DataError, match=FAULTS[fault].sentence):
            require_usable([FAULTS[fault].record()])
    with pytest.raises(DataError, match="no record"):
        inspect_records([])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    n=st.integers(1, 120),
    nu=st.integers(1, 3),
    kinds=st.lists(st.sampled_from(sorted(SIGNALS)), min_size=4, max_size=4),
    scale=st.sampled_from([1e-12, 1.0, 1e12]),
)
def test_any_record_gets_verdicts_without_a_warning(
    n: int, nu: int, kinds: list[str], scale: float
) -> None:
    columns = [scale * SIGNALS[k](n) for k in kinds]
    record = Record(np.column_stack(columns[:nu]), columns[3], 0.1)
    findings = inspect_records([record, record.rows(0, n // 2 + 1)])
    assert all(f.sentence and "nan" not in f.sentence for f in findings)


# ------------------------------------------------------------------------- delay, feedback, speed


@pytest.mark.parametrize("delay", [0, 1, 2, 5, 12])
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.3])
def test_delay_is_found_inside_its_interval(delay: int, noise: float) -> None:
    (found,) = estimate_delays([motor(delay=delay, noise=noise, seed=delay)])
    assert found.delay == delay
    assert found.low <= delay <= found.high


def test_delay_intervals_cover_the_truth_in_heavy_noise() -> None:
    # Noise three times the signal: the interval is wide, and still right.
    found = [estimate_delays([motor(300, 3, 1.5, seed)])[0] for seed in range(60)]
    covered = sum(d.low <= 3 <= d.high for d in found)
    assert covered >= 55  # 99 % nominal: fewer than 56 of 60 has a chance below 1e-3
    assert any(not d.certain for d in found)


def test_no_effect_has_no_delay() -> None:
    r = motor()
    noise = np.random.default_rng(2).normal(size=r.y.shape)
    (found,) = estimate_delays([replace(r, y=noise, sha256="")])
    assert found.delay is None


def test_delays_of_two_inputs_differ() -> None:
    rng = np.random.default_rng(3)
    u = rng.choice([-1.0, 1.0], (1500, 2))
    y = signal.lfilter([0, 0.3], [1, -0.7], u[:, 0]) + signal.lfilter(
        [0, 0, 0, 0, 0.5], [1, -0.5], u[:, 1]
    )
    r = Record(u, y + 0.1 * rng.normal(size=1500), 0.1)
    assert [d.delay for d in estimate_delays([r])] == [1, 4]


@needs_measured
def test_dryer_delay_is_three() -> None:
    record = read_log(MEASURED / "dryer" / "dryer.csv")
    (found,) = estimate_delays([record])
    assert (found.delay, found.low, found.high) == (3, 3, 3)
    first = record.rows(0, 300)
    assert estimate_delays([first])[0].delay == 3


BUNDLED_LOGS = sorted(BUNDLED.glob("*.csv"))


@pytest.mark.skipif(not BUNDLED_LOGS, reason="the bundled logs are not there")
@pytest.mark.parametrize("path", BUNDLED_LOGS, ids=lambda p: p.stem)
def test_bundled_logs_have_no_dead_time_and_no_false_alarm(path: Path) -> None:
    record = read_log(path)
    delays = estimate_delays([record])
    assert [d.delay for d in delays] == [1, 1, 1, 1]
    allowed = {"collinear"} if path.stem.startswith(("forward", "rotation")) else set()
    assert alarms(inspect_records([record])) == allowed


CLEAN = [
    "dryer/dryer.csv",
    "ced/unif_low.csv",
    "tacho_motor/prbs_10hz.csv",
    "ballbeam/ballbeam.csv",
]


@needs_measured
@pytest.mark.parametrize("name", CLEAN)
def test_clean_measured_logs_raise_no_alarm(name: str) -> None:
    assert not alarms(inspect_records([read_log(MEASURED / name)]))


@needs_measured
@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("cascaded_tanks/est.csv", "saturation"),  # the tank overflows at 10 V
        ("tacho_motor/random_steps_10hz_2000.csv", "saturation"),  # the sensor clips at 5 V
        ("winding/winding.csv", "feedback"),  # speed and current loops were closed
        ("emps/train.csv", "feedback"),  # the slide's position is controlled
    ],
)
def test_known_faults_of_measured_logs_are_seen(name: str, code: str) -> None:
    assert code in alarms(inspect_records([read_log(MEASURED / name)]))


@needs_measured
@pytest.mark.parametrize("name", ["emps/train.csv", "ballbeam/ballbeam.csv"])
def test_measured_positions_integrate(name: str) -> None:
    assert integrals([read_log(MEASURED / name)])


def test_feedback_alarms_at_its_level_in_open_loop() -> None:
    # p is uniform in open loop, whatever colours the noise: of 200 about 10 fall below 5 %.
    rng = np.random.default_rng(11)
    low = 0
    for _ in range(200):
        u = np.repeat(rng.choice([-1.0, 1.0], 100), 4)[:, None]
        noise = signal.lfilter([1], [1, -0.6], rng.normal(size=(400, 1)), axis=0)
        y = signal.lfilter([0, 0.5], [1, -0.6], u, axis=0) + 0.3 * noise
        low += feedback_tests([Record(u, y, 0.1)])[0].p_value < 0.05
    assert 2 <= low <= 22  # binomial(200, 0.05): outside with a chance below 1e-3


def test_feedback_within_the_sample_is_seen_and_is_no_delay_of_the_plant() -> None:
    findings = inspect_records([controlled(within=0)])
    (delay,) = [f for f in findings if f.code == "delay"]
    assert "1 from u" in delay.text
    (feedback,) = [f for f in findings if f.code == "feedback"]
    assert feedback.severity is Severity.WARNING
    assert not [f for f in findings if f.code == "nonlinearity" and f.severity > Severity.OK]


@pytest.mark.parametrize("set_point", [True, False])
def test_feedthrough_in_open_loop_is_an_assumption_that_is_seen(set_point: bool) -> None:
    reading = (Finding("set-point", Severity.NOTE, "y_sp", channel="y_sp"),) * set_point
    findings = inspect_records(LogFacts((motor(delay=0),), reading))
    (seen,) = [f for f in findings if f.code == "at-once"]
    assert seen.severity is Severity.WARNING
    assert "the model is the controller's inverse" in seen.text
    assert ("y_sp is a set point: closed loop" in seen.text) == set_point
    assert "feedback" not in alarms(findings)


@pytest.mark.parametrize(("pole", "dt"), [(0.7, 0.1), (0.9, 0.02), (0.98, 0.01)])
def test_time_constant_of_a_first_order_plant(pole: float, dt: float) -> None:
    rng = np.random.default_rng(12)
    u = np.repeat(rng.choice([-1.0, 1.0], 200), 20)[:, None]
    y = signal.lfilter([0, 1 - pole], [1, -pole], u, axis=0) + 0.02 * rng.normal(size=u.shape)
    (speed,) = estimate_speed([Record(u, y, dt)])
    # Crude by design: linear interpolation between blocks and the noise leave about 15 %.
    assert speed.time_constant == pytest.approx(-dt / np.log(pole), rel=0.2)


@pytest.mark.parametrize("fast", [True, False])
def test_a_slow_input_shows_no_fast_time_constant(fast: bool) -> None:
    rng = np.random.default_rng(14)
    k = np.arange(6000)
    u = rng.choice([-1.0, 1.0], 6000) if fast else np.sin(k / 150.0) + 0.3 * np.sin(k / 47.0)
    y = np.append(0.0, u[:-1]) + 0.1 * rng.normal(size=6000)
    (speed,) = estimate_speed([Record(u, y, 0.1)])
    assert (speed.time_constant is None) != fast


def test_an_integrator_has_no_time_constant() -> None:
    rng = np.random.default_rng(13)
    u = rng.choice([-1.0, 1.0], (2000, 1))
    y = np.cumsum(np.vstack([[0.0], u[:-1]]), axis=0)
    (speed,) = estimate_speed([Record(u, y, 0.1)])
    assert speed.time_constant is None


def test_regression_standard_errors_cover() -> None:
    # |b̂ − b| < 2 s for 95 % of the coefficients; 60 runs × 5 lags scatter by about 1.3 %.
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u = rng.normal(size=(400, 1))
        e = 0.2 * rng.normal(size=(400, 1))
        y = signal.lfilter([0, 0.5, 0.2], [1, -0.6], u, axis=0)
        y = y + signal.lfilter([1], [1, -0.6], e, axis=0)
        fit = long_regression([Record(u, y, 1.0)], order=4)
        inside.append(np.abs(fit.b[0, 0] - [0, 0.5, 0.2, 0, 0]) < 1.96 * fit.b_error[0, 0])
    assert 0.90 < np.mean(inside) < 0.985


def test_indistinguishable_inputs_have_infinite_error() -> None:
    r = robot()
    same = replace(r, u=r.u[:, [0, 0]], sha256="")
    assert np.all(np.isinf(long_regression([same], 2).b_error))
    assert np.all(np.isfinite(long_regression([r], 2).b_error))
    assert excitation_order([same], 5) == (5, 5)


def stroke(seed: int, tau: float, samples: int = 1500) -> Record:
    """A position between two end stops, or one that a spring pulls back with ``tau`` [samples]."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 25), 25)
    w = signal.lfilter([0.0, 0.4], [1.0, -0.6], np.where(np.abs(u) > 0.1, u, 0.0))
    y = np.zeros(samples)
    for k in range(1, samples):
        y[k] = np.clip(y[k - 1] * (1.0 - 1.0 / tau) + w[k], -60.0, 60.0)
    return Record(u[:, None], y[:, None] + 0.1 * rng.standard_normal((samples, 1)), 0.02)


@pytest.mark.parametrize("seed", range(8))
def test_an_output_that_integrates_is_not_read_as_slow(seed: int) -> None:
    said = {f.code: f.text for f in inspect_records([stroke(seed, np.inf)], nonlinearity=False)}
    assert "`speed_of='y'`" in said["integrates"]
    assert "sampling" not in said or "Decimate" not in said["sampling"]
    assert "end stop" in said["saturation"] or "No signal" in said["saturation"]


def test_a_speed_without_drag_is_no_position() -> None:
    log = stroke(0, np.inf)
    assert integrals([log])
    assert integrals([replace(log, outputs=(Channel("w", "rad/s"),))]) == ()


def test_an_output_that_is_pulled_back_does_not_integrate() -> None:
    """No alarm in 60 logs with time constants up to a tenth of their length."""
    taus = np.random.default_rng(1).uniform(3.0, 150.0, 60)
    assert [tau for seed, tau in enumerate(taus) if integrals([stroke(seed, tau)])] == []
