"""A look at a log: bands that hold the truth, peers' formulas, distortions of known curves."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import optimize, signal, stats

import sysid
from sysid.data.excitation import multisine
from sysid.data.record import Array, Record
from sysid.errors import DataError, UsageError
from sysid.estimation.look.distortion import distortions, periods_of
from sysid.estimation.look.frequency import (
    FrequencyEstimate,
    blackman_tukey,
    local_models,
    periodic,
    welch,
)
from sysid.estimation.look.impulse import KERNELS, evidence, impulse_response
from sysid.estimation.look.local_models import Complex, local_model

DT = 0.1
B, A = [0.0, 0.2, 0.1], [1.0, -1.3, 0.5]


def logged(n: int, seed: int, noise: float = 0.1) -> Record:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(n)
    y = signal.lfilter(B, A, u) + noise * rng.standard_normal(n)
    return Record(u[:, None], y[:, None], DT)


def impulse(n: int) -> Array:
    return np.asarray(signal.lfilter(B, A, np.eye(1, n)[0]))


@pytest.mark.parametrize("kernel", KERNELS)
def test_impulse_response_is_the_truth_within_its_band(kernel: str) -> None:
    found = impulse_response([logged(1000, 1)], 0, 60, kernel)
    z = (found.g[:, 0] - impulse(60)) / found.error[:, 0]
    assert np.mean(np.abs(z) < 1.96) > 0.85
    assert np.max(np.abs(found.g[:, 0] - impulse(60))) < 0.02
    assert abs(found.noise - 0.1) < 0.01


def test_the_evidence_is_that_of_the_dense_normal_density() -> None:
    rng = np.random.default_rng(0)
    X, y = rng.standard_normal((30, 5)), rng.standard_normal(30)
    lags = np.arange(1.0, 6.0)
    P = KERNELS["DC"](lags[:, None], lags, 0.8, 0.7)
    found = evidence(X.T @ X, X.T @ y, float(y @ y), np.asarray(np.linalg.cholesky(P)), 0.3, 30)
    dense = stats.multivariate_normal(np.zeros(30), X @ P @ X.T + 0.3 * np.eye(30))
    assert found == pytest.approx(-2.0 * dense.logpdf(y) - 30 * np.log(2.0 * np.pi), rel=1e-10)


def test_far_above_the_noise_it_is_least_squares() -> None:
    r = logged(3000, 2, noise=1e-3)
    X = np.lib.stride_tricks.sliding_window_view(r.u[:, 0], 40)[:, ::-1]
    X, y = X - X.mean(axis=0), r.y[39:, 0] - r.y[39:, 0].mean()
    plain = np.linalg.lstsq(X, y, rcond=None)[0]
    spread = np.sqrt(np.diag(np.linalg.inv(X.T @ X)) * np.sum((y - X @ plain) ** 2) / 2920)
    found = impulse_response([r], 0, 40)
    assert np.all(np.abs(found.g[:12, 0] - plain[:12]) < spread[:12])
    np.testing.assert_allclose(found.error[:8, 0], spread[:8], rtol=0.1)


def test_coloured_noise_leaves_the_bands_honest() -> None:
    """White noise assumed, errors of an AR(1) with pole 0.95 would be 2 to 3 bands large."""
    z, steps = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.standard_normal(200), 4)
        e = signal.lfilter([1.0], [1.0, -0.95], 0.1 * rng.standard_normal(800))
        r = Record(u[:, None], (signal.lfilter(B, A, u) + e)[:, None], DT)
        found = impulse_response([r], 0, 40)
        z.append((found.g[:20, 0] - impulse(20)) / found.error[:20, 0])
        steps.append((found.step[:, 0] - np.cumsum(impulse(40))) / found.step_error[:, 0])
    assert np.sqrt(np.mean(np.square(z))) < 1.3
    assert np.sqrt(np.mean(np.square(steps))) < 1.4


def test_regularisation_beats_least_squares() -> None:
    """The reason for it: on short logs its error is a fraction of that of plain least squares."""
    ratios = []
    for seed in range(5):
        r = logged(200, seed)
        n = 50
        X = np.lib.stride_tricks.sliding_window_view(r.u[:, 0], n)[:, ::-1]
        plain = np.linalg.lstsq(X, r.y[n - 1 :, 0], rcond=None)[0]
        found = impulse_response([r], 0, n).g[:, 0]
        ratios.append(np.linalg.norm(found - impulse(n)) / np.linalg.norm(plain - impulse(n)))
    assert np.mean(ratios) < 0.6


def test_the_step_response_is_the_sum() -> None:
    r = logged(120, 3)
    found = impulse_response([r], 0, 20, "TC")
    assert found.step.shape == (20, 1)
    np.testing.assert_allclose(found.step[:, 0], np.cumsum(found.g[:, 0]), atol=1e-12)
    assert np.all(found.step_error > 0.0)


@pytest.mark.parametrize("method", [local_models, welch, blackman_tukey])
def test_bands_hold_the_truth(method: Callable[[list[Record]], FrequencyEstimate]) -> None:
    """12 logs of 100 lines, neighbours correlated: the study has the share to a percent."""
    inside = []
    for seed in range(12):
        f = method([logged(600, 100 + seed)])
        truth = signal.freqz(B, A, f.w * DT)[1]
        inside.append(np.mean(np.abs(f.value[:, 0, 0] - truth) < f.radius[:, 0, 0]))
    assert 0.9 < np.mean(inside) < 0.99


def test_local_modelss_do_not_leak() -> None:
    """A resonance that rings through a short record: windows smear it, polynomials follow it."""
    ring = [1.0, -1.9, 0.98]
    rng = np.random.default_rng(0)
    u = rng.standard_normal(1000)
    r = Record(u[:, None], signal.lfilter([0.0, 1.0], ring, u)[:, None], DT)
    gone = []
    for f in (local_models([r]), welch([r])):
        truth = signal.freqz([0.0, 1.0], ring, f.w * DT)[1]
        gone.append(np.median(np.abs(f.value[:, 0, 0] / truth - 1.0)))
    assert gone[0] < 0.3 * gone[1]


def resonance(n: int, seed: int) -> tuple[Record, Array, Array]:
    """A damping of half a per cent, a tenth as wide as a window; and its b and a."""
    rng = np.random.default_rng(seed)
    a = np.real(np.poly(0.996 * np.exp([0.8j, -0.8j])))
    b = np.array([0.0, 0.02, 0.01])
    u = rng.standard_normal(n + 2000)
    y = signal.lfilter(b, a, u)
    y = (y + 0.03 * np.std(y) * rng.standard_normal(len(u)))[2000:]
    return Record(u[2000:, None], y[:, None], DT), b, a


def test_rational_functions_follow_a_resonance() -> None:
    r, b, a = resonance(800, 1)
    gone, inside = [], []
    for rational in (False, True):
        f = local_models([r], rational)
        truth = signal.freqz(b, a, f.w * DT)[1]
        error = np.abs(f.value[:, 0, 0] - truth)
        gone.append(np.linalg.norm(error) / np.linalg.norm(truth))
        inside.append(np.mean(error < f.radius[:, 0, 0]))
    assert gone[1] < 0.2 < gone[0]
    assert inside[1] > 0.88  # of 149 places that go together in windows: 95 % ± 4 %


def test_a_rational_window_is_a_least_squares_fit() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(-1.0, 1.0, 15)
    lines: Complex = rng.standard_normal((15, 2)) + 1j * rng.standard_normal((15, 2))
    U, V = np.split(lines, 2, axis=1)
    Y = (1.0 + 0.3j) * U / (1.0 + (0.5 - 0.6j) * x[:, None]) + 0.1 + 0.05 * V

    def errors(p: Array) -> Array:
        c = p[:7] + 1j * p[7:]
        N, T = np.polyval(c[2::-1], x), np.polyval(c[5:2:-1], x)
        e = Y[:, 0] - (N * U[:, 0] + T) / (1.0 + c[6] * x)
        return np.concatenate([e.real, e.imag])

    start = np.zeros(14)
    start[[0, 6, 7, 13]] = 1.0, 0.5, 0.3, -0.6
    best = optimize.least_squares(errors, start, xtol=1e-12, ftol=1e-12)
    found = local_model(U, Y, x, rational=True)
    assert found.left[0] == pytest.approx(2.0 * best.cost, rel=1e-3)  # its rounds end near it
    gone = abs(found.value[0, 0] - (best.x[0] + 1j * best.x[7]))
    assert gone < 0.05 * np.sqrt(found.spread[0, 0] * found.left[0] / found.freedom)


def test_blackman_tukey_is_the_sum_of_weighed_correlations() -> None:
    r = logged(400, 5)
    found = blackman_tukey([r], 40)
    u, y = r.u[:, 0] - r.u.mean(), r.y[:, 0] - r.y.mean()
    lag = np.arange(-40, 41)
    window = 0.5 * (1.0 + np.cos(np.pi * lag / 40))

    def spectrum(a: Array, b: Array, w: float) -> complex:
        n = len(a)
        R = [
            np.sum(a[max(k, 0) : n + min(k, 0)] * b[max(-k, 0) : n - max(k, 0)])
            for k in lag.tolist()
        ]
        return complex(np.sum(window * np.array(R) * np.exp(-1j * w * lag)))

    for k in (0, 60, 149):
        w = float(found.w[k]) * DT
        wanted = spectrum(y, u, w) / spectrum(u, u, w)
        np.testing.assert_allclose(found.value[k, 0, 0], wanted, rtol=1e-9)


def periods(curve: str, seeds: tuple[int, ...] = (0,)) -> list[Record]:
    records = []
    for seed in seeds:
        s = multisine(51.2, DT, 15000.0, (0.0, 2.0), seed, ("u",), odd=True, periods=4)
        u = s.excited[: 4 * 512] / 15000.0
        v = {"line": u, "square": u + 0.1 * u**2, "cube": u + 0.1 * u**3}[curve]
        noise = 1e-3 * np.random.default_rng(seed).standard_normal(u.shape)
        y = signal.lfilter(B, A, v, axis=0) + noise
        records.append(Record(u, y, DT))
    return records


@pytest.mark.parametrize("method", [local_models, welch, blackman_tukey])
def test_noise_is_a_one_sided_density(method: Callable[[list[Record]], FrequencyEstimate]) -> None:
    """White noise of σ has 2 σ² Δt everywhere; 3 % of 4000 samples are its error, windows bias."""
    f = method([logged(4000, 4, noise=0.5)])
    high = f.w > 0.3 * f.w[-1]
    assert np.mean(f.noise[high, 0]) == pytest.approx(2.0 * 0.25 * DT, rel=0.15)


def test_records_share_their_noise() -> None:
    """Four records of other lengths: a half of the error of one, and it holds."""
    records = [logged(n, 50 + n) for n in (600, 590, 580, 570)]
    one, four = local_models(records[:1]), local_models(records)
    assert np.median(four.error / one.error) == pytest.approx(0.5, abs=0.1)
    truth = signal.freqz(B, A, four.w * DT)[1]
    assert np.mean(np.abs(four.value[:, 0, 0] - truth) < four.radius[:, 0, 0]) > 0.85


def test_inputs_that_move_together_have_no_response_each() -> None:
    r = logged(600, 0)
    twins = Record(np.hstack([r.u, 2.0 * r.u]), r.y, DT)
    found = local_models([twins])
    assert not np.any(np.isfinite(found.error))
    assert found.trusted_up_to(0, 0) == 0.0
    with pytest.raises(DataError, match="no frequency"):
        found.as_data(twins)


def test_periods_give_the_ratio_of_mean_spectra_and_its_band() -> None:
    inside = []
    for seed in range(10):
        (r,) = periods("line", (seed,))
        f = periodic([r])
        assert f is not None
        Y, U = np.fft.rfft(r.y[512:, 0]), np.fft.rfft(r.u[512:, 0])
        lines = np.rint(f.w / (2.0 * np.pi) * 3 * 512 * DT).astype(int)
        np.testing.assert_allclose(f.value[:, 0, 0], Y[lines] / U[lines], rtol=1e-10)
        truth = signal.freqz(B, A, f.w * DT)[1]
        inside.append(np.mean(np.abs(f.value[:, 0, 0] - truth) < f.radius[:, 0, 0]))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.025)  # 780 lines: σ = 0.8 %


def test_realisations_add_the_variance_of_the_nonlinearity() -> None:
    seeds = (0, 1, 2, 3, 4)
    linear, bent = periodic(periods("line", seeds)), periodic(periods("cube", seeds))
    assert linear is not None
    assert bent is not None
    assert np.median(bent.error) > 3.0 * np.median(linear.error)


def test_even_and_odd_distortions_are_told_apart() -> None:
    levels = {}
    for curve in ("line", "square", "cube"):
        found = distortions(periods(curve), 0)
        assert found is not None
        assert found.period == 512
        levels[curve] = (found.even, found.odd)
        assert (found.even_seen, found.odd_seen) == (curve == "square", curve == "cube")
    assert levels["line"][0] < -50 and levels["line"][1] < -50  # noqa: PT018
    assert levels["square"][0] > levels["square"][1] + 15
    assert levels["cube"][1] > levels["cube"][0] + 15


def test_realisations_show_the_variance_of_a_nonlinearity() -> None:
    linear = distortions(periods("line", (0, 1, 2)), 0)
    bent = distortions(periods("cube", (0, 1, 2)), 0)
    assert linear is not None
    assert bent is not None
    assert bent.nonlinear > linear.nonlinear + 10


def test_rests_at_the_ends_are_no_part_of_the_periods() -> None:
    (r,) = periods("cube")
    still = np.zeros((10, 1))
    whole = Record(np.vstack([still, r.u, still]), np.vstack([still, r.y, still]), DT)
    ours, theirs = distortions([whole], 0), distortions([r], 0)
    assert ours is not None
    assert theirs is not None
    assert ours.periods == theirs.periods == (3,)
    assert ours.odd == pytest.approx(theirs.odd, abs=1e-9)


def test_no_period_no_distortions() -> None:
    assert periods_of(logged(500, 0)) is None
    assert distortions([logged(500, 0)], 0) is None


def test_the_whole_look() -> None:
    found = sysid.look(logged(1500, 7))
    (path,) = found.paths
    gain = sum(B) / sum(A)
    assert abs(path.gain - gain) < 3.0 * path.gain_error + 0.01
    assert path.settles
    assert path.delay is not None
    assert path.delay.delay == 1
    assert 0.5 < path.trusted_hz <= 5.0
    with pytest.raises(DataError, match="too few"):
        sysid.look(logged(20, 0))


def test_a_slow_plant_is_looked_at_in_longer_steps() -> None:
    """Time constant 400 samples: 120 of them show nothing of the gain."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.standard_normal(40), 500)
    y = signal.lfilter([0.0, 1.0 / 400.0], [1.0, -1.0 + 1.0 / 400.0], u)
    y += 0.02 * rng.standard_normal(len(y))
    found = sysid.look(Record(u[:, None], y[:, None], 0.01))
    (path,) = found.paths
    assert found.impulses[0].dt > 0.05
    assert path.settles
    assert abs(path.gain - 1.0) < 3.0 * path.gain_error + 0.01
    assert path.rise_s == pytest.approx(4.0, rel=0.15)


def test_a_controller_is_said() -> None:
    rng = np.random.default_rng(0)
    u, y = np.zeros(800), np.zeros(800)
    for k in range(1, 800):
        y[k] = 0.8 * y[k - 1] + 0.5 * u[k - 1] + 0.1 * rng.standard_normal()
        u[k] = -0.6 * y[k] + 0.05 * rng.standard_normal()
    assert sysid.look(Record(u[:, None], y[:, None], DT)).closed_loop
    assert not sysid.look(logged(800, 1)).closed_loop


def test_an_odd_multisine_is_odd_and_periodic() -> None:
    s = multisine(20.0, DT, 15000.0, (0.0, 3.0), 1, ("u",), odd=True, periods=3)
    u = s.excited[:200, 0]
    lines = np.abs(np.fft.rfft(u))
    excited = np.flatnonzero(lines > 1e-2 * lines.max())
    assert np.all(excited % 2 == 1)
    odd = np.arange(1, excited.max() + 1, 2)
    assert 0.6 < len(excited) / len(odd) < 0.9
    with pytest.raises(UsageError, match="periods"):
        multisine(20.0, DT, 15000.0, (0.0, 3.0), periods=0)


def test_a_polynomial_window_is_least_squares_and_its_lines_left_out_are_refits() -> None:
    rng = np.random.default_rng(4)
    x = np.linspace(-1.0, 1.0, 13)
    lines: Complex = rng.standard_normal((13, 2)) + 1j * rng.standard_normal((13, 2))
    U, Y = np.split(lines, 2, axis=1)
    K = np.column_stack([U[:, 0] * x**k for k in range(3)] + [x**k for k in range(3)])
    found = local_model(U, Y, x, rational=False)
    theta = np.linalg.lstsq(K, Y[:, 0], rcond=None)[0]
    assert found.value[0, 0] == pytest.approx(theta[0], rel=1e-10)
    assert found.spread[0, 0] == pytest.approx(np.linalg.inv(K.conj().T @ K)[0, 0].real, rel=1e-9)
    unseen = 0.0
    for k in range(13):
        rest = np.arange(13) != k
        without = np.linalg.lstsq(K[rest], Y[rest, 0], rcond=None)[0]
        unseen += abs(Y[k, 0] - K[k] @ without) ** 2
    assert found.unseen[0] == pytest.approx(unseen, rel=1e-9)
