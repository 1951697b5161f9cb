"""Are a mission's intervals honest: do 90 % ones of time and final position hold a twin's?

Each twin is a robot of its own numbers. It drives a noisy log, from which its tracks are identified
with the default options; the mission is driven 500 times by the model, as ``--runs 500`` does, and
once by the twin itself. Counted is how often the twin's time and final position lie between the 5 %
and the 95 % quantile of the runs.
Some minutes of one core.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.agreement import figures_alone
from studies.runner import Study, by_case
from sysid.data.record import PWM_FULL_SCALE, Channel, Record
from sysid.effects.ground import Ground
from sysid.estimation.pem import fit
from sysid.report.markdown import table
from sysid.robot.mission.batch.figures import Figures
from sysid.robot.mission.batch.runner import BatchRunner
from sysid.robot.mission.batch.sampler import run_seeds
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.contracts import ROBOT_INPUTS, ROBOT_OUTPUTS
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.spec import Mission
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

Array = NDArray[np.float64]
STUDY = Study("prediction_intervals", "prediction_intervals.md", runs=200)
RUNS = 500
DT = 0.1
SAMPLES = 300
"""Length of a log, 30 s."""

NOISE = 1.5
"""Standard deviation of a reading [rad/s]: a seventh of the speed at half drive."""

LEVEL = 12000.0
"""Commands of a log switch between plus and minus this [µs]."""

MISSION = Mission.model_validate({"goal": (3.0, 1.5), "obstacles": [(1.5, 0.9)]})
QUANTITIES = ("time_s", "x", "y")


@dataclass(frozen=True)
class Twin:
    """Tracks of first order: ω⁺ = aω + b f(u), one a side.

    Attributes:
        a, b: their numbers, (2,).
        dead_zone: share of full drive that moves nothing.
        bend: share that a gain loses at full drive.
    """

    a: Array
    b: Array
    dead_zone: float = 0.0
    bend: float = 0.0
    dt: float = DT
    inputs: tuple[Channel, ...] = ROBOT_INPUTS
    outputs: tuple[Channel, ...] = ROBOT_OUTPUTS
    input_range: tuple[tuple[float, float], ...] = ()
    u_offset: Array = field(default_factory=lambda: np.zeros(2))
    ground: Ground = field(default_factory=Ground)

    def initial_state(self) -> Array:
        """At rest."""
        return np.zeros(2)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """One sample."""
        drive = u / PWM_FULL_SCALE
        moves = np.sign(drive) * np.maximum(np.abs(drive) - self.dead_zone, 0.0)
        moves = PWM_FULL_SCALE * moves * (1.0 - self.bend * np.abs(moves))
        return self.a * state + self.b * moves, state


@dataclass(frozen=True)
class Case:
    """Kind of twin, noise of its log, and what varies in the runs as in the twin's own drive.

    Attributes:
        name: row of the table.
        inside: whether the truth is a model of the structure.
        dead_zone, bend: of the twins.
        colour: pole of the noise.
        vary: names of what varies.
    """

    name: str
    inside: bool = True
    dead_zone: float = 0.0
    bend: float = 0.0
    colour: float = 0.0
    vary: tuple[str, ...] = ("parameters",)


CASES = (
    Case("white noise"),
    Case("noise with pole 0.8", colour=0.8),
    Case("white noise; start, obstacles, slip vary too",
         vary=("parameters", "start", "obstacles", "friction")),
    Case("dead zone of 5 % of full drive", inside=False, dead_zone=0.05),
    Case("gain falls by 15 % to full drive", inside=False, bend=0.15),
)  # fmt: skip


def twin_of(case: Case, seed: int) -> Twin:
    """A robot of its own numbers: lags 0.15 to 0.35 s, gains 10 % apart."""
    rng = np.random.default_rng((seed, 1))
    a = np.exp(-DT / rng.uniform(0.15, 0.35, 2))
    gain = 1e-3 * rng.uniform(0.9, 1.1, 2)
    return Twin(a, (1.0 - a) * gain, case.dead_zone, case.bend)


def identified(case: Case, twin: Twin, seed: int) -> Model:
    """Its tracks as a fit finds them from one noisy log."""
    rng = np.random.default_rng((seed, 2))
    u = LEVEL * rng.choice([-1.0, 1.0], (SAMPLES, 2)).repeat(3, axis=0)[:SAMPLES]
    state, rows = twin.initial_state(), []
    for now in u:
        state, y = twin.step(state, now)
        rows.append(y)
    e = rng.standard_normal((SAMPLES, 2))
    for k in range(1, SAMPLES):
        e[k] = case.colour * e[k - 1] + math.sqrt(1.0 - case.colour**2) * e[k]
    own = {"nb": [[1, 0], [0, 1]], "nf": [[1, 0], [0, 1]], "nk": 1}
    record = Record(u, np.array(rows) + NOISE * e, DT, ROBOT_INPUTS, ROBOT_OUTPUTS)
    return fit(structure_class("oe").from_orders(own, 2, 2), [record])


def setup_of(case: Case, seed: int) -> Setup:
    """The mission as the model of a twin drives it."""
    return Setup.of(MISSION, [identified(case, twin_of(case, seed), seed)], case.vary)


@cache
def compiled(name: str) -> BatchRunner:
    """The loop of a case, compiled for its first twin: what another twin has other is arguments."""
    return BatchRunner(setup_of(case_of(name), 0), 0, RUNS)


def case_of(name: str) -> Case:
    """The case of a row."""
    return next(c for c in CASES if c.name == name)


def simulated(name: str, setup: Setup, seed: int) -> Figures:
    """500 runs.

    Raises:
        AssertionError: a run alone ends otherwise, so that the loop is none for this twin.
    """
    seeds = run_seeds(seed, RUNS)
    found = compiled(name).of(setup.plant_variants[0].sampler.draw(seeds)).figures
    if seed < 3:
        alone = figures_alone(setup, seeds[7])
        assert np.allclose(alone, [column[7] for column in found], atol=1e-9, equal_nan=True)
    return found


def judged(name: str, seed: int) -> list[tuple[bool, float]]:
    """One twin: whether the interval holds its outcome, and how wide it is, by quantity."""
    case = case_of(name)
    found = simulated(name, setup_of(case, seed), seed)
    twin = Setup.of(MISSION, [twin_of(case, seed)], case.vary)
    own = figures_alone(twin, run_seeds(seed + 10**6, 1)[0])
    truth = dict(zip(Figures._fields, own, strict=True))
    arrived = found.verdict == Verdict.ARRIVED
    held = []
    for quantity in QUANTITIES:
        low, high = np.quantile(getattr(found, quantity)[arrived], (0.05, 0.95))
        # a quantile lies between runs: equal times differ by rounding
        held.append((bool(low - 1e-9 <= truth[quantity] <= high + 1e-9), float(high - low)))
    return held


def row(case: Case, twins: Sequence[Sequence[tuple[bool, float]]]) -> list[str]:
    """Coverage of every quantity, and the median width of its interval."""
    held = np.array(twins, dtype=float)  # (twins, quantities, 2)
    share = 100.0 * held[:, :, 0].mean(axis=0)
    width = np.median(held[:, :, 1], axis=0)
    return [
        case.name,
        "inside" if case.inside else "outside",
        *(f"{s:.1f}" for s in share),
        f"{width[0]:.2f}",
        f"{1000 * width[1]:.0f}, {1000 * width[2]:.0f}",
    ]


def main() -> None:
    """Run the study and write its report."""
    asked = STUDY.asked(__doc__)
    found = by_case(judged, [c.name for c in CASES], asked)
    rows = [row(c, found[c.name]) for c in CASES if c.name in found]
    headers = ["twins", "model class", "time", "x", "y", "width of time [s]", "of x, y [mm]"]
    error = 100.0 * math.sqrt(0.9 * 0.1 / asked.runs)
    text = HEAD.format(twins=asked.runs, runs=RUNS, samples=SAMPLES, error=error)
    STUDY.write(asked, text + "\n" + table(headers, rows, "llrrrrr"))


HEAD = """# Prediction intervals of missions

{twins} twins a line. Each is a robot with its own lags and gains, identified (`oe`, first order, a
track at a time) from a log of its own of {samples} samples with noise; a mission around an obstacle
is driven {runs} times by the model, as `--runs {runs}` does, and once by the twin. *time*, *x* and
*y* are the shares [%] of twins whose time and final place lie in the 90 % interval of the runs
(standard error of a figure: {error:.1f}); the widths are medians. *Outside* of the model class log
and drive are those of a machine that no parameters of the model make: there the covariance of the
parameters knows nothing of the error.
"""

if __name__ == "__main__":
    main()
