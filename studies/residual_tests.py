"""How often do the residual tests alarm: on right models (should be 1 %) and on wrong ones?

Simulates right and wrong models, fits them with the plainest means (least squares for ARX,
scipy's Levenberg–Marquardt for OE; none of this package's estimators) and counts alarms at a
nominal 1 %. Twelve minutes of one core.
"""

from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.optimize import least_squares
from scipy.signal import lfilter

from studies.residual_correlations import autocorrelation, cross_correlation
from studies.runner import Study, by_case, fewer
from sysid.criteria.output_residuals import OutputResiduals
from sysid.criteria.residuals import whiteness_test
from sysid.data.checks.feedback import feedback_tests
from sysid.data.record import Record
from sysid.report.markdown import table

Array = NDArray[np.float64]
Generator = np.random.Generator
STUDY = Study("residual_tests", "residual_tests.md", runs=500)
LAGS = 25
RUN_IN = 500
"""Samples simulated before a record begins, so that noise and slow inputs are stationary."""


@dataclass(frozen=True)
class Transfer:
    """One path B/F from an input: b, (f1, …), and the delay nk."""

    b: tuple[float, ...]
    f: tuple[float, ...]
    nk: int


@dataclass(frozen=True)
class Residuals:
    """What the tests are given: residuals, inputs and Jacobian, one array a record."""

    errors: list[Array]
    inputs: list[Array]
    jacobian: list[Array]


@dataclass(frozen=True)
class Case:
    """A simulated situation: a truth, a model fitted to it, and whether that model is right."""

    name: str
    simulate: Callable[[Generator, int], Residuals]
    noise_parameters: int = 0
    noise_model: bool = False


PLANT = (Transfer((0.3, 0.2), (-1.2, 0.5), 1),)
TWO_INPUTS = (*PLANT, Transfer((0.5,), (-0.8,), 2))


def shifted(x: Array, k: int) -> Array:
    """x(t − k), at rest before the record."""
    return np.concatenate([np.zeros(k), x[: len(x) - k]]) if k else x


def draw_input(rng: Generator, samples: int, kind: str) -> Array:
    """A white, slow (AR(1), pole 0.95) or stepwise (25 samples a level) input."""
    if kind == "slow":
        return lfilter([1.0], [1.0, -0.95], rng.standard_normal(samples + RUN_IN))[RUN_IN:]
    if kind == "steps":
        return np.repeat(rng.uniform(-1.0, 1.0, samples // 25 + 1), 25)[:samples]
    return rng.standard_normal(samples)


def respond(paths: tuple[Transfer, ...], u: Array) -> Array:
    """Output of all paths, at rest before the record."""
    return sum(shifted(lfilter(p.b, (1.0, *p.f), u[:, i]), p.nk) for i, p in enumerate(paths))  # type: ignore[return-value]


def oe_fit(
    paths: tuple[Transfer, ...],
    ys: list[Array],
    us: list[Array],
    held: dict[int, float] | None = None,
    bounds: tuple[float, float] = (-np.inf, np.inf),
) -> Residuals:
    """Output error by Levenberg–Marquardt from ``paths``, several records joined.

    ``held`` fixes entries of (b…, f…) of the paths; ``bounds`` limit the last free one. Neither a
    held entry nor one that ends on its bound has a column in the Jacobian.
    """

    def unpack(theta: Array) -> tuple[Transfer, ...]:
        out, at = [], 0
        for p in paths:
            b, f = theta[at : at + len(p.b)], theta[at + len(p.b) : at + len(p.b) + len(p.f)]
            out.append(Transfer(tuple(b), tuple(f), p.nk))
            at += len(p.b) + len(p.f)
        return tuple(out)

    def errors(theta: Array) -> Array:
        fitted = unpack(theta)
        return np.concatenate([y - respond(fitted, u) for y, u in zip(ys, us, strict=True)])

    def gradient(theta: Array) -> Array:
        """∂ŷ/∂b_j = q^−(nk+j) u/F, ∂ŷ/∂f_j = −q^−j ŷ/F."""
        rows = []
        for u in us:
            columns = []
            for i, p in enumerate(unpack(theta)):
                filtered = lfilter([1.0], (1.0, *p.f), u[:, i])
                own = shifted(lfilter(p.b, (1.0, *p.f), filtered), p.nk)
                columns += [shifted(filtered, p.nk + j) for j in range(len(p.b))]
                columns += [-shifted(own, j + 1) for j in range(len(p.f))]
            rows.append(np.column_stack(columns))
        return np.concatenate(rows)

    start = np.concatenate([(*p.b, *p.f) for p in paths])
    start[list(held or {})] = list((held or {}).values())
    free = np.array([k for k in range(len(start)) if k not in (held or {})])
    low, high = np.full(len(free), -np.inf), np.full(len(free), np.inf)
    low[-1], high[-1] = bounds
    limited = bool(np.isfinite(bounds).any())

    def whole(part: Array) -> Array:
        theta = start.copy()
        theta[free] = part
        return theta

    result = least_squares(
        lambda part: errors(whole(part)),
        np.clip(start[free], low + 1e-3, high - 1e-3),
        jac=lambda part: -gradient(whole(part))[:, free],
        bounds=(low, high) if limited else (-np.inf, np.inf),
        method="trf" if limited else "lm",
    )
    cuts = np.cumsum([len(y) for y in ys])[:-1]
    moved = np.abs(result.x - low) > 1e-6, np.abs(result.x - high) > 1e-6
    estimated = free[moved[0] & moved[1]]
    jacobian = gradient(whole(result.x))[:, estimated]
    return Residuals(np.split(result.fun, cuts), us, np.split(jacobian, cuts))


def arx_fit(
    na: int, nb: int, nk: int, y: Array, u: Array, held: dict[int, float] | None = None
) -> Residuals:
    """ARX by least squares; the first samples, whose regressors are unknown, stay NaN.

    ``held`` fixes entries of (a…, b…); their columns are not in the Jacobian.
    """
    columns = [-shifted(y, k) for k in range(1, na + 1)]
    columns += [shifted(u[:, 0], nk + k) for k in range(nb)]
    phi = np.column_stack(columns)
    first = max(na, nk + nb - 1)
    free = [k for k in range(phi.shape[1]) if k not in (held or {})]
    theta = np.zeros(phi.shape[1])
    theta[list(held or {})] = list((held or {}).values())
    rest = y - phi @ theta
    theta[free] = np.linalg.lstsq(phi[first:, free], rest[first:], rcond=None)[0]
    errors = y - phi @ theta
    errors[:first] = np.nan
    return Residuals([errors], [u], [phi[:, free]])


def coloured(rng: Generator, samples: int, alpha: tuple[float, ...]) -> Array:
    """Unit-variance AR noise."""
    v = lfilter([1.0], alpha, rng.standard_normal(samples + RUN_IN))[RUN_IN:]
    return np.asarray(v / v.std())


def oe_case(
    kind: str,
    noise: tuple[float, ...],
    *,
    paths: tuple[Transfer, ...] = PLANT,
    model: tuple[Transfer, ...] | None = None,
    records: int = 1,
    ratio: float = 0.3,
    held: dict[int, float] | None = None,
    bounds: tuple[float, float] = (-np.inf, np.inf),
) -> Callable[[Generator, int], Residuals]:
    """OE data, noise at ``ratio`` of the output's standard deviation, and the fit of ``model``."""

    def simulate(rng: Generator, samples: int) -> Residuals:
        us, ys = [], []
        for _ in range(records):
            each = samples // records
            u = np.column_stack([draw_input(rng, each, kind) for _ in paths])
            y = respond(paths, u)
            us.append(u)
            ys.append(y + ratio * y.std() * coloured(rng, each, noise))
        return oe_fit(model or paths, ys, us, held, bounds)

    return simulate


def arx_case(
    kind: str,
    *,
    na: int = 2,
    nb: int = 2,
    nk: int = 1,
    ratio: float = 0.3,
    gain: float = 0.0,
    held: dict[int, float] | None = None,
) -> Callable[[Generator, int], Residuals]:
    """ARX data with plant :data:`PLANT`, u = reference − gain y(t−1), and an ARX fit."""
    a, b = (1.0, *PLANT[0].f), (0.0, *PLANT[0].b)
    closed = np.polyadd(np.array([*a, 0.0, 0.0]), gain * np.array([0.0, 0.0, *b[1:], 0.0]))

    def simulate(rng: Generator, samples: int) -> Residuals:
        r = draw_input(rng, samples + RUN_IN, kind)
        e = rng.standard_normal(samples + RUN_IN)
        e *= ratio * lfilter(b, a, r).std() / lfilter([1.0], a, e).std()
        y = lfilter(b, closed, r) + lfilter([1.0], closed, e)
        u = r - gain * shifted(y, 1)
        return arx_fit(na, nb, nk, y[RUN_IN:], u[RUN_IN:, None], held)

    return simulate


AR1, AR2 = (1.0, -0.9), (1.0, -1.8, 0.9)
RIGHT = (
    Case("ARX, white input", arx_case("white"), 2, True),
    Case("ARX, slow input", arx_case("slow"), 2, True),
    Case("ARX, steps", arx_case("steps"), 2, True),
    Case("ARX, little noise (3 %), slow input", arx_case("slow", ratio=0.03), 2, True),
    Case("OE, white noise, white input", oe_case("white", (1.0,)), 0, True),
    Case("OE, AR(1) noise, white input", oe_case("white", AR1)),
    Case("OE, AR(1) noise, slow input", oe_case("slow", AR1)),
    Case("OE, AR(1) noise, steps", oe_case("steps", AR1)),
    Case("OE, AR(2) noise, slow input", oe_case("slow", AR2)),
    Case("OE, AR(2) noise, slow input, little noise (3 %)", oe_case("slow", AR2, ratio=0.03)),
    Case("OE, AR(1) noise, 2 slow inputs, 2 records",
         oe_case("slow", AR1, paths=TWO_INPUTS, records=2)),
)  # fmt: skip
# entries of ARX's (a1, a2, b1, b2) and of OE's (b1, b2, f1, f2)
RIGHT += (
    Case("ARX, a1 fixed at its true value, slow input", arx_case("slow", held={0: -1.2}), 1, True),
    Case("OE, AR(1) noise, f1 fixed at its true value, slow input",
         oe_case("slow", AR1, held={2: -1.2})),
    Case("OE, AR(1) noise, f2 bounded by its true value, slow input",
         oe_case("slow", AR1, bounds=(0.5, 0.9))),
)  # fmt: skip
FIRST_ORDER = (Transfer((0.5,), (-0.8,), 1),)
LATE = (Transfer(PLANT[0].b, PLANT[0].f, 3),)
WRONG = (
    Case("ARX, a pole missing (na 1 for 2), slow input", arx_case("slow", na=1), 1, True),
    Case("ARX, delay 1 too long, white input", arx_case("white", nk=2), 2, True),
    Case("OE, AR(1) noise, a pole missing, slow input", oe_case("slow", AR1, model=FIRST_ORDER)),
    Case("OE, AR(1) noise, a pole missing, steps", oe_case("steps", AR1, model=FIRST_ORDER)),
    Case("OE, AR(1) noise, delay 2 too short, slow input",
         oe_case("slow", AR1, paths=LATE, model=PLANT)),
    Case("OE, AR(1) noise, delay 2 too long, slow input", oe_case("slow", AR1, model=LATE)),
    Case("ARX, a1 fixed at -1 for -1.2, slow input", arx_case("slow", held={0: -1.0}), 1, True),
    Case("ARX, b1 fixed at 0.2 for 0.3, white input", arx_case("white", held={2: 0.2}), 2, True),
    Case("OE, AR(1) noise, f1 and f2 fixed at -1 and 0.35, white input",
         oe_case("white", AR1, held={2: -1.0, 3: 0.35})),
    Case("OE, white noise, f2 bounded at 0.4 for 0.5, white input",
         oe_case("white", (1.0,), bounds=(0.0, 0.4))),
    Case("ARX right, but feedback with gain 0.5, as much noise as signal",
         arx_case("white", gain=0.5, ratio=1.0), 2, True),
)  # fmt: skip

Alarms = dict[str, float]
COLUMNS = {
    "white": "whiteness",
    "ljung_box": "Ljung–Box, dof = 25 − na",
    "independent": "independence",
    "unprojected": "independence without J",
    "feedback": "feedback",
    "naive_any": "a lag outside 2.58/√N",
    "band_share": "lags outside the P band",
}


def alarms(case: Case, seed: int, samples: int) -> Alarms:
    """One replicate: 1 for each test that alarms (a share of lags for ``band_share``)."""
    data = case.simulate(np.random.default_rng([seed, samples]), samples)
    e, u, j = data.errors, data.inputs, data.jacobian
    cross, given = cross_correlation(e, u), OutputResiduals.of(e, u, j)
    past = np.abs(cross.values[cross.lags >= 0])
    out = {
        "independent": not given.independence().passed,
        "unprojected": not OutputResiduals.of(e, u).independence().passed,
        "feedback": not given.feedback().passed,
        "naive_any": bool((past > 2.58 / np.sqrt(samples)).any()),
        "band_share": float((past > cross.bound).mean()),
    }
    if case.noise_model:
        r = autocorrelation(e).values[1:, 0]
        weights = samples * (samples + 2.0) / (samples - np.arange(1, LAGS + 1))
        out["white"] = not whiteness_test(e, j).passed
        out["ljung_box"] = bool(special.chdtrc(LAGS - case.noise_parameters, r**2 @ weights) < 0.01)
    return {k: float(v) for k, v in out.items()}


def alarms_of(name: str, seed: int, samples: int) -> Alarms:
    """One replicate of a case of the report."""
    return alarms(next(c for c in (*RIGHT, *WRONG) if c.name == name), seed, samples)


def rates(draws: Sequence[Alarms]) -> Alarms:
    """Alarm rates [%] over replicates of a case."""
    return {k: 100.0 * float(np.mean([d[k] for d in draws])) for k in draws[0]}


@dataclass(frozen=True)
class Log:
    """A simulated log for the test of feedback that ``sysid inspect`` makes, before any model."""

    name: str
    simulate: Callable[[Generator, int], Record]


def smooth_input(rng: Generator, samples: int, kind: str) -> Array:
    """A multisine of 19 lines or a chirp, which any few samples of theirs foretell."""
    k = np.arange(samples)
    if kind == "chirp":
        return np.sin(2.0 * np.pi * (0.005 * k + 0.05 * k**2 / samples) + rng.uniform(0.0, 6.28))
    phase = 2.0 * np.pi * np.outer(k, np.arange(1, 20)) / 200.0
    return np.cos(phase + rng.uniform(0.0, 2.0 * np.pi, 19)).sum(axis=1) / 5.0


def open_log(
    kind: str, noise: tuple[float, ...] = (1.0,), *, delay: int = 1, bend: float = 0.0
) -> Callable[[Generator, int], Record]:
    """:data:`PLANT` behind a delay; ``bend`` adds u|u|, which makes it nonlinear."""

    def simulate(rng: Generator, samples: int) -> Record:
        smooth = kind in ("multisine", "chirp")
        u = (smooth_input if smooth else draw_input)(rng, samples, kind)
        late = shifted(u, delay)
        y = lfilter(PLANT[0].b, (1.0, *PLANT[0].f), late + bend * late * np.abs(late))
        y = y + 0.2 * y.std() * coloured(rng, samples, noise)
        return Record(u[:, None], y[:, None], 0.1)

    return simulate


def loop_log(
    gain: float, integral: float = 0.0, colour: float = 0.0, kind: str = "steps"
) -> Callable[[Generator, int], Record]:
    """:data:`PLANT` with process noise under a controller that answers in the same row."""

    def simulate(rng: Generator, samples: int) -> Record:
        r = draw_input(rng, samples, kind)
        push = 0.1 * lfilter([1.0], [1.0, -colour], rng.standard_normal(samples))
        u, y, total = np.zeros(samples), np.zeros(samples), 0.0
        for t in range(samples):
            y[t] = push[t]
            for k in (1, 2):
                if t >= k:
                    y[t] += PLANT[0].b[k - 1] * u[t - k] - PLANT[0].f[k - 1] * y[t - k]
            total += integral * (r[t] - y[t])
            u[t] = gain * (r[t] - y[t]) + total
        return Record(u[:, None], y[:, None], 0.1)

    return simulate


OPEN_LOGS = (
    *(Log(f"open loop, {kind}", open_log(kind))
      for kind in ("white", "slow", "steps", "multisine", "chirp")),
    Log("open loop, steps, AR(1) noise", open_log("steps", AR1)),
    Log("open loop, multisine, AR(2) noise", open_log("multisine", AR2)),
    Log("open loop, white, feedthrough", open_log("white", delay=0)),
    Log("open loop, steps, delay 21", open_log("steps", delay=21)),
    Log("open loop, slow, delay 61, AR(1) noise", open_log("slow", AR1, delay=61)),
    Log("open loop, multisine, u + 0.3 u|u|", open_log("multisine", bend=0.3)),
)  # fmt: skip
LOOP_LOGS = (
    Log("P control in the same row, gain 0.5", loop_log(0.5)),
    Log("P control in the same row, gain 0.1", loop_log(0.1)),
    Log("PI control in the same row", loop_log(0.3, 0.05)),
    Log("PI control in the same row, AR(1) noise", loop_log(0.3, 0.05, 0.9)),
    Log("PI control in the same row, white reference", loop_log(0.3, 0.05, kind="white")),
)


def feedback_seen(name: str, seed: int, samples: int) -> bool:
    """Whether one simulated log is called recorded in closed loop."""
    log = next(x for x in (*OPEN_LOGS, *LOOP_LOGS) if x.name == name)
    record = log.simulate(np.random.default_rng([seed, samples]), samples)
    return any(t.seen for t in feedback_tests([record]))


def feedback_table(logs: Sequence[Log], asked: Namespace, lengths: tuple[int, ...]) -> str:
    """How often feedback is seen [%], a row a log."""
    found = [by_case(feedback_seen, [x.name for x in logs], asked, n) for n in lengths]
    rows = [[x.name, *(f"{100.0 * np.mean(f[x.name]):.1f}" for f in found)]
            for x in logs if all(x.name in f for f in found)]  # fmt: skip
    return table(["log", *(f"N = {n}" for n in lengths)], rows, "l" + "r" * len(lengths))


def alarm_table(cases: Sequence[Case], asked: Namespace, lengths: tuple[int, ...]) -> str:
    """Alarm rates, a row a case and length."""
    found = {n: by_case(alarms_of, [c.name for c in cases], asked, n) for n in lengths}
    rows = []
    for case in cases:
        for n in lengths:
            if draws := found[n].get(case.name):
                seen = rates(draws)
                cells = [f"{seen[k]:.1f}" if k in seen else "–" for k in COLUMNS]
                rows.append([case.name, str(n), *cells])
    return table(["model", "N", *COLUMNS.values()], rows, "l" + "r" * (1 + len(COLUMNS)))


def main() -> None:
    """Run the study and write its report."""
    asked = STUDY.asked(__doc__)
    half, quarter, tenth = (fewer(asked, k) for k in (2, 4, 10))
    error = 100.0 * np.sqrt(0.0099 / asked.runs)
    parts = [
        HEAD.format(replicates=asked.runs, error=error),
        alarm_table(RIGHT, asked, (300, 1000, 2000)),
        MIDDLE.format(replicates=quarter.runs),
        alarm_table(WRONG, quarter, (300, 1000)),
        FEEDBACK.format(replicates=half.runs),
        feedback_table(OPEN_LOGS, half, (300, 1000)),
        LOOPS,
        feedback_table(LOOP_LOGS, tenth, (300, 1000)),
    ]
    STUDY.write(asked, "\n".join(parts))


HEAD = """# Alarm rates of the residual tests

Share [%] of simulated models on which a test alarms at a nominal 1 %.

## Right models: every figure should be 1

{replicates} replicates a line, standard error {error:.1f}. Noise is 30 % of the output's standard
deviation unless said otherwise. The columns "Ljung–Box", "independence without J" and "a lag
outside 2.58/√N" are what the tests replace: parameters taken off the degrees of freedom, the fitted
parameters' share not projected out, and the band for white residuals. "Lags outside the P band" is
the share of single lags (0…25), not of models.

OE lines of 300 samples with AR noise and steps, a slow input or a bound lie above 1. That is the
fit's doing, not the test's: with so little information the estimate leaves the region where the
model is linear in its parameters. With a tenth of the noise they do not.
"""
MIDDLE = """
## Wrong models: 100 is full power

{replicates} replicates a line. A test alarms where its kind of error is present: feedback only in
the last case, whiteness wherever dynamics or noise model are too small.
"""

FEEDBACK = """
## Feedback, before any model

How often [%] `sysid inspect` says that a log was recorded in closed loop. In open loop every figure
should be 1 at most; {replicates} replicates a line.
"""
LOOPS = """
With a controller 100 is full power:
"""

if __name__ == "__main__":
    main()
