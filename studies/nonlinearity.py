"""How often the test for nonlinearity of a log alarms on linear plants, and what it finds."""

from argparse import Namespace
from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter
from sysid_datasets import path as bundled
from sysid_datasets.generate import OMEGA_SIGMA, truth_of
from sysid_datasets.twin import Twin

from studies.records import TRIALS, data_folder
from studies.runner import Study, by_case
from sysid.criteria.fit import Array
from sysid.data.checks.nonlinearity import NonlinearityTest, nonlinearity_tests
from sysid.data.io import read_log
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Record
from sysid.report.markdown import table

STUDY = Study("nonlinearity", "nonlinearity.md", runs=60)
RUN_IN = 300
Polynomials = tuple[tuple[float, ...], tuple[float, ...]]
PLANTS: dict[str, Polynomials] = {
    "first order, slow": ((0.0, 0.05), (1.0, -0.95)),
    "second order": ((0.0, 0.1, 0.08), (1.0, -1.5, 0.7)),
    "resonance": ((0.0, 0.5, 0.3), (1.0, -1.7, 0.95)),
}
INPUTS = ("white", "slow", "steps", "two levels", "one-sided steps", "multisine")
NOISES: dict[str, tuple[tuple[float, ...], tuple[float, ...] | None, float]] = {
    "white at the output": ((1.0,), (1.0,), 0.3),
    "in the equation": ((1.0,), None, 0.1),
    "AR(2) at the output": ((1.0,), (1.0, -1.8, 0.9), 0.1),
}
LENGTHS = (300, 1500)
ROBOT_LOGS = ("multilevel", "multisine", "forward_back")
LINEAR_MOSTLY = {"dryer": None, "ballbeam": None, "winding": None, "cdplayer_arm": 1.0}
"""Records without a trial of their own, with the sample time where the file has none."""


def signal(rng: Generator, n: int, kind: str) -> Array:
    """An input of about unit size."""
    if kind == "white":
        return rng.standard_normal(n)
    if kind == "slow":
        return np.asarray(lfilter([0.31], [1.0, -0.95], rng.standard_normal(n)))
    if kind == "steps":
        return np.repeat(rng.uniform(-1.7, 1.7, n // 20 + 1), 20)[:n]
    if kind == "two levels":
        return np.repeat(rng.choice([-1.0, 1.0], n // 5 + 1), 5)[:n]
    if kind == "one-sided steps":
        return np.repeat(rng.uniform(0.0, 3.4, n // 12 + 1), 12)[:n]
    lines = np.arange(1, n // 20)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(lines))
    t = np.arange(n)[:, None]
    return np.asarray(
        np.cos(2.0 * np.pi * lines * t / n + phases).sum(axis=1) * np.sqrt(2.0 / len(lines))
    )


def linear(rng: Generator, n: int, plant: str, kind: str, noise: str) -> list[Record]:
    """A log of a linear plant."""
    b, a = PLANTS[plant]
    top, bottom, ratio = NOISES[noise]
    u = signal(rng, n + RUN_IN, kind)
    x = lfilter(b, a, u)
    v = lfilter(top, a if bottom is None else bottom, rng.standard_normal(n + RUN_IN))
    y = x + ratio * x.std() * v / v.std()
    return [Record(u[RUN_IN:], y[RUN_IN:], 0.1, sha256="simulated")]


def two_by_two(rng: Generator, n: int) -> list[Record]:
    """Two logs of a coupled plant with heavy-tailed noise."""
    found = []
    for _ in range(2):
        u = np.column_stack([signal(rng, n // 2, "steps"), signal(rng, n // 2, "slow")])
        y = np.column_stack([
            lfilter([0.0, 0.5], [1.0, -0.8], u[:, 0]) + lfilter([0.0, 0.2], [1.0, -0.6], u[:, 1]),
            lfilter([0.0, 0.4], [1.0, -0.7], u[:, 1]),
        ])  # fmt: skip
        found.append(Record(u, y + 0.1 * rng.standard_t(5, y.shape), 0.1, sha256="simulated"))
    return found


def closed_loop(rng: Generator, n: int) -> list[Record]:
    """A proportional controller around the second-order plant."""
    reference, e = signal(rng, n, "steps"), rng.standard_normal(n)
    y, u = np.zeros(n), np.zeros(n)
    for t in range(2, n):
        y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + 0.1 * u[t - 1] + 0.08 * u[t - 2] + 0.05 * e[t]
        u[t] = 0.8 * (reference[t] - y[t])
    return [Record(u, y, 0.1, sha256="simulated")]


@cache
def frictionless(name: str) -> tuple[Array, Array]:
    """Commands and speeds of the robot's twin without friction and without a limit of its drive."""
    truth = truth_of(name, Twin(motor_coulomb=0.0, track_load=(0.0, 0.0), duty_limit=1.0))
    return truth.pwm, truth.omega


def linear_robot(rng: Generator, n: int, name: str) -> list[Record]:
    """That robot under the commands of a bundled log, its encoders noisy."""
    pwm, omega = (part[:n] for part in frictionless(name))
    return [
        Record(pwm, omega + OMEGA_SIGMA * rng.standard_normal(omega.shape), 0.1, sha256="simulated")
    ]


PLAIN: dict[str, Callable[[Generator, int], list[Record]]] = {
    f"{kind}, {noise}, {plant}": partial(linear, plant=plant, kind=kind, noise=noise)
    for kind in INPUTS
    for noise in NOISES
    for plant in PLANTS
}
FURTHER: dict[str, Callable[[Generator, int], list[Record]]] = {
    "two coupled outputs, two logs, heavy-tailed noise": two_by_two,
    "closed loop": closed_loop,
    **{f"robot without friction, {k}": partial(linear_robot, name=k) for k in ROBOT_LOGS},
}


def alarm(name: str, seed: int, n: int) -> bool:
    """Whether any output is called nonlinear at 1 % over all outputs."""
    draw = {**PLAIN, **FURTHER}[name]
    tests = nonlinearity_tests(draw(np.random.default_rng([seed, *name.encode()]), n))
    return bool(min(t.p_value for t in tests) * len(tests) < 0.01)


def level_tables(asked: Namespace) -> list[str]:
    """Alarm rates [%] by input and noise, pooled over the plants; further cases below."""
    more = Namespace(**{**vars(asked), "runs": len(PLANTS) * asked.runs})
    hits = {n: by_case(alarm, list(PLAIN), asked, n) for n in LENGTHS}
    others = {n: by_case(alarm, list(FURTHER), more, n) for n in LENGTHS}

    def pooled(n: int, start: str) -> str:
        some = [hit for name, seen in hits[n].items() if name.startswith(start) for hit in seen]
        return f"{100.0 * np.mean(some):.1f}" if some else "–"

    rows = [
        [kind, *(pooled(n, f"{kind}, {noise}, ") for noise in NOISES for n in LENGTHS)]
        for kind in INPUTS
    ]
    heads = ["input", *(f"{noise}, N = {n}" for noise in NOISES for n in LENGTHS)]
    further = [
        [name, *(f"{100.0 * np.mean(others[n].get(name, [])):.1f}" for n in LENGTHS)]
        for name in others[LENGTHS[0]]
    ]
    every = [h for part in (hits, others) for by in part.values() for s in by.values() for h in s]
    return [
        table(heads, rows, "l" + "r" * (len(heads) - 1)),
        table(["further plants", *(f"N = {n}" for n in LENGTHS)], further, "lrr"),
        f"All {len(every)} logs together: {100.0 * np.mean(every):.2f} %.\n",
    ]


def measured() -> list[tuple[str, Sequence[Record]]]:
    """The measured and bundled logs."""
    found: list[tuple[str, Sequence[Record]]] = []
    folder = data_folder()
    if folder is not None:
        for name, ts in LINEAR_MOSTLY.items():
            file = sorted((folder / name).glob("*.csv"))[0]
            found.append((name, [read_log(file, ReadOptions(ts=ts))]))
        skipped = {"robot"}
        found += [(n, make().train) for n, make in TRIALS.items() if n not in skipped]
    names = ("multilevel", "prbs", "multisine", "forward_back", "rotation")
    return found + [(n, [read_log(bundled(n))]) for n in names]


def line(name: str, t: NonlinearityTest) -> list[str]:
    """A row of the table of measured logs."""
    p = f"{t.p_value:.1g}" if t.p_value >= 1e-12 else "< 1e-12"
    says = "nonlinear" if t.p_value < 0.01 else "–"
    return [name, t.output, p, says, f"{100.0 * t.share:.1f}", t.shape]


HEAD = """# The test for nonlinearity of a log

## Linear plants: every figure should be 1

Share [%] of simulated logs of linear plants called nonlinear at a nominal 1 %, {count} logs a
figure (three plants: first order and slow, second order, lightly damped), standard error
{error:.1f}.
"""
MIDDLE = """
## Measured and bundled logs

Estimation parts only. `dryer`, `ballbeam` and `cdplayer_arm` are practically linear. The share is
what products of lags predict of the best linear one-step predictor's error variance; even a trace
may matter in a free run.
"""


def main() -> None:
    """Run the study and write its report."""
    asked = STUDY.asked(__doc__)
    count = asked.runs * len(PLANTS)
    rows = [line(name, t) for name, logs in measured() for t in nonlinearity_tests(logs)]
    heads = ["log", "output", "p", "verdict", "share [%]", "mostly"]
    parts = [
        HEAD.format(count=count, error=100.0 * np.sqrt(0.0099 / count)),
        *level_tables(asked),
        MIDDLE,
        table(heads, rows, "llrlrl"),
    ]
    STUDY.write(asked, "\n".join(parts))


if __name__ == "__main__":
    main()
