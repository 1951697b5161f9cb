"""Suites of cases: what is hidden, how large, under which commands and noise, by seed.

Seeds below ``FRESH`` are for development: rules may be set on them. Those from ``FRESH`` on judge,
once, after which they are development seeds, too.
"""

import copy
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from sysid_datasets.physics import actuator_causes, motor_causes, sensor_causes
from sysid_datasets.physics.causes import CAUSES, WITH_BODY
from sysid_datasets.physics.hidden import Cause, Hidden, timed
from sysid_datasets.physics.logs import SEEN_IN_SAMPLES, Case
from sysid_datasets.physics.noises import NOISES
from sysid_datasets.physics.others import MACHINES, OUTSIDE, single_drive
from sysid_datasets.physics.parameters import Controller
from sysid_datasets.physics.robots import Rig, figures, log_uniform, plain_machine, seen_from_above
from sysid_datasets.physics.simulate import Telemetry

FRESH = 10000
"""First seed of those that judge."""

SMALL = 0.4
"""Factor on the sizes of the suite of small ones."""

OPEN_STYLES = ("steps", "steps", "joystick", "multisine", "autoregressive", "binary")
"""Commands of the suites with something hidden; steps twice as often."""

EFFECTS = tuple(CAUSES)


def case(suite: str, seed: int) -> Case:
    """One case; the effects of a suite take turns with the seed.

    Raises:
        KeyError: there is no such suite.
        ValueError: the seed is negative.
    """
    if seed < 0:
        raise ValueError(f"a seed of {seed} is negative")
    code = int.from_bytes(suite.encode()[:8].ljust(8), "big")
    rng = np.random.Generator(np.random.PCG64([code, seed, 0]))
    return SUITES[suite](suite, seed, rng)


def singles(suite: str, seed: int, rng: np.random.Generator, factor: float = 1.0) -> Case:
    """One cause, of a size between barely visible and strong, drawn log-uniformly."""
    return _hidden_case(suite, seed, rng, (EFFECTS[seed % len(EFFECTS)],), factor)


def small(suite: str, seed: int, rng: np.random.Generator) -> Case:
    """The same, 0.4 times as large: many are below what the log can show."""
    return singles(suite, seed, rng, SMALL)


def tied(effect: str, rival: str, seed: int) -> Case:
    """One cause of an effect that many logs cannot tell from its rival, of ordinary size.

    Causes that are right by either name are left out, unless an effect has no other.
    """
    suite = f"{effect}/{rival}"
    rng = np.random.Generator(np.random.PCG64([*suite.encode(), seed, 0]))
    rig = Rig(plain_machine(rng))
    drawn = [c(np.random.default_rng(0), rig, 1.0)[1] for c in CAUSES[effect]]
    mine = [c for c, h in zip(CAUSES[effect], drawn, strict=True) if rival not in h.also]
    return _hidden_case(suite, seed, rng, (effect,), causes=tuple(mine) or CAUSES[effect][:1])


def pairs(suite: str, seed: int, rng: np.random.Generator) -> Case:
    """Two causes."""
    return _hidden_case(suite, seed, rng, _several(rng, 2))


def triples(suite: str, seed: int, rng: np.random.Generator) -> Case:
    """Three causes."""
    return _hidden_case(suite, seed, rng, _several(rng, 3))


def nothing(suite: str, seed: int, rng: np.random.Generator) -> Case:
    """Nothing hidden, under noise, loops, lengths, rates and commands of many kinds, in turn."""
    rig = Rig(plain_machine(rng))
    sigma, style = log_uniform(rng, 0.005, 0.03), str(rng.choice(OPEN_STYLES))
    base = Case(suite, seed, rig, style=style, sigma=sigma)
    return NOTHINGS[list(NOTHINGS)[seed % len(NOTHINGS)]](base, rng)


def _closed(base: Case, rng: np.random.Generator) -> Case:
    """The readings' own loop: a PI controller as fast as the machine."""
    f = figures(base.rig.machine)
    gain = rng.uniform(0.5, 2.0) / f.speed
    loop = Controller(proportional=gain, integral=gain / f.time_constant)
    machine = replace(base.rig.machine, controller=loop)
    return replace(
        base, rig=replace(base.rig, machine=machine), reference=0.8 * f.speed, style="steps"
    )


def _changed(**fields: object) -> Callable[[Case, np.random.Generator], Case]:
    return lambda base, rng: replace(base, **fields)  # type: ignore[arg-type]


def _fine(base: Case, rng: np.random.Generator) -> Case:
    """A converter finer than the noise."""
    step = base.sigma * figures(base.rig.machine).speed * 0.25
    return replace(base, rig=replace(base.rig, wire=replace(base.rig.wire, step=step)))


def _fast(base: Case, rng: np.random.Generator) -> Case:
    """A kilohertz for 20 s, with a winding that follows at once."""
    drives = tuple(
        replace(d, motor=replace(d.motor, inductance=0.0)) for d in base.rig.machine.drives
    )
    machine = replace(base.rig.machine, drives=drives)
    rig = replace(base.rig, machine=machine, telemetry=Telemetry(rate=1000.0))
    return replace(base, rig=rig, duration=20.0)


def _from_above(base: Case, rng: np.random.Generator) -> Case:
    """A pose in the log; the wheels roll as the drawing says."""
    return replace(base, rig=seen_from_above(base.rig))


NOTHINGS: dict[str, Callable[[Case, np.random.Generator], Case]] = {
    "white": lambda base, rng: base,
    "coloured": _changed(noise="coloured"),
    "heavy": _changed(noise="heavy"),
    "walk": _changed(walk=0.02),
    "closed": _closed,
    "fine-steps": _fine,
    "short": _changed(duration=20.0),
    "long": _changed(duration=240.0),
    "kilohertz": _fast,
    "white-command": _changed(style="white"),
    "walking-command": _changed(style="random-walk"),
    "pose": _from_above,
}
"""Logs in which nothing is hidden."""


def _several(rng: np.random.Generator, count: int) -> tuple[str, ...]:
    """Effects of different causes, one with a body at most."""
    while True:
        some = tuple(str(e) for e in rng.choice(EFFECTS, count, replace=False))
        if sum(e in WITH_BODY for e in some) <= 1 and not _clash(some):
            return some


EXCLUSIVE = (
    frozenset({"coulomb-friction", "stiction", "backlash"}),
    frozenset({"quantisation", "held-telemetry", "dropouts"}),
    frozenset({"unsigned-speed", "sensor-bias", "sensor-saturation"}),
)
"""Causes that write the same fields, or hide each other wholly."""


def _clash(some: tuple[str, ...]) -> bool:
    return any(len(group.intersection(some)) > 1 for group in EXCLUSIVE)


def _hidden_case(
    suite: str,
    seed: int,
    rng: np.random.Generator,
    effects: tuple[str, ...],
    factor: float = 1.0,
    causes: tuple[Cause, ...] = (),
) -> Case:
    """A case with a cause of each effect; of ``causes`` where these are given."""
    again = copy.deepcopy(rng)
    rig, hidden = _caused(rng, effects, factor, causes)
    spared: tuple[Rig, ...] = ()
    if len(effects) > 1:
        seen = frozenset(SEEN_IN_SAMPLES)
        left_out = [seen, *(seen | {h.id} for h in hidden)]
        spared = tuple(
            _caused(copy.deepcopy(again), effects, factor, causes, some)[0] for some in left_out
        )
    styles = next((h.styles for h in hidden if h.styles), OPEN_STYLES)
    return Case(
        suite,
        seed,
        rig,
        hidden,
        spared=spared,
        style=str(rng.choice(styles)),
        noise=str(rng.choice([*NOISES, "white", "white"])),
        sigma=log_uniform(rng, 0.004, 0.02),
        duration=float(rng.choice([60.0, 100.0, 150.0])),
    )


def _caused(
    rng: np.random.Generator,
    effects: tuple[str, ...],
    factor: float,
    causes: tuple[Cause, ...],
    left_out: frozenset[str] = frozenset(),
) -> tuple[Rig, tuple[Hidden, ...]]:
    """A machine with a cause of each effect, but of those left out, and what was drawn of all."""
    rig = Rig(plain_machine(rng))
    hidden: list[Hidden] = []
    # a body first: it is made for the plain drives
    for effect in sorted(effects, key=lambda e: e not in WITH_BODY):
        some = causes or CAUSES[effect]
        made, found = some[int(rng.integers(len(some)))](rng, rig, factor)
        rig = rig if found.id in left_out else made
        hidden.append(found)
    return rig, tuple(hidden)


REALISTIC = (
    actuator_causes.switches_that_turn_on_late,
    actuator_causes.battery_resistance,
    actuator_causes.battery_runs_down,
    actuator_causes.dead_time,
    actuator_causes.late_command,
    motor_causes.gap,
    motor_causes.stribeck,
    motor_causes.heat,
    sensor_causes.eccentric_encoder,
    sensor_causes.coarse_ticks,
)
"""What a cheap robot has, all of it."""

MILD = 0.5
"""Factor on each of their sizes."""


def realistic(suite: str, seed: int, rng: np.random.Generator) -> Case:
    """Everything at once, half as large each; half of the bridges have one quadrant.

    Besides: PWM of 8 to 12 bits, switches with a resistance, clocks that jitter by milliseconds.
    """
    rig, hidden = Rig(plain_machine(rng)), []
    bridges = (actuator_causes.diodes,) if rng.uniform() < 0.5 else ()
    for cause in (*bridges, *REALISTIC):
        rig, found = cause(rng, rig, MILD)
        hidden.append(found)
    drives = tuple(
        replace(
            d,
            firmware=replace(d.firmware, bits=float(rng.integers(8, 13))),
            bridge=replace(d.bridge, on_resistance=0.05 * d.motor.resistance),
        )
        for d in rig.machine.drives
    )
    rig = timed(
        replace(rig, machine=replace(rig.machine, drives=drives)),
        command_jitter=0.005,
        reading_jitter=0.002,
    )
    style, sigma = str(rng.choice(["joystick", "steps"])), log_uniform(rng, 0.003, 0.01)
    return Case(suite, seed, rig, tuple(hidden), style=style, sigma=sigma, duration=120.0)


def machines(suite: str, seed: int, rng: np.random.Generator) -> Case:
    """Other machines, in turn, with one cause or none."""
    base = Case(suite, seed, Rig(single_drive(rng)), sigma=log_uniform(rng, 0.004, 0.02))
    return MACHINES[list(MACHINES)[seed % len(MACHINES)]](base, rng)


def outside(suite: str, seed: int, rng: np.random.Generator) -> Case:
    """What no effect of the catalogue holds: the right answer is no name."""
    name = list(OUTSIDE)[seed % len(OUTSIDE)]
    plain = single_drive(rng) if name == "tanks" else plain_machine(rng)
    base = Case(suite, seed, Rig(plain), sigma=log_uniform(rng, 0.004, 0.02))
    return OUTSIDE[name](base, rng)


SUITES: dict[str, Callable[[str, int, np.random.Generator], Case]] = {
    "singles": singles,
    "small": small,
    "nothing": nothing,
    "pairs": pairs,
    "triples": triples,
    "realistic": realistic,
    "machines": machines,
    "outside": outside,
}
"""Suites by name."""
