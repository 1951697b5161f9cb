"""``lumped_or_black_box.md``: one motor by its bench and by black boxes, on the same logs (§5.6).

    python -m studies.lumped_report    # what a step takes, measured anew, before make reports

The motor is simulated with the thesis's printed constants and what no bench table holds: a warm
winding, brushes that take a voltage, friction that is larger at standstill.
"""

import json
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import sysid
from studies.runner import REPORTS
from sysid.data.record import Array, Channel, Record
from sysid.errors import SysidError
from sysid.estimation.selection.comparison import Ranking
from sysid.export.c.report import operations
from sysid.export.c.step import c_step
from sysid.report.markdown import table
from sysid.structures.model import Model
from sysid.testbench.motor.characterise import MotorOptions, characterise_motor
from sysid.testbench.motor.model import bench_model

NAME = "lumped_or_black_box.md"
TIMES = REPORTS / "lumped_times.json"
DT = 0.02
GEAR = 120.0
TABLES_ONLY = "bench, tables only"
TABLES = ("motor_values", "motor_no_load", "motor_stall")
ORDERS = "na=2 nb=2 nk=1"
BLACK_BOXES = {
    "arx": ORDERS,
    "oe": "nb=2 nf=2 nk=1",
    "hammerstein-wiener": "nb=2 nf=2 nk=1",
    "narx-wavelet": ORDERS,
}


@dataclass(frozen=True)
class Truth:
    """The motor that is simulated, SI units at the motor's shaft.

    Attributes:
        R, Kem, Kc, f, C0, J: the thesis's printed constants, R of the warm winding (+ 6 %).
        brushes: voltage that they take [V].
        breakaway: friction at standstill over C0.
        stribeck: speed at which half of the surplus is gone [rad/s].
        noise: of the speed reading at the output shaft [rad/s].
        current_noise: [A].
    """

    R: float = 3.1 * 1.06
    Kem: float = 0.0023
    Kc: float = 8.6626e-4
    f: float = 1.0651e-7
    C0: float = 2.9658e-5
    J: float = 1e-7
    brushes: float = 0.15
    breakaway: float = 1.6
    stribeck: float = 20.0
    noise: float = 0.02
    current_noise: float = 0.005


def driven(volts: Array, seed: int, truth: Truth | None = None) -> tuple[Array, Array]:
    """Speed of the output shaft [rad/s] and current [A] at the rows, voltage held between them."""
    m, parts = truth or Truth(), 40
    h, w = DT / parts, 0.0
    speed, current = np.empty(len(volts)), np.empty(len(volts))
    for k, v in enumerate(volts):
        speed[k] = w / GEAR
        for _ in range(parts):
            given = math.copysign(max(abs(v) - m.brushes, 0.0), v) if w == 0.0 else v
            drop = m.brushes * math.tanh(w / 1.0) if w else 0.0
            i = (given - drop - m.Kem * w) / m.R
            dry = m.C0 * (1.0 + (m.breakaway - 1.0) / (1.0 + (w / m.stribeck) ** 2))
            torque = m.Kc * i - m.f * w
            if w == 0.0:
                w = h / m.J * math.copysign(max(abs(torque) - dry, 0.0), torque)
                continue
            after = w + h / m.J * (torque - math.copysign(dry, w))
            w = after if after * w > 0.0 else 0.0  # friction stops, it does not turn round
        current[k] = i
    rng = np.random.default_rng(seed)
    noisy = speed + m.noise * rng.standard_normal(len(volts))
    return noisy, current + m.current_noise * rng.standard_normal(len(volts))


def levels(low: float, high: float, seconds: float, seed: int) -> Array:
    """Steps of random voltage, both directions, each held for 0.3 to 1.2 s [V]."""
    rng = np.random.default_rng(seed)
    found: list[float] = []
    while len(found) * DT < seconds:
        level = rng.choice([-1.0, 1.0]) * rng.uniform(low, high)
        found += [level] * int(rng.uniform(0.3, 1.2) / DT)
    return np.array(found[: int(seconds / DT)])


LOGS = {
    "like the log of the fits": (0.0, 5.0, 2),
    "beyond it: 5 to 7.5 V": (5.0, 7.5, 3),
    "about standstill: up to 0.8 V": (0.0, 0.8, 4),
}
"""What judges: voltages and seed."""


def record(name: str, volts: Array, seed: int) -> tuple[Record, Array]:
    """A log of the motor, and its current."""
    speed, current = driven(volts, seed)
    log = Record(
        volts[:, None], speed[:, None], DT,
        (Channel("voltage", "V"),), (Channel("omega", "rad/s"),), name=name, sha256=name,
    )  # fmt: skip
    return log, current


@cache
def log_of_fits() -> tuple[Record, Array]:
    """The log that everything but the tables is made of, and its current."""
    return record("steps.csv", levels(0.0, 5.0, 60.0, 1), 1)


@cache
def models() -> dict[str, Model]:
    """The bench's models, the grey box and the black boxes, by the name in the table."""
    log, current = log_of_fits()
    bench = Path(sysid.__file__).resolve().parent.parent / "datasets" / "bench"
    tables = [bench / f"{name}.csv" for name in TABLES]
    made: dict[str, Model | None] = {}
    made[TABLES_ONLY] = bench_model(characterise_motor(tables), (), DT)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.csv"
        rows = np.column_stack([log.t, log.u[:, 0], current, log.y[:, 0]])
        head = "t,voltage_V,current_A,omega_rad_s"
        np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.9g")
        drive = characterise_motor([path], MotorOptions(gear=GEAR))
        made["bench, one drive"] = bench_model(
            drive, (), DT, (log.input_names[0], log.output_names[0])
        )
    made["dc-motor, fitted"] = sysid.fit(log, "dc-motor")
    for name, orders in BLACK_BOXES.items():
        made[name] = sysid.fit(log, name, orders)
    return {k: m for k, m in made.items() if m is not None}


def operations_of(model: Model) -> str:
    """Arithmetic and calls of one step of the model in C; a dash where it has no C."""
    try:
        plain, calls = operations(c_step(model).body)
    except SysidError:
        return "–"
    return f"{plain} + {calls}"


@dataclass(frozen=True)
class ReadOff:
    """What a person reads off a model: gain [rad/s per V], time constant [s], dead band [V]."""

    gain: float | None
    time_constant: float | None
    dead_band: float | None


def truth_read_off() -> ReadOff:
    """Of the motor that is simulated."""
    m = Truth()
    damping = m.Kc * m.Kem + m.f * m.R
    return ReadOff(m.Kc / damping / GEAR, m.J * m.R / damping, m.C0 * m.R / m.Kc + m.brushes)


def read_off(model: Model) -> ReadOff:
    """Of a model, where its parameters say it."""
    p = {x.name: float(v) for x, v in zip(model.parameters, model.theta, strict=True)}
    if "resistance" in p:
        damping = p["torque_constant"] * p["back_emf"] + p["motor_viscous"] * p["resistance"]
        return ReadOff(
            p["torque_constant"] / damping / p["gear"],
            p["motor_inertia"] * p["resistance"] / damping,
            p["motor_friction"] * p["resistance"] / p["torque_constant"],
        )
    if "time_constant" in p:
        return ReadOff(p["gain"], p["time_constant"], p["coulomb"])
    if model.structure.name in ("arx", "oe"):
        letter = "a" if model.structure.name == "arx" else "f"
        poles = np.roots([1.0, p[f"{letter}1"], p[f"{letter}2"]])
        slow = float(np.max(np.abs(poles)))
        gain = (p["b1"] + p["b2"]) / (1.0 + p[f"{letter}1"] + p[f"{letter}2"])
        return ReadOff(gain, -DT / math.log(slow), None)
    return ReadOff(None, None, None)


HEAD = """# Lumped or black box

The thesis (§5.6) weighs a motor model of physical constants against one learnt from data: how well
the system is understood, what a step costs, how good the model is. Here both are made of one motor
and judged on the same logs.

The motor is simulated: the thesis's printed constants, a winding 6 % above its cold resistance,
brushes that take 0.15 V, friction 1.6 times as large at standstill, a speed reading with 0.02 rad/s
and a current with 5 mA of noise; steps of ± 5 V for 60 s, 50 Hz. *Bench, tables only* are the
constants of `sysid bench motor` from the bundled tables and values, which never saw this motor
drive; *bench, one drive* are those of the same command from the log itself; the others are
`sysid fit` on that log with orders 2, 2, delay 1.

## Quality, size, cost

Free-run fit [%] on logs that no model saw, as `sysid compare --val LOG` judges. BIC of one-step
errors on the log of the fits, for those fitted to it; smaller is better, and an output-error model
pays for having no model of the noise. n: estimated parameters. Operations of one step in the
exported C: arithmetic and comparisons + calls of functions. µs a step: of the plant in Python, as
`sysid compare` shows it, measured once by `python -m studies.lumped_report`, since no
time is the same twice.

"""


def write(folder: Path) -> Mapping[str, str]:
    """The text of the report."""
    log, made = log_of_fits()[0], models()
    judged: dict[str, Ranking] = {}
    for name, (low, high, seed) in LOGS.items():
        held, _ = record(name, levels(low, high, 40.0, seed), seed)
        judged[name] = sysid.compare(held, made, "fit", name=name)
    bic = sysid.compare(log, made, "bic", name="the log of the fits")
    times = json.loads(TIMES.read_text(encoding="utf-8")) if TIMES.is_file() else {}
    rows = []
    for name, model in made.items():
        fits = [_fit(r, name) for r in judged.values()]
        numbers = (_criterion(bic, name), str(model.n_estimated), operations_of(model))
        rows.append([name, *fits, *numbers, str(times.get(name, "–"))])
    heads = ["model", *LOGS, "BIC", "n", "operations a step", "µs a step"]
    text = HEAD + table(heads, rows, "l" + "r" * (len(heads) - 1))
    text += "\n## What can be read off\n\n"
    shown = {"*the motor itself*": truth_read_off(), **{k: read_off(m) for k, m in made.items()}}
    rows = [
        [
            name,
            *(_number(v) for v in (r.gain, r.time_constant, r.dead_band)),
            made[name].structure.traits.tells if name in made else "",
        ]
        for name, r in shown.items()
    ]
    text += table(
        ["model", "gain [rad/s/V]", "time constant [s]", "dead band [V]", "in words"], rows, "lrrrl"
    )
    return {NAME: text + _conclusions(judged, made)}


def _conclusions(judged: Mapping[str, Ranking], made: Mapping[str, Model]) -> str:
    """What the tables say, with their numbers."""
    like, beyond, still = judged.values()
    black = [n for n in BLACK_BOXES if n in made]

    def best(r: Ranking) -> str:
        name = next(x.contender.id for x in r.lines if x.contender.id in black)
        return f"{name} ({_fit(r, name)} %)"

    sizes = [made[n].n_estimated for n in black]
    drive = "bench, one drive"
    return f"""
- **Quality.** On a log like that of the fits the best black box, {best(like)}, is close to the
  bench's constants from one drive ({_fit(like, drive)} %). Where nothing was learnt, beyond 5 V and
  about standstill, the best black boxes are {best(beyond)} and {best(still)}, the
  constants {_fit(beyond, drive)} % and {_fit(still, drive)} %: physics extrapolates, curves do not.
- **Tables alone** give {_fit(like, TABLES_ONLY)} %: a cold winding, a meter's rounding and a motor
  without its drive are another motor. One drive mends it, with no instrument but the current's.
- **What is understood.** Constants can be checked against a data sheet, changed (another gear,
  another load), and explain why. From a drive alone inertia and friction come in units of the
  torque constant, which only a torque tells. The gain of a linear model is a mean over the levels
  of its log, dry friction included. A network has {max(sizes)} numbers, and none with a meaning.
- **Cost.** A linear model takes a handful of operations. The lumped motor steps inside a sample,
  since dry friction must not chatter, and costs as much as the network: thrift is no argument
  between these two, and on a controller neither is a burden.
"""


def _fit(ranking: Ranking, name: str) -> str:
    return next((f"{x.value:.1f}" for x in ranking.lines if x.contender.id == name), "–")


def _criterion(ranking: Ranking, name: str) -> str:
    fitted = [x for x in ranking.lines if x.contender.id == name and x.contender.id != TABLES_ONLY]
    return next((f"{x.value:.0f}" for x in fitted if math.isfinite(x.value)), "–")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def measure() -> None:
    """Write what a step took into ``TIMES``: two digits, the quickest of several rounds."""
    ranking = sysid.compare(log_of_fits()[0], models(), "fit", name="the log of the fits")
    found = {
        x.contender.id: float(f"{1e6 * x.step_time:.2g}")
        for x in ranking.lines
        if x.step_time is not None
    }
    TIMES.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    measure()
